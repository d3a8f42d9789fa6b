//! Environment maps on the device against double precision: orientation, interpolation between texels, and their use in all slots that show
//! the sky.
//!
//! Devices may quantise a sample's position between two texels to 1/256 of their distance (`subTexelPrecisionBits`, at least 4 in Vulkan, 8
//! on current devices): radiance agrees to two such steps of the greatest texel. A wrong direction is off by whole texels.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Vec2, Vec3};
use magpie::gpu::{Buffer, BufferMemory, BufferUse};
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie::scene::{Environment, ResidentOptions, ResidentScene, Scene};
use magpie_shaders::Address;
use magpie_tests::bench::{Bench, Shot, results};
use magpie_tests::fixtures::{add, camera, environment, material, plane, scene};
use magpie_tests::harness::{config, gpu};
use magpie_tests::oracle::gbuffer::Eye;
use std::sync::Arc;

const STEP: f32 = 1.0 / 256.0;

const LOOK: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/sky.glsl"
layout(local_size_x = 64) in;
struct Seen { vec2 uv; vec3 back; vec3 radiance; vec3 with_sun; vec3 irradiance; };
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer SeenBuffer { Seen at[]; };
layout(push_constant, scalar) uniform Push { uvec2 view; uvec2 directions; uvec2 seen; uint count; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    Sky sky = ViewBuffer(view).at[0].sky;
    vec3 d = PositionBuffer(directions).at[i];
    vec2 uv = environment_uv(sky, d);
    SeenBuffer(seen).at[i] = Seen(
        uv, environment_direction(sky, uv), sky_radiance(sky, d), sky_radiance_with_sun(sky, d), sky_irradiance(sky, d)
    );
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    directions: Address,
    seen: Address,
    count: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Seen {
    uv: [f32; 2],
    back: [f32; 3],
    radiance: [f32; 3],
    with_sun: [f32; 3],
    irradiance: [f32; 3],
}

/// A floor under this sky, without other lights.
fn world(environment: Environment) -> Scene {
    let mut s = scene("surrounded", camera(Vec3::new(0.0, 1.0, 4.0), Vec3::new(0.0, 1.2, 0.0)));
    add(&mut s, plane(2.0), material([0.5; 3], 0.0, 0.5), Affine3A::IDENTITY);
    s.environment = Some(environment);
    s
}

/// Directions all over the sphere, including the poles, the axes, and both sides of the seam.
fn directions() -> Vec<Vec3> {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let spread = (0..4000).map(|i| {
        let y = 1.0 - (i as f32 + 0.5) / 2000.0;
        let (sin, cos) = (i as f32 * golden).sin_cos();
        (Vec3::new(cos, 0.0, sin) * (1.0 - y * y).sqrt() + Vec3::Y * y).normalize()
    });
    let seam = [1e-3_f32, -1e-3].map(|x| Vec3::new(x, 0.2, 1.0).normalize());
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    spread.chain(seam).chain(axes).collect()
}

fn look(bench: &mut Bench, scene: &Scene, directions: &[Vec3]) -> Result<Vec<Seen>> {
    let gpu = bench.gpu.clone();
    let kernel = bench.kernel("look.comp", LOOK)?;
    let resident = ResidentScene::new(&gpu, scene, ResidentOptions::default())?.shared();
    let shot = Shot { scene: &resident, camera: &scene.cameras[0], extent: Extent::new(16, 9) };
    let mut buffer =
        Buffer::new(&gpu, "directions", size_of_val(directions) as u64, BufferMemory::Upload, BufferUse::Storage)?;
    buffer.write(0, bytemuck::cast_slice(directions))?;
    let buffer = Arc::new(buffer);
    let (count, bytes) = (directions.len() as u32, (directions.len() * size_of::<Seen>()) as u64);
    let mut back = None;
    bench.run(shot.extent, &[], |g, imports| {
        let view = shot.view(&gpu, g, imports)?;
        let key = imports.borrow_mut().buffer(&buffer);
        let from = g.import_buffer("directions", BufferDesc::new(buffer.bytes()), Access::BufferRead, key).read();
        let seen = g.pass("test.look", Queue::Graphics, |p| {
            let (view, from) = (p.read(view.block), p.read(from));
            let (seen, to) = p.create_buffer("seen", BufferDesc::new(bytes));
            (seen.read(), move |c: &mut Record<'_>| {
                let params = Params { view: c.id(view), directions: c.id(from), seen: c.id(to), count };
                c.dispatch_groups(kernel, &params, [count.div_ceil(64), 1, 1]);
            })
        });
        let (target, read) = results(&gpu, g, imports, "read back", bytes)?;
        let target = g.pass("test.copy", Queue::Transfer, |p| {
            let from = p.copy_from(seen);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
        });
        g.leave(target.read(), Access::HostRead, Domain::Copy);
        back = Some(read);
        Ok(())
    })?;
    let back = back.context("nothing was declared")?;
    Ok(bytemuck::pod_collect_to_vec(&back.contents()[..bytes as usize]))
}

