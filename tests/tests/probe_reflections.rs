//! Reflections by probes: closed forms, and the reference.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DAffine3, DVec3, Quat, Vec3, Vec4};
use magpie::gpu::Gpu;
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie::scene::{Environment, Material, Mesh, ReflectionProbe, Scene, SceneFacts, Sphere};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_shaders::StorageImage;
use magpie_tests::against::{Shown, mean_of, truth_of};
use magpie_tests::bench::Bench;
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene, sun};
use magpie_tests::harness::{builtin, config, gpu, render};
use std::f32::consts::FRAC_PI_2;

/// Probes without other effects.
const PROBE: [&str; 7] = [
    "stages.reflections=probe",
    "stages.shadows=off",
    "stages.gi=off",
    "stages.ao=off",
    "direct.emitter_rays=0",
    "reflections.precision=32",
    "gbuffer.precision=full",
];
const SKY: [&str; 5] =
    ["stages.reflections=sky", "stages.gi=off", "stages.ao=off", "reflections.precision=32", "gbuffer.precision=full"];
const RAYS: [&str; 6] = [
    "stages.reflections=ray-traced",
    "reflections.denoiser=none",
    "reflections.reuse=false",
    "reflections.precision=32",
    "gbuffer.precision=full",
    "stages.gi=off",
];
const SMALL: Shown = Shown { size: [32, 32], time: 0.0 };

fn with<'a>(base: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    base.iter().chain(more).copied().collect()
}

/// Radiance of `reflections`, the mean of so many frames.
fn reflected(gpu: &Gpu, scene: &Scene, changes: &[&str], frames: u32) -> Result<Vec<DVec3>> {
    Ok(mean_of("reflections", gpu, scene, changes, SMALL, frames)?.0)
}

/// The same without the first frames, in which captures are single samples.
fn settled(gpu: &Gpu, scene: &Scene, changes: &[&str], frames: u32) -> Result<Vec<DVec3>> {
    let view = Some(("reflections.probe", "radiance"));
    let result = render(gpu, scene, &config(changes)?, SMALL.size, frames, view)?;
    let image = result.images.context("no image")?.linear;
    Ok(image.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).collect())
}

fn ball(radius: f32, centre: Vec3) -> Mesh {
    Mesh { name: "ball".to_owned(), spheres: vec![Sphere { centre, radius }], ..Mesh::default() }
}

fn upright(z: f32, turn: f32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_x(turn), Vec3::new(0.0, 0.0, z))
}

fn flat_environment(radiance: Vec3) -> Environment {
    let radiance = vec![radiance; 32];
    Environment { name: "flat".to_owned(), width: 8, height: 4, radiance: radiance.into(), scale: 1.0, turn: 0.0 }
}

/// Greatest relative difference of pixels that `wanted` has.
fn farthest(found: &[DVec3], wanted: &[DVec3]) -> f64 {
    let apart = |(f, w): (&DVec3, &DVec3)| f.distance(*w) / w.length();
    found.iter().zip(wanted).filter(|(_, w)| w.length() > 1e-3).map(apart).fold(0.0, f64::max)
}

/// Root mean square difference over the root mean square of what is wanted.
fn error(found: &[DVec3], wanted: &[DVec3]) -> f64 {
    let apart: f64 = found.iter().zip(wanted).map(|(f, w)| f.distance_squared(*w)).sum();
    (apart / wanted.iter().map(|w| w.length_squared()).sum::<f64>()).sqrt()
}

/// A constant environment stays constant: no faces, no edges, no mip darker than another, and the split sum is exact. The ball is small, so that
/// it hardly sees itself in the probe.
#[test]
fn a_constant_environment_has_no_faces_and_no_mips() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for side in ["reflections.resolution=16", "reflections.resolution=64"] {
        for roughness in [0.0, 0.1, 0.3, 0.5, 0.7, 1.0] {
            let mut s = scene("white", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
            add(&mut s, ball(0.6, Vec3::ZERO), material([1.0; 3], 1.0, roughness), Affine3A::IDENTITY);
            s.environment = Some(flat_environment(Vec3::new(0.8, 1.0, 1.2)));
            // What the ball itself sends back is noise here, and is left out.
            let changes = with(&PROBE, &[side, "reflections.correction=off"]);
            let (found, sky) = (reflected(&gpu, &s, &changes, 1)?, reflected(&gpu, &s, &SKY, 1)?);
            // Only where the lobe looks away from the ball: facing the camera.
            let near = |k: &usize| {
                let (x, y) = (*k as f64 % 32.0 - 15.5, *k as f64 / 32.0 - 15.5);
                x.hypot(y) < if roughness > 0.5 { 4.0 } else { 9.0 }
            };
            let pick = |all: &[DVec3]| (0..all.len()).filter(near).map(|k| all[k]).collect::<Vec<_>>();
            let (found, sky) = (pick(&found), pick(&sky));
            let apart = farthest(&found, &sky);
            println!("{side}, roughness {roughness}: {apart:.5}");
            ensure!(sky.iter().all(|v| v.y > 0.1) && apart < 0.01, "{side}, roughness {roughness}: {apart}");
        }
    }
    Ok(())
}

