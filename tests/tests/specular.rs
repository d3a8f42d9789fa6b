//! Dielectric reflections by KHR_materials_specular and KHR_materials_ior, in the frame and in the reference: closed forms, textures, and
//! one against the other.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Quat, Vec2, Vec3};
use magpie::gpu::{Buffer, Gpu};
use magpie::graph::{Access, Domain, Extent, Format, Queue, Record};
use magpie::scene::{ColourSpace, Environment, Material, Mesh, Sampler, Scene, Sphere, Texture, TextureUse};
use magpie_passes::reference::{Only, PixelSampling, Reference, ReferenceOptions};
use magpie_shaders::Address;
use magpie_tests::against::{self, Shown};
use magpie_tests::bench::{Bench, results};
use magpie_tests::fixtures::{add, camera, material, plane, scene, sphere, sun};
use magpie_tests::harness::{config, gpu, linear, render};
use std::f64::consts::PI;
use std::sync::Arc;

const EDGE: u32 = 16;

/// A dielectric with this specular strength and colour.
fn dielectric(colour: [f32; 3], roughness: f32, specular: f32, specular_colour: [f32; 3]) -> Material {
    Material { specular, specular_colour: Vec3::from(specular_colour), ..material(colour, 0.0, roughness) }
}

/// A plane that fills a narrow view, at an angle to its normal.
fn seen_at(degrees: f64, material: Material) -> Scene {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let eye = magpie::scene::Camera { vertical_fov: 2e-3, ..camera([0.0, 4.0 * cos, 4.0 * sin], [0.0; 3]) };
    let mut s = scene("a plane", eye);
    add(&mut s, plane(20.0), material, Affine3A::IDENTITY);
    s
}

fn even(radiance: Vec3) -> Environment {
    let radiance = vec![radiance; 8].into();
    Environment { name: "even".to_owned(), width: 4, height: 2, radiance, scale: 1.0, turn: 0.0 }
}

fn mean(values: impl ExactSizeIterator<Item = DVec3>) -> DVec3 {
    let n = values.len() as f64;
    values.sum::<DVec3>() / n
}

/// Mean of an output of the frame.
fn framed(gpu: &Gpu, scene: &Scene, changes: &[&str], view: (&str, &str)) -> Result<DVec3> {
    let changes: Vec<&str> = ["shadows.edges=hard"].iter().chain(changes).copied().collect();
    let pixels = linear(render(gpu, scene, &config(&changes)?, [EDGE, EDGE], 1, Some(view))?)?;
    Ok(mean(pixels.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3())))
}

/// Mean of the reference.
fn traced(gpu: &Gpu, scene: &Scene, only: Only, samples: u32) -> Result<DVec3> {
    let pixel = PixelSampling::Centre;
    let options = ReferenceOptions { width: EDGE, height: EDGE, only, pixel, check: true, ..Default::default() };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(mean(reference.estimate().mean.iter().copied()))
}

/// Greatest relative difference of a channel.
fn off(found: DVec3, wanted: DVec3) -> f64 {
    ((found - wanted) / wanted).abs().max_element()
}

