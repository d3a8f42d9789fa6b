//! Changes of size, implementation, camera cuts and switches during a run: histories stay right, nothing leaks, and there are no validation
//! messages.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::config::Config;
use magpie::gpu::Kernel;
use magpie::graph::{HistoryScope, Switches};
use magpie::measure::Memory;
use magpie::prelude::*;
use magpie::scene::{Camera, Scene};
use magpie::slot::{BoxedEffect, Build, SettingSpec, Settings, SlotError};
use magpie_passes::contracts::{PostIn, PostOut};
use magpie_passes::{FrameRequest, ReadBack, RenderOptions, Renderer, Slots};
use magpie_shaders::{SampledImage, Stage, StorageImage};
use magpie_tests::harness::{BorrowedGpu, builtin, gpu};
use std::env;
use std::sync::{Arc, Mutex, PoisonError};

const SIZE: [u32; 2] = [96, 54];

const BLEND: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint now; uint before; uint next; uvec2 size; float share; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    store(next, p, mix(load(now, p), load(before, p), share));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    now: SampledImage,
    before: SampledImage,
    next: StorageImage,
    size: [u32; 2],
    share: f32,
}

/// Whether the history was valid, per frame.
type ValidityLog = Arc<Mutex<Vec<bool>>>;

/// The standard post, blended with the previous frame.
struct Trail {
    standard: BoxedEffect<PostIn, PostOut>,
    blend: Kernel,
    share: f32,
    scope: HistoryScope,
    validity_log: ValidityLog,
}

impl Effect for Trail {
    type In = PostIn;
    type Out = PostOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, input: PostIn) -> PostOut {
        let PostOut { radiance, display: now } = self.standard.add(g, view, input);
        let history = g.history(&self.scope, "trail", g.desc(now));
        self.validity_log.lock().unwrap_or_else(PoisonError::into_inner).push(history.valid);
        let (blend, share) = (self.blend, if history.valid { self.share } else { 0.0 });
        let display = g.pass("post.trail", Queue::AsyncCompute, |p| {
            let (now, before) = (p.sample(now), p.sample(history.previous));
            let (display, next) = p.write(history.next);
            let extent = p.extent(display.read());
            (display.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = Params { now: c.id(now), before: c.id(before), next: c.id(next), size, share };
                c.dispatch(blend, &params, extent);
            })
        });
        PostOut { radiance, display }
    }
}

/// Magpie's slots with [`Trail`], and one implementation whose creation fails.
fn slots() -> (Slots, ValidityLog) {
    let (mut slots, validity_log) = (Slots::default(), ValidityLog::default());
    let about = "Higher keeps more of the frame before.";
    let settings = [SettingSpec::float("share", "", about, 0.5, 0.0..=1.0)];
    let log = validity_log.clone();
    slots.post.register("trail", "Blended with the frame before.", &settings, move |build, settings| {
        Ok(Box::new(trail(build, settings, log.clone())?))
    });
    slots.gi.register("broken", "It cannot be made.", &[], |_, _| Err(SlotError::other("no such luck")));
    (slots, validity_log)
}

fn trail(build: &Build<'_>, settings: &Settings, validity_log: ValidityLog) -> Result<Trail, SlotError> {
    let words = magpie_shaders::compile("trail.comp", BLEND, Stage::Compute).map_err(SlotError::other)?;
    let blend = build.kernel_from_words("trail.comp", &words)?;
    let standard = Slots::default().post.choose(build, "standard", &Default::default())?;
    Ok(Trail { standard, blend, share: settings.f32("share")?, scope: HistoryScope::new(), validity_log })
}

/// A renderer with its scene. Validation messages fail a frame.
struct Run {
    scene: Scene,
    renderer: Renderer,
    /// Returned to the pool after the renderer is dropped.
    gpu: BorrowedGpu,
}

impl Run {
    fn new(slots: &Slots, config: &Config) -> Result<Option<Self>> {
        let Some(gpu) = gpu()? else { return Ok(None) };
        let scene = builtin("cornell")?;
        let options =
            RenderOptions { width: SIZE[0], height: SIZE[1], seed: 1, check: false, ..RenderOptions::default() };
        let renderer = Renderer::new(&gpu, &scene, slots, config, options)?;
        Ok(Some(Self { scene, renderer, gpu }))
    }

    fn frame(&mut self, read_back: bool) -> Result<Option<ReadBack>> {
        let result =
            self.renderer.frame(FrameRequest { camera: &self.scene.cameras[0], time: 0.0, view: None, read_back })?;
        self.gpu.check_validation()?;
        Ok(result.and_then(|r| r.images))
    }

    fn image(&mut self) -> Result<ReadBack> {
        self.frame(true)?.context("no image was read back")
    }

    /// Memory in use after the device is idle: bytes and number of allocations.
    fn in_use(&self) -> Result<(u64, u32)> {
        self.gpu.wait_idle()?;
        Ok(self.gpu.in_use())
    }
}

