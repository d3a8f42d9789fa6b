//! How wide the penumbrae around each pixel are: noise comes from nowhere else, and what a denoiser blurs further it spoils.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::SHADOWS_REACH_COMP;
use magpie_shaders::shadows::ReachParams;

/// Spreads the width of penumbrae from the pixels whose rays met something to those that it concerns.
pub struct Reach {
    kernel: Kernel,
}

impl Reach {
    /// Makes its pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&SHADOWS_REACH_COMP)? })
    }

    /// `penumbra`: what rays found, of full or half size. What comes out has the size of `like`.
    pub fn add(&self, g: &mut FrameGraph, penumbra: Handle<Image>, like: Handle<Image>, name: &str) -> Handle<Image> {
        let (kernel, format) = (self.kernel, g.desc(penumbra).format);
        let step = if g.extent(penumbra) == g.extent(like) { 1 } else { 2 };
        g.pass(&format!("shadows.reach{name}"), Queue::AsyncCompute, |p| {
            let penumbra = p.sample(penumbra);
            let (reach, target) = p.create("reach", ImageDesc::like(format, like));
            let extent = p.extent(like);
            (reach.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = ReachParams { size, penumbra: c.id(penumbra), reach: c.id(target), step };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