/// With a specularFactor of 0 there is no reflection and no loss of the diffuse part: albedo / pi times irradiance, for all angles,
/// roughnesses, specular colours and indices of refraction.
#[test]
fn without_a_reflection_it_is_lambert() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let to_sun = Vec3::new(0.3, 0.9, -0.5).normalize();
    let (colour, white) = ([0.5, 0.22, 0.06], [1.0; 3]);
    // The compact G-buffer stores base colour in 8 bits, where only white is exact.
    for (degrees, roughness, albedo, tint, ior, precision) in [
        (10.0, 1.0, colour, [1.0; 3], 1.5, "full"),
        (60.0, 0.5, colour, [4.0, 1.0, 0.0], 1.5, "full"),
        (80.0, 0.1, colour, [1.0; 3], 2.4, "full"),
        (45.0, 0.7, white, [1.0; 3], 1.5, "compact"),
    ] {
        let bare = Material { ior, ..dielectric(albedo, roughness, 0.0, tint) };
        let mut s = seen_at(degrees, bare);
        s.lights.push(sun(to_sun));
        let wanted = Vec3::from(albedo).as_dvec3() * f64::from(to_sun.y);
        let set = format!("gbuffer.precision={precision}");
        let frame = framed(&gpu, &s, &[&set], ("direct.shade", "radiance"))?;
        let truth = traced(&gpu, &s, Only::All, 16)?;
        s.materials[0].specular = 1.0;
        let with = off(traced(&gpu, &s, Only::All, 64)?, wanted);
        println!(
            "{degrees} degrees, roughness {roughness}, {precision}: frame {:.4} % off Lambert, reference {:.4} %; with the reflection {:.1} %",
            100.0 * off(frame, wanted),
            100.0 * off(truth, wanted),
            100.0 * with
        );
        ensure!(off(frame, wanted) < 0.005, "frame: {frame}, and {wanted} is right");
        ensure!(off(truth, wanted) < 0.001, "reference: {truth}, and {wanted} is right");
        ensure!(with > 0.02, "a reflection should make a difference: {with}");
    }
    // Sky light too: under uniform light the surface reflects its base colour.
    let mut s = seen_at(60.0, dielectric(colour, 0.5, 0.0, [1.0; 3]));
    s.environment = Some(even(Vec3::ONE));
    let wanted = Vec3::from(colour).as_dvec3();
    let gi = framed(&gpu, &s, &["stages.gi=sky", "stages.ao=off", "gbuffer.precision=full"], ("gi.sky", "radiance"))?;
    // Where nothing reflects there is no such pass; with another surface, out of sight below this one, there is.
    let mut mixed = s.clone();
    let below = Affine3A::from_translation(Vec3::NEG_Y * 9.0);
    add(&mut mixed, sphere(4), dielectric(colour, 0.5, 1.0, [1.0; 3]), below);
    let mirrored = framed(&gpu, &mixed, &["stages.ao=off"], ("reflections.sky", "radiance"))?;
    let truth = traced(&gpu, &s, Only::All, 256)?;
    println!("even sky: frame {:.4} % off, reference {:.4} %", 100.0 * off(gi, wanted), 100.0 * off(truth, wanted));
    ensure!(off(gi, wanted) < 0.005 && mirrored == DVec3::ZERO, "gi {gi}, reflections {mirrored}");
    ensure!(off(truth, wanted) < 0.005, "reference: {truth}");
    Ok(())
}

/// Schlick's reflectance with the extension's f0 and f90.
fn schlick(ior: f64, specular: f64, colour: DVec3, cosine: f64) -> DVec3 {
    let f0 = (((ior - 1.0) / (ior + 1.0)).powi(2) * colour).min(DVec3::ONE) * specular;
    f0 + (DVec3::splat(specular) - f0) * (1.0 - cosine).powi(5)
}

/// A smooth black dielectric under uniform light shows its reflectance in every channel.
#[test]
fn a_coloured_mirror_shows_its_reflectance() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (degrees, ior, specular, colour) in [
        (20.0, 1.5, 1.0, [20.0, 8.0, 2.0]),
        (20.0, 1.5, 0.5, [1.0, 1.0, 1.0]),
        (20.0, 2.0, 0.8, [0.2, 0.6, 4.0]),
        (70.0, 1.5, 0.7, [0.0, 10.0, 40.0]),
    ] {
        let mut s = seen_at(degrees, Material { ior, ..dielectric([0.0; 3], 0.0, specular, colour) });
        s.environment = Some(even(Vec3::ONE));
        let wanted =
            schlick(f64::from(ior), f64::from(specular), Vec3::from(colour).as_dvec3(), degrees.to_radians().cos());
        let truth = traced(&gpu, &s, Only::All, 64)?;
        let frame = framed(&gpu, &s, &["stages.ao=off"], ("reflections.sky", "radiance"))?;
        println!(
            "{degrees} degrees, ior {ior}, {specular} {colour:?}: {wanted:.4}, reference {truth:.4}, frame {frame:.4}"
        );
        ensure!((truth - wanted).abs().max_element() < 0.003, "reference: {truth}, and {wanted} is right");
        // Rounding of f0 and f90 in the compact G-buffer (lib/gbuffer_specular.glsl).
        ensure!((frame - wanted).abs().max_element() < 0.01, "frame: {frame}, and {wanted} is right");
    }
    Ok(())
}

