//! Direct lighting: every light on every pixel, GGX and Lambert, the key light times its visibility.
use crate::stages::{DirectIn, DirectOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::{Stage, StageError};
use magpie_shaders::DIRECT_SHADE_COMP;
use magpie_shaders::direct::{NO_VISIBILITY, ShadeParams};

/// The slot.
pub fn stage() -> Stage<DirectIn, DirectOut> {
    Stage::new("direct").about("Light straight from the lights, and what surfaces emit themselves.").with(
        "all-lights",
        "Every light is evaluated at every pixel.",
        &[],
        |build, _| Ok(Box::new(AllLights::new(build.gpu)?)),
    )
}

struct AllLights {
    shade: Kernel,
}

impl AllLights {
    fn new(gpu: &Gpu) -> Result<Self, StageError> {
        Ok(Self { shade: gpu.kernel(&DIRECT_SHADE_COMP).map_err(StageError::other)? })
    }
}

impl Effect for AllLights {
    type In = DirectIn;
    type Out = DirectOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        let (kernel, block, gbuffer) = (self.shade, view.block, i.gbuffer);
        let radiance = g.pass("direct.shade", Queue::Graphics, |p| {
            let block = p.read(block);
            i.scene.read(p);
            let (depth, normal) = (p.sample(gbuffer.depth), p.sample(gbuffer.normal));
            let (base_colour, material) = (p.sample(gbuffer.base_colour), p.sample(gbuffer.material));
            let emission = p.sample(gbuffer.emission);
            let visibility = i.shadows.visibility.map(|v| p.sample(v));
            // 32 bits: sunlight on a mirror leaves the range of half floats.
            let (radiance, target) = p.create("radiance", ImageDesc::like(Format::Rgba32Float, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance, move |c: &mut Record<'_>| {
                let params = ShadeParams {
                    view: c.id(block),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    base_colour: c.id(base_colour),
                    material: c.id(material),
                    emission: c.id(emission),
                    visibility: visibility.map_or(NO_VISIBILITY, |v| c.id(v).0),
                    radiance: c.id(target),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        DirectOut { radiance }
    }
}
