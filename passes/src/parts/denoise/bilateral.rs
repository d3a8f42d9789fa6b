//! The denoiser `bilateral`: one edge-aware blur.
use super::inputs::index_of;
use super::{DenoiseIn, Options, Precision, Signal};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::DENOISE_BILATERAL_COMP;
use magpie_shaders::denoise::BilateralParams;

/// The denoiser `bilateral`.
pub struct Bilateral {
    effect: &'static str,
    kernel: Kernel,
    radius: u32,
    precision: Precision,
}

impl Bilateral {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>, effect: &'static str, options: Options) -> Result<Self, SlotError> {
        let kernel = build.kernel(&DENOISE_BILATERAL_COMP)?;
        Ok(Self { effect, kernel, radius: options.radius, precision: options.precision })
    }

    /// Adds the pass. `name` is appended to its name.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        let (kernel, radius, block) = (self.kernel, self.radius, view.block);
        let Signal { image: noisy, content } = i.signal;
        let (format, packing) = (content.result(self.precision), content.packing(self.precision).layout);
        g.pass(&format!("{}.bilateral{name}", self.effect), Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.surfaces.reprojected.guide));
            let noise_width = i.hints.width.map(|h| p.sample(h));
            let normals = i.normals().map(|h| p.sample(h));
            let (filtered, target) = p.create("filtered", ImageDesc::like(format, noisy));
            let (extent, noisy) = (p.extent(noisy), p.sample(noisy));
            (filtered.read(), move |c: &mut Record<'_>| {
                let params = BilateralParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    guide: c.id(guide),
                    normals: index_of(c, normals),
                    noisy: c.id(noisy),
                    filtered: c.id(target),
                    noise_width: index_of(c, noise_width),
                    radius,
                    packing,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
