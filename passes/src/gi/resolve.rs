//! Multiplies denoised light with the albedo of the diffuse lobe, at full resolution.
use super::MATERIAL;
use crate::contracts::{Channel, LightingIn};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::GI_RESOLVE_COMP;
use magpie_shaders::gi::ResolveParams;

/// The last pass of implementations that denoise light without the albedo of what it falls on.
pub struct Resolve {
    kernel: Kernel,
    format: Format,
}

impl Resolve {
    /// Creates the pipeline. `format`: of the radiance that the slot gives.
    pub fn new(build: &Build<'_>, format: Format) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&GI_RESOLVE_COMP)?, format })
    }

    /// Adds the pass, which writes to `kept`, an image of the size of the frame and of the format of the slot, or else to one of its own.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        denoised: Handle<Image>,
        kept: Option<WriteHandle<Image>>,
    ) -> Handle<Image> {
        let (kernel, block, format) = (self.kernel, view.block, self.format);
        g.pass("gi.resolve", Queue::AsyncCompute, |p| {
            let (block, denoised) = (p.read(block), p.sample(denoised));
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], MATERIAL].concat());
            let (radiance, target) = match kept {
                Some(kept) => p.write(kept),
                None => p.create("radiance", ImageDesc::like(format, i.gbuffer.depth)),
            };
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = ResolveParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    denoised: c.id(denoised),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
