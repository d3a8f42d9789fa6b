//! Direct lighting of scenes with one light against a double-precision CPU implementation.
//!
//! Two comparisons:
//! - **from the G-buffer**: position, normal and material as the lighting pass reads them, everything after that in double precision.
//!   Relative error at most 1e-3 of the largest channel on every lit pixel, plus a millionth of the median of the lit pixels: where a range
//!   or a cone fades out, and where a surface turns away, the result depends on the last bits of a 32-bit distance or cosine. The number of
//!   pixels that need this is printed and limited.
//! - **from the scene**: position, normal and colours of the flat surfaces from the scene itself. This includes the rounding of the
//!   G-buffer, and the device's decoding of sRGB (half an 8-bit step by the specification, which is 4e-3 of these colours): 5e-3, plus a
//!   ten-thousandth of the median where lights fade out and depth is rounded.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie::scene::{Light, Material, ResidentOptions, ResidentScene, Scene};
use magpie_passes::{Frame, Slots};
use magpie_shaders::{SampledImage, StorageImage};
use magpie_tests::bench::{Bench, Shot};
use magpie_tests::fixtures::{add, camera, material, plane, scene, sphere, sun};
use magpie_tests::harness::{config, gpu};
use magpie_tests::oracle::gbuffer::{Eye, octahedral};
use magpie_tests::oracle::shading::{SurfacePoint, direct, incident};

const EXTENT: Extent = Extent { width: 320, height: 180 };

/// Reads back the base colour as shaders see it, since the precision of sRGB decoding depends on the device.
const DECODED: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint source; uint result; uvec2 size; };
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(uvec2(pixel), size))) store(result, pixel, load(source, pixel));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    source: SampledImage,
    result: StorageImage,
    size: [u32; 2],
}

