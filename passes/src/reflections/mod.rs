//! Specular indirect light. So far: the sky in the mirror direction, with nothing in its way.
use crate::stages::{IndirectIn, IndirectOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::{Stage, StageError};
use magpie_shaders::REFLECTIONS_SKY_COMP;
use magpie_shaders::reflections::SkyParams;

/// The slot.
pub fn stage() -> Stage<IndirectIn, IndirectOut> {
    Stage::new("reflections")
        .about("Specular indirect light.")
        .with(
            "sky",
            "The sky in the mirror direction, blurred with roughness: no occluders, no other objects.",
            &[],
            |build, _| Ok(Box::new(Sky::new(build.gpu)?)),
        )
        .with("off", "None.", &[], |_, _| Ok(Box::new(Off)))
}

struct Off;

impl Effect for Off {
    type In = IndirectIn;
    type Out = IndirectOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: IndirectIn) -> IndirectOut {
        IndirectOut { radiance: None }
    }
}

struct Sky {
    kernel: Kernel,
}

impl Sky {
    fn new(gpu: &Gpu) -> Result<Self, StageError> {
        Ok(Self { kernel: gpu.kernel(&REFLECTIONS_SKY_COMP).map_err(StageError::other)? })
    }
}

impl Effect for Sky {
    type In = IndirectIn;
    type Out = IndirectOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: IndirectIn) -> IndirectOut {
        if !view.has_sky {
            return IndirectOut { radiance: None };
        }
        let (kernel, block, gbuffer) = (self.kernel, view.block, i.gbuffer);
        let radiance = g.pass("reflections.sky", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let (depth, normal) = (p.sample(gbuffer.depth), p.sample(gbuffer.normal));
            let (base_colour, material) = (p.sample(gbuffer.base_colour), p.sample(gbuffer.material));
            let (radiance, target) = p.create("radiance", ImageDesc::like(Format::Rgba32Float, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = SkyParams {
                    view: c.id(block),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    base_colour: c.id(base_colour),
                    material: c.id(material),
                    radiance: c.id(target),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        IndirectOut { radiance: Some(radiance) }
    }
}
