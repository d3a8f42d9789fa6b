//! Reflections by rays converge to the reference, whatever the surface, the scene and the way to trace.
use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Light, Material, Scene};
use magpie_passes::RenderOptions;
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_shaders::Rays;
use magpie_tests::against::{Bias, RAW_REFLECTIONS, Shown, bias, blocks, mean_with, truth_of};
use magpie_tests::fixtures::{add, block, camera, material, scene, sphere};
use magpie_tests::harness::{builtin, gpu};
use std::env;

/// Rays of each pixel and frame.
const RAYS_PER_FRAME: u32 = 8;
/// Surfaces that a path meets; the reference scatters once more, at the pixel's own.
const BOUNCES: u32 = 8;
/// What all surfaces of a scene are made of.
#[derive(Clone, Copy, Debug)]
enum Made {
    Metal,
    Dielectric,
    /// A coat of that roughness over rough paint.
    Coat,
}

fn made(mut scene: Scene, of: Made, roughness: f32) -> Scene {
    for m in &mut scene.materials {
        (m.metallic_roughness_texture, m.normal_texture) = (None, None);
        (m.metalness, m.roughness) = (if matches!(of, Made::Metal) { 1.0 } else { 0.0 }, roughness);
        m.clearcoat = 0.0;
        if matches!(of, Made::Coat) {
            (m.roughness, m.clearcoat, m.clearcoat_roughness) = (0.7, 1.0, roughness);
        }
    }
    scene
}

/// A closed box whose ceiling shines, so that even mirrors on all sides make little noise, and a ball and a block in it.
fn box_of(of: Made, roughness: f32) -> Scene {
    let mut s = scene("box", camera([0.3, -0.2, 1.3], [-0.2, -0.5, 0.0]));
    let walls = Material { double_sided: true, ..material([0.85, 0.9, 0.9], 0.0, 0.0) };
    add(&mut s, block(Vec3::new(1.5, 1.2, 1.5)), walls, Affine3A::IDENTITY);
    let mut s = made(s, of, roughness);
    let ball =
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.4), glam::Quat::IDENTITY, Vec3::new(-0.5, -0.7, -0.4));
    add(&mut s, sphere(24), material([0.8, 0.2, 0.1], 0.0, 1.0), ball);
    add(
        &mut s,
        block(Vec3::new(0.25, 0.5, 0.25)),
        material([0.2, 0.6, 0.3], 0.0, 0.9),
        Affine3A::from_translation(Vec3::new(0.6, -0.7, -0.6)),
    );
    s.lights.push(Light::Rectangle {
        centre: DVec3::new(0.0, 1.199, 0.0),
        half_u: Vec3::X * 1.45,
        half_v: Vec3::Z * 1.45,
        radiance: Vec3::new(1.0, 0.9, 0.7),
    });
    s.light_nodes.resize(1, None);
    s
}

/// Gives lamps without size one, and the sun a width of 11 degrees. What smooth surfaces reflect of smaller ones is found by one path of a
/// million and then outshines all else, so that no number of samples would tell a bias from noise.
fn with_wide_lights(mut scene: Scene) -> Scene {
    for light in &mut scene.lights {
        match light {
            Light::Directional { angular_radius, .. } => *angular_radius = angular_radius.max(0.1),
            Light::Point { position, intensity, .. } => {
                // Smaller than the distance from the glass around it.
                let radius = 0.009;
                let radiance = *intensity / (std::f32::consts::PI * radius * radius);
                *light = Light::Sphere { centre: *position, radius, radiance };
            }
            _ => {}
        }
    }
    scene
}

/// A scene, and the time at which it is shown.
fn scene_of(name: &str, of: Made, roughness: f32) -> Result<(Scene, f64)> {
    Ok(match name {
        "box" => (box_of(of, roughness), 0.0),
        "carousel" => (with_wide_lights(made(builtin(name)?, of, roughness)), 1.3),
        _ => (with_wide_lights(made(builtin(name)?, of, roughness)), 0.0),
    })
}

/// Pixels of a block, each way. Mirrors of mirrors magnify the rounding of the first normal, which moves the images of lamps by parts of a
/// pixel: what is compared are means of blocks.
const BLOCK: u32 = 6;
const SIZE: [u32; 2] = [96, 72];

/// How much is computed.
#[derive(Clone, Copy)]
struct Effort {
    /// Least and greatest number of independent runs of frames and reference. There are as many as make the noise small enough.
    runs: [u32; 2],
    /// Rays of each pixel and run, in frames and reference.
    rays: u32,
    /// Standard error of relMSE that is small enough.
    error: f64,
}