/// sRGB decoding (IEC 61966-2-1) of an 8-bit code.
fn linear(code: u8) -> f64 {
    let x = f64::from(code) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// sRGB encoding of a linear value to an 8-bit code, not rounded: the inverse of [`linear`].
fn code(x: f64) -> f64 {
    255.0 * if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// A material with values that are exact in 8 bits.
fn coded(rgb: [u8; 3], metalness: u8, roughness: u8) -> Material {
    material(rgb.map(|c| linear(c) as f32), f32::from(metalness) / 255.0, f32::from(roughness) / 255.0)
}

/// Indices: the floor, the tilted board, the emissive ball and the unlit one; then balls of many materials.
const FLOOR: u32 = 0;
const BOARD: u32 = 1;
const GLOW: u32 = 2;
const UNLIT: u32 = 3;

fn world(light: Light) -> Scene {
    let mut s = scene("one light", camera(Vec3::new(0.4, 3.6, 6.2), Vec3::new(0.0, 0.4, 0.0)));
    let at = |x: f32, y: f32, z: f32, r: f32| {
        Affine3A::from_scale_rotation_translation(Vec3::splat(r), Quat::IDENTITY, Vec3::new(x, y, z))
    };
    add(&mut s, plane(5.0), coded([188, 180, 200], 0, 128), Affine3A::IDENTITY);
    let tilt = Affine3A::from_rotation_translation(
        Quat::from_rotation_x(0.73) * Quat::from_rotation_z(0.31),
        Vec3::new(0.0, 1.1, -2.1),
    );
    add(&mut s, plane(1.0), coded([120, 200, 90], 51, 89), tilt);
    let glow = Material { emission: Vec3::new(1.5, 0.25, 3.0), ..coded([0, 0, 0], 255, 128) };
    add(&mut s, sphere(24), glow, at(2.6, 0.5, -1.6, 0.5));
    let unlit = Material { unlit: true, ..material([0.25, 0.5, 1.0], 0.3, 0.4) };
    add(&mut s, sphere(24), unlit, at(-2.6, 0.5, -1.6, 0.5));
    let balls = [
        ([255, 255, 255], 0, 255),
        ([230, 60, 20], 0, 128),
        ([20, 90, 220], 0, 51),
        ([128, 128, 128], 0, 12),
        ([255, 200, 120], 255, 12),
        ([250, 240, 230], 255, 51),
        ([200, 100, 90], 255, 128),
        ([90, 180, 200], 128, 255),
    ];
    for (i, (rgb, metalness, roughness)) in balls.into_iter().enumerate() {
        let (x, z) = ((i % 4) as f32 - 1.5, (i / 4) as f32);
        add(&mut s, sphere(32), coded(rgb, metalness, roughness), at(1.3 * x, 0.45, 1.5 * z - 0.4, 0.45));
    }
    // A polished slab that mirrors all four lights: tests the peak of the highlight, not only its tail.
    let slab =
        Affine3A::from_scale_rotation_translation(Vec3::new(3.0, 1.0, 0.7), Quat::IDENTITY, Vec3::new(0.0, 0.01, 2.3));
    add(&mut s, plane(1.0), coded([255, 220, 180], 255, 12), slab);
    s.lights.push(light);
    s
}

/// One pixel as the lighting pass reads it, and its result.
struct Pixel {
    instance: Option<u32>,
    point: SurfacePoint,
    geometric: DVec3,
    visibility: f32,
    emission: DVec3,
    radiance: DVec3,
}

fn rgb(v: &[f32; 4]) -> DVec3 {
    Vec3::new(v[0], v[1], v[2]).as_dvec3()
}

fn render(bench: &mut Bench, scene: &Scene) -> Result<Vec<Pixel>> {
    let resident = ResidentScene::new(&bench.gpu, scene, ResidentOptions::default())?.shared();
    let camera = &scene.cameras[0];
    let kernel = bench.kernel("decoded.comp", DECODED)?;
    let gpu = bench.gpu.clone();
    let mut stages = Frame::new(
        &magpie::slot::Build::new(&gpu, magpie::prelude::Rays::Software),
        &Slots::default(),
        &config(&["shadows.edges=hard", "direct.area=0", "direct.precision=32"])?,
    )?;
    let shot = Shot { scene: &resident, camera, extent: EXTENT };
    let wanted = [
        "gbuffer.draw:depth",
        "gbuffer.draw:normal",
        "gbuffer.draw:material",
        "gbuffer.draw:ids",
        "gbuffer.draw:base_colour",
        "test.decoded:base_colour",
        "shadows.trace:visibility",
        "direct.shade:radiance",
        "gbuffer.draw:emission",
        "gbuffer.draw:geometric_normal",
    ];
    let ran = bench
        .run(EXTENT, &wanted, |g, imports| {
            shot.frame(&gpu, &mut stages, g, imports)?;
            let source = g.find("gbuffer.draw", "base_colour")?;
            g.pass("test.decoded", Queue::Graphics, |p| {
                let source = p.sample(source);
                let (_, result) = p.create("base_colour", ImageDesc::full(Format::Rgba32Float));
                ((), move |c: &mut Record<'_>| {
                    let size = [EXTENT.width, EXTENT.height];
                    c.dispatch(kernel, &Params { source: c.id(source), result: c.id(result), size }, EXTENT);
                })
            });
            Ok(())
        })?
        .clean()?;
    let v = |i: usize| ran.values(wanted[i]);
    let (depth, normal, material, ids) = (v(0)?, v(1)?, v(2)?, v(3)?);
    let (codes, base_colour, visibility) = (&ran.image(wanted[4])?.bytes, v(5)?, v(6)?);
    let (radiance, emission, geometric) = (v(7)?, v(8)?, v(9)?);

    // Devices differ in the precision of sRGB decoding, but the value must round to the same 8-bit code.
    let off = codes.chunks_exact(4).zip(&base_colour);
    let off = off.flat_map(|(codes, read)| (0..3).map(|c| (code(read[c].into()) - f64::from(codes[c])).abs()));
    let off = off.fold(0.0, f64::max);
    println!("the device decodes sRGB to within {off:.3} of an 8-bit step");
    ensure!(off < 0.5, "the device decodes sRGB {off} steps off");

    let eye = Eye::new(camera, EXTENT);
    let pixels = (0..depth.len()).map(|i| {
        let ray = eye.pixel_ray(i);
        Pixel {
            instance: (ids[i][0] as u32).checked_sub(1),
            point: SurfacePoint {
                position: eye.world_position(i, depth[i][0]),
                normal: octahedral(normal[i][0], normal[i][1]),
                to_viewer: -ray.normalize(),
                base_colour: rgb(&base_colour[i]),
                metalness: (f64::from(material[i][0]) * 255.0).round() / 255.0,
                roughness: (f64::from(material[i][1]) * 255.0).round() / 255.0,
            },
            geometric: octahedral(geometric[i][0], geometric[i][1]),
            visibility: visibility[i][0],
            emission: rgb(&emission[i]),
            radiance: rgb(&radiance[i]),
        }
    });
    Ok(pixels.collect())
}

/// Relative error by the largest expected channel: in full, and what exceeds `floor`.
fn off(actual: DVec3, expected: DVec3, floor: f64) -> (f64, f64) {
    let (error, size) = ((actual - expected).abs().max_element(), expected.max_element());
    (error / size, (error - floor).max(0.0) / size)
}

/// Median over the lit pixels of the expected largest channel.
fn median(pixels: &[Pixel], lights: &[Light]) -> f64 {
    let lit = pixels.iter().filter(|p| p.instance.is_some() && p.visibility > 0.0);
    let mut sizes: Vec<f64> = lit.map(|p| direct(&p.point, lights).max_element()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() / 2).copied().unwrap_or(0.0)
}

/// All comparisons for one light. `lit` is the least share of lit pixels.
fn check(label: &str, light: Light, lit: f64) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let scene = world(light);
    let pixels = render(&mut bench, &scene)?;
    let eye = Eye::new(&scene.cameras[0], EXTENT);
    let light = &scene.lights[0];

    let (mut bright, mut dark, mut glowing, mut unlit) = (0_u32, 0_u32, 0_u32, 0_u32);
    let (mut faint, mut above, mut brightest) = (0_u32, 0_u32, 0.0_f64);
    let (mut worst, mut flat, mut worst_flat) = (0.0_f64, 0_u32, 0.0_f64);
    let usual = median(&pixels, &scene.lights);
    for (i, pixel) in pixels.iter().enumerate() {
        let at = || format!("{label}: pixel ({}, {})", i % EXTENT.width as usize, i / EXTENT.width as usize);
        let Some(instance) = pixel.instance else {
            ensure!(pixel.radiance == DVec3::ZERO, "{}: nothing is there, yet it shines {}", at(), pixel.radiance);
            continue;
        };
        if instance == GLOW || instance == UNLIT {
            let (count, wanted) = match instance {
                GLOW => (&mut glowing, DVec3::new(1.5, 0.25, 3.0)),
                _ => (&mut unlit, DVec3::new(0.25, 0.5, 1.0)),
            };
            *count += 1;
            ensure!(pixel.radiance == pixel.emission, "{}: {} is not {}", at(), pixel.radiance, pixel.emission);
            // One step of a half float, which may be rounded towards zero; the interpolated vertex colour is 1 up to rounding.
            let off = ((pixel.emission - wanted) / wanted).abs().max_element();
            ensure!(off < 1.0 / 1024.0, "{}: emission {} instead of {wanted}", at(), pixel.emission);
            continue;
        }
        if pixel.visibility == 0.0 {
            dark += 1;
            ensure!(pixel.radiance == DVec3::ZERO, "{} lies in shadow, yet shines {}", at(), pixel.radiance);
            continue;
        }
        let expected = direct(&pixel.point, &scene.lights);
        ensure!(expected.max_element() > 0.0, "{}: visible, but not lit", at());
        bright += 1;
        brightest = brightest.max(expected.max_element());
        let (error, excess) = off(pixel.radiance, expected, 1e-6 * usual);
        worst = worst.max(excess);
        if error > 1e-3 {
            faint += 1;
        }
        if excess > 1e-3 {
            above += 1;
            let facing = pixel.point.normal.dot(incident(light, pixel.point.position).direction);
            let shines = pixel.radiance;
            println!("{}: instance {instance}, {shines} instead of {expected}, {error:.2e}, cosine {facing:.2e}", at());
        }

        if instance == FLOOR || instance == BOARD {
            let placed = scene.instances[instance as usize].world_from_object;
            let (normal, through) = (placed.matrix3.y_axis, placed.translation);
            let ray = eye.pixel_ray(i);
            let position = eye.position + ray * ((through - eye.position).dot(normal) / ray.dot(normal));
            let m = &scene.materials[instance as usize];
            let point = SurfacePoint {
                position,
                normal: normal.normalize() * -ray.dot(normal).signum(),
                to_viewer: -ray.normalize(),
                base_colour: m.base_colour.truncate().as_dvec3(),
                metalness: m.metalness.into(),
                roughness: m.roughness.into(),
            };
            let expected = direct(&point, &scene.lights);
            flat += 1;
            worst_flat = worst_flat.max(off(pixel.radiance, expected, 1e-4 * usual).1);
        }
    }
    println!(
        "{label}: {bright} lit pixels, off by at most {worst:.2e} ({faint} need the floor, median {usual:.3}, brightest {brightest:.0}); {flat} of flat surfaces against the scene \
         itself {worst_flat:.2e}; {dark} dark, {glowing} glowing, {unlit} unlit ones exact"
    );
    ensure!(f64::from(bright) > lit * pixels.len() as f64, "{label}: only {bright} pixels are lit");
    ensure!(dark > 1000 && glowing > 200 && unlit > 200, "{label}: {dark} dark, {glowing} glowing, {unlit} unlit");
    ensure!(above == 0, "{label}: {above} lit pixels are off by more than 1e-3, at most by {worst:.2e}");
    ensure!(brightest > 1000.0 * usual, "{label}: no sharp highlight was hit, only {brightest}");
    ensure!(faint * 1000 < bright, "{label}: {faint} of {bright} lit pixels are within 1e-3 only by the floor");
    ensure!(flat > 3000, "{label}: only {flat} lit pixels of flat surfaces");
    ensure!(worst_flat <= 5e-3, "{label}: off by {worst_flat:.2e} from the scene itself");
    shadows(label, &scene, light, &pixels)
}

