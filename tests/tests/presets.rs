//! Presets from low to ultra have decreasing error and increasing time.
use anyhow::{Context, Result, ensure};
use glam::Vec3;
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie::slot::QUALITIES;
use magpie_accuracy::metrics::{Picture, flip_ldr, mse};
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};

const SIZE: [u32; 2] = [112, 63];
/// Number of frames, of which the last is compared.
const FRAMES: usize = 8;
/// Least and greatest number of timed frames. The fastest counts, since other work on the machine only adds time; more are timed until the
/// order is right.
const TIMED: [usize; 2] = [5, 400];
/// Least ratio of a preset's time to the one before.
const SLACK: f64 = 0.9;

/// A renderer with a preset in a slot.
struct Run<'a> {
    renderer: Renderer,
    scene: &'a Scene,
    slot: &'static str,
    times: Vec<f64>,
}

impl<'a> Run<'a> {
    fn new(gpu: &Gpu, scene: &'a Scene, slot: &'static str, preset: &str, size: [u32; 2], seed: u32) -> Result<Self> {
        let options = RenderOptions { width: size[0], height: size[1], seed, ..RenderOptions::default() };
        let config = config(&[&format!("stages.{slot}={preset}")])?;
        let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
        renderer.read_slots(&[slot])?;
        Ok(Self { renderer, scene, slot, times: Vec::new() })
    }

    fn frame(&mut self) -> Result<FrameResult> {
        let request = FrameRequest { camera: &self.scene.cameras[0], time: 0.0, view: None, read_back: true };
        self.renderer.frame(request)?.context("a size of zero")
    }

    /// Renders a frame and records its time, milliseconds: of the slot's passes, or of all for `post`, which sets the resolution.
    fn time(&mut self) -> Result<()> {
        let result = self.frame()?;
        let is_own = |name: &str| {
            let of_slot = name.split('.').next() == Some(self.slot) || name.starts_with("reproject.");
            of_slot || self.slot == "post"
        };
        let own = result.sample.passes.iter().filter(|p| is_own(&p.name));
        self.times.push(own.filter_map(|p| p.gpu_ns).sum::<u64>() as f64 * 1e-6);
        Ok(())
    }