/// Few samples of blurred means come nearer to many samples than as many plain samples do.
#[test]
fn filtered_samples_beat_plain_ones() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for roughness in [0.4, 0.7, 1.0] {
        let mut s = scene("lobes", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
        add(&mut s, ball(0.6, Vec3::ZERO), material([1.0; 3], 1.0, roughness), Affine3A::IDENTITY);
        // Small bright spots, which plain samples miss.
        let texel =
            |k: u32| if (k.wrapping_mul(2_654_435_761) >> 8) % 97 < 2 { Vec3::splat(40.0) } else { Vec3::splat(0.3) };
        let radiance: Vec<Vec3> = (0..64 * 32).map(texel).collect();
        let name = "spots".to_owned();
        s.environment =
            Some(Environment { name, width: 64, height: 32, radiance: radiance.into(), scale: 1.0, turn: 0.0 });
        let of = |more: &[&'static str]| {
            reflected(
                &gpu,
                &s,
                &with(&with(&PROBE, &["reflections.correction=off", "reflections.indirect=false"]), more),
                1,
            )
        };
        let many = of(&["reflections.filter_samples=1024", "reflections.filter_means=false"])?;
        let few = error(&of(&["reflections.filter_samples=32"])?, &many);
        let plain = error(&of(&["reflections.filter_samples=32", "reflections.filter_means=false"])?, &many);
        println!("roughness {roughness}: 32 samples {few:.4}, plain {plain:.4}");
        ensure!(few < 0.2 && few < 0.7 * plain, "roughness {roughness}: {few}, plain {plain}");
    }
    Ok(())
}

const ROOM: Vec3 = Vec3::new(2.0, 1.5, 3.0);

/// A closed room of unlit walls, whose colour says where they are, and a mirror in it.
fn room(mirror: Affine3A, roughness: f32) -> Scene {
    let mut s = scene("room", camera([0.3, 0.4, 1.9], [-0.3, -0.6, -0.4]));
    let mut walls = block(ROOM);
    walls.colours = walls.positions.iter().map(|p| (*p / ROOM * 0.45 + 0.5).extend(1.0)).collect();
    add(
        &mut s,
        walls,
        Material { unlit: true, double_sided: true, ..material([1.0; 3], 0.0, 1.0) },
        Affine3A::IDENTITY,
    );
    add(&mut s, plane(0.8), material([1.0; 3], 1.0, roughness), mirror);
    s
}

/// A probe over the whole room that captures beside its middle.
fn off_centre(s: &Scene, centre: Vec3) -> Scene {
    let world_from_box = DAffine3::IDENTITY;
    let probe = ReflectionProbe { world_from_box, half_size: ROOM * 1.001, centre, fade: 0.0 };
    Scene { probes: vec![probe], ..s.clone() }
}

/// Distances, in metres, between the points of the walls that two pictures of the mirror show: mean and greatest.
fn misplaced(found: &[DVec3], truth: &[DVec3]) -> [f64; 2] {
    let metres = |v: &DVec3| (*v - 0.5) / 0.45 * ROOM.as_dvec3();
    let apart: Vec<f64> = found
        .iter()
        .zip(truth)
        .filter(|(_, t)| **t != DVec3::ZERO)
        .map(|(f, t)| metres(f).distance(metres(t)))
        .collect();
    [apart.iter().sum::<f64>() / apart.len() as f64, apart.iter().copied().fold(0.0, f64::max)]
}