fn configuration(changes: &[&str]) -> Result<Config> {
    let mut config = Config::default();
    for change in changes {
        config.set(change)?;
    }
    Ok(config)
}

#[test]
fn only_what_changes_begins_anew() -> Result<()> {
    let (slots, validity_log) = slots();
    let Some(mut run) = Run::new(&slots, &configuration(&["stages.post=trail"])?)? else { return Ok(()) };
    let step = |run: &mut Run, what: &str, valid: bool| -> Result<()> {
        run.frame(false).with_context(|| what.to_owned())?;
        let validity_log = std::mem::take(&mut *validity_log.lock().unwrap_or_else(PoisonError::into_inner));
        ensure!(validity_log == [valid], "{what}: validity {validity_log:?} instead of {valid}");
        Ok(())
    };
    step(&mut run, "the first frame", false)?;
    step(&mut run, "the second", true)?;
    run.renderer.swap("gi", "off")?;
    step(&mut run, "another slot", true)?;
    run.renderer.swap("post", "trail")?;
    step(&mut run, "the same implementation", true)?;
    run.renderer.configure(&configuration(&["stages.post=trail", "stages.shadows=off"])?)?;
    step(&mut run, "a configuration with the same in this slot", true)?;
    run.renderer.configure(&configuration(&["stages.post=trail", "post.share=0.25"])?)?;
    step(&mut run, "another setting", false)?;
    step(&mut run, "after it", true)?;
    run.renderer.cut();
    step(&mut run, "a cut", false)?;
    step(&mut run, "after it", true)?;
    run.renderer.resize(33, 17);
    step(&mut run, "another size", false)?;
    step(&mut run, "after it", true)?;
    run.renderer.resize(0, 17);
    ensure!(run.frame(true)?.is_none(), "an image of no pixels");
    run.renderer.resize(33, 0);
    ensure!(run.frame(true)?.is_none(), "an image of no pixels");
    run.renderer.resize(33, 17);
    step(&mut run, "minimised for a while", true)?;
    run.renderer.set_switches(Switches { queues: Some(3), alias: false, ..Switches::default() });
    step(&mut run, "other switches", true)?;
    run.renderer.swap("post", "standard")?;
    ensure!(run.frame(true)?.is_some(), "no image");
    run.renderer.swap("post", "trail")?;
    step(&mut run, "another implementation for a frame", false)?;
    step(&mut run, "after it", true)?;
    run.renderer.restart();
    step(&mut run, "a restart", false)
}

#[test]
fn what_cannot_be_made_leaves_the_old_one_in_place() -> Result<()> {
    let (slots, validity_log) = slots();
    // Without noise all frames are equal.
    let still = ["stages.post=trail", "stages.gi=sky", "shadows.edges=hard", "direct.area=0"];
    let Some(mut run) = Run::new(&slots, &configuration(&still)?)? else { return Ok(()) };
    let before = run.renderer.config().clone();
    let expected = run.image()?;
    let wrong = configuration(&["stages.gi=broken", "stages.post=standard", "post.share=0.1"])?;
    let misspelt = configuration(&["stages.post=trail", "post.sheer=0.1"])?;
    let failures: [(Result<(), _>, &[&str]); 5] = [
        (run.renderer.swap("shadow", "off"), &["swap", "shadow", "shadows"]),
        (run.renderer.swap("shadows", "of"), &["stages.shadows", "\"of\"", "off"]),
        (run.renderer.swap("gi", "broken"), &["stages.gi", "broken"]),
        (run.renderer.configure(&wrong), &["stages.gi", "broken"]),
        (run.renderer.configure(&misspelt), &["post.sheer", "share"]),
    ];
    for (failure, words) in failures {
        let error = failure.err().context("it did not fail")?.to_string();
        println!("{error}");
        ensure!(words.iter().all(|word| error.contains(word)), "{error} does not name {words:?}");
    }
    ensure!(*run.renderer.config() == before, "another configuration: {:?}", run.renderer.config());
    let image = run.image()?;
    ensure!(image.linear.bytes == expected.linear.bytes, "another image");
    let validity_log = validity_log.lock().unwrap_or_else(PoisonError::into_inner);
    ensure!(*validity_log == [false, true], "the history went on: {validity_log:?}");
    Ok(())
}

#[test]
fn nothing_moves_in_a_cut() -> Result<()> {
    let Some(mut run) = Run::new(&Slots::default(), &Config::default())? else { return Ok(()) };
    let here = run.scene.cameras[0].clone();
    let mut there = here.clone();
    there.world_from_camera.translation += glam::DVec3::new(0.05, 0.02, -0.1);
    let motion = |run: &mut Run, camera: &Camera| -> Result<usize> {
        let request = FrameRequest { camera, time: 0.0, view: Some(("gbuffer.draw", "motion")), read_back: true };
        let result = run.renderer.frame(request)?.and_then(|r| r.images).context("no motion")?;
        run.gpu.check_validation()?;
        Ok(result.linear.values().iter().filter(|v| v[0] != 0.0 || v[1] != 0.0).count())
    };
    ensure!(motion(&mut run, &here)? == 0, "the first frame moves");
    let moved = motion(&mut run, &there)?;
    ensure!(moved > 1000, "only {moved} pixels move with the camera");
    run.renderer.cut();
    ensure!(motion(&mut run, &here)? == 0, "a cut moves");
    // A frame of size zero counts as none: motion is relative to the last frame that was shown.
    run.renderer.resize(0, 0);
    let nothing = run.renderer.frame(FrameRequest { camera: &here, time: 0.0, view: None, read_back: true })?;
    ensure!(nothing.is_none(), "an image of no pixels");
    run.renderer.resize(SIZE[0], SIZE[1]);
    ensure!(motion(&mut run, &there)? == moved, "it moves otherwise after it was minimised");
    Ok(())
}

