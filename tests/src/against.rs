//! Radiance of the slot `direct`, compared with the reference.
use crate::harness::config;
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_accuracy::metrics::RELMSE_EPSILON;
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};

/// Size and time of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Scene time, seconds.
    pub time: f64,
}

/// Mean radiance of the slot over `frames` frames of a configuration, each checked, and the time of its `direct.` passes, milliseconds per
/// frame.
///
/// # Errors
/// Any error of the renderer, and values that are not finite.
pub fn mean(gpu: &Gpu, scene: &Scene, changes: &[&str], shown: Shown, frames: u32) -> Result<(Vec<DVec3>, f64)> {
    let [width, height] = shown.size;
    let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(changes)?, options)?;
    renderer.read_slots(&["direct"])?;
    let (mut sums, mut ns) = (vec![DVec3::ZERO; (width * height) as usize], 0);
    for _ in 0..frames {
        let request = FrameRequest { camera: &scene.cameras[0], time: shown.time, view: None, read_back: true };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        let image = result.slots[0].1.as_ref().context("no direct light")?;
        for (sum, v) in sums.iter_mut().zip(image.values()) {
            *sum += DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])) / f64::from(frames);
        }
        let direct = result.sample.passes.iter().filter(|p| p.name.starts_with("direct."));
        ns += direct.filter_map(|p| p.gpu_ns).sum::<u64>();
    }
    Ok((sums, ns as f64 * 1e-6 / f64::from(frames)))
}

/// The ground truth.
///
/// # Errors
/// Any error of the reference.
pub fn truth(gpu: &Gpu, scene: &Scene, shown: Shown, samples: u32) -> Result<Estimate> {
    let options = ReferenceOptions {
        width: shown.size[0],
        height: shown.size[1],
        only: Only::Direct,
        pixel: PixelSampling::Centre,
        time: shown.time,
        seed: 77,
        ..ReferenceOptions::default()
    };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
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
