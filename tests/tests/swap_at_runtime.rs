//! The example of swaps while frames go on.
use anyhow::{Context, Result, ensure};
use magpie_passes::{FrameRequest, RenderError};
use magpie_tests::harness::{builtin, gpu};

#[path = "../../demo/examples/swap_at_runtime.rs"]
#[allow(dead_code)] // its `main` is not used here
mod swap_at_runtime;
use swap_at_runtime::Running;

const SIZE: [u32; 2] = [48, 27];

#[test]
fn every_implementation_of_a_slot_is_tried_and_timed() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut running = Running::new(&gpu, builtin("cornell")?, SIZE)?;
    let before = running.renderer.config().clone();
    let times = running.try_all("ao")?;
    gpu.check_validation()?;
    let names: Vec<&str> = times.iter().map(|(name, _)| name.as_str()).collect();
    ensure!(names == ["ray-traced", "screen-space", "off"], "{names:?}");
    for (name, milliseconds) in &times {
        ensure!((*milliseconds > 0.0) == (name != "off"), "{name}: {milliseconds} ms");
    }
    ensure!(*running.renderer.config() == before, "another configuration is left");
    ensure!(running.try_all("oa").is_err_and(|error| error.to_string().contains("oa")), "an unknown slot is tried");
    Ok(())
}

/// Picture of the next frame.
fn next(running: &mut Running) -> Result<Vec<u8>> {
    let request = FrameRequest { camera: &running.scene.cameras[0], time: 0.0, view: None, read_back: true };
    let images = running.renderer.frame(request)?.and_then(|result| result.images);
    Ok(images.context("no picture")?.linear.bytes)
}

/// The light of surfels gathers over frames. A swap of another slot leaves it, a swap of its own slot starts it anew.
#[test]
fn slots_that_are_not_swapped_keep_their_histories() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let start = || -> Result<Running> {
        let mut running = Running::new(&gpu, builtin("cornell")?, SIZE)?;
        running.renderer.swap("ao", "off")?;
        Ok(running)
    };
    let mut plain = start()?;
    let pictures: Vec<_> = (0..6).map(|_| next(&mut plain)).collect::<Result<_>>()?;
    let mut swapped = start()?;
    for picture in &pictures[..4] {
        ensure!(next(&mut swapped)? == *picture, "frames differ before a swap");
    }
    swapped.renderer.swap("ao", "screen-space")?;
    ensure!(next(&mut swapped)? != pictures[4], "occlusion changes nothing");
    swapped.renderer.swap("ao", "off")?;
    ensure!(next(&mut swapped)? == pictures[5], "the swap of `ao` changed the light of `gi`");
    swapped.renderer.swap("gi", "sky")?;
    next(&mut swapped)?;
    swapped.renderer.swap("gi", "surfels")?;
    let anew = next(&mut swapped)?;
    next(&mut plain)?;
    ensure!(anew != next(&mut plain)?, "`gi` kept its history over its own swap");
    Ok(())
}

#[test]
fn a_mistake_keeps_what_was_there() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (mut plain, mut mistaken) =
        (Running::new(&gpu, builtin("cornell")?, SIZE)?, Running::new(&gpu, builtin("cornell")?, SIZE)?);
    for _ in 0..2 {
        ensure!(next(&mut plain)? == next(&mut mistaken)?, "two runs differ");
        let error = mistaken.renderer.swap("ao", "screen-spice");
        let Err(RenderError::Config(error)) = error else { anyhow::bail!("{error:?}") };
        ensure!(error.to_string().contains("did you mean \"screen-space\""), "{error}");
        let mut config = mistaken.renderer.config().clone();
        config.set("ao.slices=1000")?;
        ensure!(mistaken.renderer.configure(&config).is_err(), "1000 slices are accepted");
    }
    ensure!(next(&mut plain)? == next(&mut mistaken)?, "a mistake changed the picture");
    Ok(())
}
