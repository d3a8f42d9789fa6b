//! Width of the penumbrae around each pixel. Visibility is noisy only there, so a denoiser need not blur further.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::SHADOWS_PENUMBRA_WIDTH_COMP;
use magpie_shaders::shadows::PenumbraWidthParams;

/// Spreads the width of penumbrae from the pixels whose rays hit an occluder to all pixels that they may cover.
pub struct PenumbraWidth {
    kernel: Kernel,
}

impl PenumbraWidth {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&SHADOWS_PENUMBRA_WIDTH_COMP)? })
    }

    /// Adds the pass. `penumbra` holds the widths at the hits, at full or half resolution. The result has the size of `like`.
    pub fn add(&self, g: &mut FrameGraph, penumbra: Handle<Image>, like: Handle<Image>, name: &str) -> Handle<Image> {
        let (kernel, format) = (self.kernel, g.desc(penumbra).format);
        let step = if g.extent(penumbra) == g.extent(like) { 1 } else { 2 };
        g.pass(&format!("shadows.penumbra_width{name}"), Queue::AsyncCompute, |p| {
            let penumbra = p.sample(penumbra);
            let (width, target) = p.create("width", ImageDesc::like(format, like));
            let extent = p.extent(like);
            (width.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = PenumbraWidthParams { size, penumbra: c.id(penumbra), width: c.id(target), step };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
