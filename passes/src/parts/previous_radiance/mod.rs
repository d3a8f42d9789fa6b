//! The radiance of the previous frame, for effects that gather light from the screen. It is kept only if an effect asks for it.
use magpie::gpu::Kernel;
use magpie::graph::HistoryScope;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::PREVIOUS_RADIANCE_KEEP_COMP;
use magpie_shaders::previous_radiance::KeepParams;

/// Format of the kept radiance.
const FORMAT: Format = Format::Rgba16Float;

/// Keeps the lit picture of each frame for the next.
pub struct PreviousRadiance {
    kernel: Kernel,
    scope: HistoryScope,
}

impl PreviousRadiance {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&PREVIOUS_RADIANCE_KEEP_COMP)?, scope: HistoryScope::new() })
    }

    /// The previous frame's radiance, as [`LightingIn::previous_radiance`](crate::contracts::LightingIn::previous_radiance) describes it,
    /// and the write handle for this frame's.
    pub fn begin(&self, g: &mut FrameGraph) -> (Handle<Image>, WriteHandle<Image>) {
        let history = g.history(&self.scope, "previous_radiance", ImageDesc::full(FORMAT));
        (history.previous, history.next)
    }

    /// Adds the pass that keeps `radiance`. Pixels that are not finite are counted and stored as unknown, with 0 in all channels.
    pub fn keep(&self, g: &mut FrameGraph, next: WriteHandle<Image>, radiance: Handle<Image>) {
        let kernel = self.kernel;
        g.pass("previous_radiance.keep", Queue::AsyncCompute, |p| {
            let (source, extent) = (p.sample(radiance), p.extent(radiance));
            let (_, kept) = p.write(next);
            ((), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let (not_finite, greatest) = (c.not_finite(), FORMAT.greatest());
                let params = KeepParams { not_finite, size, radiance: c.id(source), kept: c.id(kept), greatest };
                c.dispatch(kernel, &params, extent);
            })
        });
    }
}
