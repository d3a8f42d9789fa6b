//! Direct lighting: every light on every pixel, GGX and Lambert, the key light times its visibility.
use crate::precision;
use crate::stages::{DirectIn, DirectOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::{Settings, Stage, StageError};
use magpie_shaders::DIRECT_SHADE_COMP;
use magpie_shaders::direct::{NO_VISIBILITY, ShadeParams};

/// The slot.
pub fn stage() -> Stage<DirectIn, DirectOut> {
    Stage::new("direct").about("Light straight from the lights, and what surfaces emit themselves.").with(
        "all-lights",
        "Every light is evaluated at every pixel.",
        &[precision::setting()],
        |build, settings| Ok(Box::new(AllLights::new(build.gpu, settings)?)),
    )
}

struct AllLights {
    shade: Kernel,
    format: Format,
}

impl AllLights {
    fn new(gpu: &Gpu, settings: &Settings) -> Result<Self, StageError> {
        let shade = gpu.kernel(&DIRECT_SHADE_COMP).map_err(StageError::other)?;
        Ok(Self { shade, format: precision::format(settings)? })
    }
}

impl Effect for AllLights {
    type In = DirectIn;
    type Out = DirectOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        let (kernel, format, block, gbuffer) = (self.shade, self.format, view.block, i.gbuffer);
        let radiance = g.pass("direct.shade", Queue::Graphics, |p| {
            let block = p.read(block);
            i.scene.read(p);
            let (depth, normal) = (p.sample(gbuffer.depth), p.sample(gbuffer.normal));
            let (base_colour, material) = (p.sample(gbuffer.base_colour), p.sample(gbuffer.material));
            let emission = p.sample(gbuffer.emission);
            let visibility = i.shadows.visibility.map(|v| p.sample(v));
            // 32 bits unless asked otherwise: sunlight on a mirror leaves the range of half floats.
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, gbuffer.depth));
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
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        DirectOut { radiance }
    }
}
