//! Light of the sky on the visible surfaces, dimmed by ambient occlusion, in one compute pass. The slots `gi` and `reflections` use it with
//! different shaders.
use crate::contracts::{Channel, LightingIn, LightingOut};
use crate::precision;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Settings, SlotError};
use magpie_shaders::Shader;
use magpie_shaders::sky_light::{NO_IMAGE, SkyLightParams};

/// Channels of the G-buffer for diffuse light.
const DIFFUSE: &[Channel] = &[Channel::Normal, Channel::BaseColour, Channel::Material, Channel::Coat];
/// Channels of the G-buffer for specular light, whose lobe may be cut off by the surface's own plane.
const SPECULAR: &[Channel] =
    &[Channel::Normal, Channel::GeometricNormal, Channel::BaseColour, Channel::Material, Channel::Coat];

/// No indirect light.
pub struct Off;

impl Effect for Off {
    type In = LightingIn;
    type Out = LightingOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: LightingIn) -> LightingOut {
        LightingOut::default()
    }
}

/// Sky light by one shader.
pub struct SkyLight {
    pass: &'static str,
    is_diffuse: bool,
    idle_reason: fn(&SceneFacts) -> Option<&'static str>,
    kernel: Kernel,
    format: Format,
}

impl SkyLight {
    /// Creates the pipeline of `shader` for a pass of this name. `is_diffuse`: the shader reads bent normals. `idle_reason` returns
    /// why no surface of a scene reflects such light, if none does. The settings include [`precision`](precision::setting).
    pub fn new(
        build: &Build<'_>,
        pass: &'static str,
        shader: &Shader,
        is_diffuse: bool,
        idle_reason: fn(&SceneFacts) -> Option<&'static str>,
        settings: &Settings,
    ) -> Result<Self, SlotError> {
        let format = precision::format(settings)?;
        Ok(Self { pass, is_diffuse, idle_reason, kernel: build.kernel(shader)?, format })
    }
}

impl Effect for SkyLight {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        let idle = if !facts.has_sky { Some("the scene has no sky") } else { (self.idle_reason)(facts) };
        idle.map_or_else(Needs::default, Needs::idle)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        if self.needs(&view.facts).idle.is_some() {
            return LightingOut::default();
        }
        let (kernel, format, is_diffuse, block) = (self.kernel, self.format, self.is_diffuse, view.block);
        let LightingIn { gbuffer, ao, .. } = i;
        let radiance = g.pass(self.pass, Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let surfaces = gbuffer.read(p, if is_diffuse { DIFFUSE } else { SPECULAR });
            let openness = ao.openness.map(|h| p.sample(h));
            let bent_normal = ao.bent_normal.filter(|_| is_diffuse).map(|h| p.sample(h));
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = SkyLightParams {
                    view: c.id(block),
                    gbuffer: surfaces.images(c),
                    openness: openness.map_or(NO_IMAGE, |t| c.id(t).index()),
                    bent_normal: bent_normal.map_or(NO_IMAGE, |t| c.id(t).index()),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        LightingOut::radiance(radiance)
    }
}
