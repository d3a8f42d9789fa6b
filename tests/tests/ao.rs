//! Ambient occlusion: rays against the reference and against closed forms, horizons of the depth image against the reference, and the
//! effect of a range of 0 and of a slot that is off.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Mat4, Quat, Vec3, Vec4};
use magpie::prelude::*;
use magpie::scene::{Camera, Scene};
use magpie_accuracy::metrics::{Picture, RELMSE_EPSILON, relmse, rmse};
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_shaders::StorageImage;
use magpie_tests::bench::Bench;
use magpie_tests::fixtures;
use magpie_tests::harness::{builtin, config_without_bounces, gpu};
use std::env;
use std::f64::consts::PI;

/// Renders frames with every check on and passes each to `look`.
fn frames(
    gpu: &Gpu,
    scene: &Scene,
    changes: &[&str],
    size: [u32; 2],
    count: u32,
    mut look: impl FnMut(&FrameResult) -> Result<()>,
) -> Result<()> {
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config_without_bounces(changes)?, options)?;
    renderer.read_slots(&["ao", "direct"])?;
    for _ in 0..count {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let result = renderer.frame(request)?.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        look(&result)?;
    }
    Ok(())
}

/// Mean openness of each pixel over some frames.
fn openness(gpu: &Gpu, scene: &Scene, changes: &[&str], size: [u32; 2], count: u32) -> Result<Vec<f64>> {
    let mut sum = vec![0.0; (size[0] * size[1]) as usize];
    frames(gpu, scene, changes, size, count, |frame| {
        let image = frame.slots[0].1.as_ref().context("no image of openness")?.values();
        sum.iter_mut().zip(image).for_each(|(s, v)| *s += f64::from(v[0]));
        Ok(())
    })?;
    Ok(sum.into_iter().map(|s| s / f64::from(count)).collect())
}

fn truth(gpu: &Gpu, scene: &Scene, size: [u32; 2], range: f32, samples: u32) -> Result<Estimate> {
    let options = ReferenceOptions {
        width: size[0],
        height: size[1],
        only: Only::AmbientOcclusion,
        pixel: PixelSampling::Centre,
        ao_range: range,
        check: true,
        ..ReferenceOptions::default()
    };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

fn picture(size: [u32; 2], values: impl IntoIterator<Item = f64>) -> Picture {
    let values: Vec<f32> = values.into_iter().map(|v| v as f32).collect();
    Picture::grey(size[0] as usize, size[1] as usize, &values)
}

/// relMSE due to the standard error of a ground truth.
fn noise_floor(estimate: &Estimate) -> f64 {
    let errors = estimate.standard_error();
    let share = |(e, m): (&DVec3, &DVec3)| e.x * e.x / (m.x * m.x + RELMSE_EPSILON);
    errors.iter().zip(&estimate.mean).map(share).sum::<f64>() / errors.len() as f64
}

#[test]
fn rays_converge_to_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Where hardly any of the hemisphere is open, as between leaves, the ground truth's noise is large relative to its value: its known
    // contribution is subtracted unless there is time for a converged one.
    let full = env::var_os("MAGPIE_FULL").is_some();
    let (samples, most_noise) = if full { (65536, 5e-5) } else { (4096, 4e-4) };
    for (name, size) in [("cornell", [24, 24]), ("courtyard", [32, 18])] {
        let scene = builtin(name)?;
        let truth = truth(&gpu, &scene, size, 1.0, samples)?;
        let found = openness(
            &gpu,
            &scene,
            &["stages.ao=ray-traced", "ao.denoiser=none", "ao.rays=64"],
            size,
            if full { 1024 } else { 64 },
        )?;
        let wanted = picture(size, truth.mean.iter().map(|m| m.x));
        // At the edges of leaves raster and ray may see different leaves, with different openness.
        let is_another = |(f, m): (&f64, &DVec3)| (f - m.x).abs() > 0.05;
        let others = found.iter().zip(&truth.mean).filter(|pair| is_another(*pair)).count();
        ensure!(others * 100 <= found.len(), "{name}: {others} pixels are off by more than 0.05");
        let kept = found.iter().zip(&truth.mean).map(|(f, m)| if is_another((f, m)) { m.x } else { *f });
        let (error, floor) = (relmse(&picture(size, kept), &wanted)?, noise_floor(&truth));
        let white = relmse(&picture(size, vec![1.0; found.len()]), &wanted)?;
        println!(
            "{name}: {others} pixels show another surface; relMSE {error:.2e}; noise of the truth alone {floor:.2e}; of white {white:.2e}; mean {:.5} against {:.5}",
            found.iter().sum::<f64>() / found.len() as f64,
            wanted.mean_luminance()
        );
        ensure!(floor < most_noise, "{name}: the truth is too noisy to tell: {floor}");
        let taken_off = if full { 0.0 } else { floor };
        ensure!(error - taken_off < 1e-4 && white > 1e-2, "{name}: {error}, of which {floor} is noise of the truth");
    }
    Ok(())
}

