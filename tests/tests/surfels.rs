//! Surfels: their light against the reference, their bounds, and what they must not let through.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie::scene::{Camera, Material, Scene};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_shaders::StorageImage;
use magpie_shaders::surfels::{MULTI_SCALE, RUNNING_MEAN};
use magpie_tests::against::{RAW_REFLECTIONS, Shown, light_and_block_error, mean_with, truth_of};
use magpie_tests::bench::Bench;
use magpie_tests::fixtures::{add, block, camera, material, scene};
use magpie_tests::harness::{builtin, config, gpu, save_picture};
use magpie_tests::rooms::open_rooms;

const SURFELS: [&str; 7] = [
    "stages.gi=surfels",
    "gi.precision=32",
    "gbuffer.precision=full",
    "stages.shadows=off",
    "stages.reflections=off",
    "stages.ao=off",
    "post.anti_aliasing=none",
];
const SIZE: [u32; 2] = [96, 72];

const GI: &str = "gi.gather:radiance";
const COUNTERS: &str = "gi.show:counters";

/// Frames of a scene, each with one image of them.
struct Frames {
    renderer: Renderer,
    camera: Camera,
}

impl Frames {
    fn new(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<Self> {
        let [width, height] = SIZE;
        let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
        let config = config(&[&SURFELS[..], changes].concat())?;
        Ok(Self {
            renderer: Renderer::new(gpu, scene, &Slots::default(), &config, options)?,
            camera: scene.cameras[0].clone(),
        })
    }

    fn next(&mut self, image: &str) -> Result<FrameResult> {
        let request = FrameRequest { camera: &self.camera, time: 0.0, view: image.split_once(':'), read_back: true };
        let result = self.renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        Ok(result)
    }

    /// The light of the frame after so many others.
    fn light(&mut self, others: u32) -> Result<Vec<DVec3>> {
        for _ in 0..others {
            self.next(GI)?;
        }
        let image = self.next(GI)?.images.context("no image")?.linear;
        Ok(image.values().iter().map(|v| Vec3::from_slice(v).as_dvec3()).collect())
    }
}

fn mean(pixels: &[DVec3]) -> f64 {
    pixels.iter().map(|p| p.element_sum()).sum::<f64>() / (3 * pixels.len()) as f64
}

/// The first frame is a plausible picture, and later ones have the light of the reference.
#[test]
fn light_is_that_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let options = ReferenceOptions { only: Only::Gi, ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &scene, Shown { size: SIZE, time: 0.0 }, 256)?.mean;
    let mut frames = Frames::new(&gpu, &scene, &[])?;
    let mut last = f64::INFINITY;
    for (frame, others, least, error) in [(1, 0, 0.9, 0.5), (8, 6, 0.9, 0.2), (64, 55, 0.97, 0.08)] {
        let [light, blocks] = light_and_block_error(&frames.light(others)?, &truth, SIZE[0]);
        println!("frame {frame}: light {light:.3}, error of blocks {blocks:.3}");
        ensure!((least..1.05).contains(&light), "frame {frame}: light {light}");
        ensure!(blocks < error && blocks < last, "frame {frame}: error {blocks}");
        last = blocks;
    }
    Ok(())
}

/// Below this share of the truth, light counts as black.
const BLACK: f64 = 0.1;

/// In the first frame, leaves and narrow things are not black where the reference has light, although few surfels with one path each lie on them.
#[test]
fn first_frames_have_no_black_patches() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    let cameras = scene.cameras.clone();
    for name in ["close", "alcove"] {
        scene.cameras = cameras.iter().filter(|camera| camera.name == name).cloned().collect();
        let options = ReferenceOptions { only: Only::Gi, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &scene, Shown { size: SIZE, time: 0.0 }, 128)?.mean;
        let found = Frames::new(&gpu, &scene, &[])?.light(0)?;
        let is_lit = |wanted: DVec3| wanted.element_sum() > 3e-3;
        let is_black = |found: DVec3, wanted: DVec3| found.element_sum() < BLACK * wanted.element_sum();
        let black = found.iter().zip(&truth).filter(|(f, w)| is_lit(**w) && is_black(**f, **w)).count();
        let black = black as f64 / truth.iter().filter(|wanted| is_lit(**wanted)).count() as f64;
        println!("{name}: {:.2} % of the first frame are black", 100.0 * black);
        ensure!(black < 0.005, "{name}: {black} of the first frame is black");
    }
    Ok(())
}