/// Pseudo-random numbers (splitmix64, Steele et al. 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u32) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % u64::from(limit)) as u32
    }
}

/// Frames after which unused memory has been freed.
const SETTLE: usize = 40;

#[test]
fn a_thousand_swaps_and_resizes_leak_nothing() -> Result<()> {
    let (slots, _) = slots();
    let Some(mut run) = Run::new(&slots, &Config::default())? else { return Ok(()) };
    let choices: Vec<(String, Vec<String>)> = slots
        .infos()
        .into_iter()
        .map(|info| (info.name.clone(), info.names().into_iter().filter(|n| n != "broken").collect()))
        .collect();
    // The image, bytes and allocations in use, and the frame's memory statistics.
    let settle = |run: &mut Run| -> Result<(ReadBack, (u64, u32), Memory)> {
        let image = run.image()?;
        for _ in 0..SETTLE {
            run.frame(false)?;
        }
        let request = FrameRequest { camera: &run.scene.cameras[0], time: 0.0, view: None, read_back: false };
        let result = run.renderer.frame(request)?.context("a size of zero")?;
        run.gpu.check_validation()?;
        Ok((image, run.in_use()?, result.sample.memory))
    };
    let (first, at_first, told_first) = settle(&mut run)?;
    let mut random = Random(8);
    let (mut rendered, mut skipped, mut swaps, mut resizes, mut most) = (0, 0, 0, 0, at_first);
    // Of most frames nobody waits for the result: the renderer keeps as many in flight as it may.
    let steps = if env::var_os("MAGPIE_FULL").is_some() { 25_000 } else { 1000 };
    for step in 0..steps {
        match random.below(12) {
            0..=2 => {
                let (slot, names) = &choices[random.below(choices.len() as u32) as usize];
                run.renderer.swap(slot, &names[random.below(names.len() as u32) as usize])?;
                swaps += 1;
            }
            3 | 4 => {
                let zero = random.below(8) == 0;
                let width = if zero { 0 } else { 1 + random.below(200) };
                run.renderer.resize(width, 1 + random.below(120));
                resizes += 1;
            }
            5 => run.renderer.cut(),
            6 => {
                let queues = [None, Some(2), Some(3)][random.below(3) as usize];
                run.renderer.set_switches(Switches { queues, ..Switches::combination(random.below(64) as u8) });
            }
            kind => {
                let (camera, read_back) = (&run.scene.cameras[0], kind == 7);
                let ticket = run.renderer.submit(FrameRequest { time: 0.0, camera, view: None, read_back })?;
                run.gpu.check_validation().with_context(|| format!("step {step}"))?;
                match ticket {
                    Some(ticket) if read_back => {
                        let images = run.renderer.finish(ticket)?.images;
                        ensure!(images.is_some(), "step {step}: no image");
                        rendered += 1;
                    }
                    Some(_) => rendered += 1,
                    None => skipped += 1,
                }
                let now = run.gpu.in_use();
                most = (most.0.max(now.0), most.1.max(now.1));
            }
        }
    }
    println!("{rendered} frames, {skipped} of no size, {swaps} swaps, {resizes} resizes; at most {most:?} in use");
    ensure!(rendered > 300 && skipped > 10 && swaps > 200 && resizes > 100, "too little was tried");

    run.renderer.configure(&Config::default())?;
    run.renderer.resize(SIZE[0], SIZE[1]);
    run.renderer.set_switches(Switches::default());
    run.renderer.restart();
    let (last, at_last, told_last) = settle(&mut run)?;
    println!("in use (bytes, places): {at_first:?} before, {at_last:?} after");
    // The counters of passes have room for the frame with the most of them.
    ensure!(at_last.1 == at_first.1, "{} places in use instead of {}", at_last.1, at_first.1);
    ensure!(at_last.0.abs_diff(at_first.0) < 1 << 16, "{} bytes in use instead of {}", at_last.0, at_first.0);
    ensure!(told_last == told_first, "{told_last:?} instead of {told_first:?}");
    let display = |i: &ReadBack| i.display.as_ref().map(|d| d.bytes.clone());
    ensure!(last.linear.bytes == first.linear.bytes && display(&last) == display(&first), "another image");
    ensure!(first.linear.bytes.iter().any(|b| *b != 0), "black");
    Ok(())
}
