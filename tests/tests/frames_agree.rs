//! Frames of all backends look the same: mean FLIP below 0.01, with every check on.
use anyhow::{Result, ensure};
use magpie::config::Config;
use magpie::gpu::Gpu;
use magpie::pixels::Pixels;
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::flip::mean_flip;
use magpie_tests::harness::{REAL_SCENES, asset, builtin, display, gpu};

const SIZE: [u32; 2] = [320, 180];
/// Greatest mean FLIP between two backends.
const LIMIT: f64 = 0.01;
/// Least mean FLIP between the picture and a uniform one, so that the comparison means something.
const MIN_FROM_FLAT: f64 = 0.05;

fn picture(gpu: &Gpu, scene: &Scene, rays: Rays) -> Result<Pixels> {
    let options =
        RenderOptions { width: SIZE[0], height: SIZE[1], seed: 0, check: true, rays, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &Config::default(), options)?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    let Some(result) = renderer.frame(request)? else { anyhow::bail!("a size of zero") };
    ensure!(result.findings.is_empty(), "{rays}: {}", result.findings[0]);
    display(result)
}

/// A picture of the same size in its mean colour.
fn flat(picture: &Pixels) -> Pixels {
    let seen = picture.presentable();
    let pixels = seen.as_chunks::<4>().0;
    let mean = |c: usize| (pixels.iter().map(|p| u64::from(p[c])).sum::<u64>() / pixels.len() as u64) as u8;
    let bytes = [mean(0), mean(1), mean(2), 255].repeat(pixels.len());
    Pixels { extent: picture.extent, format: magpie::graph::Format::Rgba8Unorm, bytes }
}

fn compare(gpu: &Gpu, label: &str, scene: &Scene) -> Result<()> {
    let software = picture(gpu, scene, Rays::Software)?;
    let from_flat = mean_flip(&software, &flat(&software))?;
    ensure!(from_flat > MIN_FROM_FLAT, "{label}: the picture is within {from_flat} of one flat colour");
    for rays in gpu.rays().into_iter().filter(|r| *r != Rays::Software) {
        let flip = mean_flip(&software, &picture(gpu, scene, rays)?)?;
        println!("{label}: mean FLIP {flip:.6} between software and {rays} ({from_flat:.3} from one flat colour)");
        ensure!(flip < LIMIT, "{label}: mean FLIP {flip} between software and {rays}");
    }
    Ok(())
}

#[test]
fn courtyard() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    compare(&gpu, "courtyard", &builtin("courtyard")?)
}

#[test]
fn real_scenes() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for file in REAL_SCENES {
        let Some(scene) = asset(file)? else { return Ok(()) };
        compare(&gpu, file, &scene)?;
    }
    Ok(())
}

#[test]
fn a_frame_of_half_the_scene_is_seen() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let with = picture(&gpu, &scene, Rays::Software)?;
    let mut half = scene.clone();
    half.instances.truncate(half.instances.len() / 2);
    let flip = mean_flip(&with, &picture(&gpu, &half, Rays::Software)?)?;
    ensure!(flip > LIMIT, "half of the scene is worth a FLIP of {flip} only");
    Ok(())
}
