//! One blur along surfaces: the cheap denoiser.
use super::DenoiseIn;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::DENOISE_BILATERAL_COMP;
use magpie_shaders::denoise::{BilateralParams, NO_IMAGE};

/// The denoiser.
pub struct Bilateral {
    effect: &'static str,
    kernel: Kernel,
    radius: u32,
}

impl Bilateral {
    /// Makes its pipeline.
    pub fn new(build: &Build<'_>, effect: &'static str, settings: &Settings) -> Result<Self, SlotError> {
        let kernel = build.kernel(&DENOISE_BILATERAL_COMP)?;
        Ok(Self { effect, kernel, radius: settings.u32("radius")? })
    }

    /// Denoises an image.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        let (kernel, radius, block) = (self.kernel, self.radius, view.block);
        g.pass(&format!("{}.bilateral{name}", self.effect), Queue::AsyncCompute, |p| {
            let (block, guide, noisy) = (p.read(block), p.sample(i.reprojected.guide), p.sample(i.noisy));
            let reach = i.reach.map(|h| p.sample(h));
            let normals = i.normals().map(|h| p.sample(h));
            let (filtered, target) = p.create("filtered", ImageDesc::like(i.content.colour(), i.noisy));
            let extent = p.extent(i.noisy);
            (filtered.read(), move |c: &mut Record<'_>| {
                let params = BilateralParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    guide: c.id(guide),
                    normals: normals.map_or(NO_IMAGE, |t| c.id(t).index()),
                    noisy: c.id(noisy),
                    filtered: c.id(target),
                    reach: reach.map_or(NO_IMAGE, |t| c.id(t).index()),
                    radius,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
