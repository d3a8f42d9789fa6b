//! How much indirect light has changed since the previous frame, for denoisers with a history: paths of the previous frame are followed again.
use super::paths::Paths;
use crate::contracts::{Channel, LightingIn};
use crate::parts::denoise::{Changes, follows_light, squares, surfaces};
use crate::parts::hit_shading::HitShading;
use crate::ray_kernels::RayKernels;
use magpie::graph::HistoryScope;
use magpie::prelude::*;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::gi::GradientParams;
use magpie_shaders::{GI_GRADIENT_RAY, GI_TINTED_GRADIENT_RAY};

/// Follows paths of one pixel of nine again.
pub struct Gradient {
    trace: RayKernels,
    changes: Changes,
    scope: HistoryScope,
}

/// What the next frame needs of the paths that this one follows.
pub struct Kept {
    /// The surface of one pixel of nine, two texels each.
    pub surfaces: WriteHandle<Image>,
    /// Luminance that its first ray finds.
    pub luminance: WriteHandle<Image>,
}

impl Gradient {
    /// Creates the pipelines; `None` if no denoiser follows that has a history, or it shall not be adaptive.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Option<Self>, SlotError> {
        if !follows_light(settings)? {
            return Ok(None);
        }
        Ok(Some(Self {
            trace: RayKernels::new(build, &GI_GRADIENT_RAY, &GI_TINTED_GRADIENT_RAY)?,
            changes: Changes::noisy(build)?,
            scope: HistoryScope::new(),
        }))
    }

    /// Adds the passes. Returns [`Hints::change`](crate::parts::denoise::Hints::change), and what the paths of this frame are to be kept in.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        hits: HitShading,
        paths: &Paths,
        samples: u32,
    ) -> (Handle<Image>, Kept) {
        let frame = g.extent(i.gbuffer.depth);
        let extent = squares(frame);
        let surfaces = g.history(&self.scope, "surfaces", surfaces(frame));
        let luminance = g.history(&self.scope, "luminance", ImageDesc::fixed(Format::R32Float, extent));
        let valid = surfaces.valid && luminance.valid;
        let (kernel, block) = (self.trace.of(view), view.block);
        let Paths { bounces, regularization, .. } = *paths;
        let change = g.pass("gi.gradient", Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[Channel::Motion]);
            let (surfaces, luminance) = (p.sample(surfaces.previous), p.sample(luminance.previous));
            let (change, target) = p.create("change", ImageDesc::fixed(Format::Rgba32Float, extent));
            (change.read(), move |c: &mut Record<'_>| {
                let params = GradientParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    motion: gbuffer.images(c).motion,
                    hits: hits.params(c),
                    previous: c.id(surfaces),
                    previous_luminance: c.id(luminance),
                    change: c.id(target),
                    valid: valid.into(),
                    samples,
                    bounces,
                    regularization,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        let change = self.changes.add(g, change, "gi", "");
        (change, Kept { surfaces: surfaces.next, luminance: luminance.next })
    }
}
