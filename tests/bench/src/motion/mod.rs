//! Effects in motion, `magpie bench motion`: error of each frame against that frame's ground truth, for raw rays and for each denoiser.
mod paths;
mod report;

pub use paths::{Moment, Path, Turned, around, paths, stand};
pub use report::MotionReport;

use crate::FrameBenchError;
use magpie::config::{Catalogue, Config};
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use serde::Serialize;

/// Frames of eight rays per pixel that a ground truth is the mean of.
const TRUTH_FRAMES: u32 = 16;
/// Frames at rest before the motion: more than the longest default history.
pub const WARM_UP: u32 = 40;

/// Options of `magpie bench motion`.
#[derive(Clone, Debug)]
pub struct MotionOptions {
    /// Name of the slot, whose implementation must have a denoiser.
    pub slot: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Frames per path.
    pub frames: u32,
    /// Backend for rays.
    pub rays: Rays,
    /// Seed of everything random.
    pub seed: u32,
    /// Configuration of everything else.
    pub config: Config,
    /// Commit of the build, for the report.
    pub commit: String,
}

/// A variant of the slot's settings to compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contestant {
    /// Text in the legend.
    pub label: &'static str,
    changes: &'static [(&'static str, &'static str)],
}

const TRUE: &[(&str, &str)] = &[("rays", "8"), ("denoiser", "none")];

impl Contestant {
    const fn new(label: &'static str, changes: &'static [(&'static str, &'static str)]) -> Self {
        Self { label, changes }
    }
}

/// The variants to compare, the raw one first. What an effect has no settings for is skipped.
pub const CONTESTANTS: [Contestant; 7] = [
    Contestant::new("one ray", &[("rays", "1"), ("denoiser", "none")]),
    Contestant::new("svgf", &[("rays", "1"), ("denoiser", "svgf")]),
    Contestant::new("svgf, fixed history", &[("rays", "1"), ("denoiser", "svgf"), ("adaptive", "false")]),
    Contestant::new("svgf, reconstructed", &[("rays", "1"), ("denoiser", "svgf"), ("reconstruct", "true")]),
    Contestant::new("pica-pica", &[("rays", "1"), ("denoiser", "pica-pica"), ("reconstruct", "true")]),
    Contestant::new("pica-pica, quarter rays", &[("pixels_per_ray", "4"), ("denoiser", "pica-pica")]),
    Contestant::new("eight rays", TRUE),
];

/// Results of one contestant on one path.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Course {
    /// Name of the path.
    pub path: &'static str,
    /// Label of the contestant.
    pub label: &'static str,
    /// Root mean square error of each frame.
    pub errors: Vec<f64>,
    /// Root mean square change of the error since the frame before, of each frame but the first: flicker.
    pub flicker: Vec<f64>,
    /// Mean value of each frame's image.
    pub means: Vec<f64>,
    /// Mean value of each frame's ground truth.
    pub true_means: Vec<f64>,
}

impl Course {
    /// The first frame, from 1, in which the mean has covered this share of its way to the final value: the delay after a switch.
    #[must_use]
    pub fn frame_of(&self, share: f64) -> Option<usize> {
        let end = *self.true_means.last()?;
        self.means.iter().position(|mean| *mean >= share * end).map(|at| at + 1)
    }
}

/// Values of all pixels and channels of an image.
type Values = Vec<f64>;

/// A renderer of which one slot's image is read back.
struct Bench {
    renderer: Renderer,
    slot: String,
    lights: u32,
    label: String,
}

impl Bench {
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        options: &MotionOptions,
        label: &str,
        changes: &[(&str, &str)],
    ) -> Result<Self, FrameBenchError> {
        let config = config(options, changes)?;
        let MotionOptions { size: [width, height], rays, seed, .. } = *options;
        let render = RenderOptions { width, height, seed, rays, check: false };
        let failed = FrameBenchError::render(label);
        let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, render).map_err(failed)?;
        renderer.read_slots(&[&options.slot]).map_err(failed)?;
        Ok(Self { renderer, slot: options.slot.clone(), lights: scene.lights.len() as u32, label: label.to_owned() })
    }

    fn frame(&mut self, path: &Path, moment: &Moment) -> Result<Values, FrameBenchError> {
        (0..self.lights).for_each(|light| self.renderer.scale_light(light, moment.light));
        let request = FrameRequest { camera: &moment.camera, time: moment.time, view: None, read_back: true };
        let failed = FrameBenchError::render(&self.label);
        let result = self.renderer.frame(request).map_err(failed)?;
        let image = result.and_then(|r| r.slots.into_iter().next()).and_then(|(_, image)| image);
        let none = || FrameBenchError::NoImage { path: path.name, slot: self.slot.clone() };
        let image = image.ok_or_else(none)?;
        let channels = image.format.channels() as usize;
        // Alpha of radiance says nothing, and single bright pixels must not decide.
        let is_radiance = self.slot == "reflections";
        let channels = if is_radiance { 3 } else { channels };
        let shown = |x: f64| if is_radiance { x / (1.0 + x) } else { x };
        Ok(image.values().iter().flat_map(|v| v[..channels].iter().map(|x| shown(f64::from(*x)))).collect())
    }
}