/// In a room that is its box, a mirror shows the wall where it is, from anywhere, wherever the probe captures; so do captured distances.
#[test]
fn parallax_is_corrected_in_a_box() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Of a texel at the middle of a face that is three metres away, the diagonal.
    let texel = 2.0 / 63.0 * 3.0 * 2_f64.sqrt();
    for mirror in [
        Affine3A::from_translation(Vec3::new(-0.3, -0.9, -0.3)),
        Affine3A::from_rotation_translation(Quat::from_rotation_x(0.7), Vec3::new(-0.2, -0.7, -0.6)),
    ] {
        let s = room(mirror, 0.0);
        let truth = reflected(&gpu, &s, &with(&RAYS, &["reflections.bounces=1"]), 1)?;
        ensure!(truth.iter().filter(|t| **t != DVec3::ZERO).count() > 150, "the mirror is in the picture");
        let found = |scene: &Scene, correction: &'static str| -> Result<[f64; 2]> {
            Ok(misplaced(&reflected(&gpu, scene, &with(&PROBE, &[correction]), 1)?, &truth))
        };
        for centre in [Vec3::ZERO, Vec3::new(0.9, 0.5, -1.2)] {
            let placed = off_centre(&s, centre);
            let [boxed, most_boxed] = found(&placed, "reflections.correction=box")?;
            let [traced, most_traced] = found(&placed, "reflections.correction=distance")?;
            let [off, _] = found(&placed, "reflections.correction=off")?;
            println!(
                "centre {centre}: misplaced by {boxed:.3} m (most {most_boxed:.3}) by the box, {traced:.3} m (most {most_traced:.3}) by \
                 distances, {off:.3} m without"
            );
            // The edges of the room and of the mirror that the probe itself sees are blended over a texel.
            ensure!(boxed < texel && traced < texel, "centre {centre}: {boxed} m and {traced} m, a texel is {texel} m");
            ensure!(off > 4.0 * texel, "without correction {off} m");
        }
        let [own, _] = found(&s, "reflections.correction=distance")?;
        println!("the camera's probe: {own:.3} m");
        ensure!(own < texel, "the camera's probe: {own} m");
    }
    Ok(())
}

/// Roughness by distance is what the formula says, and faces and directions are each other's inverse.
#[test]
fn functions_of_the_probe_are_their_formulas() -> Result<()> {
    #[repr(C)]
    #[derive(Clone, Copy, Pod, Zeroable)]
    struct Params {
        to: StorageImage,
        size: u32,
    }
    const SIZE: u32 = 32;
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel(
        "probe_functions.comp",
        r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/probe.glsl"
#include "lib/sampling.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint to; uint size; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(p, uvec2(size))) return;
    vec2 u = (vec2(p) + 0.5) / float(size);
    vec3 d = sample_sphere(u);
    vec2 at;
    uint face = cube_face(d, at);
    float back = distance(normalize(cube_direction(face, at)), d);
    ProbeHit hit = ProbeHit(d, 4.0 * u.x, 2.0, 1.0, 0.0);
    float roughness = probe_roughness(PROBE_NARROWING_ROUGHNESS, u.y, hit);
    float alpha = probe_roughness(PROBE_NARROWING_ALPHA, u.y, hit);
    // From inside of a box to its walls.
    vec3 origin = vec3(u - 0.5, 0.25);
    vec3 met = origin + leaves_box(origin, d, vec3(1.0, 2.0, 3.0)) * d;
    float on = largest_component(met / vec3(1.0, 2.0, 3.0)) - 1.0;
    float axis = leaves_box(vec3(0.5, 0.0, 0.0), vec3(0.0, 0.0, -1.0), vec3(0.5, 2.0, 3.0)) - 3.0;
    store(int(p.y) >= 0 ? to : 0u, p, vec4(back, roughness, alpha * alpha, abs(on) + abs(axis)));
}
"#,
    )?;
    let extent = Extent::new(SIZE, SIZE);
    let ran = bench.run(extent, &["test.functions:out"], |g, _| {
        let out = g.pass("test.functions", Queue::Graphics, |p| {
            let (out, to) = p.create("out", ImageDesc::fixed(Format::Rgba32Float, extent));
            (out.read(), move |c: &mut Record<'_>| {
                let params = Params { to: c.id(to), size: SIZE };
                c.dispatch(kernel, &params, extent);
            })
        });
        g.output(out);
        Ok(())
    })?;
    for (k, value) in ran.values("test.functions:out")?.iter().enumerate() {
        let [x, y] = [k as u32 % SIZE, k as u32 / SIZE].map(|n| (n as f32 + 0.5) / SIZE as f32);
        let ratio = 4.0 * x / 2.0;
        ensure!(value[0] < 1e-5 && value[3] < 1e-5, "direction {k}: {value:?}");
        ensure!((value[1] - (ratio * y).min(1.0)).abs() < 1e-5, "roughness {k}: {value:?}");
        ensure!((value[2] - (ratio * y * y).min(1.0)).abs() < 1e-5, "alpha {k}: {value:?}");
    }
    Ok(())
}

