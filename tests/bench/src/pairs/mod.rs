//! Pairs of features, `magpie bench pairs`: error of the final picture against the ground truth with each pair of features on, while
//! nothing moves and while the camera moves.
mod features;
mod report;

pub use features::{FEATURES, Feature};
pub use report::PairsReport;

use crate::FrameBenchError;
use crate::motion::{Moment, Path, paths};
use features::{Traced, coat, is_anti_aliased, is_single_scattering, light_up, settle};
use magpie::config::Config;
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use serde::Serialize;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Frames before the picture at rest is compared: one more than the longest default history.
const STILL_FRAMES: u32 = 33;
/// Frames of the camera's path. Those whose numbers, from 1, are multiples of [`EACH`] are compared.
const MOVING_FRAMES: u32 = 12;
const EACH: usize = 4;
/// Frames that a ground truth is the mean of: their jitter visits each eighth of a pixel's width and each sixth of its height once.
const TRUTH_FRAMES: u32 = 48;
/// Factor by which a pair's error may exceed that of two independent features, the root of the sum of squares, before it is marked.
pub const SUSPICIOUS: f64 = 1.2;

/// Options of `magpie bench pairs`.
#[derive(Clone, Debug)]
pub struct PairsOptions {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Backend for rays, unless a feature sets one.
    pub rays: Rays,
    /// Names of the features to combine; empty for all.
    pub only: Vec<String>,
    /// Seed of everything random.
    pub seed: u32,
    /// Configuration of everything else.
    pub config: Config,
    /// Commit of the build, for the report.
    pub commit: String,
}

/// Error with two features on, one feature (given twice), or none.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// Names of the features; empty for none.
    pub features: [&'static str; 2],
    /// Root mean square difference of display values, 0 to 1, at rest.
    pub still: f64,
    /// The same while the camera moves, mean over the compared frames.
    pub moving: f64,
}

/// Linear radiance, three values per pixel.
type Picture = Vec<f32>;

/// Key of a ground truth: pixel sampling, which slots are ray-traced, added lights and coats, and the model of scattering. The error of one implementation against another is
/// measured by `magpie accuracy` instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    anti_aliased: bool,
    traced: Traced,
    lights: bool,
    coats: bool,
    single_scattering: bool,
}

/// Ground truths by kind: at rest, then at each compared moment.
#[derive(Default)]
struct Truths(BTreeMap<Kind, Vec<Picture>>);

impl Truths {
    /// Those of a kind, rendered on first use.
    fn of(
        &mut self,
        kind: Kind,
        make: impl FnOnce() -> Result<Vec<Picture>, FrameBenchError>,
    ) -> Result<&[Picture], FrameBenchError> {
        Ok(match self.0.entry(kind) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => free.insert(make()?),
        })
    }
}

/// The moments to render.
struct Walk {
    /// The scene as it is, with lights, with coats, and with both.
    scenes: [Scene; 4],
    still: Moment,
    moving: Vec<Moment>,
}

impl Walk {
    fn new(scene: &Scene) -> Result<Self, FrameBenchError> {
        let path = paths(scene, MOVING_FRAMES).into_iter().find(|path| path.name == "camera");
        let Some(Path { before: Some(still), moments, .. }) = path else { return Err(FrameBenchError::NoCamera) };
        let lit = light_up(scene);
        let scenes = [scene.clone(), lit.clone(), coat(scene), coat(&lit)];
        Ok(Self { scenes, still, moving: moments })
    }

    fn scene(&self, kind: Kind) -> &Scene {
        &self.scenes[usize::from(kind.lights) + 2 * usize::from(kind.coats)]
    }

    /// The moments that are compared with a ground truth.
    fn compared(&self) -> impl Iterator<Item = &Moment> {
        std::iter::once(&self.still).chain(self.moving.iter().skip(EACH - 1).step_by(EACH))
    }
}

/// A renderer with its label.
struct Bench {
    renderer: Renderer,
    label: String,
}

impl Bench {
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        options: &PairsOptions,
        label: &str,
        config: &Config,
        rays: Rays,
    ) -> Result<Self, FrameBenchError> {
        let [width, height] = options.size;
        let render = RenderOptions { width, height, seed: options.seed, rays, ..RenderOptions::default() };
        let failed = FrameBenchError::render(label);
        let renderer = Renderer::new(gpu, scene, &Slots::default(), config, render).map_err(failed)?;
        Ok(Self { renderer, label: label.to_owned() })
    }

    /// The next frame's picture, or the slot's image that is read back; empty unless `looks`.
    fn frame(&mut self, moment: &Moment, looks: bool) -> Result<Picture, FrameBenchError> {
        let request = FrameRequest { camera: &moment.camera, time: moment.time, view: None, read_back: looks };
        let failed = FrameBenchError::render(&self.label);
        let result = self.renderer.frame(request).map_err(failed)?;
        let slot = |image: Option<&magpie::pixels::Pixels>| image.map(magpie::pixels::Pixels::values);
        let picture = result.and_then(|r| match r.slots.first() {
            Some((_, image)) => slot(image.as_ref()),
            None => slot(r.images.as_ref().map(|i| &i.linear)),
        });
        Ok(picture.unwrap_or_default().iter().flat_map(|v| [v[0], v[1], v[2]]).collect())
    }
}

