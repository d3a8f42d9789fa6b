//! Diffuse indirect light. So far: the irradiance of the sky, as much of it as ambient occlusion leaves.
use crate::precision;
use crate::sky_light::{Off, SkyLight};
use crate::stages::{IndirectIn, IndirectOut};
use magpie::stage::Stage;
use magpie_shaders::GI_SKY_COMP;

/// The slot.
pub fn stage() -> Stage<IndirectIn, IndirectOut> {
    Stage::new("gi")
        .about("Diffuse indirect light.")
        .with(
            "sky",
            "Irradiance of the whole sky, dimmed by the slot `ao` and the material's occlusion map: no light of other surfaces.",
            &[precision::setting()],
            |build, settings| Ok(Box::new(SkyLight::new(build.gpu, "gi.sky", &GI_SKY_COMP, true, settings)?)),
        )
        .with("off", "None.", &[], |_, _| Ok(Box::new(Off)))
}
