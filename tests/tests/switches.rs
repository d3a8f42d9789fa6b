//! The frame is the same, bit for bit, with any steps of the graph switched off and any number of queues.
use anyhow::{Context, Result, ensure};
use magpie::graph::Switches;
use magpie::scene::{BUILTIN, Scene};
use magpie_passes::{FrameRequest, ReadBack, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{asset, builtin, config, gpu};

/// Small, as scenes are rendered many times. Odd, so that half sizes are rounded.
const SIZE: [u32; 2] = [81, 45];
const FRAMES: usize = 2;

/// The last of the first frames after a restart. Validation messages and non-finite values are errors.
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

/// Every combination of switches, on one, two and three queues if more than one is used.
fn every_combination() -> Vec<Switches> {
    let mut all = Vec::new();
    for bits in 0..64 {
        for queues in [None, Some(2), Some(3)] {
            let switches = Switches { queues, ..Switches::combination(bits) };
            // Otherwise the plan is for one queue anyway.
            if queues.is_none() || (switches.asynchronous && !switches.serial) {
                all.push(switches);
            }
        }
    }
    all
}

/// Each switch alone, all but one, none and all, and three queues.
fn some_combinations() -> Vec<Switches> {
    let bits = (0..6).flat_map(|bit| [1 << bit, 63 ^ (1 << bit)]).chain([0, 63]);
    let three = Switches { queues: Some(3), ..Switches::default() };
    bits.map(Switches::combination).chain([three]).collect()
}

fn same_under(scene: &Scene, all: &[Switches]) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed: 3, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, scene, &Slots::default(), &config(&[])?, options)?;
    let expected = last_frame(&mut renderer, scene, Switches::default())?;
    ensure!(expected.linear.bytes.iter().any(|b| *b != 0), "{}: black", scene.name);
    for &switches in all {
        let found =
            last_frame(&mut renderer, scene, switches).with_context(|| format!("{}: {switches:?}", scene.name))?;
        let same = found.linear.bytes == expected.linear.bytes
            && found.display.as_ref().map(|d| &d.bytes) == expected.display.as_ref().map(|d| &d.bytes);
        ensure!(same, "{}: another image with {switches:?}", scene.name);
    }
    println!("{}: {} combinations, the same image", scene.name, all.len());
    Ok(())
}

#[test]
fn built_in_scenes() -> Result<()> {
    // The carousel has all features of the others, and moves.
    same_under(&builtin("carousel")?, &every_combination())?;
    let others = BUILTIN.iter().filter(|(name, _)| *name != "carousel");
    others.clone().try_for_each(|(name, _)| same_under(&builtin(name)?, &some_combinations()))
}

#[test]
fn real_scenes() -> Result<()> {
    let files = [
        "pica_pica_mini_diorama/scene.gltf",
        "pica_pica_robot/robot_01.glb",
        "damaged_helmet/DamagedHelmet.glb",
        "flight_helmet/FlightHelmet.gltf",
    ];
    // Real scenes are larger, but have no other features.
    let some =
        [Switches::combination(0), Switches::combination(63), Switches { queues: Some(3), ..Switches::default() }];
    files.iter().try_for_each(|file| asset(file)?.as_ref().map_or(Ok(()), |scene| same_under(scene, &some)))
}
