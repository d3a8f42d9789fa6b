//! Soft shadows by rays without a denoiser, averaged over many frames, converge to the ground truth.
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_accuracy::metrics::RELMSE_EPSILON;
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config_without_bounces, gpu};
use std::env;

#[allow(dead_code, reason = "shared with the tests of maps")]
#[path = "shadow_maps/rig.rs"]
mod rig;

/// Mean visibility of the first lights over some frames of eight rays.
fn mean(gpu: &Gpu, scene: &Scene, [width, height]: [u32; 2], frames: u32) -> Result<Vec<DVec3>> {
    let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
    let config = config_without_bounces(&["shadows.denoiser=none", "shadows.rays=8"])?;
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
    renderer.read_slots(&["shadows"])?;
    let mut sums = vec![DVec3::ZERO; (width * height) as usize];
    for _ in 0..frames {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{:?}", result.findings);
        let image = result.slots[0].1.as_ref().context("no shadows")?;
        for (sum, v) in sums.iter_mut().zip(image.values()) {
            *sum += DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])) / f64::from(frames);
        }
    }
    Ok(sums)
}

fn truth(gpu: &Gpu, scene: &Scene, [width, height]: [u32; 2], samples: u32) -> Result<Estimate> {
    let only = Only::Shadows;
    let options =
        ReferenceOptions { width, height, only, pixel: PixelSampling::Centre, seed: 77, ..ReferenceOptions::default() };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

#[test]
fn rays_converge_to_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // The known noise of the ground truth is subtracted unless there is time for a converged one.
    let full = env::var_os("MAGPIE_FULL").is_some();
    let (samples, frames, most_noise) = if full { (32768, 1024, 5e-5) } else { (4096, 128, 2e-4) };
    for (name, size, channels) in [("cornell", [48, 48], 1), ("courtyard", [48, 27], 2)] {
        let scene = builtin(name)?;
        let truth = truth(&gpu, &scene, size, samples)?;
        let found = mean(&gpu, &scene, size, frames)?;
        let (mut error, mut floor, mut white, mut counted, mut others) = (0.0, 0.0, 0.0, 0.0, 0);
        let errors = truth.standard_error();
        let mut worst: f64 = 0.0;
        for ((found, wanted), e) in found.iter().zip(&truth.mean).zip(&errors) {
            // At the edges of leaves raster and ray may see different leaves, with different shadows.
            if (0..channels).any(|k| (found[k] - wanted[k]).abs() > 0.05) {
                others += 1;
                continue;
            }
            for k in 0..channels {
                let scale = wanted[k] * wanted[k] + RELMSE_EPSILON;
                error += (found[k] - wanted[k]).powi(2) / scale;
                floor += e[k] * e[k] / scale;
                white += (1.0 - wanted[k]).powi(2) / scale;
                worst = worst.max((found[k] - wanted[k]).abs());
                counted += 1.0;
            }
        }
        let [error, floor, white] = [error, floor, white].map(|sum: f64| sum / counted);
        ensure!(others * 100 <= found.len(), "{name}: {others} pixels are off by more than 0.05");
        println!(
            "{name}: relMSE {error:.2e}, of which {floor:.1e} is noise of the truth; {others} pixels show another surface; of white {white:.1}; worst {worst:.3?}"
        );
        ensure!(floor < most_noise, "{name}: the truth is too noisy to tell: {floor:.1e}");
        let taken_off = if full { 0.0 } else { floor };
        ensure!(error - taken_off < 1e-4 && white > 0.1, "{name}: relMSE {error:.2e}, noise of the truth {floor:.1e}");
    }
    Ok(())
}

#[test]
fn the_penumbra_of_a_disc_has_the_analytic_width() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let visibility = |scene: &Scene| {
        let mean = mean(&gpu, scene, rig::SIZE, 32)?;
        Ok(mean.into_iter().map(|v| [v.x as f32, v.y as f32, v.z as f32, 0.0]).collect())
    };
    let widths = rig::penumbrae(visibility)?;
    ensure!(widths.iter().all(|r| (0.97..1.03).contains(r)), "{widths:?}");
    Ok(())
}
