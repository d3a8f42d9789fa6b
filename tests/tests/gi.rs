//! Diffuse indirect light by rays: the light of the reference, less noise by the denoiser, and nothing where nothing scatters.
use anyhow::{Result, ensure};
use glam::DVec3;
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_passes::RenderOptions;
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_shaders::Rays;
use magpie_tests::against::{Bias, Shown, bias, blocks, mean_with, truth_of};
use magpie_tests::gi::UNBIASED;
use magpie_tests::harness::{builtin, config, gpu, render};

const BOUNCES: u32 = 4;
/// Rays, beside [`UNBIASED`].
const RAW: [&str; 3] = ["stages.gi=ray-traced", "gi.rays=8", "gi.bounces=4"];
/// Pixels of a block, each way; what is compared are means of blocks.
const BLOCK: u32 = 4;
const SIZE: [u32; 2] = [64, 48];

fn bias_of(gpu: &Gpu, scene: &Scene, rays: Rays, runs: u32, count: u32) -> Result<Bias> {
    let shown = Shown { size: SIZE, time: 0.0 };
    let (mut found, mut truth) = (Vec::new(), Vec::new());
    for seed in 1..=runs {
        let options = RenderOptions { seed, rays, ..RenderOptions::default() };
        let image = mean_with(options, "gi", gpu, scene, &[&RAW[..], &UNBIASED].concat(), shown, count / 8)?.0;
        found.push(blocks(&image, SIZE, BLOCK));
        let options = ReferenceOptions { only: Only::Gi, depth: BOUNCES + 1, seed, ..ReferenceOptions::default() };
        truth.push(blocks(&truth_of(options, gpu, scene, shown, count)?.mean, SIZE, BLOCK));
    }
    Ok(bias(&found, &truth))
}

/// The mean of the denoised image is nearer to the truth than raw rays, by far.
#[test]
fn the_denoiser_lowers_the_error() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let shown = Shown { size: SIZE, time: 0.0 };
    let image = |changes: &[&str], frames: u32| -> Result<Vec<DVec3>> {
        let changes = [&RAW[..], &UNBIASED, changes].concat();
        Ok(mean_with(RenderOptions::default(), "gi", &gpu, &scene, &changes, shown, frames)?.0)
    };
    let truth = image(&[], 96)?;
    let error = |found: &[DVec3]| {
        let square: f64 = found.iter().zip(&truth).map(|(a, b)| (*a - *b).length_squared()).sum();
        (square / truth.len() as f64).sqrt()
    };
    let raw = error(&image(&["gi.rays=1"], 1)?);
    for denoiser in ["svgf", "recurrent-blur", "pica-pica"] {
        // The mean of frames 1 to 16, so that a wrong first frame counts.
        let denoised = error(&image(&["gi.rays=1", &format!("gi.denoiser={denoiser}")], 16)?);
        println!("raw {raw:.4}, {denoiser} {denoised:.4}");
        ensure!(denoised < 0.25 * raw, "{denoiser}: {denoised}, raw {raw}");
    }
    Ok(())
}

/// Where all is metal no implementation has a pass.
#[test]
fn metal_costs_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("cornell")?;
    for m in &mut scene.materials {
        (m.metalness, m.metallic_roughness_texture) = (1.0, None);
    }
    for implementation in ["surfels", "ray-traced", "screen-space"] {
        let result = render(&gpu, &scene, &config(&[&format!("stages.gi={implementation}")])?, SIZE, 1, None)?;
        let passes = &result.sample.passes;
        ensure!(passes.iter().any(|p| p.name == "direct.shade"), "there is no frame");
        ensure!(!passes.iter().any(|p| p.name.starts_with("gi.")), "{implementation} has passes");
    }
    Ok(())
}

/// Rays have the light of the reference.
#[test]
fn rays_converge_to_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, rays) in [("cornell", Rays::Software), ("courtyard", Rays::Query), ("cornell", Rays::Pipeline)] {
        if gpu.check_rays(rays).is_err() {
            println!("{name}: the device has no {rays:?}");
            continue;
        }
        let b = bias_of(&gpu, &builtin(name)?, rays, 4, 32)?;
        println!(
            "{name}, {rays:?}: relMSE {:.1e} ± {:.0e}, light {:.4} ± {:.4}",
            b.relmse, b.error, b.light, b.light_error
        );
        ensure!(b.error < 5e-4, "{name}: too much noise to tell: {b:?}");
        ensure!(b.relmse < 1e-3 && (b.light - 1.0).abs() < 0.01 + 3.0 * b.light_error, "{name}: {b:?}");
    }
    Ok(())
}
