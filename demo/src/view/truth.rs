//! The path-traced reference beside the picture: it gathers samples while the camera stands still, and the picture is measured against it.

use std::{
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use magpie::{
    config::{Catalogue, Config},
    graph::{Extent, Format},
    pixels::Pixels,
    scene::Camera,
};
use magpie_accuracy::metrics::{MetricError, Picture, RELMSE_EPSILON, flip_ldr_map, magma, relmse};
use magpie_passes::{
    Slots,
    reference::{Estimate, Reference, ReferenceError, ReferenceOptions, single_scattering},
};
use serde::Serialize;

use super::{
    meshes::{ERROR, TRUTH},
    window::{App, Wish},
};
use crate::exit::Failure;

/// Time that the reference may take of a frame.
const BUDGET: Duration = Duration::from_millis(12);
/// Least time between two comparisons.
const PAUSE: Duration = Duration::from_millis(500);
/// Configurations whose numbers are kept.
const KEPT: usize = 12;

/// How far the picture of a configuration is from the truth, and what it takes.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Measured {
    /// What differs from the defaults.
    pub(crate) config: String,
    /// Mean FLIP of display values, 0 to 1.
    pub(crate) flip: f64,
    /// Relative mean squared error of radiance.
    pub(crate) relmse: f64,
    /// How much of that is expected of the noise that the reference still has.
    pub(crate) relmse_of_reference: f64,
    /// Samples per pixel of the reference.
    pub(crate) samples: u64,
    /// Median GPU time of a frame, milliseconds.
    pub(crate) gpu_ms: Option<f64>,
    #[serde(skip)]
    key: Config,
    #[serde(skip)]
    seen: Seen,
}

/// The reference of what is seen now.
pub(super) struct Truth {
    reference: Reference,
    seen: Seen,
    /// Nothing is traced before the camera has stood still for a frame.
    is_still: bool,
    /// What is shown.
    state: TruthState,
    compared: Option<Instant>,
    /// Radiance of the frame that will be compared.
    radiance: Option<Pixels>,
    /// Whether such a frame is in flight.
    awaits: bool,
    comparison: Option<JoinHandle<Result<Compared, MetricError>>>,
}

/// What is shown of the reference.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TruthState {
    /// Samples per pixel.
    pub(super) samples: u64,
    /// Whether the error against it is known.
    pub(super) has_map: bool,
}

/// What an estimate depends on.
#[derive(Clone, Debug, PartialEq)]
struct Seen {
    camera: Camera,
    time: f64,
    extent: Extent,
    single_scattering: bool,
    scene: String,
}

/// A frame that will be compared.
pub(super) struct Asked {
    /// Display values of the reference.
    shown: Pixels,
    /// The configuration of the frame, and the median GPU time of frames with it, milliseconds.
    config: Config,
    gpu_ms: Option<f64>,
    seen: Seen,
}

impl Asked {
    /// Notes the configuration of the frame that is about to be submitted, and what frames with it take.
    pub(super) fn note(&mut self, config: &Config, gpu_ms: Option<f64>) {
        (self.config, self.gpu_ms) = (config.clone(), gpu_ms);
    }

    /// Whether a frame shows what the reference does.
    pub(super) fn suits(&self, camera: &Camera, time: f64, extent: Extent) -> bool {
        (&self.seen.camera, self.seen.time, self.seen.extent) == (camera, time, extent)
    }
}

struct Compared {
    measured: Measured,
    map: Pixels,
}

/// Both pictures, to be compared on a thread of its own.
struct Pair {
    estimate: Estimate,
    radiance: Pixels,
    display: Pixels,
    truth: Pixels,
    measured: Measured,
}

impl Truth {
    pub(super) fn state(&self) -> TruthState {
        self.state
    }
}

