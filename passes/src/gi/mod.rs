//! Diffuse indirect light: the irradiance of the sky times ambient occlusion, a search on the screen, rays, resampled paths, or surfels.
mod gradient;
mod paths;
mod ray_traced;
mod resolve;
mod restir;
mod screen_space;
mod surfels;

use crate::contracts::{Channel, LightingIn, LightingOut};
use crate::precision;
use crate::sky_light::{Off, SkyLight};
use magpie::scene::SceneFacts;
use magpie::slot::{Preset, Slot};
use magpie_shaders::GI_SKY_COMP;
use ray_traced::RayTraced;
use restir::Restir;
use screen_space::ScreenSpace;
use surfels::Surfels;

/// What the albedo of a surface is made of, beside its normal.
const MATERIAL: &[Channel] = &[Channel::BaseColour, Channel::Material, Channel::Coat];

/// From cheap to accurate. Rays that end at surfels see what lies between those.
pub const PRESETS: [Preset; 4] = [
    Preset {
        name: "low",
        implementation: "surfels",
        settings: &[("surfel_radius", "0.04"), ("coverage", "0.1"), ("resolution", "half")],
    },
    Preset {
        name: "medium",
        implementation: "surfels",
        settings: &[("surfel_radius", "0.03"), ("resolution", "half")],
    },
    Preset { name: "high", implementation: "surfels", settings: &[] },
    Preset {
        name: "ultra",
        implementation: "ray-traced",
        settings: &[("cache", "surfels"), ("denoiser", "recurrent-blur")],
    },
];

pub fn slot() -> Slot<LightingIn, LightingOut> {
    Slot::new("gi")
        .about("Diffuse indirect light.")
        .with(
            "sky",
            "Irradiance of the sky, dimmed by `ao` and the material's occlusion map. No light from other surfaces.",
            &[precision::setting()],
            |build, settings| Ok(Box::new(SkyLight::new(build, "gi.sky", &GI_SKY_COMP, true, idle_reason, settings)?)),
        )
        .with(
            "screen-space",
            "Light of the surfaces in the picture, found by a search in the depth image, and of the sky where they leave it open.",
            &screen_space::settings(),
            |build, settings| Ok(Box::new(ScreenSpace::new(build, settings)?)),
        )
        .with(
            "ray-traced",
            "Rays over the hemisphere of each surface, shaded where they hit, and denoised.",
            &ray_traced::settings(),
            |build, settings| Ok(Box::new(RayTraced::new(build, settings)?)),
        )
        .with(
            "restir",
            "One path of each pixel and frame, whose first point is reused in later frames and by the pixels around, and denoised.",
            &restir::settings(),
            |build, settings| Ok(Box::new(Restir::new(build, settings)?)),
        )
        .with(
            "surfels",
            "Discs on surfaces that gather light over frames, one path at a time, and pass it on to each other: all bounces.",
            &surfels::settings(),
            |build, settings| Ok(Box::new(Surfels::new(build, settings, settings.choice("resolution")? == "half")?)),
        )
        .with("off", "None.", &[], |_, _| Ok(Box::new(Off)))
        .default_to("surfels")
        .presets(&PRESETS)
}

/// The reason why no surface of the scene reflects diffusely, if none does.
fn idle_reason(facts: &SceneFacts) -> Option<&'static str> {
    match facts.diffuse {
        _ if facts.area == 0.0 => Some("there is no surface"),
        0.0 => Some("all surfaces are metal, black or unlit"),
        _ => None,
    }
}

/// The reason why nothing bounces, if nothing does. Lights that are dimmed to nothing count: what is kept of light that bounces must be there when they shine
/// again.
fn no_bounces(facts: &SceneFacts) -> Option<&'static str> {
    let shines = facts.has_sky || facts.shows_emission || facts.lights.iter().any(|light| light.full_power > 0.0);
    idle_reason(facts).or_else(|| (!shines).then_some("no light shines"))
}
