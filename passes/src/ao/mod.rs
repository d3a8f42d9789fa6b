//! Ambient occlusion: the cosine-weighted share of the hemisphere above each pixel that has no occluder in range. It dims indirect light only.
mod ray_traced;
mod screen_space;

use crate::contracts::{AO_RANGE, AoIn, AoOut};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Needs, Preset, SettingSpec, Settings, Slot, SlotError};

/// Format of openness before a denoiser.
const OPENNESS: Format = Format::R16Float;

/// From cheap to accurate. Occluders outside of the picture are missing from `screen-space`.
pub const PRESETS: [Preset; 4] = [
    Preset { name: "low", implementation: "screen-space", settings: &[("resolution", "half")] },
    Preset { name: "medium", implementation: "screen-space", settings: &[] },
    Preset { name: "high", implementation: "ray-traced", settings: &[("rays", "1"), ("denoiser", "svgf")] },
    Preset { name: "ultra", implementation: "ray-traced", settings: &[("rays", "4"), ("denoiser", "svgf")] },
];

pub fn slot() -> Slot<AoIn, AoOut> {
    Slot::new("ao")
        .about("Fraction of the hemisphere above each pixel that is not occluded nearby. Dims indirect light.")
        .with("ray-traced", "Rays over the hemisphere.", &ray_traced::settings(), |build, settings| {
            Ok(if has_range(settings)? {
                Box::new(ray_traced::RayTraced::new(build, settings)?)
            } else {
                Box::new(Off)
            })
        })
        .with(
            "screen-space",
            "GTAO: horizons in the depth buffer, with bent normals.",
            &screen_space::settings(),
            |build, settings| {
                let found = has_range(settings)?;
                Ok(if found { Box::new(screen_space::ScreenSpace::new(build, settings)?) } else { Box::new(Off) })
            },
        )
        .with("off", "No occlusion.", &[], |_, _| Ok(Box::new(Off)))
        .default_to("screen-space")
        .presets(&PRESETS)
}

/// The setting `range`, which all implementations share.
fn range() -> SettingSpec {
    let about = "Distance up to which surfaces occlude ambient light. Higher: wider and darker corners, and more time. 0: no occlusion, \
                 and no pass.";
    SettingSpec::float("range", "metres", about, AO_RANGE.into(), 0.0..=1000.0)
}

/// Whether the setting `range` is above 0; otherwise nothing occludes.
fn has_range(settings: &Settings) -> Result<bool, SlotError> {
    Ok(settings.f32("range")? > 0.0)
}

/// The needs of both implementations.
fn needs(facts: &SceneFacts) -> Needs {
    if facts.area > 0.0 { Needs::default() } else { Needs::idle("there is no surface") }
}

struct Off;

impl Effect for Off {
    type In = AoIn;
    type Out = AoOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: AoIn) -> AoOut {
        AoOut { openness: None, bent_normal: None }
    }
}