impl Pair {
    fn compare(self) -> Result<Compared, MetricError> {
        let Self { estimate, radiance, display, truth, mut measured } = self;
        let test = Picture::from_pixels(&radiance)?;
        let pixels = estimate.mean.iter().map(|mean| mean.as_vec3().to_array()).collect();
        let reference = Picture { pixels, ..test };
        measured.relmse = relmse(&Picture::from_pixels(&radiance)?, &reference)?;
        measured.relmse_of_reference = noise(&estimate);
        let shown = |pixels: &Pixels| {
            Picture::from_pixels(&Pixels { format: Format::Rgba8Unorm, bytes: pixels.presentable(), ..*pixels })
        };
        let map = flip_ldr_map(&shown(&display)?, &shown(&truth)?)?;
        measured.flip = map.mean();
        let bytes = magma(&map).as_chunks::<3>().0.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
        let map = Pixels { extent: truth.extent, format: Format::Rgba8Unorm, bytes };
        Ok(Compared { measured, map })
    }
}

/// The relative squared error that the noise of an estimate is expected to add, mean over pixels and channels.
fn noise(estimate: &Estimate) -> f64 {
    let errors = estimate.standard_error();
    let of_pixel = |(error, mean): (&glam::DVec3, &glam::DVec3)| {
        (*error * *error / (*mean * *mean + glam::DVec3::splat(RELMSE_EPSILON))).element_sum() / 3.0
    };
    errors.iter().zip(&estimate.mean).map(of_pixel).sum::<f64>() / errors.len().max(1) as f64
}

/// What differs from the defaults, as `--set` takes it.
fn differences(catalogue: &Catalogue, config: &Config) -> String {
    let defaults = catalogue.complete(&Config::default());
    let stages = config.stages.iter().filter(|(slot, name)| defaults.stages.get(*slot) != Some(name));
    let stages = stages.map(|(slot, name)| format!("{slot}={name}"));
    let settings = config.settings.iter().flat_map(|(slot, settings)| {
        let known = defaults.settings.get(slot);
        let is_same = move |key: &String, value| known.and_then(|known| known.get(key)) == Some(value);
        let is_default = defaults.stages.get(slot) == config.stages.get(slot);
        settings
            .iter()
            .filter(move |(key, value)| is_default && !is_same(key, value))
            .map(move |(key, value)| format!("{slot}.{key}={value}"))
    });
    let all: Vec<String> = stages.chain(settings).collect();
    if all.is_empty() { "defaults".to_owned() } else { all.join(" ") }
}