/// The real spherical harmonics up to order 2, Ramamoorthi and Hanrahan 2001, equation 3.
fn harmonics(n: DVec3) -> [f64; 9] {
    let DVec3 { x, y, z } = n;
    let (a, b, c, d, e) = (0.282_095, 0.488_603, 1.092_548, 0.315_392, 0.546_274);
    [a, b * y, b * z, b * x, c * x * y, c * y * z, d * (3.0 * z * z - 1.0), c * x * z, e * (x * x - y * y)]
}

#[test]
fn the_device_looks_where_the_processor_looks() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let directions = directions();
    for (turn, scale) in [(0.0, 1.0), (0.8, 0.5), (-2.5, 3.0)] {
        let e = Environment { turn, scale, ..environment() };
        let greatest = scale * e.radiance.iter().map(|t| t.max_element()).fold(0.0, f32::max);
        let coefficients = e.irradiance_sh();
        let seen = look(&mut bench, &world(e.clone()), &directions)?;
        let (mut worst_uv, mut worst, mut bright) = (0.0_f32, 0.0_f32, 0);
        for (d, seen) in directions.iter().zip(&seen) {
            let at = || format!("turn {turn}, direction {d}: {seen:?}");
            // u wraps around at the seam, and is arbitrary at the poles.
            let off = (e.uv(*d) - Vec2::from(seen.uv)).abs();
            let around = off.x.min(1.0 - off.x) * (1.0 - d.y * d.y).max(0.0).sqrt();
            worst_uv = worst_uv.max(around.max(off.y));
            ensure!(around.max(off.y) < 1e-5, "{}, wanted {}", at(), e.uv(*d));
            ensure!(Vec3::from(seen.back).abs_diff_eq(*d, 2e-5), "{}", at());
            let wanted = e.radiance(*d);
            let off = (Vec3::from(seen.radiance) - wanted).abs().max_element() / greatest;
            worst = worst.max(off);
            ensure!(off < 2.0 * STEP, "{}, wanted {wanted}", at());
            ensure!(seen.with_sun == seen.radiance, "{}: there is no sun beside the image", at());
            bright += u32::from(wanted.max_element() > 0.5 * greatest);
            let wanted: DVec3 = coefficients.iter().zip(harmonics(d.as_dvec3())).map(|(c, y)| c.as_dvec3() * y).sum();
            let off = (Vec3::from(seen.irradiance).as_dvec3() - wanted.max(DVec3::ZERO)).abs().max_element();
            ensure!(off < 1e-5 * f64::from(greatest), "{}, wanted the irradiance {wanted}", at());
        }
        println!("turn {turn}: off by at most {worst_uv:.1e} of the image, {worst:.1e} of the greatest radiance");
        ensure!(bright > 20, "turn {turn}: only {bright} directions show the bright texel");
    }
    Ok(())
}

#[test]
fn the_slots_show_it() -> Result<()> {
    const EXTENT: Extent = Extent { width: 160, height: 90 };
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let wanted = ["gbuffer.draw:depth", "sky.fill:lit", "gi.sky:radiance", "reflections.sky:radiance"];
    let mut show = |e: &Environment| -> Result<[Vec<[f32; 4]>; 4]> {
        let scene = world(e.clone());
        let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
        let shot = Shot { scene: &resident, camera: &scene.cameras[0], extent: EXTENT };
        let ran = bench.frame(shot, &config(&["stages.gi=sky"])?, &wanted)?.clean()?;
        let [depth, lit, gi, reflections] = wanted;
        Ok([ran.values(depth)?, ran.values(lit)?, ran.values(gi)?, ran.values(reflections)?])
    };
    let e = Environment { turn: 0.4, ..environment() };
    let greatest = e.radiance.iter().map(|t| t.max_element()).fold(0.0, f32::max);
    let [depth, lit, gi, reflections] = show(&e)?;
    let [_, _, gi_twice, reflections_twice] = show(&Environment { scale: 2.0, ..e.clone() })?;

    let camera = world(e.clone()).cameras.remove(0);
    let eye = Eye::new(&camera, EXTENT);
    let (mut behind, mut bright, mut surface) = (0, 0, 0);
    for i in 0..depth.len() {
        let (x, y) = (i % EXTENT.width as usize, i / EXTENT.width as usize);
        if depth[i][0] > 0.0 {
            surface += 1;
            for (part, twice) in [(&gi, &gi_twice), (&reflections, &reflections_twice)] {
                for c in 0..3 {
                    let (one, two) = (part[i][c], twice[i][c]);
                    ensure!(
                        one > 0.0 && (two / one - 2.0).abs() < 1e-4,
                        "({x}, {y}): {one}, and {two} of twice the light"
                    );
                }
            }
            continue;
        }
        let wanted = e.radiance(eye.pixel_ray(i).as_vec3());
        let off = (Vec3::from_slice(&lit[i]) - wanted).abs().max_element();
        ensure!(off < 2.0 * STEP * greatest, "({x}, {y}): {:?}, wanted {wanted}", lit[i]);
        behind += 1;
        bright += u32::from(wanted.max_element() > 0.5 * greatest);
    }
    println!("{surface} pixels of the floor, {behind} of the map, {bright} of its bright texel");
    ensure!(surface > 1000 && behind > 3000 && bright > 50, "{surface} {behind} {bright}");
    Ok(())
}