/// Balls and boards with many reflections under a directional and a local light.
fn many_reflections() -> Scene {
    let mut s = scene("reflections of their own", camera([0.0, 2.2, 4.6], [0.0, 0.35, 0.0]));
    add(&mut s, plane(5.0), dielectric([0.5, 0.45, 0.4], 0.6, 0.3, [1.0; 3]), Affine3A::IDENTITY);
    let kinds = [
        dielectric([0.8, 0.2, 0.1], 0.3, 1.0, [1.0; 3]),
        dielectric([0.8, 0.2, 0.1], 0.3, 0.0, [1.0; 3]),
        dielectric([0.1, 0.2, 0.6], 0.3, 1.0, [12.0, 4.0, 1.0]),
        dielectric([0.1, 0.2, 0.6], 0.5, 0.5, [0.2, 6.0, 25.0]),
        Material { ior: 2.2, ..dielectric([0.3; 3], 0.4, 1.0, [1.0; 3]) },
        Material { ior: 1.15, ..dielectric([0.3, 0.6, 0.3], 0.4, 1.0, [1.0; 3]) },
        Material { metalness: 0.5, ..dielectric([0.9, 0.7, 0.3], 0.4, 0.2, [1.0, 0.0, 1.0]) },
        Material { metalness: 1.0, ..dielectric([0.9, 0.7, 0.3], 0.4, 0.0, [0.0; 3]) },
    ];
    for (i, kind) in (0_u8..).zip(kinds) {
        let ball = Mesh {
            name: "ball".to_owned(),
            spheres: vec![Sphere { centre: Vec3::ZERO, radius: 0.42 }],
            ..Mesh::default()
        };
        let (x, z) = (f32::from(i % 4) - 1.5, f32::from(i / 4));
        add(&mut s, ball, kind, Affine3A::from_translation(Vec3::new(x, 0.43, 1.1 * z - 0.7)));
    }
    s.lights.push(sun(Vec3::new(-0.4, 0.8, 0.6)));
    s
}

/// The frame's direct light against the reference's. A parallel sun is free of noise in both, so only the G-buffer's rounding remains.
#[test]
fn frame_and_reference_agree() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let s = many_reflections();
    let shown = Shown { size: [96, 54], time: 0.0 };
    let truth = against::truth(&gpu, &s, shown, 16)?;
    let mut plain = s.clone();
    for m in &mut plain.materials {
        (m.ior, m.specular, m.specular_colour) = (1.5, 1.0, Vec3::ONE);
    }
    let (ignored, _) = against::mean(&gpu, &plain, &["shadows.edges=hard"], shown, 1)?;
    // In the compact G-buffer the base colour of the floor is off by 0.7 %, as in any scene.
    for (precision, median, most) in [("compact", 0.012, 0.02), ("full", 0.002, 0.01)] {
        let set = format!("gbuffer.precision={precision}");
        let (found, _) = against::mean(&gpu, &s, &["shadows.edges=hard", &set], shown, 1)?;
        let [error, _] = against::relmse(&found, &truth);
        let [without, _] = against::relmse(&ignored, &truth);
        // Pixels on the edge of a shadow or a ball may differ completely.
        let mut apart: Vec<f64> = found
            .iter()
            .zip(&truth.mean)
            .filter(|(_, t)| t.max_element() > 0.02)
            .map(|(f, t)| (*f - *t).abs().max_element() / t.max_element())
            .collect();
        apart.sort_by(f64::total_cmp);
        let share = |p: f64| apart[((apart.len() - 1) as f64 * p) as usize];
        println!(
            "{precision}: relMSE {error:.2e} ({without:.2e} with all reflections alike); median {:.2e}, 95 % within {:.2e}, 99 % within {:.2e}",
            share(0.5),
            share(0.95),
            share(0.99)
        );
        ensure!(apart.len() > 2000, "only {} pixels are lit", apart.len());
        ensure!(
            share(0.5) < median && share(0.95) < most && share(0.99) < 0.05,
            "{precision}: frame and reference differ"
        );
        ensure!(without > 100.0 * error, "{without} against {error}: nothing would be seen of the extension");
    }
    Ok(())
}

