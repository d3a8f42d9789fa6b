//! The same frames on two devices, opened one after the other, are equal to the byte.
use anyhow::{Context, Result, ensure};
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, ReadBack, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{asset, builtin, config, gpu};

const FRAMES: usize = 8;

/// Images of every frame on a device of its own; `None` without a GPU.
fn run(scene: &Scene) -> Result<Option<Vec<ReadBack>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let options = RenderOptions { width: 160, height: 90, seed: 7, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, scene, &Slots::default(), &config(&[])?, options)?;
    let frames = (0..FRAMES).map(|_| {
        let result =
            renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true })?;
        let result = result.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        result.images.context("nothing was read back")
    });
    frames.collect::<Result<Vec<_>>>().map(Some)
}

fn twice(scene: &Scene) -> Result<()> {
    let (Some(first), Some(second)) = (run(scene)?, run(scene)?) else { return Ok(()) };
    for frame in [0, FRAMES - 1] {
        let (a, b) = (&first[frame], &second[frame]);
        let display = |r: &ReadBack| r.display.clone().map(|d| d.bytes).context("no display image");
        let (shown_a, shown_b) = (display(a)?, display(b)?);
        ensure!(a.linear.bytes.iter().any(|v| *v != 0), "{}: frame {frame} is black", scene.name);
        let differ = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(a, b)| a != b).count();
        let (radiance, shown) = (differ(&a.linear.bytes, &b.linear.bytes), differ(&shown_a, &shown_b));
        println!("{}, frame {frame}: {radiance} of {} bytes of radiance differ", scene.name, a.linear.bytes.len());
        ensure!(a.linear.bytes.len() == b.linear.bytes.len() && shown_a.len() == shown_b.len(), "sizes differ");
        ensure!(radiance + shown == 0, "{}: {radiance} bytes of radiance and {shown} of display differ", scene.name);
    }
    Ok(())
}

#[test]
fn courtyard() -> Result<()> {
    twice(&builtin("courtyard")?)
}

#[test]
fn cornell() -> Result<()> {
    twice(&builtin("cornell")?)
}

#[test]
fn diorama() -> Result<()> {
    asset("pica_pica_mini_diorama/scene.gltf")?.as_ref().map_or(Ok(()), twice)
}