/// Ground truths: the mean over frames with many rays and without denoising or post-processing.
fn truths(gpu: &Gpu, walk: &Walk, kind: Kind, options: &PairsOptions) -> Result<Vec<Picture>, FrameBenchError> {
    let config = settle(&options.config, kind.anti_aliased, kind.traced, kind.single_scattering)?;
    let mut bench = Bench::new(gpu, walk.scene(kind), options, "truth", &config, options.rays)?;
    let failed = FrameBenchError::render("truth");
    bench.renderer.read_slots(&["sky"]).map_err(failed)?;
    let mut pictures = Vec::new();
    for moment in walk.compared() {
        let mut sums = bench.frame(moment, true)?;
        for _ in 1..TRUTH_FRAMES {
            sums.iter_mut().zip(bench.frame(moment, true)?).for_each(|(sum, v)| *sum += v);
        }
        sums.iter_mut().for_each(|sum| *sum /= TRUTH_FRAMES as f32);
        pictures.push(sums);
    }
    Ok(pictures)
}

/// Root mean square difference of display values: `x / (1 + x)`, then a gamma of 2.2.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let shown = |x: f32| (f64::from(x) / (1.0 + f64::from(x))).powf(1.0 / 2.2);
    (a.iter().zip(b).map(|(a, b)| (shown(*a) - shown(*b)).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// The error with two features on; `None` if they exclude each other.
fn cell(
    gpu: &Gpu,
    walk: &Walk,
    pair: [&Feature; 2],
    truths: &mut Truths,
    options: &PairsOptions,
) -> Result<Option<Cell>, FrameBenchError> {
    let Some((config, rays, switches)) = features::combine(&options.config, options.rays, pair)? else {
        return Ok(None);
    };
    let (anti_aliased, traced) = (is_anti_aliased(&config), Traced::of(&config));
    let (lights, coats) = (pair.iter().any(|f| f.lights), pair.iter().any(|f| f.coats));
    let kind = Kind { anti_aliased, traced, lights, coats, single_scattering: is_single_scattering(&config) };
    let truth = truths.of(kind, || self::truths(gpu, walk, kind, options))?;
    let label = format!("{} with {}", pair[0].name, pair[1].name);
    let mut bench = Bench::new(gpu, walk.scene(kind), options, &label, &config, rays)?;
    bench.renderer.set_switches(switches);
    for _ in 1..STILL_FRAMES {
        bench.frame(&walk.still, false)?;
    }
    let still = difference(&bench.frame(&walk.still, true)?, &truth[0]);
    let mut moving = Vec::new();
    for (at, moment) in walk.moving.iter().enumerate() {
        let looks = (at + 1) % EACH == 0;
        let picture = bench.frame(moment, looks)?;
        if looks {
            moving.push(difference(&picture, &truth[(at + 1) / EACH]));
        }
    }
    let moving = moving.iter().sum::<f64>() / moving.len() as f64;
    Ok(Some(Cell { features: pair.map(|f| f.name), still, moving }))
}

/// Measures every feature alone and every pair.
///
/// # Errors
/// [`FrameBenchError`].
pub fn run(
    gpu: &Gpu,
    scene: &Scene,
    options: &PairsOptions,
    mut progress: impl FnMut(&str),
) -> Result<PairsReport, FrameBenchError> {
    for name in &options.only {
        if !FEATURES.iter().any(|f| f.name == name) {
            let known = FEATURES.map(|f| f.name).join(", ");
            return Err(FrameBenchError::UnknownFeature { name: name.clone(), known });
        }
    }
    let walk = Walk::new(scene)?;
    let known = gpu.rays();
    let here = |f: &&Feature| f.rays.is_none_or(|rays| known.contains(&rays));
    let wanted = |f: &&Feature| options.only.is_empty() || options.only.iter().any(|name| name == f.name);
    let taken: Vec<&Feature> = FEATURES.iter().filter(here).filter(wanted).collect();
    let mut truths = Truths::default();
    let mut cells = Vec::new();
    cells.extend(cell(gpu, &walk, [&Feature::NONE; 2], &mut truths, options)?);
    for (at, first) in taken.iter().enumerate() {
        for second in &taken[at..] {
            progress(&format!("{} with {}", first.name, second.name));
            cells.extend(cell(gpu, &walk, [first, second], &mut truths, options)?);
        }
    }
    Ok(PairsReport::new(gpu, scene, options, taken.iter().map(|f| f.name).collect(), cells))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_that_of_what_is_shown() {
        assert_eq!(difference(&[0.5, 3.0], &[0.5, 3.0]), 0.0);
        // 1 is displayed as half of the display's linear light.
        let half = 0.5_f64.powf(1.0 / 2.2);
        assert!((difference(&[1.0, 0.0], &[0.0, 0.0]) - (half * half / 2.0).sqrt()).abs() < 1e-9);
        assert!(difference(&[f32::NAN], &[0.0]).is_nan());
    }
}