/// Whether the light is occluded, by double-precision rays against every triangle near enough.
fn hidden(scene: &Scene, pixel: &Pixel, light: &Light) -> bool {
    hidden_at(scene, pixel.point.position, pixel.geometric, light)
}

/// The same for a point of a plane.
fn hidden_at(scene: &Scene, position: DVec3, normal: DVec3, light: &Light) -> bool {
    // A tenth of a millimetre off the surface: much less than a pixel.
    let origin = position + 1e-4 * normal;
    let to = incident(light, origin);
    scene.instances.iter().any(|instance| {
        let place = instance.world_from_object;
        let mesh = &scene.meshes[instance.mesh as usize];
        let radius = mesh.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
        let reach = f64::from(radius) * place.matrix3.x_axis.length() * 1.001;
        let centre = place.translation - origin;
        if centre.cross(to.direction).length() > reach {
            return false;
        }
        mesh.indices.chunks_exact(3).any(|t| {
            let [a, b, c] =
                [0, 1, 2].map(|k| place.transform_point3(mesh.positions[t[k] as usize].as_dvec3()) - origin);
            let (u, v) = (b - a, c - a);
            let p = to.direction.cross(v);
            let determinant = u.dot(p);
            if determinant.abs() < 1e-14 {
                return false;
            }
            let s = -a;
            let x = s.dot(p) / determinant;
            let q = s.cross(u);
            let y = to.direction.dot(q) / determinant;
            let t = v.dot(q) / determinant;
            x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.0 && t < to.distance * 0.999
        })
    })
}

