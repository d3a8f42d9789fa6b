//! Ray-traced hard shadows: one ray per pixel from the surface to the key light, or one per four pixels.
use crate::stages::{ShadowIn, ShadowOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::{Build, SettingSpec, Settings, StageError};
use magpie_shaders::shadows::{TraceParams, UpsampleParams};
use magpie_shaders::{SHADOWS_TRACE_RAY, SHADOWS_UPSAMPLE_COMP};

/// The effect.
pub struct RayTraced {
    trace: RayKernel,
    /// At half resolution only.
    upsample: Option<Kernel>,
}

/// Its settings.
pub fn settings() -> [SettingSpec; 1] {
    let about = "`full`: one ray per pixel. `half`: one ray per four pixels, brought to full size along surfaces; a quarter of the \
                 rays, thin shadows and the edges of others suffer.";
    [SettingSpec::choice("resolution", about, "full", &["full", "half"]).sweep_all()]
}

impl RayTraced {
    /// Makes its pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, StageError> {
        let half = settings.choice("resolution")? == "half";
        let upsample = half.then(|| build.gpu.kernel(&SHADOWS_UPSAMPLE_COMP)).transpose().map_err(StageError::other)?;
        Ok(Self { trace: build.ray_kernel(&SHADOWS_TRACE_RAY)?, upsample })
    }
}

impl Effect for RayTraced {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: ShadowIn) -> ShadowOut {
        if view.key_light.is_none() {
            return ShadowOut { visibility: None }; // nothing casts a shadow: no pass, no ray
        }
        let (kernel, block, step) = (self.trace, view.block, if self.upsample.is_some() { 2 } else { 1 });
        let traced = g.pass("shadows.trace", Queue::AsyncCompute, |p| {
            let (block, tlas) = (p.read(block), i.scene.trace(p));
            let (depth, normal) = (p.sample(i.gbuffer.depth), p.sample(i.gbuffer.normal));
            let ids = p.sample(i.gbuffer.ids);
            let like = ImageDesc::like(Format::R8Unorm, i.gbuffer.depth);
            let desc = if step == 1 { like } else { ImageDesc::half(Format::R8Unorm) };
            let (visibility, target) = p.create("visibility", desc);
            let extent = p.extent_of(desc);
            (visibility.read(), move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    rays: c.rays(),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    ids: c.id(ids),
                    visibility: c.id(target),
                    step,
                };
                c.trace(kernel, tlas, &params, extent);
            })
        });
        let visibility = match self.upsample {
            Some(kernel) => upsample(g, view, kernel, i, traced),
            None => traced,
        };
        ShadowOut { visibility: Some(visibility) }
    }
}

/// From half resolution to full.
fn upsample(g: &mut FrameGraph, view: &View, kernel: Kernel, i: ShadowIn, traced: Handle<Image>) -> Handle<Image> {
    let block = view.block;
    g.pass("shadows.upsample", Queue::AsyncCompute, |p| {
        let (block, traced) = (p.read(block), p.sample(traced));
        let (depth, normal) = (p.sample(i.gbuffer.depth), p.sample(i.gbuffer.normal));
        let (visibility, target) = p.create("visibility", ImageDesc::like(Format::R8Unorm, i.gbuffer.depth));
        let extent = p.extent(i.gbuffer.depth);
        (visibility.read(), move |c: &mut Record<'_>| {
            let params = UpsampleParams {
                view: c.id(block),
                depth: c.id(depth),
                normal: c.id(normal),
                half_visibility: c.id(traced),
                visibility: c.id(target),
            };
            c.dispatch(kernel, &params, extent);
        })
    })
}