/// The mean of one ray per pixel over frames has less error than as many independent rays.
#[test]
fn frames_add_up() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, size) = (builtin("cornell")?, [32, 32]);
    let truth = openness(&gpu, &scene, &["stages.ao=ray-traced", "ao.denoiser=none", "ao.rays=64"], size, 64)?;
    for count in [1, 16, 64] {
        let found = openness(&gpu, &scene, &["stages.ao=ray-traced", "ao.denoiser=none"], size, count)?;
        let n = truth.len() as f64;
        let random = truth.iter().map(|p| p * (1.0 - p) / f64::from(count)).sum::<f64>() / n;
        let error = found.iter().zip(&truth).map(|(f, t)| (f - t).powi(2)).sum::<f64>() / n;
        println!("{count} frames of one ray: variance {error:.2e}, of independent rays {random:.2e}");
        let most = if count == 1 { 1.1 } else { 0.6 };
        ensure!(error < most * random, "{count} frames: {error} against {random}");
    }
    // The same rays, in one frame or over eight.
    let (one, eight) = ("ao.rays=8", "ao.rays=1");
    let at_once = openness(&gpu, &scene, &["stages.ao=ray-traced", "ao.denoiser=none", one], size, 1)?;
    ensure!(
        at_once == openness(&gpu, &scene, &["stages.ao=ray-traced", "ao.denoiser=none", eight], size, 8)?,
        "rays 0 to 7 differ"
    );
    Ok(())
}

/// The point of a plane at a pixel's centre.
fn seen_on(camera: &Camera, size: [u32; 2], pixel: usize, normal: Vec3) -> Option<Vec3> {
    let clip: Mat4 = camera.clip_from_view(size[0] as f32 / size[1] as f32) * camera.view_from_world(DVec3::ZERO);
    let (x, y) = (pixel % size[0] as usize, pixel / size[0] as usize);
    let ndc = |at: usize, n: u32| (at as f32 + 0.5) / n as f32 * 2.0 - 1.0;
    let near = clip.inverse() * Vec4::new(ndc(x, size[0]), ndc(y, size[1]), 1.0, 1.0);
    let (eye, near) = (camera.eye().as_vec3(), near.truncate() / near.w);
    let along = near - eye;
    let t = -eye.dot(normal) / along.dot(normal);
    (t > 0.0).then(|| eye + t * along)
}

/// A floor and optionally a wall at x = 0, much larger than every range. The wall is visible up to a height of 1.6 metres.
fn floor(wall: bool) -> Scene {
    let mut scene = fixtures::scene("crease", fixtures::camera(Vec3::new(3.0, 3.0, 0.4), Vec3::ZERO));
    fixtures::add(&mut scene, fixtures::plane(50.0), fixtures::material([0.5; 3], 0.0, 1.0), Affine3A::IDENTITY);
    if wall {
        let upright = Affine3A::from_quat(Quat::from_rotation_z(-std::f32::consts::FRAC_PI_2));
        fixtures::add(&mut scene, fixtures::plane(50.0), fixtures::material([0.5; 3], 0.0, 1.0), upright);
    }
    scene
}

/// Openness at a distance from an infinite wall that occludes within `range`: projected onto the ground, which cancels the cosine (Nusselt
/// 1928), the wall covers the part of the unit disc beyond distance / range.
fn beside_a_wall(distance: f64, range: f64) -> f64 {
    let c = (distance / range).min(1.0);
    1.0 - (c.acos() - c * (1.0 - c * c).sqrt()) / PI
}

