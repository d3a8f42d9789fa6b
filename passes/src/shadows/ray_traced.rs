//! Ray-traced hard shadows: one ray per pixel from the surface to the key light.
use crate::stages::{ShadowIn, ShadowOut};
use magpie::prelude::*;
use magpie::stage::{Build, StageError};
use magpie_shaders::SHADOWS_TRACE_RAY;
use magpie_shaders::shadows::TraceParams;

/// The effect.
pub struct RayTraced {
    trace: RayKernel,
}

impl RayTraced {
    /// Makes its pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, StageError> {
        Ok(Self { trace: build.ray_kernel(&SHADOWS_TRACE_RAY)? })
    }
}

impl Effect for RayTraced {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: ShadowIn) -> ShadowOut {
        if view.key_light.is_none() {
            return ShadowOut { visibility: None }; // nothing casts a shadow: no pass, no ray
        }
        let (kernel, block) = (self.trace, view.block);
        let visibility = g.pass("shadows.trace", Queue::AsyncCompute, |p| {
            let (block, tlas) = (p.read(block), i.scene.trace(p));
            let (depth, normal) = (p.sample(i.gbuffer.depth), p.sample(i.gbuffer.normal));
            let ids = p.sample(i.gbuffer.ids);
            let (visibility, target) = p.create("visibility", ImageDesc::like(Format::R8Unorm, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (visibility.read(), move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    rays: c.rays(),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    ids: c.id(ids),
                    visibility: c.id(target),
                };
                c.trace(kernel, tlas, &params, extent);
            })
        });
        ShadowOut { visibility: Some(visibility) }
    }
}
