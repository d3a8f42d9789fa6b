//! Renders one configuration and measures its cost and error.
use crate::AccuracyError;
use crate::compose::TERMS;
use crate::display::Display;
use crate::metrics::{Comparison, Picture};
use crate::plan::Setup;
use crate::results::{Cost, Errors, Measurement, Run, StageCost};
use crate::truth::{SHARES, Truth, truth_of};
use magpie::config::Value;
use magpie::gpu::Gpu;
use magpie::measure::{FrameSample, PassTime, median};
use magpie::pixels::Pixels;
use magpie::prelude::Rays;
use magpie::scene::{Camera, Scene};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use std::collections::BTreeMap;

/// Untimed frames at the start, in which pipelines and memory are created.
const WARM_UP: u32 = 2;

/// Settings that take effect when a scene is loaded: each combination of values needs its own renderer.
const OF_LOADING: [(&str, &str); 2] = [("acceleration", "compaction"), ("acceleration", "ray_detail")];

/// Words in a pass's name that mark it as denoising. All other passes count as tracing.
const DENOISING: [&str; 12] = [
    "accumulate",
    "bilateral",
    "blur",
    "classify",
    "denoise",
    "filter",
    "gradient",
    "level",
    "reproject",
    "spatial",
    "temporal",
    "upsample",
];

/// Read-back images of a configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Images {
    /// Linear radiance.
    pub picture: Picture,
    /// Output images of slots, by slot: those that have a ground truth, and the terms of the picture.
    pub slots: BTreeMap<String, Picture>,
}

/// Key of a ground truth of the whole picture: camera at rest, samples at pixel centres.
pub const PICTURE: &str = "";
/// The same averaged over pixels, for `post`.
pub const AREA: &str = "post";
/// The same as [`PICTURE`] after the camera has moved.
pub const MOVING: &str = "moving";
/// The same as [`AREA`] after the camera has moved.
pub const MOVING_AREA: &str = "moving.post";

/// Renders configurations of one scene from one camera.
pub struct Bench<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    camera: &'a Camera,
    rays: Rays,
    slots: Slots,
    /// Cameras of the moving frames, which follow the frames at rest.
    cameras: Vec<Camera>,
    /// One renderer for each combination of settings that matter when loading.
    renderers: Vec<(Vec<Option<Value>>, Renderer)>,
}

impl<'a> Bench<'a> {
    /// Loads nothing yet.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene, camera: &'a Camera, rays: Rays, slots: &Slots) -> Self {
        Self { gpu, scene, camera, rays, slots: slots.clone(), cameras: Vec::new(), renderers: Vec::new() }
    }

    /// Sets the cameras of the frames after those at rest, for configurations with a history.
    pub fn set_cameras(&mut self, cameras: Vec<Camera>) {
        self.cameras = cameras;
    }

    /// The renderer for a configuration, reset to its first frame.
    fn renderer(&mut self, setup: &Setup, run: &Run) -> Result<&mut Renderer, AccuracyError> {
        let of = |(slot, key): (&str, &str)| setup.config.settings.get(slot).and_then(|s| s.get(key)).cloned();
        let key = OF_LOADING.map(of).to_vec();
        let at = match self.renderers.iter().position(|(known, _)| *known == key) {
            Some(at) => at,
            None => {
                let [width, height] = run.size;
                let options =
                    RenderOptions { width, height, seed: run.seed, rays: self.rays, ..RenderOptions::default() };
                let new = Renderer::new(self.gpu, self.scene, &self.slots, &setup.config, options)?;
                self.renderers.push((key, new));
                self.renderers.len() - 1
            }
        };
        let renderer = &mut self.renderers[at].1;
        renderer.configure(&setup.config)?;
        renderer.restart();
        Ok(renderer)
    }

    /// Renders one round of a configuration. In round 0 errors are measured too, against `truths` by slot (the whole picture's under
    /// [`PICTURE`]), and the images of the last frame are returned.
    ///
    /// # Errors
    /// [`AccuracyError`].
    pub fn measure(
        &mut self,
        setup: &Setup,
        round: u32,
        run: &Run,
        truths: &BTreeMap<String, Truth>,
    ) -> Result<(Measurement, Option<Images>), AccuracyError> {
        let camera = self.camera;
        let cameras = if round == 0 && setup.turns { self.cameras.clone() } else { Vec::new() };
        let renderer = self.renderer(setup, run)?;
        let mut looked_at: Vec<&str> =
            truths.keys().map(String::as_str).filter(|s| has_truth(s) && setup.slots.iter().any(|w| w == s)).collect();
        let terms = TERMS.into_iter().filter(|_| !setup.is_whole());
        terms.for_each(|term| looked_at.extend((!looked_at.contains(&term)).then_some(term)));
        renderer.read_slots(&looked_at)?;

        // If the scene moves, errors are measured at the last frame only, whose time is that of the ground truth.
        let all = run.frames.last().copied().unwrap_or(1);
        let last = if round == 0 { all } else { WARM_UP + run.timed };
        let races = run.minutes.is_some();
        let (mut samples, mut errors, mut images, mut moving) = (Vec::new(), Vec::new(), None, None);
        for frame in 1..=last + cameras.len() as u32 {
            let is_compared = round == 0 && run.frames.contains(&frame) && (!setup.moving || frame == last);
            let ends = frame > last && frame == last + cameras.len() as u32;
            let back = if setup.moving { f64::from(last - frame) * run.time_step } else { 0.0 };
            let camera = frame.checked_sub(last + 1).and_then(|at| cameras.get(at as usize)).unwrap_or(camera);
            let read_back = is_compared || ends;
            let request = FrameRequest { camera, time: run.time - back, view: None, read_back };
            let lacks = |what: &str| AccuracyError::Lacks { setup: setup.label.clone(), frame, what: what.to_owned() };
            let result = renderer.frame(request)?.ok_or_else(|| lacks("anything"))?;
            if is_compared {
                let found = pictures(&result, setup, frame)?;
                errors.push(compare(&found, truths, [PICTURE, AREA], setup, frame)?);
                images = Some(found);
            } else if ends {
                let found = Images { slots: BTreeMap::new(), ..pictures(&result, setup, frame)? };
                moving = Some(compare(&found, truths, [MOVING, MOVING_AREA], setup, frame)?);
            } else if frame > WARM_UP && frame <= last && (samples.len() < run.timed as usize || races) {
                samples.push(result.sample);
            }
        }
        let device = || AccuracyError::NoTimes { device: run.device.name.clone() };
        let cost = cost(&samples).ok_or_else(device)?;
        Ok((Measurement { setup: setup.id.clone(), round, cost, errors, moving }, images))
    }
}

