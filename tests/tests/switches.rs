//! The frame is the same, bit for bit, whatever the graph leaves undone and on however many queues it is planned.
use anyhow::{Context, Result, ensure};
use magpie::graph::Switches;
use magpie::scene::{BUILTIN, Scene};
use magpie_passes::{FrameRequest, ReadBack, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{asset, builtin, config, gpu};

/// Small: each scene is rendered several hundred times. Odd, so that halves are rounded.
const SIZE: [u32; 2] = [81, 45];
const FRAMES: usize = 2;

/// The last of the first frames after a restart. Validation messages and values that are no numbers are errors.
fn last_frame(renderer: &mut Renderer, scene: &Scene, switches: Switches) -> Result<ReadBack> {
    renderer.restart();
    renderer.set_switches(switches);
    let mut images = None;
    for frame in 1..=FRAMES {
        let read_back = frame == FRAMES;
        let result = renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back })?;
        let result = result.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        images = result.images;
    }
    images.context("no image was read back")
}

fn same_under_all_switches(scene: &Scene) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed: 3, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, scene, &Slots::default(), &config(&[])?, options)?;
    let expected = last_frame(&mut renderer, scene, Switches::default())?;
    ensure!(expected.linear.bytes.iter().any(|b| *b != 0), "{}: black", scene.name);
    let mut compared = 0;
    for bits in 0..64 {
        for queues in [None, Some(2), Some(3)] {
            let switches = Switches { queues, ..Switches::combination(bits) };
            let is_worth_it = queues.is_none() || (switches.asynchronous && !switches.serial);
            if !is_worth_it {
                continue; // planned for one queue in any case
            }
            let found =
                last_frame(&mut renderer, scene, switches).with_context(|| format!("{}: {switches:?}", scene.name))?;
            let same = found.linear.bytes == expected.linear.bytes
                && found.display.as_ref().map(|d| &d.bytes) == expected.display.as_ref().map(|d| &d.bytes);
            ensure!(same, "{}: another image with {switches:?}", scene.name);
            compared += 1;
        }
    }
    println!("{}: {compared} combinations, the same image", scene.name);
    Ok(())
}

#[test]
fn built_in_scenes() -> Result<()> {
    BUILTIN.iter().try_for_each(|(name, _)| same_under_all_switches(&builtin(name)?))
}

#[test]
fn real_scenes() -> Result<()> {
    let files = [
        "pica_pica_mini_diorama/scene.gltf",
        "pica_pica_robot/robot_01.glb",
        "damaged_helmet/DamagedHelmet.glb",
        "flight_helmet/FlightHelmet.gltf",
    ];
    files.iter().try_for_each(|file| asset(file)?.as_ref().map_or(Ok(()), same_under_all_switches))
}