/// A texture with a ramp of strengths in alpha, and colours in the other channels.
fn textured() -> Scene {
    let mut s = seen_at(30.0, dielectric([0.0; 3], 0.0, 0.9, [10.0, 5.0, 5.0]));
    let eye = magpie::scene::Camera { vertical_fov: 0.4, ..s.cameras[0].clone() };
    s.cameras[0] = eye;
    let texel = |x: u8, y: u8| [60 + 60 * x, 255 - 50 * y, 100 + 40 * y, 40 + 70 * x];
    let rgba: Vec<u8> = (0..16_u8).flat_map(|i| texel(i % 4, i / 4)).collect();
    s.textures.push(Texture::new("strength".to_owned(), [4, 4], ColourSpace::Linear, rgba.clone()));
    s.textures.push(Texture::new("colour".to_owned(), [4, 4], ColourSpace::Srgb, rgba));
    s.samplers.push(Sampler { linear_magnify: false, ..Sampler::default() });
    let used = |texture| Some(TextureUse { texture, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] });
    s.materials[0].specular_texture = used(0);
    s.materials[0].specular_colour_texture = used(1);
    s.meshes[0].uv0 = s.meshes[0].positions.iter().map(|p| Vec2::new(0.7 * p.x + 0.03, 0.7 * p.z + 0.03)).collect();
    s.environment = Some(even(Vec3::ONE));
    s
}

/// Strength from alpha, colour decoded from sRGB: frame and reference read the same texels, with known results.
#[test]
fn textures_are_read_where_the_extension_has_them() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let s = textured();
    let size = [64, 48];
    let options = ReferenceOptions {
        width: size[0],
        height: size[1],
        pixel: PixelSampling::Centre,
        check: true,
        ..Default::default()
    };
    let mut reference = Reference::new(&gpu, &s, &s.cameras[0], options)?;
    reference.add(128)?;
    let changes = config(&["stages.ao=off", "gbuffer.precision=full"])?;
    let frame = linear(render(&gpu, &s, &changes, size, 1, Some(("reflections.sky", "radiance")))?)?;
    let eye = magpie_tests::oracle::gbuffer::Eye::new(&s.cameras[0], Extent::new(size[0], size[1]));
    let linear_of = |c: u8| ((f64::from(c) / 255.0 + 0.055) / 1.055).powf(2.4);
    let (mut compared, mut sum, mut apart, mut apart_frame) = (0, 0.0, 0.0_f64, 0.0_f64);
    for (at, (truth, shown)) in reference.estimate().mean.iter().zip(frame.values()).enumerate() {
        let ray = eye.pixel_ray(at);
        let p = eye.position - ray * (eye.position.y / ray.y);
        let (u, v) = ((0.7 * p.x + 0.03).rem_euclid(1.0) * 4.0, (0.7 * p.z + 0.03).rem_euclid(1.0) * 4.0);
        if [u, v].iter().any(|c| (c - c.round()).abs() < 0.2) {
            continue;
        }
        let (x, y) = (u as u8, v as u8);
        let [r, g, b, a] = [60 + 60 * x, 255 - 50 * y, 100 + 40 * y, 40 + 70 * x];
        let colour = DVec3::new(10.0, 5.0, 5.0) * DVec3::new(linear_of(r), linear_of(g), linear_of(b));
        let cosine = -ray.normalize().y;
        let wanted = schlick(1.5, f64::from(0.9_f32) * f64::from(a) / 255.0, colour, cosine);
        let error = (*truth - wanted).abs().max_element();
        (sum, apart) = (sum + error, apart.max(error));
        apart_frame =
            apart_frame.max((Vec3::new(shown[0], shown[1], shown[2]).as_dvec3() - wanted).abs().max_element());
        compared += 1;
    }
    let mean = sum / f64::from(compared);
    println!("{compared} pixels: reference within {apart:.4}, {mean:.5} on average, frame within {apart_frame:.4}");
    ensure!(compared > 600, "only {compared}");
    // The reference is noisy, and the frame's split-sum fit up to 0.01 too bright.
    ensure!(mean < 0.002 && apart < 0.02 && apart_frame < 0.02, "reference {mean} and {apart}, frame {apart_frame}");
    Ok(())
}

