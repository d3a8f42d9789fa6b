//! Reprojection: finds the pixels of the previous frame that showed the same surfaces.
use crate::contracts::{Channel, GBuffer, Reprojected, SceneHandles};
use magpie::gpu::Kernel;
use magpie::graph::{History, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::REPROJECT_SURFACES_COMP;
use magpie_shaders::reproject::ReprojectParams;

/// Reprojection of the visible surfaces, shared by all effects of a frame. The pass is culled if none reads the result.
pub struct Reprojection {
    kernel: Kernel,
    scope: HistoryScope,
}

impl Reprojection {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        let kernel = build.kernel(&REPROJECT_SURFACES_COMP)?;
        Ok(Self { kernel, scope: HistoryScope::new() })
    }

    /// Adds the pass `reproject.surfaces`.
    pub fn add(&mut self, g: &mut FrameGraph, view: &View, scene: SceneHandles, i: GBuffer) -> Reprojected {
        let (kernel, block) = (self.kernel, view.block);
        let History { previous, next, valid } =
            g.history(&self.scope, "guide", ImageDesc::like(Format::Rg32Uint, i.depth));
        g.pass("reproject.surfaces", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), scene.read(p));
            let gbuffer = i.read(p, &[Channel::Depth, Channel::GeometricNormal, Channel::Motion, Channel::Ids]);
            let previous_guide = p.sample(previous);
            let (next, guide) = p.write(next);
            let (taps, target) = p.create("taps", ImageDesc::like(Format::R32Uint, i.depth));
            let extent = p.extent(i.depth);
            let reprojected = Reprojected { guide: next.read(), taps: taps.read(), previous_guide: previous };
            (reprojected, move |c: &mut Record<'_>| {
                let params = ReprojectParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    gbuffer: gbuffer.images(c),
                    previous_guide: c.id(previous_guide),
                    guide: c.id(guide),
                    taps: c.id(target),
                    valid: valid.into(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
