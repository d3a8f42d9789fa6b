//! Features that ship together: anti-aliasing moves every surface that denoisers keep a history of.
use anyhow::{Context, Result, ensure};
use magpie::gpu::Gpu;
use magpie::pixels::Pixels;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};

const SIZE: [u32; 2] = [160, 90];
/// Frames that are denoised: one more than the longest history by default.
const FRAMES: u32 = 33;
const SEEDS: u32 = 4;

/// A number for each pixel and channel.
type Values = Vec<f64>;

fn values(image: &Pixels) -> Values {
    let channels = image.format.channels() as usize;
    image.values().iter().flat_map(|v| v[..channels].iter().map(|x| f64::from(*x))).collect()
}

/// What the last of [`FRAMES`] frames gives: the slot's image, the picture's radiance, or another image in its place.
fn last(gpu: &Gpu, scene: &Scene, changes: &[&str], seed: u32, view: Option<(&str, &str)>) -> Result<[Values; 2]> {
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(changes)?, options)?;
    renderer.read_slots(&["shadows"])?;
    for frame in 1.. {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: frame == FRAMES };
        let result = renderer.frame(request)?.context("no frame")?;
        if let Some(images) = result.images {
            let slot = result.slots[0].1.as_ref().context("the slot gives nothing")?;
            return Ok([values(slot), values(&images.linear)]);
        }
    }
    unreachable!()
}

fn mean(images: &[Values]) -> Values {
    (0..images[0].len()).map(|at| images.iter().map(|i| i[at]).sum::<f64>() / images.len() as f64).collect()
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn shadows_keep_their_history_under_anti_aliasing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let mut errors = Vec::new();
    for anti_aliasing in ["post.anti_aliasing=none", "post.anti_aliasing=taa"] {
        let many = [anti_aliasing, "shadows.denoiser=none", "shadows.rays=8"];
        let truths = (1..=SEEDS).map(|seed| last(&gpu, &scene, &many, seed, None)).collect::<Result<Vec<_>>>()?;
        let truth = [0, 1].map(|k| mean(&truths.iter().map(|t| t[k].clone()).collect::<Vec<_>>()));
        let denoised = last(&gpu, &scene, &[anti_aliasing], 0, None)?;
        let one = last(&gpu, &scene, &[anti_aliasing, "shadows.denoiser=none"], 0, None)?;
        let [_, frames] = last(&gpu, &scene, &[anti_aliasing], 0, Some(("shadows.accumulate", "frames")))?;
        let mut frames: Vec<f64> = frames.iter().map(|f| f * 255.0).collect();
        frames.sort_by(f64::total_cmp);
        let median = frames[frames.len() / 2].round();
        let few = frames.iter().filter(|frames| **frames < 1.5).count() as f64 / frames.len() as f64;
        let error = [0, 1].map(|k| rms(&denoised[k], &truth[k]));
        let ray = [0, 1].map(|k| rms(&one[k], &truth[k]));
        println!(
            "{anti_aliasing}: median history {median} frames, one frame at most in {:.1} % of pixels; RMSE {error:.5?}, of one ray {ray:.5?}",
            100.0 * few
        );
        errors.push((median, error));
    }
    ensure!(errors[1].0 >= 28.0, "the median history is {} frames", errors[1].0);
    ensure!(errors[1].1[1] <= 1.2 * errors[0].1[1], "{:?} with anti-aliasing, {:?} without", errors[1], errors[0]);
    Ok(())
}
