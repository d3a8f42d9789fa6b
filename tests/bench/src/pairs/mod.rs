//! Features that ship together, two at a time: how far the picture at the end of the frame is from the truth with each pair of them on, while
//! nothing moves and while the camera does. `magpie bench pairs`.
mod features;
mod report;

pub use features::{FEATURES, Feature};
pub use report::PairsReport;

use crate::motion::{Moment, Path, paths};
use features::{is_anti_aliased, light_up, settle, traces_ao};
use magpie::config::{Config, ConfigError};
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderError, RenderOptions, Renderer, Slots};
use serde::Serialize;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Frames before the picture of what stands still is taken: one more than the longest history by default.
const STILL_FRAMES: u32 = 33;
/// Frames of the camera's path. Those whose numbers, from 1, are multiples of [`EACH`] are compared.
const MOVING_FRAMES: u32 = 12;
const EACH: usize = 4;
/// Frames that a truth is the mean of. So many look once at each eighth of a pixel's width and each sixth of its height.
const TRUTH_FRAMES: u32 = 48;
/// A pair is told apart whose error is so many times what its two features make, were they independent: the root of the sum of their squares.
pub const SUSPICIOUS: f64 = 1.2;

/// What is measured.
#[derive(Clone, Debug)]
pub struct PairsOptions {
    /// Pixels.
    pub size: [u32; 2],
    /// How rays are traced where a feature does not say.
    pub rays: Rays,
    /// Names of the features that take part; all where it is empty.
    pub only: Vec<String>,
    /// What changes nothing but the picture.
    pub seed: u32,
    /// Around what is measured.
    pub config: Config,
    /// The source, for the report.
    pub commit: String,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum PairsError {
    /// A frame could not be rendered.
    #[error("{label}: {source}")]
    Render {
        /// With which features.
        label: String,
        /// What went wrong.
        source: Box<RenderError>,
    },
    /// The slots cannot be set as is needed.
    #[error(transparent)]
    Config(Box<ConfigError>),
    /// There is nothing to look at.
    #[error("the scene has no camera")]
    NoCamera,
    /// A feature of another name.
    #[error("no feature is named `{name}`; there are {known}")]
    Unknown {
        /// The name.
        name: String,
        /// All names.
        known: String,
    },
}

/// Two features, or one twice, or none twice: what the picture is off by.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// Names of the features; empty for none.
    pub features: [&'static str; 2],
    /// Root mean square difference of what a display would show, 0 to 1, while nothing moves.
    pub still: f64,
    /// The same while the camera moves, the mean over frames.
    pub moving: f64,
}

/// A linear picture: three numbers of each pixel.
type Picture = Vec<f32>;

/// What truths are kept by: where pixels are sampled, how ambient occlusion is found, and whether lamps were added. How far one way to find
/// it is from another is for `magpie accuracy` to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    anti_aliased: bool,
    traced_ao: bool,
    lights: bool,
}

/// What each kind of truth shows: standing still, then at each moment that is compared.
#[derive(Default)]
struct Truths(BTreeMap<Kind, Vec<Picture>>);

impl Truths {
    /// Those of a kind; they are made when they are asked for first.
    fn of(
        &mut self,
        kind: Kind,
        make: impl FnOnce() -> Result<Vec<Picture>, PairsError>,
    ) -> Result<&[Picture], PairsError> {
        Ok(match self.0.entry(kind) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => free.insert(make()?),
        })
    }
}

/// What is seen, frame by frame.
struct Walk {
    scene: Scene,
    lit: Scene,
    still: Moment,
    moving: Vec<Moment>,
}

impl Walk {
    fn new(scene: &Scene) -> Result<Self, PairsError> {
        let path = paths(scene, MOVING_FRAMES).into_iter().find(|path| path.name == "camera");
        let Some(Path { before: Some(still), moments, .. }) = path else { return Err(PairsError::NoCamera) };
        Ok(Self { scene: scene.clone(), lit: light_up(scene), still, moving: moments })
    }

    fn scene(&self, lights: bool) -> &Scene {
        if lights { &self.lit } else { &self.scene }
    }

    /// The moments of which there is a truth.
    fn compared(&self) -> impl Iterator<Item = &Moment> {
        std::iter::once(&self.still).chain(self.moving.iter().skip(EACH - 1).step_by(EACH))
    }
}

