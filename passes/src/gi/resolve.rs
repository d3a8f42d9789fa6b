//! Irradiance times the albedo that it is kept without.
use crate::contracts::{Channel, LightingIn};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::GI_RESOLVE_COMP;
use magpie_shaders::gi::ResolveParams;

/// Multiplies with the diffuse albedo: the pass `gi.resolve`.
pub struct Resolve {
    kernel: Kernel,
    format: Format,
}

impl Resolve {
    /// Describes the pipeline. `format`: of the radiance.
    pub fn new(build: &Build<'_>, format: Format) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&GI_RESOLVE_COMP)?, format })
    }

    /// Adds the pass. `irradiance`: over pi, at full size.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: LightingIn, irradiance: Handle<Image>) -> Handle<Image> {
        let (kernel, block, format) = (self.kernel, view.block, self.format);
        g.pass("gi.resolve", Queue::AsyncCompute, |p| {
            let (block, irradiance) = (p.read(block), p.sample(irradiance));
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], super::MATERIAL].concat());
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = ResolveParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    denoised: c.id(irradiance),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