#[test]
fn a_crease_is_as_dark_as_known_on_paper() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    ensure!((beside_a_wall(0.0, 1.0) - 0.5).abs() < 1e-12 && beside_a_wall(2.0, 1.0) == 1.0, "the form itself");
    let (scene, size) = (floor(true), [64, 36]);
    let camera = &scene.cameras[0];
    for range in [0.25, 1.0, 4.0] {
        let set = format!("ao.range={range:?}");
        let rays = openness(&gpu, &scene, &["stages.ao=ray-traced", "ao.denoiser=none", "ao.rays=64", &set], size, 16)?;
        let horizons = openness(&gpu, &scene, &["stages.ao=screen-space", &set], size, 1)?;
        let (mut worst, mut square, mut square_of_horizons, mut darkest) = (0.0_f64, 0.0, 0.0, 1.0_f64);
        let mut pixels = 0.0;
        for pixel in 0..rays.len() {
            let Some(on_floor) = seen_on(camera, size, pixel, Vec3::Y) else { continue };
            // To the left of the edge the pixel shows the wall.
            let distance = match seen_on(camera, size, pixel, Vec3::X) {
                Some(on_wall) if on_floor.x < 0.0 => on_wall.y,
                _ => on_floor.x,
            };
            let wanted = beside_a_wall(distance.into(), range);
            worst = worst.max((rays[pixel] - wanted).abs());
            square += (rays[pixel] - wanted).powi(2);
            square_of_horizons += (horizons[pixel] - wanted).powi(2);
            darkest = darkest.min(wanted);
            pixels += 1.0;
        }
        let (of_rays, of_horizons) = ((square / pixels).sqrt(), f64::sqrt(square_of_horizons / pixels));
        println!(
            "range {range}: rays are off by {of_rays:.5}, at most {worst:.4}; horizons by {of_horizons:.4}; darkest {darkest:.3}"
        );
        ensure!(pixels > 2000.0 && darkest < 0.6, "range {range}: the crease is not in the picture");
        ensure!(of_rays < 2e-3 && worst < 0.02, "range {range}: {of_rays}, at most {worst}");
        // Geometry outside the picture is missing in the depth image.
        ensure!(range > 1.5 || of_horizons < 0.05, "range {range}: horizons are off by {of_horizons}");
    }
    Ok(())
}

#[test]
fn nothing_hides_an_open_floor() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = floor(false);
    for (changes, least) in [
        (&["stages.ao=ray-traced", "ao.denoiser=none", "ao.rays=8"][..], 1.0),
        (&["stages.ao=ray-traced", "ao.denoiser=none", "ao.rays=8", "ao.resolution=half"], 1.0),
        (&["stages.ao=screen-space"], 0.999),
        (&["stages.ao=screen-space", "ao.slices=1", "ao.noise=moving"], 0.999),
        (&["stages.ao=screen-space", "ao.resolution=half", "ao.thickness=0.0"], 0.999),
    ] {
        let found = openness(&gpu, &scene, changes, [65, 35], 2)?;
        let darkest = found.iter().copied().fold(1.0, f64::min);
        println!("{changes:?}: {darkest}");
        ensure!(darkest >= least && found.iter().all(|f| *f <= 1.0005), "{changes:?}: {darkest}");
    }
    Ok(())
}

#[test]
fn without_a_range_or_switched_off_there_is_no_pass() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, size) = (builtin("courtyard")?, [48, 27]);
    // Names of the slot's passes, the picture, direct light, and whether there is an openness image.
    type Outcome = (Vec<String>, Vec<u8>, Vec<u8>, bool);
    let run = |changes: &[&str]| -> Result<Outcome> {
        let mut outcome = None;
        frames(&gpu, &scene, changes, size, 1, |frame| {
            let d = &frame.declaration;
            let passes = (0..d.passes.len() as u32).map(|p| d.pass_name(p).to_owned());
            let passes = passes.filter(|name| name.starts_with("ao.")).collect();
            let bytes = frame.images.as_ref().context("no image")?.linear.bytes.clone();
            let direct = frame.slots[1].1.as_ref().context("no direct light")?.bytes.clone();
            outcome = Some((passes, bytes, direct, frame.slots[0].1.is_some()));
            Ok(())
        })?;
        outcome.context("no frame")
    };
    let off = run(&["stages.ao=off"])?;
    ensure!(off.0.is_empty() && !off.3, "off: {:?}", off.0);
    for (name, changes, passes) in [
        ("ray-traced", &["stages.ao=ray-traced", "ao.denoiser=none"][..], &["ao.trace"][..]),
        ("screen-space", &["stages.ao=screen-space"], &["ao.search", "ao.filter"]),
    ] {
        let on = run(changes)?;
        ensure!(on.0 == passes && on.3, "{name}: {:?}", on.0);
        ensure!(on.1 != off.1, "{name} changes nothing");
        ensure!(on.2 == off.2, "{name} changes direct light");
        let with = |change| [changes, &[change]].concat();
        let half = run(&with("ao.resolution=half"))?;
        ensure!(half.0.len() == passes.len() + 1 && half.0.last().is_some_and(|p| p == "ao.upsample"), "{:?}", half.0);
        ensure!(run(&with("ao.range=0.0"))? == off, "{name} with a range of 0 is not as if it were off");
    }
    Ok(())
}

