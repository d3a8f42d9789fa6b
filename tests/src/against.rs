//! Radiance of lighting slots, compared with the reference.
use crate::harness::config;
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_accuracy::metrics::RELMSE_EPSILON;
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};

/// What makes reflections `ray-traced` unbiased, beside all bounces and no regularization: every ray shaded anew, nothing shared between pixels
/// or frames, nothing rounded, eight rays of each pixel and frame.
pub const RAW_REFLECTIONS: [&str; 11] = [
    "stages.reflections=ray-traced",
    "reflections.denoiser=none",
    "reflections.reconstruct=false",
    "reflections.reuse=false",
    "reflections.rays=8",
    "reflections.precision=32",
    "gbuffer.precision=full",
    "stages.shadows=off",
    "stages.gi=off",
    "stages.ao=off",
    "direct.emitter_rays=0",
];

/// Size and time of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Scene time, seconds.
    pub time: f64,
}

/// Mean radiance of the slot `direct` over `frames` frames of a configuration, each checked, and the time of its passes, milliseconds per
/// frame.
///
/// # Errors
/// Any error of the renderer, and values that are not finite.
pub fn mean(gpu: &Gpu, scene: &Scene, changes: &[&str], shown: Shown, frames: u32) -> Result<(Vec<DVec3>, f64)> {
    mean_of("direct", gpu, scene, changes, shown, frames)
}

/// The same of any slot that gives radiance.
///
/// # Errors
/// Any error of the renderer, and values that are not finite.
pub fn mean_of(
    slot: &str,
    gpu: &Gpu,
    scene: &Scene,
    changes: &[&str],
    shown: Shown,
    frames: u32,
) -> Result<(Vec<DVec3>, f64)> {
    mean_with(RenderOptions { check: true, ..RenderOptions::default() }, slot, gpu, scene, changes, shown, frames)
}

/// The same with other options; their size does not count.
///
/// # Errors
/// Any error of the renderer, and with `check` values that are not finite.
pub fn mean_with(
    options: RenderOptions,
    slot: &str,
    gpu: &Gpu,
    scene: &Scene,
    changes: &[&str],
    shown: Shown,
    frames: u32,
) -> Result<(Vec<DVec3>, f64)> {
    let [width, height] = shown.size;
    let options = RenderOptions { width, height, ..options };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(changes)?, options)?;
    renderer.read_slots(&[slot])?;
    let (mut sums, mut ns) = (vec![DVec3::ZERO; (width * height) as usize], 0);
    for _ in 0..frames {
        let request = FrameRequest { camera: &scene.cameras[0], time: shown.time, view: None, read_back: true };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        let image = result.slots[0].1.as_ref().with_context(|| format!("no image of `{slot}`"))?;
        for (sum, v) in sums.iter_mut().zip(image.values()) {
            *sum += DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])) / f64::from(frames);
        }
        let of_slot = |name: &str| name.split_once('.').is_some_and(|(first, _)| first == slot);
        ns += result.sample.passes.iter().filter(|p| of_slot(&p.name)).filter_map(|p| p.gpu_ns).sum::<u64>();
    }
    Ok((sums, ns as f64 * 1e-6 / f64::from(frames)))
}

/// The ground truth of direct light.
///
/// # Errors
/// Any error of the reference.
pub fn truth(gpu: &Gpu, scene: &Scene, shown: Shown, samples: u32) -> Result<Estimate> {
    truth_of(ReferenceOptions { only: Only::Direct, ..ReferenceOptions::default() }, gpu, scene, shown, samples)
}

