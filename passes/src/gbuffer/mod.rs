//! Raster G-buffer: one draw list of every instance, vertices pulled by address; spheres by the ray through each pixel.
use crate::contracts::{GBuffer, GBufferIn};
use magpie::gpu::{Blend, RasterDesc, RasterKernel};
use magpie::graph::DrawClass;
use magpie::prelude::*;
use magpie::slot::{Build, SettingSpec, Settings, Slot, SlotError};
use magpie_shaders::gbuffer::DrawParams;
use magpie_shaders::{GBUFFER_DRAW_FRAG, GBUFFER_DRAW_VERT, GBUFFER_SPHERE_FRAG, GBUFFER_SPHERE_VERT};

/// Base colour (occlusion in alpha), normals, metalness and roughness, emission, motion, ids: 42 bytes a pixel with depth.
const COMPACT: [(&str, Format); 6] = [
    ("base_colour", Format::Rgba8Srgb),
    ("normal", Format::Rgba16Snorm),
    ("material", Format::Rg8Unorm),
    ("emission", Format::Rgba16Float),
    ("motion", Format::Rg32Float),
    ("ids", Format::Rg32Uint),
];

/// The same as it was computed: 76 bytes a pixel with depth.
const FULL: [(&str, Format); 6] = [
    ("base_colour", Format::Rgba32Float),
    ("normal", Format::Rgba32Float),
    ("material", Format::Rg32Float),
    ("emission", Format::Rgba32Float),
    ("motion", Format::Rg32Float),
    ("ids", Format::Rg32Uint),
];

/// The slot.
pub fn slot() -> Slot<GBufferIn, GBuffer> {
    Slot::new("gbuffer")
        .about("What the camera sees first: depth, normals, material, emission, motion and ids of every pixel.")
        .with(
            "raster",
            "Triangles and spheres drawn with reversed infinite depth.",
            &[precision()],
            |build, settings| Ok(Box::new(Raster::new(build, settings)?)),
        )
}

fn precision() -> SettingSpec {
    let about = "Formats. `compact`: 8-bit colours and materials, normals of 16 bits, 16-bit floats. `full`: 32-bit floats \
                 throughout, twice the memory and more.";
    SettingSpec::choice("precision", about, "compact", &["compact", "full"]).sweep_all()
}

/// Where the material is among them.
const MATERIAL: usize = 2;

/// With the reflection of the dielectric part in blue and alpha of the material, for scenes where it is not the same everywhere: 6 or 8
/// bytes a pixel more.
fn with_specular(mut colours: [(&'static str, Format); 6]) -> [(&'static str, Format); 6] {
    let (_, material) = &mut colours[MATERIAL];
    *material = if *material == Format::Rg8Unorm { Format::Rgba16Snorm } else { Format::Rgba32Float };
    colours
}

/// Both ways to draw.
struct Raster {
    plain: Drawing,
    /// For scenes whose dielectrics do not all reflect alike.
    with_specular: Drawing,
}

/// Attachments, and the pipelines that draw into them.
#[derive(Clone, Copy)]
struct Drawing {
    colours: [(&'static str, Format); 6],
    opaque: RasterKernel,
    alpha_tested: RasterKernel,
    spheres: RasterKernel,
}

impl Raster {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let colours = if settings.choice("precision")? == "full" { FULL } else { COMPACT };
        let with_specular = Drawing::new(build, with_specular(colours))?;
        Ok(Self { plain: Drawing::new(build, colours)?, with_specular })
    }
}

impl Drawing {
    fn new(build: &Build<'_>, colours: [(&'static str, Format); 6]) -> Result<Self, SlotError> {
        let [_, _, _, (_, emission), ..] = colours;
        let most = emission.greatest().to_bits();
        let kernel = |name, vertex, fragment, constants: &[u32]| {
            let colours = &colours.map(|(_, format)| format);
            let (blend, depth) = (Blend::Opaque, Some(Format::D32Float));
            let desc = RasterDesc { name, vertex, fragment, constants, colours, blend, depth };
            build.raster_kernel(&desc)
        };
        let triangles =
            |name, alpha_test: bool| kernel(name, &GBUFFER_DRAW_VERT, &GBUFFER_DRAW_FRAG, &[alpha_test.into(), most]);
        Ok(Self {
            colours,
            opaque: triangles("gbuffer.opaque", false)?,
            alpha_tested: triangles("gbuffer.alpha_tested", true)?,
            spheres: kernel("gbuffer.spheres", &GBUFFER_SPHERE_VERT, &GBUFFER_SPHERE_FRAG, &[0, most])?,
        })
    }
}

impl Effect for Raster {
    type In = GBufferIn;
    type Out = GBuffer;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: GBufferIn) -> GBuffer {
        let drawing = if view.facts.has_own_specular { self.with_specular } else { self.plain };
        let (Drawing { colours, opaque, alpha_tested, spheres }, block) = (drawing, view.block);
        let draws = view.draws.clone();
        g.pass("gbuffer.draw", Queue::Graphics, |p| {
            let (block, indices) = (p.read(block), p.index(i.scene.indices));
            i.scene.read(p);
            let [base_colour, normal, material, emission, motion, ids] =
                colours.map(|(name, format)| p.color(name, ImageDesc::full(format), [0.0; 4]).0.read());
            let depth = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0).0.read();
            let out = GBuffer { depth, base_colour, normal, material, emission, motion, ids };
            (out, move |c: &mut Record<'_>| {
                let params = DrawParams { view: c.id(block) };
                // Blended triangles are alpha-tested too.
                let tested = draws.merged([DrawClass::AlphaTested, DrawClass::Blended]);
                c.draw(opaque, &params, indices, draws.of(DrawClass::Opaque));
                c.draw(alpha_tested, &params, indices, &tested);
                c.draw(spheres, &params, indices, draws.of(DrawClass::Procedural));
            })
        })
    }
}