/// Accuracy of the screen-space implementation by settings. A white picture, and the best constant grey, exceed every limit by far.
#[test]
fn horizons_are_near_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, size, limit) in [("cornell", [96, 96], 0.55), ("courtyard", [128, 72], 0.65)] {
        let scene = builtin(name)?;
        let truth = truth(&gpu, &scene, size, 1.0, 256)?;
        let wanted = picture(size, truth.mean.iter().map(|m| m.x));
        let mean = wanted.mean_luminance();
        let grey = rmse(&picture(size, vec![mean; truth.mean.len()]), &wanted)?;
        let error = |changes: &[&str]| -> Result<f64> {
            let all: Vec<&str> = ["stages.ao=screen-space"].iter().chain(changes).copied().collect();
            let found = picture(size, openness(&gpu, &scene, &all, size, 1)?);
            let error = rmse(&found, &wanted)?;
            println!(
                "{name} {changes:?}: RMSE {error:.4}, relMSE {:.4}, mean {:.3} against {mean:.3}; one grey {grey:.4}",
                relmse(&found, &wanted)?,
                found.mean_luminance()
            );
            Ok(error)
        };
        let default = error(&[])?;
        ensure!(default < limit * grey, "{name}: {default} against {grey}");
        ensure!(error(&["ao.resolution=half"])? < (limit + 0.2) * grey, "{name} at half resolution");
        ensure!(error(&["ao.slices=4", "ao.steps=16"])? < default * 1.1, "{name}: more work is worse");
    }
    Ok(())
}

const CURVE: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/occlusion.glsl"
layout(local_size_x = 8) in;
layout(push_constant, scalar) uniform Push { uint image; vec3 of[8]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < 8u) store(image, ivec2(i, 0), vec4(specular_openness(of[i].x, of[i].y, of[i].z)));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Curve {
    image: StorageImage,
    of: [[f32; 3]; 8],
}

/// The curve of Lagarde and de Rousiers 2014, listing 26.
fn curve(openness: f64, n_v: f64, alpha: f64) -> f64 {
    ((n_v + openness).powf((-16.0 * alpha - 1.0).exp2()) - 1.0 + openness).clamp(0.0, 1.0)
}

/// Unoccluded share of a GGX lobe without Fresnel: visible normals, height-correlated Smith masking and shadowing.
fn seen_share(alpha: f64, v: DVec3, hidden: impl Fn(DVec3) -> bool) -> f64 {
    let lambda = |c: f64| ((1.0 + alpha * alpha * (1.0 / (c * c) - 1.0)).sqrt() - 1.0) / 2.0;
    let (mut all, mut seen) = (0.0, 0.0);
    for (x, y) in points() {
        let c = ((1.0 - x) / (1.0 + (alpha * alpha - 1.0) * x)).sqrt();
        let s = (1.0 - c * c).max(0.0).sqrt();
        let h = DVec3::new(s * (2.0 * PI * y).cos(), s * (2.0 * PI * y).sin(), c);
        let l = 2.0 * h.dot(v) * h - v;
        if h.dot(v) <= 0.0 || l.z <= 1e-6 {
            continue;
        }
        let weight = h.dot(v) / (v.z * c) / (1.0 + lambda(v.z) + lambda(l.z));
        all += weight;
        seen += if hidden(l) { 0.0 } else { weight };
    }
    seen / all
}

/// Points that cover the unit square evenly.
fn points() -> impl Iterator<Item = (f64, f64)> {
    const COUNT: u32 = 512;
    (0..COUNT).map(|i| ((f64::from(i) + 0.5) / f64::from(COUNT), (f64::from(i) * 0.618_033_988_7).fract()))
}