/// The ground truth of what the options say, at the centres of pixels. Seeds are other ones than those of frames.
///
/// # Errors
/// Any error of the reference.
pub fn truth_of(options: ReferenceOptions, gpu: &Gpu, scene: &Scene, shown: Shown, samples: u32) -> Result<Estimate> {
    let Shown { size: [width, height], time } = shown;
    let options =
        ReferenceOptions { width, height, pixel: PixelSampling::Centre, time, seed: options.seed ^ 77, ..options };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

/// Means over blocks of `block` by `block` pixels of an image of `size`, which divides it.
pub fn blocks(pixels: &[DVec3], size: [u32; 2], block: u32) -> Vec<DVec3> {
    let [width, height] = size.map(|side| side as usize);
    let block = block as usize;
    let across = width / block;
    let mut means = vec![DVec3::ZERO; across * (height / block)];
    for (at, value) in pixels.iter().enumerate() {
        let (x, y) = (at % width / block, at / width / block);
        means[y * across + x] += *value / (block * block) as f64;
    }
    means
}

/// Mean of an image over that of the truth, and the root mean square error of blocks of 8 by 8 pixels over the mean of the truth. Blocks have
/// less noise than pixels. All channels count alike; `width` is that of both images.
pub fn light_and_block_error(found: &[DVec3], truth: &[DVec3], width: u32) -> [f64; 2] {
    let (width, height) = (width as usize, found.len() / width as usize);
    let across = width.div_ceil(8);
    let blocks = |values: &[DVec3]| {
        let mut sums = vec![0.0; across * height.div_ceil(8)];
        for (at, value) in values.iter().enumerate() {
            sums[at / width / 8 * across + at % width / 8] += value.element_sum();
        }
        sums
    };
    let (found, truth) = (blocks(found), blocks(truth));
    let (sum, wanted): (f64, f64) = (found.iter().sum(), truth.iter().sum());
    let square: f64 = found.iter().zip(&truth).map(|(f, t)| (f - t).powi(2)).sum();
    [sum / wanted, (square / truth.len() as f64).sqrt() / (wanted / truth.len() as f64)]
}

/// How far the expected values of two ways to compute a picture are apart.
#[derive(Clone, Copy, Debug)]
pub struct Bias {
    /// relMSE of the expected values: noise adds nothing to it but an error, in both directions.
    pub relmse: f64,
    /// Standard error of that, from its spread over pixels.
    pub error: f64,
    /// Mean light of the one over that of the other.
    pub light: f64,
    /// Standard error of that, from its spread over runs.
    pub light_error: f64,
}

/// The bias of `found` against `truth`, from at least two independent runs of each. The product of two independent errors of a pixel has the
/// squared bias as its expected value; the mean over all pairs of runs is taken.
pub fn bias(found: &[Vec<DVec3>], truth: &[Vec<DVec3>]) -> Bias {
    let runs = found.len() as f64;
    let pixels = found[0].len();
    let squares: Vec<f64> = (0..pixels)
        .map(|at| {
            let wanted = truth.iter().map(|t| t[at]).sum::<DVec3>() / truth.len() as f64;
            let apart = || found.iter().zip(truth).map(|(f, t)| f[at] - t[at]);
            let (sum, own) = (apart().sum::<DVec3>(), apart().map(|d| d * d).sum::<DVec3>());
            let square = (sum * sum - own) / (runs * (runs - 1.0));
            (square / (wanted * wanted + DVec3::splat(RELMSE_EPSILON))).element_sum() / 3.0
        })
        .collect();
    let of = |values: &[f64]| {
        let (n, mean) = (values.len() as f64, values.iter().sum::<f64>() / values.len() as f64);
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    };
    let (relmse, error) = of(&squares);
    let light = |image: &Vec<DVec3>| image.iter().map(|v| v.element_sum()).sum::<f64>();
    let wanted = truth.iter().map(light).sum::<f64>() / runs;
    let shares: Vec<f64> = found.iter().zip(truth).map(|(f, t)| 1.0 + (light(f) - light(t)) / wanted).collect();
    let (light, light_error) = of(&shares);
    Bias { relmse, error, light, light_error }
}

/// relMSE, and the part of it that is due to the ground truth's noise.
pub fn relmse(found: &[DVec3], truth: &Estimate) -> [f64; 2] {
    let (mut error, mut noise) = (0.0, 0.0);
    for ((found, wanted), deviation) in found.iter().zip(&truth.mean).zip(truth.standard_error()) {
        let scale = *wanted * *wanted + DVec3::splat(RELMSE_EPSILON);
        let apart = *found - *wanted;
        error += (apart * apart / scale).element_sum() / 3.0;
        noise += (deviation * deviation / scale).element_sum() / 3.0;
    }
    [error, noise].map(|sum| sum / found.len() as f64)
}