/// Behind a camera that moves sideways, what comes into sight has light too, and what stays keeps it.
#[test]
fn light_stays_while_the_camera_moves() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let to = scene.cameras[0].world_from_camera.translation;
    let mut frames = Frames::new(&gpu, &scene, &["post.anti_aliasing=taa"])?;
    let mut light = Vec::new();
    for frame in 0..32 {
        let aside = 0.02 * f64::from(frame) - 0.62;
        frames.camera.world_from_camera.translation = to + aside * scene.cameras[0].world_from_camera.x_axis;
        light = frames.light(0)?;
    }
    let options = ReferenceOptions { only: Only::Gi, ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &scene, Shown { size: SIZE, time: 0.0 }, 256)?.mean;
    let [light, blocks] = light_and_block_error(&light, &truth, SIZE[0]);
    println!("light {light:.3}, error of blocks {blocks:.3}");
    ensure!((0.93..1.05).contains(&light) && blocks < 0.15, "light {light}, error {blocks}");
    Ok(())
}

/// Counters of a frame, in the order of `SurfelShowParams::counters`.
fn counters(result: &FrameResult) -> Result<[f32; 8]> {
    let values = result.images.as_ref().context("no image")?.linear.values();
    let numbers: Vec<f32> = values.iter().map(|v| v[0]).collect();
    numbers.try_into().ok().context("eight counters")
}

fn rays(result: &FrameResult) -> u64 {
    let of_slot = result.sample.passes.iter().filter(|p| p.name.starts_with("gi."));
    of_slot.map(|p| p.rays_closest + p.rays_any).sum()
}

/// No frame traces more rays than the budget has, whatever stands in the way of rays, and the picture is soon covered.
#[test]
fn bounds_hold() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, budget) in [("courtyard", 20_000_u64), ("cornell", 4_000), ("cornell", 250_000)] {
        let scene = builtin(name)?;
        let budget_change = format!("gi.budget={budget}");
        let mut frames = Frames::new(&gpu, &scene, &[&budget_change, "gi.surfels=4096"])?;
        let mut uncovered = Vec::new();
        let mut most = 0;
        for frame in 1..=32 {
            let result = frames.next(COUNTERS)?;
            let [live, _, _, _, dropped, missing, visible, counted] = counters(&result)?;
            let traced = rays(&result);
            ensure!(counted as u64 == traced, "frame {frame}: {counted} rays counted, {traced} traced");
            ensure!(traced <= budget, "{name}, frame {frame}: {traced} rays of {budget}");
            ensure!(live <= 4096.0 && visible > 0.0, "{name}, frame {frame}: {live} surfels for {visible} pixels");
            uncovered.push(missing / visible);
            most = most.max(traced);
            if frame == 32 {
                println!("{name}: {live} surfels, {dropped} references dropped, at most {most} rays of {budget}");
            }
        }
        println!("uncovered: {:.4} {:.4} {:.4} {:.4}", uncovered[0], uncovered[1], uncovered[7], uncovered[31]);
        ensure!(budget < 250_000 || uncovered[31] < 0.005, "{name}: {} of the picture is uncovered", uncovered[31]);
    }
    Ok(())
}

/// Two runs give the same picture, bit by bit.
#[test]
fn runs_are_alike() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let run = || -> Result<Vec<DVec3>> { Frames::new(&gpu, &scene, &[])?.light(11) };
    ensure!(run()? == run()?, "two runs differ");
    Ok(())
}