/// The read-back images. A slot without output counts as visibility 1 or radiance 0.
fn pictures(result: &FrameResult, setup: &Setup, frame: u32) -> Result<Images, AccuracyError> {
    let lacks = |what: &str| AccuracyError::Lacks { setup: setup.label.clone(), frame, what: what.to_owned() };
    let images = result.images.as_ref().ok_or_else(|| lacks("a picture"))?;
    let named = |what: &str, pixels: &Pixels| {
        let what = format!("{}: frame {frame}: {what}", setup.label);
        Picture::from_numbers(pixels).map_err(AccuracyError::metric(&what))
    };
    let picture = named("picture", &images.linear)?;
    let mut slots = BTreeMap::new();
    for (slot, image) in &result.slots {
        let image = match image {
            Some(image) => named(slot, image)?,
            None => {
                let nothing = if SHARES.contains(&slot.as_str()) { 1.0 } else { 0.0 };
                Picture { pixels: vec![[nothing; 3]; picture.pixels.len()], ..picture }
            }
        };
        slots.insert(slot.clone(), image);
    }
    Ok(Images { picture, slots })
}

/// Compares a frame with the ground truth: the slots' own images, and the picture with the one under `keys[0]`; as the image of `post`,
/// also with the one under `keys[1]`.
fn compare(
    images: &Images,
    truths: &BTreeMap<String, Truth>,
    keys: [&str; 2],
    setup: &Setup,
    frame: u32,
) -> Result<Errors, AccuracyError> {
    let display = Display::of(&setup.config);
    let against = |what: &str, test: &Picture, truth: &Truth| {
        let display = if SHARES.contains(&what) { Display::PLAIN } else { display };
        let what = format!("{}: frame {frame}: {what}", setup.label);
        Comparison::displayed(test, &truth.picture, &display).map_err(AccuracyError::metric(&what))
    };
    let whole = truths.get(keys[0]).ok_or_else(|| AccuracyError::Lacks {
        setup: setup.label.clone(),
        frame,
        what: "a truth of the picture".to_owned(),
    })?;
    let mut slots = BTreeMap::new();
    for (slot, image) in images.slots.iter().filter(|(slot, _)| setup.slots.contains(slot)) {
        if let Some(truth) = truths.get(slot) {
            slots.insert(slot.clone(), against(slot, image, truth)?);
        }
    }
    if let Some(truth) = truths.get(keys[1]).filter(|_| setup.slots.iter().any(|s| s == AREA)) {
        slots.insert(AREA.to_owned(), against("picture", &images.picture, truth)?);
    }
    Ok(Errors { frame, picture: against("picture", &images.picture, whole)?, slots })
}

