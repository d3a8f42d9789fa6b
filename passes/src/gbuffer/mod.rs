//! Raster G-buffer: one draw list of every instance, vertices pulled by address.
use crate::stages::{GBuffer, GBufferIn};
use magpie::gpu::{RasterDesc, RasterKernel};
use magpie::prelude::*;
use magpie::stage::{Stage, StageError};
use magpie_shaders::gbuffer::DrawParams;
use magpie_shaders::{GBUFFER_DRAW_FRAG, GBUFFER_DRAW_VERT};

/// Base colour (occlusion in alpha), normals, metalness and roughness, emission, motion, ids.
const COLOURS: [(&str, Format); 6] = [
    ("base_colour", Format::Rgba8Srgb),
    ("normal", Format::Rgba16Snorm),
    ("material", Format::Rg8Unorm),
    ("emission", Format::Rgba16Float),
    ("motion", Format::Rg16Float),
    ("ids", Format::Rg32Uint),
];

/// The slot.
pub fn stage() -> Stage<GBufferIn, GBuffer> {
    Stage::new("gbuffer")
        .about("What the camera sees first: depth, normals, material, emission, motion and ids of every pixel.")
        .with("raster", "Triangles drawn with reversed infinite depth.", &[], |build, _| {
            Ok(Box::new(Raster::new(build.gpu)?))
        })
}

struct Raster {
    opaque: RasterKernel,
    alpha_tested: RasterKernel,
}

impl Raster {
    fn new(gpu: &Gpu) -> Result<Self, StageError> {
        let kernel = |name, alpha_test: bool| {
            let desc = RasterDesc {
                name,
                vertex: &GBUFFER_DRAW_VERT,
                fragment: &GBUFFER_DRAW_FRAG,
                constants: &[alpha_test.into()],
                colours: &COLOURS.map(|(_, format)| format),
                depth: Some(Format::D32Float),
            };
            gpu.raster_kernel(&desc).map_err(StageError::other)
        };
        Ok(Self { opaque: kernel("gbuffer.opaque", false)?, alpha_tested: kernel("gbuffer.alpha_tested", true)? })
    }
}

impl Effect for Raster {
    type In = GBufferIn;
    type Out = GBuffer;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: GBufferIn) -> GBuffer {
        let (opaque, alpha_tested, block) = (self.opaque, self.alpha_tested, view.block);
        let draws = view.draws.clone();
        g.pass("gbuffer.draw", Queue::Graphics, |p| {
            let (block, indices) = (p.read(block), p.index(i.scene.indices));
            i.scene.read(p);
            let [base_colour, normal, material, emission, motion, ids] =
                COLOURS.map(|(name, format)| p.color(name, ImageDesc::full(format), [0.0; 4]).0.read());
            let depth = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0).0.read();
            let out = GBuffer { depth, base_colour, normal, material, emission, motion, ids };
            (out, move |c: &mut Record<'_>| {
                let params = DrawParams { view: c.id(block) };
                let (solid, tested) = draws.split_at(draws.partition_point(|d| !d.alpha_test));
                c.draw(opaque, &params, indices, solid);
                c.draw(alpha_tested, &params, indices, tested);
            })
        })
    }
}