/// The dark side of a thin wall stays dark, from the first frame on.
#[test]
fn walls_let_no_light_through() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut pictures = Vec::new();
    for wall in [0.001, 0.01, 0.1] {
        let scene = open_rooms(wall);
        let mut frames = Frames::new(&gpu, &scene, &[])?;
        let mut light = Vec::new();
        for (frame, others) in [(1, 0), (4, 2), (24, 19)] {
            light = frames.light(others)?;
            let side = |columns: std::ops::Range<usize>| {
                let of_side: Vec<DVec3> =
                    light.iter().enumerate().filter(|(at, _)| columns.contains(&(at % 96))).map(|(_, p)| *p).collect();
                mean(&of_side)
            };
            let (bright, dark) = (side(0..47), side(49..96));
            println!(
                "wall of {wall} m, frame {frame}: dark side {:.2e} of the bright one ({bright:.3})",
                dark / bright
            );
            ensure!(bright > 0.01, "the bright side is dark: {bright}");
            ensure!(dark < 0.01 * bright, "wall of {wall} m, frame {frame}: {}", dark / bright);
        }
        let brighter = light.iter().map(|v| 100.0 * *v).collect();
        pictures.extend([light, brighter]);
    }
    // Above as it is, below a hundred times as bright.
    let order = [0, 2, 4, 1, 3, 5].map(|k: usize| pictures[k].clone());
    save_picture("surfel walls", SIZE[0], 3, &order)
}

/// What a mirror shows has the light that surfels know: with one bounce, and without rays of its own for the rest.
#[test]
fn reflections_take_light_from_surfels() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("cornell")?;
    let mirror = scene.materials.len() as u32;
    scene.materials.push(Material { metalness: 1.0, roughness: 0.0, ..material([0.9; 3], 1.0, 0.0) });
    let floor = scene.instances.iter_mut().find(|instance| instance.name == "floor").context("no floor")?;
    floor.material = mirror;
    let shown = Shown { size: SIZE, time: 0.0 };
    let options = ReferenceOptions { only: Only::Reflections, ..ReferenceOptions::default() };
    // With fewer samples its mean, of caustics, is off by half a percent.
    let truth = truth_of(options, &gpu, &scene, shown, 2048)?.mean;
    let light = |gi: &str| -> Result<f64> {
        let changes = [&RAW_REFLECTIONS[..], &[gi, "reflections.bounces=1", "reflections.rays=1"]].concat();
        let found = mean_with(RenderOptions::default(), "reflections", &gpu, &scene, &changes, shown, 24)?.0;
        Ok(mean(&found) / mean(&truth))
    };
    let (without, with) = (light("stages.gi=off")?, light("stages.gi=surfels")?);
    println!("light of what is reflected after one bounce: {without:.3} without surfels, {with:.3} with them");
    ensure!(without < 0.9 && (0.94..1.03).contains(&with), "{without} without surfels, {with} with them");
    Ok(())
}

/// In a closed room whose walls shine all radiance is that of the walls over 1 - albedo; feedback neither loses nor adds.
#[test]
fn closed_rooms_keep_their_light() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (albedo, frames) in [(0.5_f32, 48), (0.8, 96)] {
        let mut s = scene("closed", camera([0.7, 0.3, 0.6], [-0.6, -0.4, -0.5]));
        let wall =
            Material { double_sided: true, emission: Vec3::ONE, specular: 0.0, ..material([albedo; 3], 0.0, 1.0) };
        add(&mut s, block(Vec3::ONE), wall, Affine3A::IDENTITY);
        let light = mean(&Frames::new(&gpu, &s, &["gi.surfel_radius=0.06"])?.light(frames)?);
        // The pixel sees what walls have scattered at least twice; light that comes straight from walls is in `direct`.
        let truth = f64::from(albedo * albedo / (1.0 - albedo));
        println!("albedo {albedo}: {light:.4}, truth {truth:.4}, ratio {:.4}", light / truth);
        ensure!((light / truth - 1.0).abs() < 0.05, "albedo {albedo}: {light}, not {truth}");
    }
    Ok(())
}