/// The shader's curve has the values that its source implies, and its error against ray-traced lobes is no greater with alpha than with
/// perceptual roughness, a misreading of the source that doubles the roughness.
#[test]
fn specular_openness_follows_its_source_and_errs_no_more() -> Result<()> {
    // Openness, n·v and alpha; then the value computed by hand, such as 1.3^(2^-5) - 0.5 = 1.008233 - 0.5.
    let paper = [
        ([0.5, 0.8, 0.25], 0.508_233),
        ([0.3, 0.2, 0.04], 0.100_594),
        ([0.24, 0.25, 0.0], 0.0),  // 0.7 - 0.76
        ([0.75, 0.69, 0.0], 0.95), // the root of 1.44 is 1.2
        ([0.5, 0.5, 0.1], 0.5),
        ([0.4, 0.9, 1.0], 0.400_002), // 1.3^(2^-17) - 0.6
        ([1.0, 0.9, 0.0], 1.0),
        ([0.0, 0.25, 0.0625], 0.0), // 0.25^(1/4) - 1
    ];
    for ([openness, n_v, alpha], wanted) in paper {
        let found = curve(openness, n_v, alpha);
        ensure!((found - wanted).abs() < 1e-6, "{openness} {n_v} {alpha}: {found} is not {wanted}");
    }
    if let Some(gpu) = gpu()? {
        let mut bench = Bench::new(&gpu)?;
        let kernel = bench.kernel("curve.comp", CURVE)?;
        let ran = bench.run(Extent::new(8, 1), &["test.curve:image"], |g, _| {
            let image = g.pass("test.curve", Queue::Graphics, |p| {
                let (image, to) = p.create("image", ImageDesc::full(Format::R32Float));
                (image.read(), move |c: &mut Record<'_>| {
                    let params = Curve { image: c.id(to), of: paper.map(|(of, _)| of.map(|x| x as f32)) };
                    c.dispatch_groups(kernel, &params, [1, 1, 1]);
                })
            });
            g.output(image);
            Ok(())
        })?;
        for (found, (of, wanted)) in ran.clean()?.values("test.curve:image")?.iter().zip(paper) {
            ensure!((f64::from(found[0]) - wanted).abs() < 1e-5, "{of:?}: {} is not {wanted}", found[0]);
        }
    }

    // Occluders: walls of three heights, pits of three depths, an overhang, a corner.
    let hides: [fn(DVec3) -> bool; 8] = [
        |l| l.x > 0.0 && l.z < 0.33 * l.x,
        |l| l.x > 0.0 && l.z < l.x,
        |l| l.x > 0.0 && l.z < 3.0 * l.x,
        |l| l.z < 0.3,
        |l| l.z < 0.6,
        |l| l.z < 0.9,
        |l| l.x > 0.0 && l.z > 0.5,
        |l| (l.x > 0.0 && l.z < 2.0 * l.x) || (l.y > 0.0 && l.z < 2.0 * l.y),
    ];
    let cosine = |(x, y): (f64, f64)| {
        DVec3::new(x.sqrt() * (2.0 * PI * y).cos(), x.sqrt() * (2.0 * PI * y).sin(), (1.0 - x).sqrt())
    };
    let open = hides.map(|hidden| points().filter(|p| !hidden(cosine(*p))).count() as f64 / points().count() as f64);
    // Squared errors: with alpha, with perceptual roughness, without occlusion.
    let (mut all, mut count) = ([0.0; 3], 0.0);
    for roughness in (1..=10).map(|i| 0.1 * f64::from(i)) {
        let (mut own, before) = ([0.0; 3], count);
        for (n_v, turn) in [0.1, 0.3, 0.5, 0.7, 0.9].into_iter().flat_map(|n_v| (0..8).map(move |t| (n_v, t))) {
            let (sine, turn) = ((1.0_f64 - n_v * n_v).sqrt(), f64::from(turn) * PI / 4.0);
            let v = DVec3::new(sine * turn.cos(), sine * turn.sin(), n_v);
            for (hidden, open) in hides.iter().zip(open) {
                let truth = seen_share(roughness * roughness, v, hidden);
                let guesses = [curve(open, n_v, roughness * roughness), curve(open, n_v, roughness), 1.0];
                own.iter_mut().zip(guesses).for_each(|(sum, guess)| *sum += (guess - truth) * (guess - truth));
                count += 1.0;
            }
        }
        let rms = own.map(|sum| (sum / (count - before)).sqrt());
        println!(
            "roughness {roughness:.1}: alpha {:.4}, perceptual {:.4}, nothing hidden {:.4}",
            rms[0], rms[1], rms[2]
        );
        all.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
    }
    let [alpha, perceptual, nothing] = all.map(|sum| (sum / count).sqrt());
    println!("all: alpha {alpha:.4}, perceptual {perceptual:.4}, nothing hidden {nothing:.4}");
    ensure!(alpha < perceptual && alpha < 0.5 * nothing, "{alpha} {perceptual} {nothing}");
    Ok(())
}