/// Boxes that overlap do not double the light, and white stays white over their borders.
#[test]
fn overlapping_probes_keep_white_white() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("boxes", camera([0.0, 2.0, 3.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(3.0), material([1.0; 3], 1.0, 0.2), Affine3A::IDENTITY);
    s.environment = Some(flat_environment(Vec3::ONE));
    let probe = |x: f64, fade: f32| ReflectionProbe {
        world_from_box: DAffine3::from_rotation_translation(
            glam::DQuat::from_rotation_y(0.3 * x),
            DVec3::new(x, 0.5, 0.0),
        ),
        half_size: Vec3::ONE,
        centre: Vec3::new(0.1, 0.2, 0.0),
        fade,
    };
    s.probes = vec![probe(-0.5, 0.3), probe(0.4, 0.5), probe(0.2, 0.0)];
    let (found, sky) = (reflected(&gpu, &s, &PROBE, 1)?, reflected(&gpu, &s, &SKY, 1)?);
    let apart = farthest(&found, &sky);
    println!("overlapping probes: {apart:.5} from white");
    ensure!(apart < 0.01, "{apart}");
    Ok(())
}

/// At the border of a box, what its probe shows goes over into what the camera's shows, and that into the sky.
#[test]
fn borders_have_no_edge() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("border", camera([0.0, 2.0, 4.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(4.0), material([1.0; 3], 1.0, 0.0), Affine3A::IDENTITY);
    // It captures in a black ball below the floor: the greatest difference that there can be.
    let black = Material { unlit: true, double_sided: true, ..material([0.0; 3], 0.0, 1.0) };
    add(&mut s, ball(0.2, Vec3::new(0.0, -0.5, 0.0)), black, Affine3A::IDENTITY);
    let far = ReflectionProbe {
        world_from_box: DAffine3::from_translation(DVec3::ZERO),
        half_size: Vec3::new(0.9, 1.0, 1.5),
        centre: Vec3::new(0.0, -0.5, 0.0),
        fade: 0.7,
    };
    s.environment = Some(flat_environment(Vec3::ONE));
    let step = |scene: &Scene, more: &[&'static str]| -> Result<[f64; 2]> {
        let found = reflected(&gpu, scene, &with(&with(&PROBE, &["reflections.correction=off"]), more), 1)?;
        let row = &found[20 * 32..21 * 32];
        let values: Vec<f64> = row.iter().map(|v| v.y).collect();
        let most = values.windows(2).map(|w| (w[0] - w[1]).abs()).fold(0.0, f64::max);
        Ok([most, values.iter().copied().fold(0.0, f64::max) - values.iter().copied().fold(f64::MAX, f64::min)])
    };
    let soft = Scene { probes: vec![far], ..s.clone() };
    let hard = Scene { probes: vec![ReflectionProbe { fade: 0.0, ..far }], ..s.clone() };
    let ([soft_step, range], [hard_step, _]) = (step(&soft, &[])?, step(&hard, &[])?);
    println!("at the border of a box: {soft_step:.3} of {range:.3} from pixel to pixel, without fade {hard_step:.3}");
    ensure!(range > 0.3 && soft_step < 0.4 * range && hard_step > 0.9 * range, "{soft_step} {hard_step} of {range}");
    Ok(())
}

fn rays(result: &FrameResult) -> u64 {
    let of = |name: &str| name.starts_with("reflections.capture_probe");
    result.sample.passes.iter().filter(|p| of(&p.name)).map(|p| p.rays_closest).sum()
}

/// Captures, filter and lookup are passes of their own; each frame captures as many faces as it is told, the first one all; where nothing moves,
/// captures end.
#[test]
fn faces_are_spread_over_frames() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("counted", camera([0.0, 1.0, 2.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(3.0), material([0.5; 3], 0.0, 0.2), Affine3A::IDENTITY);
    s.lights.push(sun(Vec3::Y));
    let face = 16 * 16;
    for faces in [1, 2, 3, 6] {
        let changes = format!("reflections.faces={faces}");
        let more =
            ["reflections.resolution=16", "reflections.indirect=false", "reflections.average=1", changes.as_str()];
        let config = config(&with(&PROBE, &more))?;
        let options = RenderOptions { width: 16, height: 16, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &config, options)?;
        let mut frame = || -> Result<FrameResult> {
            let request = FrameRequest { camera: &s.cameras[0], time: 0.0, view: None, read_back: false };
            renderer.frame(request)?.context("no frame")
        };
        let first = frame()?;
        for name in ["reflections.capture_probe", "reflections.filter_probe", "reflections.probe"] {
            ensure!(first.sample.passes.iter().any(|p| p.name == name), "no pass {name}");
        }
        ensure!(rays(&first) == 6 * face, "the first frame: {} rays", rays(&first));
        let second = rays(&frame()?);
        ensure!(second == faces * face, "faces={faces}: {second} rays");
        // Eight captures of each face, of which one was in the first frame and some in the second.
        let mut left = 0;
        for _ in 0..60 {
            left = rays(&frame()?);
        }
        ensure!(left == 0, "faces={faces}: captures go on with {left} rays where nothing moves");
    }
    Ok(())
}

/// Looking up in the dominant direction comes nearer to the truth of rough metal than looking up in the mirror direction.
#[test]
fn the_dominant_direction_is_nearer_to_the_truth() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for roughness in [0.6, 0.8, 1.0] {
        let mut s = scene("floor", camera([0.0, 0.5, 2.5], [0.0, 0.0, 0.0]));
        add(&mut s, plane(2.0), material([1.0; 3], 1.0, roughness), Affine3A::IDENTITY);
        s.environment = Some(environment());
        let options = ReferenceOptions { only: Only::Reflections, depth: 2, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &s, SMALL, 256)?.mean;
        let of = |direction: &'static str| -> Result<f64> {
            let found = reflected(&gpu, &s, &with(&PROBE, &["reflections.correction=off", direction]), 1)?;
            // What is too dark everywhere is the albedo's error, not the direction's.
            let light = |all: &[DVec3]| all.iter().map(|v| v.element_sum()).sum::<f64>();
            let scale = light(&truth) / light(&found);
            Ok(error(&found.iter().map(|v| *v * scale).collect::<Vec<_>>(), &truth))
        };
        let (fit, cubic) = (of("reflections.direction=fit")?, of("reflections.direction=cubic")?);
        let mirror = of("reflections.direction=mirror")?;
        println!("roughness {roughness}: fit {fit:.4}, cubic {cubic:.4}, mirror {mirror:.4}");
        ensure!(fit < mirror && cubic < mirror, "roughness {roughness}: {fit} {cubic} {mirror}");
    }
    Ok(())
}

/// A lamp has one highlight, that of direct light: probes do not show it. Unlit surfaces they do.
#[test]
fn lamps_are_not_in_probes() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let brightest = |unlit: bool| -> Result<f64> {
        let mut s = scene("lamp", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
        add(&mut s, plane(3.0), material([1.0; 3], 1.0, 0.0), upright(0.0, FRAC_PI_2));
        let lamp = Material { emission: Vec3::splat(50.0), unlit, ..material([0.8; 3], 0.0, 1.0) };
        let lamp =
            Material { base_colour: if unlit { Vec4::new(50.0, 50.0, 50.0, 1.0) } else { lamp.base_colour }, ..lamp };
        add(&mut s, ball(0.5, Vec3::new(0.0, 0.0, 4.0)), lamp, Affine3A::IDENTITY);
        Ok(reflected(&gpu, &s, &PROBE, 1)?.iter().map(|v| v.y).fold(0.0, f64::max))
    };
    let (lamp, unlit) = (brightest(false)?, brightest(true)?);
    println!("a lamp of radiance 50 shows with {lamp:.3}, an unlit ball with {unlit:.3}");
    ensure!(lamp < 1.0 && unlit > 40.0, "a lamp of radiance 50 shows with {lamp}, an unlit ball with {unlit}");
    Ok(())
}

/// A camera before a mirror, and a red board behind the camera.
#[test]
fn a_probe_shows_what_is_behind_the_camera() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("mirror", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(3.0), material([1.0; 3], 1.0, 0.0), upright(0.0, FRAC_PI_2));
    add(&mut s, plane(3.0), material([0.8, 0.1, 0.1], 0.0, 1.0), upright(4.0, -FRAC_PI_2));
    s.environment = Some(environment());
    let redness = |changes: &[&str]| -> Result<f64> {
        let found = reflected(&gpu, &s, changes, 1)?;
        Ok(found[16 * 32 + 16].x / found[16 * 32 + 16].y)
    };
    let (sky, probe) = (redness(&SKY)?, redness(&PROBE)?);
    println!("red over green: {sky:.2} from the sky, {probe:.2} from the probe");
    ensure!(probe > 4.0 && sky < 2.0, "red over green: {sky} from the sky, {probe} from the probe");
    Ok(())
}