/// A scene without the extension has the same G-buffer as before; one with it has two more channels.
#[test]
fn only_scenes_that_need_it_pay_for_it() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let plain = seen_at(30.0, material([0.5; 3], 0.0, 0.5));
    let mut stated = plain.clone();
    (stated.materials[0].specular, stated.materials[0].specular_colour) = (1.0, Vec3::ONE);
    let own = seen_at(30.0, dielectric([0.5; 3], 0.5, 0.5, [1.0; 3]));
    let dense = seen_at(30.0, Material { ior: 1.8, ..material([0.5; 3], 0.0, 0.5) });
    for (s, precision, wanted) in [
        (&plain, "compact", Format::Rg8Unorm),
        (&stated, "compact", Format::Rg8Unorm),
        (&plain, "full", Format::Rg32Float),
        (&own, "compact", Format::Rgba16Snorm),
        (&dense, "compact", Format::Rgba16Snorm),
        (&own, "full", Format::Rgba32Float),
    ] {
        let changes = config(&[&format!("gbuffer.precision={precision}")])?;
        let image = linear(render(&gpu, s, &changes, [EDGE, EDGE], 1, Some(("gbuffer.draw", "material")))?)?;
        ensure!(image.format == wanted, "{precision}: {:?} instead of {wanted:?}", image.format);
        ensure!(
            image.values().iter().all(|v| v[0] == 0.0 && (v[1] - 0.5).abs() < 0.002),
            "{precision}: {:?}",
            image.values()[0]
        );
    }
    Ok(())
}

