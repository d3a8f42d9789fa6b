//! Light of the unoccluded sky on what the camera sees: one compute pass. Slots `gi` and `reflections` differ in the shader.
use crate::stages::{IndirectIn, IndirectOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::StageError;
use magpie_shaders::Shader;
use magpie_shaders::sky_light::SkyLightParams;

/// No indirect light: no pass.
pub struct Off;

impl Effect for Off {
    type In = IndirectIn;
    type Out = IndirectOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: IndirectIn) -> IndirectOut {
        IndirectOut { radiance: None }
    }
}

/// One shader over the G-buffer.
pub struct SkyLight {
    pass: &'static str,
    kernel: Kernel,
}

impl SkyLight {
    /// Makes the pipeline of `shader` for a pass of this name.
    pub fn new(gpu: &Gpu, pass: &'static str, shader: &Shader) -> Result<Self, StageError> {
        Ok(Self { pass, kernel: gpu.kernel(shader).map_err(StageError::other)? })
    }
}

impl Effect for SkyLight {
    type In = IndirectIn;
    type Out = IndirectOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: IndirectIn) -> IndirectOut {
        if !view.has_sky {
            return IndirectOut { radiance: None };
        }
        let (kernel, block, gbuffer) = (self.kernel, view.block, i.gbuffer);
        let radiance = g.pass(self.pass, Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let (depth, normal) = (p.sample(gbuffer.depth), p.sample(gbuffer.normal));
            let (base_colour, material) = (p.sample(gbuffer.base_colour), p.sample(gbuffer.material));
            let (radiance, target) = p.create("radiance", ImageDesc::like(Format::Rgba32Float, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = SkyLightParams {
                    view: c.id(block),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    base_colour: c.id(base_colour),
                    material: c.id(material),
                    radiance: c.id(target),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        IndirectOut { radiance: Some(radiance) }
    }
}
