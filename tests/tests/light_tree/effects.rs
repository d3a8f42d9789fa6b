//! The tree as effects get it, what it takes, and how long it takes to build.
use super::rig::{Job, Rig};
use super::scenes::{empty, everything, glow, town};
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::frame::View;
use magpie::graph::{Extent, FrameGraph};
use magpie::prelude::Effect;
use magpie::scene::{Scene, SceneFacts};
use magpie::slot::Needs;
use magpie_passes::contracts::{LightingIn, LightingOut};
use magpie_passes::plan::plan_frame;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::Rays;
use magpie_tests::fixtures::{add, mesh};
use magpie_tests::harness::{config, gpu};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

/// Asks for the tree, and notes whether it got tree and tables.
struct Asks {
    asks: bool,
    got: Arc<AtomicU32>,
}

impl Effect for Asks {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs { light_tree: self.asks, ..Needs::default() }
    }

    fn add(&mut self, _: &mut FrameGraph, _: &View, i: LightingIn) -> LightingOut {
        let got = u32::from(i.scene.light_tree.is_some()) + 2 * u32::from(i.scene.lights.is_some());
        self.got.store(got, Ordering::Relaxed);
        LightingOut::default()
    }
}

/// Slots with implementations of `gi` that ask for the tree and that do not, and what the last of them got.
fn slots() -> (Slots, Arc<AtomicU32>) {
    let (mut slots, got) = (Slots::default(), Arc::<AtomicU32>::default());
    for (name, asks) in [("asks", true), ("does-not-ask", false)] {
        let got = got.clone();
        let about = "Looks at what it is given.";
        slots.gi.register(name, about, &[], move |_, _| Ok(Box::new(Asks { asks, got: got.clone() })));
    }
    (slots, got)
}

const QUIET: [&str; 5] = [
    "stages.direct=all-lights",
    "stages.reflections=off",
    "stages.shadows=off",
    "stages.ao=off",
    "direct.emitter_rays=0",
];

#[test]
fn whoever_asks_gets_the_tree_and_nobody_else_pays() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let ((slots, got), scene) = (slots(), everything());
    let options = RenderOptions { width: 16, height: 9, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &slots, &config(&QUIET)?, options)?;
    let mut bytes = Vec::new();
    for (name, wanted) in [("does-not-ask", 0), ("asks", 3), ("does-not-ask", 0)] {
        renderer.swap("gi", name)?;
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        let frame = renderer.frame(request)?.context("a frame")?;
        let passes = frame.sample.passes.iter().filter(|pass| pass.name.starts_with("light_tree.")).count();
        ensure!((got.load(Ordering::Relaxed), passes > 0) == (wanted, wanted > 0), "{name}: {got:?}, {passes} passes");
        bytes.push(frame.sample.memory.scene_bytes);
    }
    ensure!(bytes[0] == bytes[2] && bytes[0] < bytes[1], "{bytes:?}");
    Ok(())
}

#[test]
fn a_plan_without_a_device_has_the_tree_too() -> Result<()> {
    let (slots, got) = slots();
    let mut dark = empty("dark");
    dark.daylight = None;
    for (scene, wanted) in [(everything(), 3), (dark, 2)] {
        let mut config = config(&QUIET)?;
        config.set("stages.gi=asks")?;
        plan_frame(&scene, &scene.cameras[0], &slots, &config, Rays::Software, Extent::new(16, 9))?;
        ensure!(got.load(Ordering::Relaxed) == wanted, "{}: {got:?}", scene.name);
    }
    Ok(())
}

/// A glowing sheet with hills, of two triangles per cell.
fn hills(cells: u32) -> Scene {
    let mut made = empty("hills");
    let side = cells + 1;
    let place = |i: u32| {
        let (x, z) = ((i % side) as f32 / cells as f32 - 0.5, (i / side) as f32 / cells as f32 - 0.5);
        Vec3::new(20.0 * x, (12.0 * x).sin() * (15.0 * z).cos(), 20.0 * z)
    };
    let positions: Vec<Vec3> = (0..side * side).map(place).collect();
    let cell = |i: u32| i / cells * side + i % cells;
    let corners = (0..cells * cells).map(cell).flat_map(|a| [a, a + side, a + 1, a + 1, a + side, a + side + 1]);
    let normals = vec![Vec3::Y; positions.len()];
    add(&mut made, mesh("hills", positions, normals, corners.collect()), glow(1.0, false), Affine3A::IDENTITY);
    made
}

/// Times of build with upload, and of a refit. Up to 10^6 lights with `MAGPIE_FULL`.
#[test]
fn trees_are_built_and_refitted_in_time() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let full = std::env::var_os("MAGPIE_FULL").is_some();
    let counts: &[u32] = if full { &[1000, 10_000, 100_000, 1_000_000] } else { &[10_000] };
    for &count in counts {
        let cells = (f64::from(count) / 2.0).sqrt() as u32;
        for (name, scene) in [("lamps", town(count)), ("triangles", hills(cells))] {
            let mut rig = Rig::new(&gpu, &scene)?;
            let start = Instant::now();
            rig.rebuild()?;
            let built = start.elapsed().as_secs_f64();
            let kernel = rig.kernel(
                "root.comp",
                "void run(uint i) { Words(to).at[0] = LightNodeBuffer(tree().nodes).at[0].count; }",
            )?;
            let bytes = rig.scene.borrow().light_tree_bytes();
            rig.run(Job::new(kernel, 1, 1, &[]))?;
            rig.go_to(0.0, DVec3::X);
            let answer = rig.run(Job::new(kernel, 1, 1, &[]))?;
            let lights = if name == "lamps" { count } else { 2 * cells * cells };
            let refit = answer.passes.iter().position(|pass| pass == "light_tree.lamps").context("no refit")?;
            println!(
                "{lights} {name}: built and uploaded in {:.1} ms, refitted in {:.2} ms, {:.1} bytes each",
                1e3 * built,
                answer.times[refit],
                bytes as f64 / f64::from(lights)
            );
            ensure!(answer.words[0] == lights, "{name}: {} of {lights} shine", answer.words[0]);
            ensure!(built < 30.0, "{name}: {built} s");
        }
    }
    Ok(())
}