/// What moves is where it is after each face was captured once: 6 / `faces` frames, after which the picture is as near to the one that a new
/// renderer makes as it is later.
#[test]
fn what_moves_shows_in_as_many_frames_as_promised() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = builtin("carousel")?;
    for material in &mut s.materials {
        // Unlit: no noise.
        (material.unlit, material.emission) = (true, Vec3::ZERO);
    }
    add(&mut s, plane(1.2), material([1.0; 3], 1.0, 0.0), Affine3A::from_translation(Vec3::new(0.0, 0.9, 2.2)));
    let later = 1.3;
    let changes = config(&with(&PROBE, &["reflections.faces=2"]))?;
    let options = RenderOptions { width: 32, height: 32, check: true, ..RenderOptions::default() };
    let show = |times: &[f64]| -> Result<Vec<DVec3>> {
        let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &changes, options)?;
        let mut last = Vec::new();
        for time in times {
            let view = Some(("reflections.probe", "radiance"));
            let request = FrameRequest { camera: &s.cameras[0], time: *time, view, read_back: true };
            let image = renderer.frame(request)?.and_then(|f| f.images).context("no image")?.linear;
            last = image.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).collect();
        }
        Ok(last)
    };
    let wanted = show(&[later])?;
    let before = error(&show(&[0.0; 8])?, &wanted);
    let promised: Vec<f64> = [0.0; 8].into_iter().chain([later; 3]).collect();
    let after = error(&show(&promised)?, &wanted);
    println!("before {before:.4}, after three frames {after:.4}");
    ensure!(before > 0.02 && after < 0.1 * before, "before {before}, after three frames {after}");
    Ok(())
}