const ESTIMATORS: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/random.glsl"
#include "lib/surfel_estimator.glsl"
layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { uint means; uint kind; uint frames; uint change; float before; float after; uint spike; float spiked; };
void main() {
    Estimator e;
    e.mean = vec3(0.0);
    e.short_mean = vec3(0.0);
    e.newest = vec3(0.0);
    e.variance = vec3(0.0);
    e.samples = 0.0;
    e.variance_blend = 1.0;
    e.brightest = 0.0;
    e.inconsistency = 1.0;
    for (int channel = 0; channel < 3; channel++) e.tilt[channel] = vec3(0.0);
    for (uint i = 0u; i < frames; i++) {
        // Twice the light in half of all directions, none in the others.
        bool lit = (hash4(uvec4(gl_GlobalInvocationID.x, i, 0u, 0u)).x & 1u) != 0u;
        float y = (lit ? 2.0 : 0.0) * (i < change ? before : after);
        add_sample(e, Sample(vec3(i == spike ? spiked : y), 1.0, vec3(0.0), 0.0), kind);
        store(means, ivec2(gl_GlobalInvocationID.x, i), vec4(e.mean, e.samples));
    }
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Estimate {
    means: StorageImage,
    kind: u32,
    frames: u32,
    change: u32,
    before: f32,
    after: f32,
    spike: u32,
    spiked: f32,
}

/// Mean and standard deviation over 64 surfels of what their estimators say, frame by frame.
fn estimates(bench: &mut Bench, case: Estimate) -> Result<Vec<[f64; 2]>> {
    let kernel = bench.kernel("estimators.comp", ESTIMATORS)?;
    let extent = Extent::new(64, case.frames);
    let ran = bench.run(extent, &["test.estimate:means"], |g, _| {
        let made = g.pass("test.estimate", Queue::Graphics, |p| {
            let (means, target) = p.create("means", ImageDesc::full(Format::Rgba32Float));
            (means.read(), move |c: &mut Record<'_>| {
                c.dispatch_groups(kernel, &Estimate { means: c.id(target), ..case }, [1; 3]);
            })
        });
        g.output(made);
        Ok(())
    })?;
    let values = ran.clean()?.values("test.estimate:means")?;
    let frames = values.chunks(64).map(|row| {
        let mean = row.iter().map(|v| f64::from(v[0])).sum::<f64>() / 64.0;
        let square = row.iter().map(|v| (f64::from(v[0]) - mean).powi(2)).sum::<f64>() / 64.0;
        [mean, square.sqrt()]
    });
    Ok(frames.collect())
}

/// At rest means are right and still, and one huge sample is forgotten, in dim light as in bright. `multi-scale` answers a change by itself; for
/// `running-mean` many surfels together find it (`changes_are_followed`).
#[test]
fn estimators_follow_and_recover() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let never = u32::MAX;
    for kind in [RUNNING_MEAN, MULTI_SCALE] {
        for scale in [1e-4_f32, 1.0, 1e4] {
            let (before, after) = (scale, 4.0 * scale);
            let case = Estimate {
                means: StorageImage::default(),
                kind,
                frames: 768,
                change: 256,
                before,
                after,
                spike: never,
                spiked: 0.0,
            };
            let found = estimates(&mut bench, case)?;
            let [rest, again] = [255, 767].map(|frame: usize| found[frame]);
            let answered = (256..768).find(|&frame| found[frame][0] > 0.9 * f64::from(after)).unwrap_or(768) - 256;
            let finds_changes = kind == MULTI_SCALE;
            let (rest_error, again_error) = (rest[0] / f64::from(before) - 1.0, again[0] / f64::from(after) - 1.0);
            println!(
                "{kind} x {scale}: at rest {rest_error:.3} ± {:.3}, 90 % after {answered} frames, then {again_error:.3} ± {:.3}",
                rest[1] / f64::from(before),
                again[1] / f64::from(after)
            );
            let spiked = estimates(
                &mut bench,
                Estimate { change: never, spike: 128, spiked: 1e8 * scale, frames: 1024, ..case },
            )?;
            let forgotten = (129..1024)
                .rev()
                .find(|&frame| (spiked[frame][0] / f64::from(before) - 1.0).abs() > 0.1)
                .unwrap_or(128)
                - 128;
            println!("    10^8 forgotten after {forgotten} frames");
            let noise = if finds_changes { 0.2 } else { 0.08 };
            ensure!(rest_error.abs() < 0.03, "{kind}: {rest_error}");
            ensure!(rest[1] < noise * f64::from(before) && again[1] < noise * f64::from(after), "{kind}: boils");
            ensure!(forgotten <= 64, "{kind}: a spike is forgotten after {forgotten} frames");
            ensure!(
                !finds_changes || (again_error.abs() < 0.06 && answered <= 256),
                "{kind}: {again_error} after a change, answered after {answered} frames"
            );
        }
    }
    Ok(())
}
