//! Direct lighting: light of lamps, suns and emissive surfaces, reflected once, and emission.
mod all_lights;
mod auto;
mod clustered;
mod clusters;
mod emitters;
mod light_change;
mod light_tree;
mod lobes;
mod sampled;
mod shade;

use crate::contracts::{DirectIn, DirectOut};
use crate::precision;
use all_lights::AllLights;
use auto::Auto;
use clustered::Clustered;
use light_tree::TreeLights;
use magpie::slot::{Preset, Slot};
use sampled::Sampled;

/// From cheap to accurate. They differ in the number of samples of lights that have a size, of rays to emissive surfaces, and of lights that the
/// tree chooses, and in whether mirrors show these sharp.
pub const PRESETS: [Preset; 4] = [
    Preset {
        name: "low",
        implementation: "auto",
        settings: &[("area", "0"), ("emitter_rays", "0"), ("split_lights", "1"), ("split", "0")],
    },
    Preset {
        name: "medium",
        implementation: "auto",
        settings: &[("area", "0"), ("emitter_rays", "1"), ("split_lights", "2"), ("split", "0")],
    },
    Preset {
        name: "high",
        implementation: "auto",
        settings: &[("area", "4"), ("emitter_rays", "1"), ("split_lights", "4"), ("split", "0.2")],
    },
    Preset {
        name: "ultra",
        implementation: "auto",
        settings: &[("area", "16"), ("emitter_rays", "4"), ("split_lights", "16"), ("split", "0.2")],
    },
];

pub fn slot() -> Slot<DirectIn, DirectOut> {
    let settings = [shade::area()].into_iter().chain(emitters::settings(0.0)).chain([precision::setting()]);
    Slot::new("direct")
        .about("Light from lights and emissive surfaces, and emission itself.")
        .with(
            "auto",
            "All lights where lamps are few, the light tree where they are many.",
            &auto::settings(),
            |build, settings| Ok(Box::new(Auto::new(build, settings)?)),
        )
        .with(
            "all-lights",
            "Every light is evaluated at every pixel.",
            &settings.collect::<Vec<_>>(),
            |build, settings| Ok(Box::new(AllLights::new(build, settings, true)?)),
        )
        .with(
            "clustered",
            "The same, with lamps by cells of the view: near ones at every pixel, what is left of the others between the corners of cells.",
            &clustered::settings(),
            |build, settings| Ok(Box::new(Clustered::new(build, settings)?)),
        )
        .with(
            "light-tree",
            "Some lights for each pixel, chosen by the light tree, with a shadow ray each.",
            &light_tree::settings(),
            |build, settings| Ok(Box::new(TreeLights::new(build, settings)?)),
        )
        .with(
            "ris",
            "One light for each pixel, chosen from candidates by what it would reflect, with a shadow ray.",
            &sampled::settings(false),
            |build, settings| Ok(Box::new(Sampled::new(build, settings, false)?)),
        )
        .with(
            "restir",
            "The same, with the lights that the pixels around and the previous frame have chosen.",
            &sampled::settings(true),
            |build, settings| Ok(Box::new(Sampled::new(build, settings, true)?)),
        )
        .presets(&PRESETS)
}