/// Visibility against double-precision shadow rays: differences are allowed within a pixel of a shadow's edge only.
fn shadows(label: &str, scene: &Scene, light: &Light, pixels: &[Pixel]) -> Result<()> {
    let expected: Vec<f32> = pixels
        .iter()
        .map(|pixel| {
            let i = incident(light, pixel.point.position);
            let faces = pixel.point.normal.dot(i.direction) > 0.0 && pixel.geometric.dot(i.direction) > 0.0;
            let reached = pixel.instance.is_some() && faces && i.irradiance.max_element() > 0.0;
            f32::from(u8::from(reached && !hidden(scene, pixel, light)))
        })
        .collect();
    let (width, eye) = (EXTENT.width as i64, Eye::new(&scene.cameras[0], EXTENT));
    let (mut differ, mut away) = (0, 0);
    for (i, pixel) in pixels.iter().enumerate() {
        if pixel.visibility == expected[i] {
            continue;
        }
        differ += 1;
        let (x, y) = (i as i64 % width, i as i64 / width);
        let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        let around = near
            .filter(|(x, y)| (0..width).contains(x) && (0..i64::from(EXTENT.height)).contains(y))
            .any(|(x, y)| expected[(y * width + x) as usize] != expected[i]);
        // An edge may also be inside the pixel, as at the foot of a wall: then the light is hidden from part of the pixel's plane.
        let within = || {
            let steps = (-4..=4).flat_map(|v| (-4..=4).map(move |u| (f64::from(u) / 8.0, f64::from(v) / 8.0)));
            let on_plane = |(u, v): (f64, f64)| {
                let along = eye.ray(x as f64 + 0.5 + u, y as f64 + 0.5 + v);
                let away = (pixel.point.position - eye.position).dot(pixel.geometric) / along.dot(pixel.geometric);
                eye.position + away * along
            };
            let is_hidden = |at: DVec3| hidden_at(scene, at, pixel.geometric, light);
            steps.map(on_plane).any(|at| is_hidden(at) == (expected[i] == 1.0))
        };
        if !around && !within() {
            away += 1;
            println!("{label}: ({x}, {y}) has visibility {}, instance {:?}", pixel.visibility, pixel.instance);
        }
    }
    println!(
        "{label}: {differ} of {} pixels differ from double-precision shadow rays, {away} away from any edge",
        pixels.len()
    );
    ensure!(away == 0, "{label}: {away} pixels are wrongly lit or dark");
    ensure!(differ * 500 < pixels.len(), "{label}: {differ} pixels are wrongly lit or dark");
    Ok(())
}