/// Light that goes round in a box of rough metal, from capture to capture, stays bounded and comes to rest.
#[test]
fn captured_light_stays_bounded() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = builtin("cornell")?;
    for material in &mut s.materials {
        (material.metalness, material.roughness) = (1.0, 0.7);
    }
    let [min, max] = SceneFacts::new(&s).bounds.context("there is geometry")?.map(DVec3::from_array);
    let half_size = (0.6 * (max - min)).as_vec3();
    let centre = Vec3::Y * 0.3 * half_size.y;
    s.probes = vec![ReflectionProbe {
        world_from_box: DAffine3::from_translation(0.5 * (min + max)),
        half_size,
        centre,
        fade: 0.0,
    }];
    let light = |more: &[&'static str], frames: u32| -> Result<f64> {
        let changes = with(&with(&PROBE, &["reflections.faces=6", "reflections.resolution=16"]), more);
        Ok(settled(&gpu, &s, &changes, frames)?.iter().map(|v| v.element_sum()).sum())
    };
    let once = light(&["reflections.indirect=false"], 100)?;
    let (soon, later) = (light(&[], 100)?, light(&[], 200)?);
    let truth: f64 =
        truth_of(ReferenceOptions { only: Only::Reflections, ..ReferenceOptions::default() }, &gpu, &s, SMALL, 256)?
            .mean
            .iter()
            .map(|v| v.element_sum())
            .sum();
    println!(
        "of the light of all bounces: direct {:.3}, {:.3} after 100 frames, {:.3} after 200",
        once / truth,
        soon / truth,
        later / truth
    );
    ensure!(
        soon > 1.1 * once && later < 1.4 * truth && (later / soon - 1.0).abs() < 0.06,
        "{once} {soon} {later} of {truth}"
    );
    Ok(())
}
