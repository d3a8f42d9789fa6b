//! Rasterises the G-buffer: draws every instance, with vertices fetched by address. Spheres are intersected with the ray through each pixel.
use crate::contracts::{GBuffer, GBufferIn};
use magpie::gpu::{Blend, RasterDesc, RasterKernel};
use magpie::graph::DrawClass;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, Slot, SlotError};
use magpie_shaders::gbuffer::DrawParams;
use magpie_shaders::{GBUFFER_DRAW_FRAG, GBUFFER_DRAW_VERT, GBUFFER_SPHERE_FRAG, GBUFFER_SPHERE_VERT};

/// Formats of the colour attachments, with their names.
#[derive(Clone, Copy)]
struct Colours {
    /// Attachments of every scene, in the order of the fragment shader's outputs.
    always: [(&'static str, Format); 6],
    /// The next attachment, only if a material has a clear coat.
    coat: (&'static str, Format),
    /// The last attachment, only if something emits.
    emission: (&'static str, Format),
}

/// Formats of `compact`: 30 bytes per pixel including depth, 2 for clear coats, and 8 for emission.
const COMPACT: Colours = Colours {
    always: [
        ("base_colour", Format::Rgba8Srgb),
        ("normal", Format::Rg16Snorm),
        ("geometric_normal", Format::Rg16Snorm),
        ("material", Format::Rg8Unorm),
        ("motion", Format::Rg16Float),
        ("ids", Format::Rg32Uint),
    ],
    coat: ("coat", Format::Rg8Unorm),
    emission: ("emission", Format::Rgba16Float),
};

/// Formats of `full`, without loss of precision: 60 bytes per pixel including depth, 8 for clear coats, and 16 for emission.
const FULL: Colours = Colours {
    always: [
        ("base_colour", Format::Rgba32Float),
        ("normal", Format::Rg32Float),
        ("geometric_normal", Format::Rg32Float),
        ("material", Format::Rg32Float),
        ("motion", Format::Rg32Float),
        ("ids", Format::Rg32Uint),
    ],
    coat: ("coat", Format::Rg32Float),
    emission: ("emission", Format::Rgba32Float),
};

pub fn slot() -> Slot<GBufferIn, GBuffer> {
    Slot::new("gbuffer")
        .about("Depth, normals, material, clear coat, emission, motion and ids of what each pixel sees.")
        .with(
            "raster",
            "Triangles and spheres drawn with reversed infinite depth.",
            &[precision(), multiple_scattering()],
            |build, settings| Ok(Box::new(Raster::new(build, settings)?)),
        )
}

fn precision() -> SettingSpec {
    let about = "Formats of the images. `compact`: 8-bit colours and materials, 16-bit normals, 16-bit floats. `full`: 32-bit floats \
                 throughout, more than twice the memory.";
    SettingSpec::choice("precision", about, "compact", &["compact", "full"]).sweep_all()
}

fn multiple_scattering() -> SettingSpec {
    let about = "Light that scatters more than once between the microfacets of rough surfaces counts, in every effect and in the reference. \
                 Off: it is lost, and rough metals are up to 69 % darker.";
    SettingSpec::switch("multiple_scattering", about, true)
}

/// Index of the material among the attachments.
const MATERIAL: usize = 3;

/// The G-buffer by rasterisation.
struct Raster {
    /// Indexed by [`Extras`].
    drawings: [Drawing; 8],
    single_scattering: bool,
}

/// What a G-buffer holds beyond what every scene needs.
#[derive(Clone, Copy)]
struct Extras {
    /// Materials set the specular reflectance of their dielectric part.
    specular: bool,
    /// A material has a clear coat.
    coat: bool,
    /// Something emits.
    emission: bool,
}

impl Extras {
    fn from_index(index: usize) -> Self {
        Self { specular: index & 1 > 0, coat: index & 2 > 0, emission: index & 4 > 0 }
    }

    fn index(self) -> usize {
        usize::from(self.specular) | usize::from(self.coat) << 1 | usize::from(self.emission) << 2
    }
}

/// Attachments, and the pipelines that draw into them.
#[derive(Clone, Copy)]
struct Drawing {
    colours: [(&'static str, Format); 6],
    coat: Option<(&'static str, Format)>,
    emission: Option<(&'static str, Format)>,
    opaque: RasterKernel,
    alpha_tested: RasterKernel,
    spheres: RasterKernel,
}

impl Raster {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let plain = if settings.choice("precision")? == "full" { FULL } else { COMPACT };
        let single_scattering = !settings.switch("multiple_scattering")?;
        let mut drawings = Vec::with_capacity(8);
        for index in 0..8 {
            drawings.push(Drawing::new(build, plain, Extras::from_index(index))?);
        }
        let drawings = std::array::from_fn(|index| drawings[index]);
        Ok(Self { drawings, single_scattering })
    }
}

impl Colours {
    /// Adds the specular reflectance of the dielectric part in blue and alpha of the material, which takes 6 or 8 bytes per pixel more.
    fn with_specular(mut self) -> Self {
        let (_, material) = &mut self.always[MATERIAL];
        *material = if *material == Format::Rg8Unorm { Format::Rgba16Snorm } else { Format::Rgba32Float };
        self
    }
}

impl Drawing {
    fn new(build: &Build<'_>, colours: Colours, extras: Extras) -> Result<Self, SlotError> {
        let Colours { always, coat, emission } = if extras.specular { colours.with_specular() } else { colours };
        let greatest = emission.1.greatest().to_bits();
        let coat = extras.coat.then_some(coat);
        let emission = extras.emission.then_some(emission);
        let formats: Vec<Format> = always.iter().chain(&coat).chain(&emission).map(|(_, format)| *format).collect();
        let kernel = |name, vertex, fragment, constants: &[u32]| {
            let (blend, depth) = (Blend::Opaque, Some(Format::D32Float));
            build.raster_kernel(&RasterDesc { name, vertex, fragment, constants, colours: &formats, blend, depth })
        };
        let triangles = |name, alpha_test: bool| {
            kernel(name, &GBUFFER_DRAW_VERT, &GBUFFER_DRAW_FRAG, &[alpha_test.into(), greatest, extras.coat.into()])
        };
        Ok(Self {
            colours: always,
            coat,
            emission,
            opaque: triangles("gbuffer.opaque", false)?,
            alpha_tested: triangles("gbuffer.alpha_tested", true)?,
            spheres: kernel(
                "gbuffer.spheres",
                &GBUFFER_SPHERE_VERT,
                &GBUFFER_SPHERE_FRAG,
                &[0, greatest, extras.coat.into()],
            )?,
        })
    }
}

impl Effect for Raster {
    type In = GBufferIn;
    type Out = GBuffer;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs { single_scattering: self.single_scattering, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: GBufferIn) -> GBuffer {
        let facts = &view.facts;
        let extras = Extras { specular: facts.has_own_specular, coat: facts.has_coat, emission: facts.shows_emission };
        let Drawing { colours, coat, emission, opaque, alpha_tested, spheres } = self.drawings[extras.index()];
        let (block, draws) = (view.block, view.draws.clone());
        g.pass("gbuffer.draw", Queue::Graphics, |p| {
            let (block, scene, indices) = (p.read(block), i.scene.read(p), p.index(i.scene.indices));
            let mut attach = |(name, format)| p.color(name, ImageDesc::full(format), [0.0; 4]).0.read();
            let [base_colour, normal, geometric_normal, material, motion, ids] = colours.map(&mut attach);
            let coat = coat.map(&mut attach);
            let emission = emission.map(attach);
            let depth = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0).0.read();
            let out = GBuffer { depth, base_colour, normal, geometric_normal, material, coat, emission, motion, ids };
            (out, move |c: &mut Record<'_>| {
                let params = DrawParams { view: c.id(block), scene: c.id(scene) };
                // Blended triangles are alpha-tested too.
                let tested = draws.merged([DrawClass::AlphaTested, DrawClass::Blended]);
                c.draw(opaque, &params, indices, draws.of(DrawClass::Opaque));
                c.draw(alpha_tested, &params, indices, &tested);
                c.draw(spheres, &params, indices, draws.of(DrawClass::Procedural));
            })
        })
    }
}