#[test]
fn directional() -> Result<()> {
    check("directional", sun(Vec3::new(-0.4, 0.7, -0.75)), 0.5)
}

#[test]
fn point_with_range() -> Result<()> {
    let light =
        Light::Point { position: DVec3::new(0.7, 2.2, 0.3), intensity: Vec3::new(20.0, 15.0, 9.0), range: Some(4.0) };
    check("point", light, 0.3)
}

#[test]
fn spot_with_cone() -> Result<()> {
    let light = Light::Spot {
        position: DVec3::new(-1.4, 3.0, -0.6),
        direction: Vec3::new(0.25, -0.8, 0.4).normalize(),
        intensity: Vec3::new(30.0, 30.0, 40.0),
        range: None,
        inner: 0.35,
        outer: 0.75,
    };
    check("spot", light, 0.2)
}

#[test]
fn rectangle() -> Result<()> {
    let light = Light::Rectangle {
        centre: DVec3::new(0.2, 3.1, -0.4),
        half_u: Vec3::new(0.5, 0.1, 0.0),
        half_v: Vec3::new(0.0, 0.05, 0.4),
        radiance: Vec3::new(9.0, 8.0, 7.0),
    };
    check("rectangle", light, 0.3)
}

#[test]
fn disc() -> Result<()> {
    let light = Light::Disc {
        centre: DVec3::new(-0.3, 3.0, -0.5),
        normal: Vec3::new(0.1, -1.0, 0.15).normalize(),
        radius: 0.4,
        radiance: Vec3::new(8.0, 9.0, 10.0),
    };
    check("disc", light, 0.3)
}

#[test]
fn ball_of_light() -> Result<()> {
    let light = Light::Sphere { centre: DVec3::new(0.6, 2.4, 0.2), radius: 0.3, radiance: Vec3::new(14.0, 11.0, 8.0) };
    check("sphere", light, 0.3)
}