/// Whether a slot's own image has a ground truth.
pub fn has_truth(slot: &str) -> bool {
    truth_of(slot).is_some()
}

fn middle(values: impl Iterator<Item = u64>) -> f64 {
    let mut values: Vec<u64> = values.collect();
    values.sort_unstable();
    median(&values).unwrap_or(0.0)
}

/// Medians over the frames; none without frames or timestamps.
fn cost(samples: &[FrameSample]) -> Option<Cost> {
    let frames: Vec<u64> = samples.iter().map(|s| s.gpu_ns).collect::<Option<_>>()?;
    let last = samples.last()?;
    let mut stages: BTreeMap<String, StageCost> = BTreeMap::new();
    for stage in samples.iter().flat_map(|s| &s.passes).map(|p| &p.stage) {
        if !stages.contains_key(stage) && !stage.is_empty() {
            stages.insert(stage.clone(), stage_cost(samples, stage)?);
        }
    }
    Some(Cost {
        frame_ms: middle(frames.iter().copied()) / 1e6,
        frame_min_ms: frames.iter().copied().min()? as f64 / 1e6,
        stages,
        transient_bytes: last.memory.transient_bytes,
        history_bytes: last.memory.history_bytes,
        acceleration_bytes: last.memory.acceleration_bytes,
    })
}

fn stage_cost(samples: &[FrameSample], stage: &str) -> Option<StageCost> {
    let sums = |of: &dyn Fn(&PassTime) -> Option<u64>| -> Option<Vec<u64>> {
        let of_stage = |s: &FrameSample| s.passes.iter().filter(|p| p.stage == stage).map(of).sum();
        samples.iter().map(of_stage).collect()
    };
    let all = sums(&|p| p.gpu_ns)?;
    let denoising = sums(&|p| if is_denoising(&p.name) { p.gpu_ns } else { Some(0) })?;
    let tracing = all.iter().zip(&denoising).map(|(all, denoising)| all - denoising);
    let passes = samples.iter().map(|s| s.passes.iter().filter(|p| p.stage == stage).count()).max()?;
    Some(StageCost {
        ms: middle(all.iter().copied()) / 1e6,
        min_ms: all.iter().copied().min()? as f64 / 1e6,
        trace_ms: middle(tracing) / 1e6,
        denoise_ms: middle(denoising.iter().copied()) / 1e6,
        rays_closest: middle(sums(&|p| Some(p.rays_closest))?.into_iter()).round() as u64,
        rays_any: middle(sums(&|p| Some(p.rays_any))?.into_iter()).round() as u64,
        passes: passes as u32,
    })
}

/// Whether a pass counts as denoising, by its name: `shadows.upsample`, `gi.denoise.temporal`.
fn is_denoising(name: &str) -> bool {
    name.split('.').skip(1).any(|step| DENOISING.iter().any(|d| step.starts_with(d)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracing_and_denoising_are_told_apart_by_name() {
        assert!(is_denoising("shadows.upsample") && is_denoising("gi.denoise.pass_1") && is_denoising("ao.temporal"));
        assert!(!is_denoising("shadows.trace") && !is_denoising("filter.trace"), "the slot's own name does not count");
    }

    #[test]
    fn costs_are_sums_per_stage_and_medians_over_frames() {
        let pass = |name: &str, ms: u64| PassTime {
            name: name.to_owned(),
            stage: name.split('.').next().unwrap().to_owned(),
            gpu_ns: Some(ms * 1_000_000),
            rays_any: 10 * ms,
            ..PassTime::default()
        };
        let frame = |ms: u64| FrameSample {
            gpu_ns: Some(10 * ms * 1_000_000),
            passes: vec![pass("shadows.trace", ms), pass("shadows.upsample", 2), pass("gi.sky", 1)],
            ..FrameSample::default()
        };
        let cost = cost(&[frame(3), frame(90), frame(4)]).unwrap();
        let shadows = cost.stages["shadows"];
        assert_eq!((shadows.ms, shadows.min_ms, shadows.trace_ms, shadows.denoise_ms), (6.0, 5.0, 4.0, 2.0));
        assert_eq!((shadows.rays_any, shadows.passes), (60, 2));
        assert_eq!((cost.frame_ms, cost.stages["gi"].denoise_ms), (40.0, 0.0));
        let mut blind = frame(1);
        blind.passes[0].gpu_ns = None;
        assert_eq!(super::cost(&[blind]), None);
    }
}