/// The configuration with changes to the slot's settings; those that its implementation does not have are skipped.
fn config(options: &MotionOptions, changes: &[(&str, &str)]) -> Result<Config, FrameBenchError> {
    let catalogue: Catalogue = Slots::default().catalogue();
    let slot = catalogue.slot(&options.slot);
    let mut config = options.config.clone();
    config.set(&format!("stages.{}=ray-traced", options.slot))?;
    for (key, value) in changes {
        let known = slot.and_then(|s| s.implementation("ray-traced"));
        if known.is_none_or(|i| i.settings.iter().any(|s| s.key == *key)) {
            config.set(&format!("{}.{key}={value}", options.slot))?;
        }
    }
    catalogue.check(&config, "bench motion")?;
    Ok(config)
}

/// Ground truths of all frames. Each frame of the renderer has different rays, so that their mean converges.
fn truths(gpu: &Gpu, path: &Path, options: &MotionOptions) -> Result<Vec<Values>, FrameBenchError> {
    let mut bench = Bench::new(gpu, &path.scene, options, "truth", TRUE)?;
    let mut truths = Vec::with_capacity(path.moments.len());
    for moment in &path.moments {
        let mut sums = bench.frame(path, moment)?;
        for _ in 1..TRUTH_FRAMES {
            sums.iter_mut().zip(bench.frame(path, moment)?).for_each(|(sum, v)| *sum += v);
        }
        sums.iter_mut().for_each(|sum| *sum /= f64::from(TRUTH_FRAMES));
        truths.push(sums);
    }
    Ok(truths)
}

fn root_mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// Renders one path with every contestant.
///
/// # Errors
/// [`FrameBenchError`].
pub fn walk(gpu: &Gpu, path: &Path, options: &MotionOptions) -> Result<Vec<Course>, FrameBenchError> {
    let truths = truths(gpu, path, options)?;
    let mean = |values: &Values| values.iter().sum::<f64>() / values.len() as f64;
    let true_means: Vec<f64> = truths.iter().map(mean).collect();
    let mut courses = Vec::new();
    let mut configs: Vec<Config> = Vec::new();
    for Contestant { label, changes } in CONTESTANTS {
        let config = config(options, changes)?;
        if configs.contains(&config) {
            continue; // the effect does not have this setting
        }
        configs.push(config);
        let mut bench = Bench::new(gpu, &path.scene, options, label, changes)?;
        if let Some(before) = &path.before {
            for _ in 0..WARM_UP {
                bench.frame(path, before)?;
            }
        }
        let (mut errors, mut flicker, mut means) = (Vec::new(), Vec::new(), Vec::new());
        let mut before: Option<Values> = None;
        for (moment, truth) in path.moments.iter().zip(&truths) {
            let seen = bench.frame(path, moment)?;
            let apart: Values = seen.iter().zip(truth).map(|(a, b)| a - b).collect();
            errors.push(root_mean_square(apart.iter().copied()));
            flicker.extend(before.map(|before| root_mean_square(apart.iter().zip(&before).map(|(a, b)| a - b))));
            before = Some(apart);
            means.push(mean(&seen));
        }
        courses.push(Course { path: path.name, label, errors, flicker, means, true_means: true_means.clone() });
    }
    Ok(courses)
}

/// Renders every path of the scene.
///
/// # Errors
/// [`FrameBenchError`].
pub fn run(
    gpu: &Gpu,
    scene: &Scene,
    options: &MotionOptions,
    mut progress: impl FnMut(&str),
) -> Result<MotionReport, FrameBenchError> {
    let mut courses = Vec::new();
    for path in paths(scene, options.frames) {
        progress(path.name);
        courses.extend(walk(gpu, &path, options)?);
    }
    Ok(MotionReport::new(gpu, scene, options, courses))
}