impl App<'_> {
    /// Shows the reference, for which the time of the scene stops, or no longer.
    pub(super) fn show_truth(&mut self, shows: bool) {
        self.interface.truth = shows;
        self.plays &= !shows;
        if !shows {
            self.truth = None;
        }
    }

    /// Traces for a part of the frame's time, and compares now and then. `picture` is the size of the picture.
    pub(super) fn advance_truth(&mut self, picture: Extent) -> Result<(), Failure> {
        if !self.interface.truth {
            return Ok(());
        }
        let Some(open) = &mut self.open else { return Ok(()) };
        let seen = Seen {
            camera: self.navigation.camera().clone(),
            time: self.time,
            extent: picture,
            single_scattering: single_scattering(&self.config),
            scene: self.scene_name.clone(),
        };
        let same_scene = |old: &Seen| {
            (old.time, old.single_scattering, &old.scene) == (seen.time, seen.single_scattering, &seen.scene)
        };
        let mut truth = match self.truth.take().filter(|truth| same_scene(&truth.seen)) {
            Some(truth) if truth.seen == seen => Truth { is_still: true, ..truth },
            Some(mut truth) => {
                truth.reference.restart(&seen.camera, picture.width, picture.height);
                self.measured.clear();
                Truth { seen, is_still: false, state: TruthState::default(), radiance: None, awaits: false, ..truth }
            }
            None => {
                let options = ReferenceOptions {
                    width: picture.width,
                    height: picture.height,
                    seed: self.arguments.seed,
                    time: seen.time,
                    rays: open.screen.rays(),
                    single_scattering: seen.single_scattering,
                    check: self.arguments.check,
                    ..ReferenceOptions::default()
                };
                let reference = Reference::new(open.screen.gpu(), &self.scene, &seen.camera, options);
                Truth {
                    reference: reference.map_err(failure)?,
                    seen,
                    is_still: false,
                    state: TruthState::default(),
                    compared: None,
                    radiance: None,
                    awaits: false,
                    comparison: None,
                }
            }
        };
        let repeats = self.arguments.time_step.is_some();
        if truth.is_still {
            let begun = Instant::now();
            // In a run that is repeated, a frame has one sample, however long it takes.
            while !truth.reference.step().map_err(failure)? && (repeats || begun.elapsed() < BUDGET) {}
        }
        let samples = truth.reference.estimate().samples;
        let is_due = repeats || truth.compared.is_none_or(|then| then.elapsed() >= PAUSE);
        if samples > truth.state.samples && is_due && !truth.awaits && truth.comparison.is_none() {
            let shown = truth.reference.display(&Slots::default(), &self.config).map_err(failure)?;
            let texture = Pixels { format: Format::Rgba8Unorm, bytes: shown.presentable(), ..shown };
            open.screen.set_picture(TRUTH, &texture)?;
            (truth.state.samples, truth.compared, truth.awaits) = (samples, Some(Instant::now()), true);
            let asked = Asked { shown, config: Config::default(), gpu_ms: None, seen: truth.seen.clone() };
            self.wishes.extend([Wish::TruthRadiance, Wish::TruthDisplay(Box::new(asked))]);
        }
        self.truth = Some(truth);
        self.compare_with_truth(repeats)
    }

    /// Begins a comparison where both pictures are there, and takes the result of one that has ended.
    fn compare_with_truth(&mut self, waits: bool) -> Result<(), Failure> {
        let (Some(truth), Some(open)) = (&mut self.truth, &mut self.open) else { return Ok(()) };
        if let Some(comparison) = truth.comparison.take_if(|comparison| waits || comparison.is_finished()) {
            let panicked = |_| Failure::Run(anyhow::anyhow!("the comparison has panicked"));
            match comparison.join().map_err(panicked)? {
                Ok(Compared { measured, map }) => {
                    if measured.seen == truth.seen {
                        truth.state.has_map = true;
                        open.screen.set_picture(ERROR, &map)?;
                        self.measured.retain(|other| other.key != measured.key);
                        self.measured.insert(0, measured);
                        self.measured.truncate(KEPT);
                    }
                }
                Err(error) => self.message = Some(format!("the picture cannot be measured: {error}")),
            }
        }
        Ok(())
    }

    /// Takes the radiance of a frame that is compared.
    pub(super) fn take_radiance(&mut self, radiance: Pixels) {
        if let Some(truth) = &mut self.truth {
            truth.radiance = Some(radiance);
        }
    }

    /// Takes the display values of the same frame, and begins to compare it with the reference.
    pub(super) fn take_display(&mut self, display: Pixels, asked: Asked) -> Result<(), Failure> {
        let Some(truth) = &mut self.truth else { return Ok(()) };
        let Asked { shown, config, gpu_ms, seen } = asked;
        let radiance = truth.radiance.take();
        // The camera may have moved since that frame was submitted.
        if seen != truth.seen {
            return Ok(());
        }
        truth.awaits = false;
        let Some(radiance) = radiance.filter(|radiance| radiance.extent == shown.extent) else { return Ok(()) };
        if display.extent != shown.extent || truth.comparison.is_some() {
            return Ok(());
        }
        let estimate = truth.reference.estimate().clone();
        let measured = Measured {
            config: differences(&self.catalogue, &config),
            flip: 0.0,
            relmse: 0.0,
            relmse_of_reference: 0.0,
            samples: estimate.samples,
            gpu_ms,
            key: config,
            seen,
        };
        let pair = Pair { estimate, radiance, display, truth: shown, measured };
        let compare = move || pair.compare();
        let thread = thread::Builder::new().name("comparison".to_owned()).spawn(compare).map_err(Failure::running)?;
        truth.comparison = Some(thread);
        Ok(())
    }

    /// Median GPU time of the frames with the present configuration.
    pub(super) fn steady_gpu_ms(&self) -> Option<f64> {
        // Those that were in flight when it was set had another.
        let steady = self.steady.saturating_sub(self.arguments.frames_in_flight as usize);
        let frames = self.recorder.frames().iter().rev().take(steady);
        let mut times: Vec<u64> = frames.filter_map(|frame| frame.gpu_ns).collect();
        times.sort_unstable();
        times.get(times.len() / 2).map(|ns| *ns as f64 / 1e6)
    }
}

fn failure(error: ReferenceError) -> Failure {
    match error {
        ReferenceError::Gpu(error) => error.into(),
        other => Failure::running(other),
    }
}