    fn ms(&self) -> f64 {
        self.times.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// Prints errors and times, and checks their order. Errors within the ground truth's `noise` need not decrease.
fn in_order(slot: &str, errors: &[f64], noise: f64, runs: &[Run<'_>]) -> Result<()> {
    println!("{slot}: the truth's noise is {noise:.5}");
    for ((name, error), run) in QUALITIES.iter().zip(errors).zip(runs) {
        println!("{slot}, {name}: error {error:.5}, {:.2} ms", run.ms());
    }
    ensure!(errors.iter().all(|e| e.is_finite() && *e > 0.0), "{slot}: {errors:?}");
    let falls = |pair: &[f64]| pair[1] < pair[0] || pair[1].max(pair[0]) < 1.2 * noise;
    ensure!(errors.windows(2).all(falls) && errors[2] < errors[0], "{slot}: {errors:?} does not fall");
    ensure!(times_rise(runs), "{slot}: {:?} falls", runs.iter().map(Run::ms).collect::<Vec<_>>());
    Ok(())
}

/// Whether no preset takes clearly less time than the one before, and the last more than the first.
fn times_rise(runs: &[Run<'_>]) -> bool {
    let times: Vec<f64> = runs.iter().map(Run::ms).collect();
    times.windows(2).all(|pair| pair[1] > SLACK * pair[0]) && times[3] > times[0]
}

/// Times frames of all presets in turn.
fn time(runs: &mut [Run<'_>]) -> Result<()> {
    for round in 0..TIMED[1] {
        if round >= TIMED[0] && times_rise(runs) {
            break;
        }
        runs.iter_mut().try_for_each(Run::time)?;
    }
    Ok(())
}

fn truth(gpu: &Gpu, scene: &Scene, only: Only, samples: u32) -> Result<Estimate> {
    let [width, height] = SIZE;
    let pixel = PixelSampling::Centre;
    let options = ReferenceOptions { width, height, only, pixel, seed: 3, ..ReferenceOptions::default() };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

/// Mean square over pixels and channels of what the slot gives after some frames less the ground truth, and of the truth's standard error.
fn squares(run: &mut Run<'_>, truth: &Estimate) -> Result<[f64; 2]> {
    (1..FRAMES).try_for_each(|_| run.frame().map(drop))?;
    let result = run.frame()?;
    let image = result.slots[0].1.as_ref().with_context(|| format!("{} gave nothing", run.slot))?;
    let channels = image.format.channels().min(3) as usize;
    let values = image.values();
    let square = |c: &dyn Fn(usize) -> f64| (0..channels).map(|i| c(i).powi(2)).sum::<f64>() / channels as f64;
    let errors = values.iter().zip(&truth.mean).map(|(found, wanted)| square(&|c| f64::from(found[c]) - wanted[c]));
    let noise = truth.standard_error().into_iter().map(|deviation| square(&|c| deviation[c]));
    Ok([errors.sum(), noise.sum()].map(|sum: f64| sum / truth.mean.len() as f64))
}

/// Checks a slot with a ground truth of so many samples, by root mean square error after some frames, over so many seeds.
fn slot_in_order(slot: &'static str, only: Only, scene: &Scene, samples: u32, seeds: u32) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let truth = truth(&gpu, scene, only, samples)?;
    let (mut errors, mut noise, mut timed) = (Vec::new(), 0.0, Vec::new());
    for preset in QUALITIES {
        let mut error = 0.0;
        for seed in 0..seeds {
            let mut run = Run::new(&gpu, scene, slot, preset, SIZE, seed)?;
            let [of_run, of_truth] = squares(&mut run, &truth)?;
            error += of_run / f64::from(seeds);
            noise = of_truth.sqrt();
            if seed == 0 {
                timed.push(run);
            }
        }
        errors.push(error.sqrt());
    }
    time(&mut timed)?;
    in_order(slot, &errors, noise, &timed)
}

#[test]
fn shadows() -> Result<()> {
    slot_in_order("shadows", Only::Shadows, &builtin("courtyard")?, 256, 1)
}

#[test]
fn ao() -> Result<()> {
    slot_in_order("ao", Only::AmbientOcclusion, &builtin("courtyard")?, 256, 1)
}

/// Several seeds, as in some runs a path that finds something bright is seen as a speck in frame 8. With 256 samples of the truth, its noise would be three times the
/// errors.
#[test]
fn gi() -> Result<()> {
    slot_in_order("gi", Only::Gi, &builtin("courtyard")?, 512, 4)
}

#[test]
fn reflections() -> Result<()> {
    slot_in_order("reflections", Only::Reflections, &builtin("courtyard")?, 256, 1)
}

/// The box with walls that are half metal and glossy, one of them emissive: sampling affects highlights most.
#[test]
fn direct() -> Result<()> {
    let mut scene = builtin("cornell")?;
    scene.materials.iter_mut().for_each(|m| (m.metalness, m.roughness) = (0.5, 0.4));
    let glows = scene.materials.iter_mut().find(|m| m.emission == Vec3::ZERO).context("everything shines")?;
    glows.emission = Vec3::splat(0.5);
    slot_in_order("direct", Only::Direct, &scene, 256, 1)
}

/// Checks `post` by FLIP of display values against a picture of four times the resolution, averaged over 4x4 pixels.
#[test]
fn post() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let mut large = Run::new(&gpu, &scene, "post", "standard", SIZE.map(|n| 4 * n), 0)?;
    (1..FRAMES / 2).try_for_each(|_| large.frame().map(drop))?;
    let shown = |result: FrameResult| -> Result<Picture> {
        let images = result.images.context("nothing was read back")?;
        Ok(Picture::from_pixels(&images.display.context("no display")?)?)
    };
    let wanted = shrunk(&shown(large.frame()?)?, 4);
    let mut runs =
        QUALITIES.iter().map(|name| Run::new(&gpu, &scene, "post", name, SIZE, 0)).collect::<Result<Vec<_>>>()?;
    let mut errors = Vec::new();
    for run in &mut runs {
        (1..2 * FRAMES).try_for_each(|_| run.frame().map(drop))?;
        let found = shown(run.frame()?)?;
        ensure!(mse(&found, &wanted)? > 0.0, "the same picture");
        errors.push(flip_ldr(&found, &wanted)?);
    }
    time(&mut runs)?;
    in_order("post", &errors, 0.0, &runs)
}

/// A picture downsampled by a box filter of `by` by `by` pixels.
fn shrunk(large: &Picture, by: usize) -> Picture {
    let (width, height) = (large.width / by, large.height / by);
    let mut pixels = vec![[0.0_f32; 3]; width * height];
    for (at, pixel) in large.pixels.iter().enumerate() {
        let (x, y) = (at % large.width / by, at / large.width / by);
        (0..3).for_each(|c| pixels[y * width + x][c] += pixel[c] / (by * by) as f32);
    }
    Picture { width, height, pixels }
}
