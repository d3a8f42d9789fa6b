//! The reference: a progressive path tracer, unbiased and unclamped.
mod estimate;
mod file;
mod show;
mod subject;

pub use estimate::{Estimate, SizeMismatch};
pub use file::EstimateFileError;

use crate::contracts::AO_RANGE;
use crate::parts::hit_shading;
use crate::parts::light_tree::LightTree;
use crate::ray_kernels::LIGHT_TREE;
use crate::read_back::Copies;
use glam::DVec3;
use magpie::config::{Config, Value};
use magpie::frame::ViewDesc;
use magpie::gpu::{Buffer, Gpu, GpuError, RayKernel, Staging};
use magpie::graph::execute::{ExecuteError, Executor, Imports};
use magpie::graph::{Access, BufferDesc, Extent, Format, ImageDesc, Queue, Record};
use magpie::scene::light_tables::LightWeights;
use magpie::scene::{Camera, FloatingOrigin, Moment, Policy, ResidentError, ResidentOptions, ResidentScene, Scene};
use magpie::slot::{Build, Needs, SlotError};
use magpie_shaders::reference::{
    PATH_BACKGROUND, PATH_BALANCE, PATH_CENTRE, PATH_CLEAR, PATH_EMISSION, PATH_LIGHTS, PATH_NO_LIGHT_HITS,
    PATH_NO_LIGHT_SAMPLES, PATH_SKY, PathParams,
};
use magpie_shaders::{REFERENCE_AO_RAY, REFERENCE_PATH_RAY, REFERENCE_SHADOWS_RAY, RayShader, Rays};
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

/// Which light the reference computes: all of it, or the output of one slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Only {
    /// The whole picture.
    #[default]
    All,
    /// Direct light of lights and emissive surfaces, and emission.
    Direct,
    /// Visibility of the first three shadow-casting lights, one in each channel, 0 to 1; in all channels if there is one light only. In scenes
    /// with surfaces that transmit light: visibility of the first light in red, green and blue.
    Shadows,
    /// Openness, 0 to 1: the cosine-weighted share of the hemisphere without an occluder in range.
    AmbientOcclusion,
    /// Indirect light that the first surface scatters specularly.
    Reflections,
    /// Indirect light that the first surface scatters diffusely.
    Gi,
    /// Indirect light that the first surface transmits.
    Transparency,
}

impl Only {
    /// All variants.
    pub const ALL: [Self; 7] = [
        Self::All,
        Self::Direct,
        Self::Shadows,
        Self::AmbientOcclusion,
        Self::Reflections,
        Self::Gi,
        Self::Transparency,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Direct => "direct",
            Self::Shadows => "shadows",
            Self::AmbientOcclusion => "ao",
            Self::Reflections => "reflections",
            Self::Gi => "gi",
            Self::Transparency => "transparency",
        }
    }
}

/// Where in a pixel its sample points are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PixelSampling {
    /// Uniformly distributed over the pixel, which anti-aliases.
    #[default]
    Area,
    /// At the centre, as in rasterisation without anti-aliasing; textures of the first surface are filtered over the pixel.
    Centre,
}

/// Options of the reference.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceOptions {
    /// Width, pixels, at least 1.
    pub width: u32,
    /// Height, pixels, at least 1.
    pub height: u32,
    /// Seed of the random numbers. Runs with different seeds are independent and can be merged.
    pub seed: u32,
    /// Greatest number of scatterings: 1 is direct light only, 0 is no limit.
    pub depth: u32,
    /// Which light to compute.
    pub only: Only,
    /// Where in a pixel to sample.
    pub pixel: PixelSampling,
    /// Distance up to which geometry counts as an occluder for ambient occlusion, metres, above 0.
    pub ao_range: f32,
    /// Time in the scene's animation, seconds.
    pub time: f64,
    /// Ray-tracing backend, which the device must support.
    pub rays: Rays,
    /// Treat messages of the validation layers as errors. The device must have been opened with them.
    pub check: bool,
    /// How light is sampled, and how samples of several strategies are combined.
    pub strategy: Strategy,
    /// Whether local lights and emissive surfaces are sampled, and lights found along rays, by the light tree. `None`: where a scene has many lights.
    pub light_tree: Option<bool>,
    /// Leave out light that scatters more than once between microfacets, as with `gbuffer.multiple_scattering=false` in the frame.
    pub single_scattering: bool,
}