const CODE: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer_specular.glsl"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Results { vec4 at[]; };
layout(push_constant, scalar) uniform Push { uvec2 results; uint count; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    // Reflectances of all sizes, strong and weak; the last is the plain one.
    float x = float(i % 256u) / 255.0, y = float(i / 256u) / 255.0;
    Dielectric d = Dielectric(vec3(x * x, x * x * x * y, 1.0 - x) * y, y);
    if (i == count - 1u) d = PLAIN_DIELECTRIC;
    vec2 code = encode_dielectric(d);
    // What the smaller format keeps of it.
    vec2 kept = round(code * 32767.0) / 32767.0;
    Dielectric back = decode_dielectric(kept);
    vec3 apart = abs(back.f0 - d.f0);
    vec3 allowed = sqrt(d.f0) / 255.0 + 4e-6;
    Results(results).at[i] =
        vec4(max(max(apart.r / allowed.r, apart.g / allowed.g), apart.b / allowed.b), abs(back.f90 - d.f90), apart.b, float(code == NO_SPECULAR_CODE));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct CodeParams {
    results: Address,
    count: u32,
}

/// Precision of the two channels that store a reflection, over its whole range.
#[test]
fn the_code_is_as_exact_as_it_says() -> Result<()> {
    const COUNT: u32 = 1 << 16;
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel("code.comp", CODE)?;
    let bytes = u64::from(COUNT) * 16;
    let mut read: Option<Arc<Buffer>> = None;
    bench.run(Extent::new(1, 1), &[], |g, imports| {
        let (sums, buffer) = results(&gpu, g, imports, "results", bytes)?;
        let sums = g.pass("test.code", Queue::Graphics, |p| {
            let (sums, target) = p.write_buffer(sums);
            (sums, move |c: &mut Record<'_>| {
                let params = CodeParams { results: c.id(target), count: COUNT };
                c.dispatch_groups(kernel, &params, [COUNT / 64, 1, 1]);
            })
        });
        g.leave(sums.read(), Access::HostRead, Domain::Compute);
        read = Some(buffer);
        Ok(())
    })?;
    let read = read.context("nothing was declared")?;
    let values: &[[f32; 4]] = bytemuck::cast_slice(&read.contents()[..bytes as usize]);
    let most = |k: usize| values.iter().map(|v| v[k]).fold(0.0, f32::max);
    println!("f0 is off by {:.3} of sqrt(f0) / 255 at most, f90 by {:.5}", most(0), most(1));
    ensure!(most(0) <= 1.01 && most(1) <= 1.0 / 126.0 + 1e-6, "f0 {}, f90 {}", most(0), most(1));
    let plain: Vec<usize> = (0..values.len()).filter(|i| values[*i][3] > 0.0).collect();
    ensure!(plain == [values.len() - 1], "{} others read as the plain dielectric", plain.len());
    ensure!(values[values.len() - 1][..3] == [0.0; 3], "the plain one is exact");
    Ok(())
}

/// Area lights and emissive meshes see the same reflections as a parallel sun.
#[test]
fn lamps_and_emitters_see_the_same_surface() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let albedo = [0.5_f32; 3];
    let bare = || dielectric(albedo, 0.4, 0.0, [1.0; 3]);
    let panel = Material { emission: Vec3::splat(6.0), ..material([0.0; 3], 1.0, 1.0) };
    let down = Affine3A::from_rotation_translation(Quat::from_rotation_x(PI as f32), Vec3::new(0.0, 1.25, 0.0));
    let mut lamp = seen_at(55.0, bare());
    lamp.lights.push(magpie::scene::Light::Rectangle {
        centre: DVec3::new(0.0, 1.25, 0.0),
        half_u: Vec3::X * 0.5,
        half_v: Vec3::Z * 0.5,
        radiance: Vec3::splat(6.0),
    });
    let mut emitter = seen_at(55.0, bare());
    add(&mut emitter, plane(0.5), panel, down);
    // The view factor of a square directly above, by its four corners (Hamilton and Morgan 1952).
    let x = 0.5 / 1.25_f64;
    let factor = 4.0 * 2.0 * x / (1.0 + x * x).sqrt() * (x / (1.0 + x * x).sqrt()).atan() / (2.0 * PI);
    let wanted = DVec3::splat(6.0 * 0.5 * factor);
    for (what, s, changes, frames) in
        [("lamp", &lamp, vec![], 1), ("emitter", &emitter, vec!["direct.emitter_rays=8", "direct.denoiser=none"], 32)]
    {
        let shown = Shown { size: [EDGE, EDGE], time: 0.0 };
        let changes: Vec<&str> = ["stages.shadows=off", "gbuffer.precision=full"].into_iter().chain(changes).collect();
        let (found, _) = against::mean(&gpu, s, &changes, shown, frames)?;
        let found = mean(found.into_iter());
        let truth = traced(&gpu, s, Only::Direct, 1024)?;
        println!(
            "{what}: frame {:.3} % off, reference {:.3} %",
            100.0 * off(found, wanted),
            100.0 * off(truth, wanted)
        );
        ensure!(
            off(found, wanted) < 0.005 && off(truth, wanted) < 0.005,
            "{what}: {found}, {truth}, and {wanted} is right"
        );
    }
    Ok(())
}
