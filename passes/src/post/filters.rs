//! Spatial filters: bilinear upscaling for frames without TAA, and sharpening.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::Wrap;
use magpie::slot::{Build, SlotError};
use magpie_shaders::post::{SharpenParams, UpscaleParams};
use magpie_shaders::{POST_SHARPEN_COMP, POST_UPSCALE_COMP, SamplerId};

/// A bilinear sampler that clamps to the edges. It is chosen for 32-bit floats: a device that can filter these can filter 16-bit floats too.
pub fn bilinear(build: &Build<'_>) -> Result<SamplerId, SlotError> {
    build.bilinear(Format::Rgba32Float, [Wrap::Clamp; 2])
}

/// Bilinear upscaling from the size of the frame to that of the output.
pub struct Upscale {
    kernel: Kernel,
    sampler: SamplerId,
}

impl Upscale {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&POST_UPSCALE_COMP)?, sampler: bilinear(build)? })
    }

    /// Adds the pass, which writes an image of size `output`.
    pub fn add(&self, g: &mut FrameGraph, colour: Handle<Image>, output: Extent) -> Handle<Image> {
        let Self { kernel, sampler } = *self;
        g.pass("post.upscale", Queue::Graphics, |p| {
            let colour = p.sample(colour);
            let (radiance, target) = p.create("radiance", ImageDesc::fixed(Format::Rgba32Float, output));
            (radiance.read(), move |c: &mut Record<'_>| {
                let size = [output.width, output.height];
                let params = UpscaleParams { colour: c.id(colour), sampler_id: sampler, radiance: c.id(target), size };
                c.dispatch(kernel, &params, output);
            })
        })
    }
}

/// Sharpening without overshoot.
pub struct Sharpen {
    kernel: Kernel,
    amount: f32,
    /// Factor before the tone curve.
    exposure: f32,
}

impl Sharpen {
    /// Creates the pipeline. `amount` is above 0 and at most 1; `exposure` is the factor before the tone curve.
    pub fn new(build: &Build<'_>, amount: f32, exposure: f32) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&POST_SHARPEN_COMP)?, amount, exposure })
    }

    /// Adds the pass.
    pub fn add(&self, g: &mut FrameGraph, colour: Handle<Image>) -> Handle<Image> {
        let Self { kernel, amount, exposure } = *self;
        g.pass("post.sharpen", Queue::Graphics, |p| {
            let source = p.sample(colour);
            let (radiance, target) = p.create("radiance", ImageDesc::like(Format::Rgba32Float, colour));
            let extent = p.extent(colour);
            (radiance.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = SharpenParams { colour: c.id(source), radiance: c.id(target), size, exposure, amount };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
