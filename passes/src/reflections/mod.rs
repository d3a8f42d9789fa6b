//! Specular indirect light: of the sky alone, of probes, of what the camera sees, or of whatever rays meet.
mod hybrid;
mod probe;
mod ray_traced;
mod reconstruct;
mod screen_space;

use crate::contracts::{LightingIn, LightingOut};
use crate::precision;
use crate::sky_light::{Off, SkyLight};
use hybrid::Hybrid;
use magpie::scene::SceneFacts;
use magpie::slot::{Preset, Slot};
use magpie_shaders::REFLECTIONS_SKY_COMP;
use probe::Probes;
use ray_traced::RayTraced;
use screen_space::ScreenSpace;

/// From cheap to accurate.
const PRESETS: [Preset; 4] = [
    Preset { name: "low", implementation: "probe", settings: &[("resolution", "32"), ("indirect", "false")] },
    Preset { name: "medium", implementation: "screen-space", settings: &[("lobe", "cone"), ("resolution", "half")] },
    Preset { name: "high", implementation: "hybrid", settings: &[] },
    Preset { name: "ultra", implementation: "ray-traced", settings: &[("bounces", "4")] },
];

/// Why implementations with a limit of roughness are idle in scenes without a sky.
const ALL_ROUGH: &str = "all surfaces are rougher than `roughness_limit`, and the scene has no sky";

pub fn slot() -> Slot<LightingIn, LightingOut> {
    Slot::new("reflections")
        .about("Specular indirect light.")
        .with(
            "sky",
            "The sky in the mirror direction, blurred by roughness and dimmed by `ao`. No other objects.",
            &[precision::setting()],
            |build, settings| {
                Ok(Box::new(SkyLight::new(
                    build,
                    "reflections.sky",
                    &REFLECTIONS_SKY_COMP,
                    false,
                    idle_reason,
                    settings,
                )?))
            },
        )
        .with(
            "probe",
            "Cube probes captured while frames are rendered: one that follows the camera, and those that the scene places.",
            &probe::settings(),
            |build, settings| Ok(Box::new(Probes::new(build, settings)?)),
        )
        .with(
            "screen-space",
            "What the camera sees, found by rays through the depth image, over the sky.",
            &screen_space::settings(),
            |build, settings| Ok(Box::new(ScreenSpace::new(build, settings)?)),
        )
        .with(
            "ray-traced",
            "Rays along the specular lobe, shaded by lights and by the previous frame.",
            &ray_traced::settings(),
            |build, settings| Ok(Box::new(RayTraced::new(build, settings)?)),
        )
        .with(
            "hybrid",
            "Rays where they show: found on the screen where it knows enough, traced elsewhere, the fewer the wider the lobe.",
            &hybrid::settings(),
            |build, settings| Ok(Box::new(Hybrid::new(build, settings)?)),
        )
        .with("off", "None.", &[], |_, _| Ok(Box::new(Off)))
        .presets(&PRESETS)
}

/// The reason why no surface of the scene has a specular reflection, if none does.
fn idle_reason(facts: &SceneFacts) -> Option<&'static str> {
    match facts.specular {
        _ if facts.area == 0.0 => Some("there is no surface"),
        0.0 => Some("no surface has a specular reflection"),
        _ => None,
    }
}