/// Whether a configuration leaves out light that scatters more than once between microfacets, for [`ReferenceOptions::single_scattering`].
pub fn single_scattering(config: &Config) -> bool {
    let setting = config.settings.get("gbuffer").and_then(|settings| settings.get("multiple_scattering"));
    setting == Some(&Value::Bool(false))
}

/// How paths find light. All are unbiased; they differ in noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Strategy {
    /// Lights and BSDFs are sampled and weighted by the power heuristic.
    #[default]
    Power,
    /// Lights and BSDFs are sampled and weighted by the balance heuristic.
    Balance,
    /// Only BSDFs are sampled. Lights without a size are never found.
    SurfacesOnly,
    /// Only lights are sampled, except for light that light sampling cannot find, such as that of unlit surfaces.
    LightsOnly,
}

impl Default for ReferenceOptions {
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            seed: 0,
            depth: 0,
            only: Only::All,
            pixel: PixelSampling::Area,
            ao_range: AO_RANGE,
            time: 0.0,
            rays: Rays::Software,
            check: false,
            strategy: Strategy::Power,
            light_tree: None,
            single_scattering: false,
        }
    }
}

/// Why the reference failed.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// The scene could not be uploaded.
    #[error("scene: {0}")]
    Scene(#[from] ResidentError),
    /// A frame of the reference could not be run.
    #[error(transparent)]
    Execute(#[from] ExecuteError),
    /// The device reported an error.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The implementation of the slot `post` could not be created.
    #[error(transparent)]
    Stage(#[from] SlotError),
    /// A sample is NaN or infinite.
    #[error("reference: pixel {x}, {y}: samples {first} to {last} have the mean {mean}")]
    NotFinite {
        /// Pixel from the left.
        x: u32,
        /// Pixel from the top.
        y: u32,
        /// First sample.
        first: u64,
        /// Last sample.
        last: u64,
        /// Their mean.
        mean: DVec3,
    },
    /// The estimate to resume from has another size.
    #[error(transparent)]
    Size(#[from] SizeMismatch),
}

/// Width and height of a tile, pixels. One pass traces a batch of samples of one tile, so that no pass occupies the device for long.
const TILE: u32 = 256;
/// Samples per pixel of one pass.
const BATCH: u32 = 16;

/// A progressive estimate of the reference picture.
pub struct Reference {
    gpu: Gpu,
    executor: Executor,
    kernel: RayKernel,
    tree: LightTree,
    scene: ResidentScene,
    camera: Camera,
    options: ReferenceOptions,
    flags: u32,
    first_lobes: u32,
    blend_cutoff: f32,
    view: Staging,
    lights: Arc<Buffer>,
    estimate: Estimate,
    /// The sample of [`Reference::step`], as far as it is traced, and the number of its tiles.
    partial: Option<(Estimate, u32)>,
    rays: [u64; 2],
}

impl Only {
    fn shader(self) -> &'static RayShader {
        match self {
            Self::Shadows => &REFERENCE_SHADOWS_RAY,
            Self::AmbientOcclusion => &REFERENCE_AO_RAY,
            _ => &REFERENCE_PATH_RAY,
        }
    }

    /// `PATH_*` bits of the light that counts, and `LOBE_*` bits (`lib/bsdf.glsl`) of the lobes of the first surface that scatter it.
    fn path(self) -> (u32, u32) {
        const DIFFUSE: u32 = 1;
        const SPECULAR: u32 = 2;
        const TRANSMISSION: u32 = 4;
        const EVERY: u32 = DIFFUSE | SPECULAR | TRANSMISSION;
        match self {
            Self::All => (PATH_EMISSION | PATH_LIGHTS | PATH_SKY | PATH_BACKGROUND, EVERY),
            Self::Direct => (PATH_EMISSION | PATH_LIGHTS, EVERY),
            Self::Gi => (PATH_SKY, DIFFUSE),
            Self::Reflections => (PATH_SKY, SPECULAR),
            Self::Transparency => (PATH_SKY, TRANSMISSION),
            Self::Shadows | Self::AmbientOcclusion => (0, 0),
        }
    }
}

impl Reference {
    /// Uploads the scene and creates the pipeline. The estimate has no samples yet.
    ///
    /// # Errors
    /// [`ReferenceError`].
    pub fn new(gpu: &Gpu, scene: &Scene, camera: &Camera, options: ReferenceOptions) -> Result<Self, ReferenceError> {
        if options.check {
            gpu.need_validation()?;
        }
        // The raster alpha-tests blended surfaces. So camera rays do the same where the result is compared with a single slot, and shadow and
        // ambient occlusion rays too. All other rays blend by alpha, with a cut-off of 0.
        let raster_cutoff = ResidentOptions::default().blend_cutoff;
        let (camera_cutoff, ray_cutoff) = match options.only {
            Only::All => (0.0, 0.0),
            Only::Shadows | Only::AmbientOcclusion => (raster_cutoff, raster_cutoff),
            _ => (raster_cutoff, 0.0),
        };
        let resident = ResidentOptions { rays: options.rays, blend_cutoff: ray_cutoff, ..ResidentOptions::default() };
        let mut resident = ResidentScene::new(gpu, scene, resident)?;
        resident.set_single_scattering(options.single_scattering);
        let origin = FloatingOrigin::default().follow(camera);
        resident.set_moment(&Moment { time: options.time, origin, cut: true });
        let (counted, first_lobes) = options.only.path();
        let clear = if resident.facts().lets_light_through { PATH_CLEAR } else { 0 };
        let strategy = match options.strategy {
            Strategy::Power => 0,
            Strategy::Balance => PATH_BALANCE,
            Strategy::SurfacesOnly => PATH_NO_LIGHT_SAMPLES,
            Strategy::LightsOnly => PATH_NO_LIGHT_HITS,
        };
        let centre = if options.pixel == PixelSampling::Centre { PATH_CENTRE } else { 0 };
        // Direct light is scattered once.
        let depth = if options.only == Only::Direct { 1 } else { options.depth };
        let light_tree = options.light_tree.unwrap_or_else(|| hit_shading::wants_tree(resident.facts()));
        resident.want_lights(gpu, &Needs { light_tree, ..Needs::default() })?;
        let tables = LightWeights::new(scene, options.time).tables().with_tree(resident.light_tree_address());
        let mut executor = Executor::new(gpu)?;
        Ok(Self {
            kernel: gpu.ray_variant(options.only.shader(), options.rays, LIGHT_TREE[usize::from(light_tree)])?,
            tree: LightTree::new(&Build::new(gpu, options.rays))?,
            lights: tables.upload(gpu, &mut executor, "reference lights")?,
            gpu: gpu.clone(),
            executor,
            scene: resident,
            camera: camera.clone(),
            options: ReferenceOptions { depth, ..options },
            flags: counted | strategy | centre | clear,
            first_lobes,
            blend_cutoff: camera_cutoff,
            view: Staging::new(gpu, "view"),
            estimate: Estimate::new(options.width, options.height),
            partial: None,
            rays: [0; 2],
        })
    }

    /// The estimate from all samples so far.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// Number of rays traced so far: closest-hit, then any-hit rays.
    pub fn rays(&self) -> [u64; 2] {
        self.rays
    }

    /// Continues from an estimate of the same picture. New samples are numbered from its number of samples on, so that those of this seed are not
    /// repeated.
    ///
    /// # Errors
    /// [`ReferenceError::Size`].
    pub fn resume(&mut self, from: &Estimate) -> Result<(), ReferenceError> {
        let mut resumed = Estimate::new(self.options.width, self.options.height);
        resumed.merge(from)?;
        self.estimate = resumed;
        Ok(())
    }

    /// Adds this number of samples to every pixel. The result is deterministic; up to rounding it does not depend on how the samples are split
    /// into calls.
    ///
    /// # Errors
    /// [`ReferenceError`]; the estimate keeps the batches before the one that failed.
    pub fn add(&mut self, samples: u32) -> Result<(), ReferenceError> {
        let mut left = samples;
        while left > 0 {
            let batch = left.min(BATCH);
            let mut added = Estimate::new(self.options.width, self.options.height);
            for y in (0..self.options.height).step_by(TILE as usize) {
                for x in (0..self.options.width).step_by(TILE as usize) {
                    self.trace([x, y], batch, &mut added)?;
                }
            }
            added.samples = u64::from(batch);
            self.estimate.merge(&added)?;
            left -= batch;
        }
        Ok(())
    }

    /// Traces one tile of one more sample per pixel, for programs that do something else between tiles. Returns whether the sample is complete;
    /// the estimate has it only then.
    ///
    /// # Errors
    /// [`ReferenceError`]; the sample is begun anew.
    pub fn step(&mut self) -> Result<bool, ReferenceError> {
        let ReferenceOptions { width, height, .. } = self.options;
        let (mut added, tile) = self.partial.take().unwrap_or_else(|| (Estimate::new(width, height), 0));
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        self.trace([tile % columns * TILE, tile / columns * TILE], 1, &mut added)?;
        if tile + 1 < columns * rows {
            self.partial = Some((added, tile + 1));
            return Ok(false);
        }
        added.samples = 1;
        self.estimate.merge(&added)?;
        Ok(true)
    }

    /// Begins an estimate of the same scene and time from another camera, in another size.
    pub fn restart(&mut self, camera: &Camera, width: u32, height: u32) {
        let origin = FloatingOrigin::default().follow(camera);
        self.scene.set_moment(&Moment { time: self.options.time, origin, cut: true });
        self.options = ReferenceOptions { width, height, ..self.options };
        (self.camera, self.estimate, self.partial) = (camera.clone(), Estimate::new(width, height), None);
    }

    /// Traces one tile, and writes its means and squared deviations into `added`. `tile` is its upper left pixel.
    fn trace(&mut self, tile: [u32; 2], samples: u32, added: &mut Estimate) -> Result<(), ReferenceError> {
        let Estimate { width, height, .. } = *added;
        let extent = Extent::new(TILE.min(width - tile[0]), TILE.min(height - tile[1]));
        let mut g = self.executor.begin(extent);
        let imports = Rc::<RefCell<Imports>>::default();
        let full = Extent::new(width, height);
        let desc = ViewDesc { seed: self.options.seed, ..ViewDesc::new(&self.camera, full) };
        let view = desc.declare(&mut self.view, &self.scene, &mut g, &mut imports.borrow_mut())?.block;
        let camera = Some(&self.camera);
        let mut scene = self.scene.declare(&mut g, &mut imports.borrow_mut(), camera, &Policy::default())?;
        let tree = self.scene.declare_light_tree(&mut g, &mut imports.borrow_mut());
        tree.into_iter().for_each(|tree| scene = self.tree.refit(&mut g, tree, scene));
        let key = imports.borrow_mut().buffer(&self.lights);
        let lights = g.import_buffer("reference.lights", BufferDesc::new(self.lights.bytes()), Access::BufferRead, key);

        let first = self.estimate.samples;
        let (kernel, mut params) = (
            self.kernel,
            PathParams {
                tile,
                first_sample: first as u32,
                samples,
                depth: self.options.depth,
                first_lobes: self.first_lobes,
                flags: self.flags,
                range: self.options.ao_range,
                blend_cutoff: self.blend_cutoff,
                ..PathParams::default()
            },
        );
        let (mean, squares) = g.pass("reference.trace", Queue::Graphics, |p| {
            if let Some(tree) = scene.light_tree {
                p.read(tree);
            }
            let (view, scene, lights) = (p.read(view), scene.trace(p), p.read(lights.read()));
            let (mean, mean_target) = p.create("mean", ImageDesc::full(Format::Rgba32Float));
            let (squares, squares_target) = p.create("squares", ImageDesc::full(Format::Rgba32Float));
            ((mean.read(), squares.read()), move |c: &mut Record<'_>| {
                params.view = c.id(view);
                params.scene = c.id(scene.root);
                params.rays = c.rays();
                params.lights = c.id(lights);
                params.mean = c.id(mean_target);
                params.squares = c.id(squares_target);
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        let copies = Copies::new(&self.gpu, &imports);
        copies.copy(&mut g, "read_back.mean", mean);
        copies.copy(&mut g, "read_back.squares", squares);
        let executed = self.executor.run(g, &imports.borrow())?;
        if self.options.check {
            self.gpu.check_validation()?;
        }
        for pass in &executed.sample.passes {
            self.rays[0] += pass.rays_closest;
            self.rays[1] += pass.rays_any;
        }

        let images: Vec<_> = copies.finish()?.iter().map(|pixels| pixels.values()).collect();
        let [means, squares] = &images[..] else { return Ok(()) };
        for (at, (mean, squares)) in means.iter().zip(squares).enumerate() {
            let (x, y) = (tile[0] + at as u32 % extent.width, tile[1] + at as u32 / extent.width);
            let value = |v: &[f32; 4]| DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]));
            let (mean, squares) = (value(mean), value(squares));
            if !(mean.is_finite() && squares.is_finite()) {
                return Err(ReferenceError::NotFinite { x, y, first, last: first + u64::from(samples) - 1, mean });
            }
            let index = y as usize * width as usize + x as usize;
            added.mean[index] = mean;
            added.squares[index] = squares;
        }
        Ok(())
    }
}