/// A renderer and what it is called.
struct Bench {
    renderer: Renderer,
    label: String,
}

impl Bench {
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        options: &PairsOptions,
        (label, config, rays): (&str, &Config, Rays),
    ) -> Result<Self, PairsError> {
        let render =
            RenderOptions { width: options.size[0], height: options.size[1], seed: options.seed, rays, check: false };
        let failed = |source| PairsError::Render { label: label.to_owned(), source: Box::new(source) };
        let renderer = Renderer::new(gpu, scene, &Slots::default(), config, render).map_err(failed)?;
        Ok(Self { renderer, label: label.to_owned() })
    }

    /// The picture of the next frame, or the image of the slot that is read; empty where nobody looks.
    fn frame(&mut self, moment: &Moment, looks: bool) -> Result<Picture, PairsError> {
        let request = FrameRequest { camera: &moment.camera, time: moment.time, view: None, read_back: looks };
        let failed = |source| PairsError::Render { label: self.label.clone(), source: Box::new(source) };
        let result = self.renderer.frame(request).map_err(failed)?;
        let slot = |image: Option<&magpie::pixels::Pixels>| image.map(magpie::pixels::Pixels::values);
        let picture = result.and_then(|r| match r.slots.first() {
            Some((_, image)) => slot(image.as_ref()),
            None => slot(r.images.as_ref().map(|i| &i.linear)),
        });
        Ok(picture.unwrap_or_default().iter().flat_map(|v| [v[0], v[1], v[2]]).collect())
    }
}

/// The pictures without noise: the mean over frames of many rays, before anything is done to it.
fn truths(gpu: &Gpu, walk: &Walk, kind: Kind, options: &PairsOptions) -> Result<Vec<Picture>, PairsError> {
    let config = settle(&options.config, kind.anti_aliased, kind.traced_ao)?;
    let mut bench = Bench::new(gpu, walk.scene(kind.lights), options, ("truth", &config, options.rays))?;
    let failed = |source| PairsError::Render { label: "truth".to_owned(), source: Box::new(source) };
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

/// Root mean square difference of two pictures as a display shows them: `x / (1 + x)`, then a gamma of 2.2.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let shown = |x: f32| (f64::from(x) / (1.0 + f64::from(x))).powf(1.0 / 2.2);
    (a.iter().zip(b).map(|(a, b)| (shown(*a) - shown(*b)).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// What is off with two features on; `None` where they exclude each other.
fn cell(
    gpu: &Gpu,
    walk: &Walk,
    pair: [&Feature; 2],
    truths: &mut Truths,
    options: &PairsOptions,
) -> Result<Option<Cell>, PairsError> {
    let Some((config, rays, switches)) = features::combine(&options.config, options.rays, pair)? else {
        return Ok(None);
    };
    let (anti_aliased, traced_ao) = (is_anti_aliased(&config), traces_ao(&config));
    let kind = Kind { anti_aliased, traced_ao, lights: pair.iter().any(|f| f.lights) };
    let truth = truths.of(kind, || self::truths(gpu, walk, kind, options))?;
    let label = format!("{} with {}", pair[0].name, pair[1].name);
    let mut bench = Bench::new(gpu, walk.scene(kind.lights), options, (&label, &config, rays))?;
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

fn wrong(error: ConfigError) -> PairsError {
    PairsError::Config(Box::new(error))
}

/// Measures every feature alone and every pair.
///
/// # Errors
/// [`PairsError`].
pub fn run(
    gpu: &Gpu,
    scene: &Scene,
    options: &PairsOptions,
    mut progress: impl FnMut(&str),
) -> Result<PairsReport, PairsError> {
    for name in &options.only {
        if !FEATURES.iter().any(|f| f.name == name) {
            let known = FEATURES.map(|f| f.name).join(", ");
            return Err(PairsError::Unknown { name: name.clone(), known });
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
        // 1 is shown as half of the display's light.
        let half = 0.5_f64.powf(1.0 / 2.2);
        assert!((difference(&[1.0, 0.0], &[0.0, 0.0]) - (half * half / 2.0).sqrt()).abs() < 1e-9);
        assert!(difference(&[f32::NAN], &[0.0]).is_nan());
    }
}
