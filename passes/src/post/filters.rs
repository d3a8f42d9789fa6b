//! Filters of one frame: bilinear upscaling where nothing better is there, and sharpening.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::Wrap;
use magpie::slot::{Build, SlotError};
use magpie_shaders::post::{SharpenParams, UpscaleParams};
use magpie_shaders::{POST_SHARPEN_COMP, POST_UPSCALE_COMP, SamplerId};

/// The filter of whole pictures in 32-bit floats: bilinear, their edges going on. A device that filters those filters 16-bit floats too.
pub fn bilinear(build: &Build<'_>) -> Result<SamplerId, SlotError> {
    build.bilinear(Format::Rgba32Float, [Wrap::Clamp; 2])
}

/// From rendered pixels to those of the picture, bilinear.
pub struct Upscale {
    kernel: Kernel,
    sampler: SamplerId,
}

impl Upscale {
    /// Makes its pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&POST_UPSCALE_COMP)?, sampler: bilinear(build)? })
    }

    /// Adds its pass.
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

/// Steeper edges without overshoot.
pub struct Sharpen {
    kernel: Kernel,
    amount: f32,
    exposure: f32,
}

impl Sharpen {
    /// Makes its pipeline. `amount` is above 0 and at most 1.
    pub fn new(build: &Build<'_>, amount: f32, exposure: f32) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&POST_SHARPEN_COMP)?, amount, exposure })
    }

    /// Adds its pass.
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