/// The bias of the frame's reflections by one way to trace; the reference is traced in software.
fn bias_of(gpu: &Gpu, scene: &Scene, time: f64, rays: Rays, effort: Effort) -> Result<Bias> {
    let shown = Shown { size: SIZE, time };
    let (mut found, mut truth) = (Vec::new(), Vec::new());
    let bounces = format!("reflections.bounces={BOUNCES}");
    let changes = [&RAW_REFLECTIONS[..], &[&bounces, "reflections.regularization=0"]].concat();
    for seed in 1..=effort.runs[1] {
        let options = RenderOptions { seed, rays, ..RenderOptions::default() };
        let frames = effort.rays.div_ceil(RAYS_PER_FRAME);
        let image = mean_with(options, "reflections", gpu, scene, &changes, shown, frames)?.0;
        found.push(blocks(&image, SIZE, BLOCK));
        let options =
            ReferenceOptions { only: Only::Reflections, depth: BOUNCES + 1, seed, ..ReferenceOptions::default() };
        truth.push(blocks(&truth_of(options, gpu, scene, shown, effort.rays)?.mean, SIZE, BLOCK));
        if seed >= effort.runs[0] && bias(&found, &truth).error < effort.error {
            break;
        }
    }
    let bias = bias(&found, &truth);
    ensure!(bias.relmse.is_finite() && bias.light.is_finite(), "not finite: {bias:?}");
    Ok(bias)
}

fn row(name: &str, of: Made, roughness: f32, rays: Rays, b: Bias) -> String {
    format!(
        "| {name} | {of:?} | {roughness} | {rays:?} | {:.1e} ± {:.0e} | {:.4} ± {:.4} |",
        b.relmse, b.error, b.light, b.light_error
    )
}

/// Small pictures of surfaces with little noise, so that a bias cannot hide in it.
#[test]
fn rays_have_no_bias() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let effort = Effort { runs: [4, 8], rays: 32, error: 3e-4 };
    for (name, of, roughness, rays) in [
        ("box", Made::Metal, 0.0, Rays::Software),
        ("box", Made::Coat, 0.1, Rays::Query),
        ("box", Made::Dielectric, 0.3, Rays::Pipeline),
        ("cornell", Made::Dielectric, 0.6, Rays::Software),
        ("cornell", Made::Metal, 1.0, Rays::Pipeline),
    ] {
        if gpu.check_rays(rays).is_err() {
            println!("{name}: the device has no {rays:?}");
            continue;
        }
        let (scene, time) = scene_of(name, of, roughness)?;
        let started = std::time::Instant::now();
        let bias = bias_of(&gpu, &scene, time, rays, effort)?;
        println!("{} {:.1?}", row(name, of, roughness, rays, bias), started.elapsed());
        ensure!(bias.error < 2.0 * effort.error, "{name}, {of:?}, {roughness}: too much noise to tell: {bias:?}");
        ensure!(bias.relmse < 1e-3, "{name}, {of:?}, {roughness}, {rays:?}: {bias:?}");
    }
    Ok(())
}

/// Whether `MAGPIE_ONLY` names a row, as in `Metal 0.1;Coat 0`; all are wanted without it.
fn is_wanted(of: Made, roughness: f32) -> bool {
    env::var("MAGPIE_ONLY").map_or(true, |only| only.split(';').any(|row| row == format!("{of:?} {roughness}")))
}

/// All surfaces in one scene, with `MAGPIE_FULL`, as a table. It takes an hour or less.
fn no_bias_on_any_surface(name: &str) -> Result<()> {
    if env::var_os("MAGPIE_FULL").is_none() {
        return Ok(());
    }
    let Some(gpu) = gpu()? else { return Ok(()) };
    let effort = Effort { runs: [4, 320], rays: 64, error: 3e-4 };
    let mut failed = Vec::new();
    for of in [Made::Metal, Made::Dielectric, Made::Coat] {
        for (roughness, rays) in [
            (0.0, Rays::Software),
            (0.1, Rays::Query),
            (0.3, Rays::Pipeline),
            (0.6, Rays::Software),
            (1.0, Rays::Query),
        ] {
            if !is_wanted(of, roughness) {
                continue;
            }
            let rays = if gpu.check_rays(rays).is_ok() { rays } else { Rays::Software };
            let (scene, time) = scene_of(name, of, roughness)?;
            let bias = bias_of(&gpu, &scene, time, rays, effort)?;
            let row = row(name, of, roughness, rays, bias);
            println!("{row}");
            let has_light = (bias.light - 1.0).abs() < 0.01 + 3.0 * bias.light_error;
            // The bound holds for all that the noise leaves possible.
            if bias.relmse + 2.0 * bias.error >= 1e-3 || bias.error >= effort.error || !has_light {
                failed.push(row);
            }
        }
    }
    ensure!(failed.is_empty(), "{failed:#?}");
    Ok(())
}

#[test]
fn no_surface_in_a_box_of_mirrors_has_a_bias() -> Result<()> {
    no_bias_on_any_surface("box")
}

#[test]
fn no_surface_in_cornell_has_a_bias() -> Result<()> {
    no_bias_on_any_surface("cornell")
}

#[test]
fn no_surface_of_the_carousel_has_a_bias() -> Result<()> {
    no_bias_on_any_surface("carousel")
}

#[test]
fn no_surface_in_the_courtyard_has_a_bias() -> Result<()> {
    no_bias_on_any_surface("courtyard")
}
