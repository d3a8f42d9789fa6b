//! Specular indirect light. So far: the sky in the mirror direction, with nothing in its way.
use crate::precision;
use crate::sky_light::{Off, SkyLight};
use crate::stages::{IndirectIn, IndirectOut};
use magpie::stage::Stage;
use magpie_shaders::REFLECTIONS_SKY_COMP;

/// The slot.
pub fn stage() -> Stage<IndirectIn, IndirectOut> {
    Stage::new("reflections")
        .about("Specular indirect light.")
        .with(
            "sky",
            "The sky in the mirror direction, blurred with roughness: no occluders, no other objects.",
            &[precision::setting()],
            |build, settings| {
                Ok(Box::new(SkyLight::new(build.gpu, "reflections.sky", &REFLECTIONS_SKY_COMP, settings)?))
            },
        )
        .with("off", "None.", &[], |_, _| Ok(Box::new(Off)))
}
