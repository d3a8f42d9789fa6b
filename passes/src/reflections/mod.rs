//! Specular indirect light. So far: the sky in the mirror direction, as much of it as ambient occlusion leaves.
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
            "The sky in the mirror direction, blurred with roughness and dimmed by the slot `ao`: no other objects.",
            &[precision::setting()],
            |build, settings| {
                Ok(Box::new(SkyLight::new(build.gpu, "reflections.sky", &REFLECTIONS_SKY_COMP, false, settings)?))
            },
        )
        .with("off", "None.", &[], |_, _| Ok(Box::new(Off)))
}
