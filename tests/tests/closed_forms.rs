//! The reference on the device against closed forms, to 0.2 %.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Environment, Light, Material, Mesh, Scene, Sphere};
use magpie_passes::reference::{Reference, ReferenceOptions};
use magpie_tests::fixtures::{add, camera, plane, scene};
use magpie_tests::harness::gpu;
use std::f64::consts::PI;

/// Greatest relative difference.
const LIMIT: f64 = 0.002;
const EDGE: u32 = 16;

/// Without a specular reflection, as the index of refraction is that of air.
fn diffuse(colour: Vec3) -> Material {
    Material { base_colour: colour.extend(1.0), metalness: 0.0, ior: 1.0, double_sided: true, ..Material::default() }
}

fn unit_ball() -> Mesh {
    Mesh { name: "ball".to_owned(), spheres: vec![Sphere { centre: Vec3::ZERO, radius: 1.0 }], ..Mesh::default() }
}

/// All pixels see the same point, or equivalent ones.
fn check(gpu: &Gpu, what: &str, scene: &Scene, samples: u32, wanted: DVec3) -> Result<()> {
    let options = ReferenceOptions { width: EDGE, height: EDGE, check: true, ..ReferenceOptions::default() };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    let estimate = reference.estimate();
    let pixels = f64::from(EDGE * EDGE);
    let mean = estimate.mean.iter().sum::<DVec3>() / pixels;
    let error = estimate.standard_error().iter().map(|e| *e * *e).sum::<DVec3>().map(f64::sqrt) / pixels;
    let off = ((mean - wanted) / wanted).abs().max_element();
    let unsure = (error / wanted).max_element();
    println!("{what:<28} {:.4} % off, +- {:.4} %", 100.0 * off, 100.0 * unsure);
    ensure!(unsure < LIMIT / 3.0, "{what}: too noisy to tell: {unsure}");
    ensure!(off <= LIMIT, "{what}: {mean}, and {wanted} is right");
    Ok(())
}

/// Every point sees only equivalent points: L = emission + albedo L.
#[test]
fn a_closed_sphere() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (albedo, samples) in [(0.2, 1024), (0.5, 1024), (0.7, 4096)] {
        let mut room = scene("closed sphere", camera([0.1, -0.2, 0.3], [0.6, 0.4, -0.5]));
        let emission = Vec3::new(0.5, 1.0, 3.0);
        let material = Material { emission, ..diffuse(Vec3::splat(albedo)) };
        add(&mut room, unit_ball(), material, Affine3A::from_scale(Vec3::splat(2.0)));
        let wanted = emission.as_dvec3() / (1.0 - f64::from(albedo));
        check(&gpu, &format!("closed sphere, albedo {albedo}"), &room, samples, wanted)?;
    }
    Ok(())
}

/// Irradiance of a plane by lights above it, in closed form.
#[test]
fn lights_over_a_plane() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let radiance = Vec3::new(2.0, 1.0, 0.5);
    let above = DVec3::new(0.0, 1.25, 0.0);
    let (radius, half) = (0.75_f32, 0.5_f32);
    let disc = {
        let r2 = f64::from(radius).powi(2);
        (Light::Disc { centre: above, normal: Vec3::NEG_Y, radius, radiance }, PI * r2 / (r2 + above.y.powi(2)))
    };
    // Four rectangles with a corner directly above the point, each with the view factor of Hamilton and Morgan 1952.
    let rectangle = {
        let x = f64::from(half) / above.y;
        let factor = 2.0 * x / (1.0 + x * x).sqrt() * (x / (1.0 + x * x).sqrt()).atan() / (2.0 * PI);
        (
            Light::Rectangle { centre: above, half_u: Vec3::X * half, half_v: Vec3::Z * half, radiance },
            4.0 * PI * factor,
        )
    };
    let sphere = {
        let ratio = f64::from(radius) / above.y;
        (Light::Sphere { centre: above, radius, radiance }, PI * ratio * ratio)
    };
    let point = (Light::Point { position: above, intensity: radiance, range: None }, above.y.powi(-2));
    let sun = {
        let direction = Vec3::new(0.6, -0.8, 0.0);
        (Light::Directional { direction, illuminance: radiance, angular_radius: 0.005 }, 0.8)
    };
    for (what, (light, irradiance)) in
        [("disc", disc), ("rectangle", rectangle), ("sphere", sphere), ("point", point), ("sun", sun)]
    {
        let colour = 0.5;
        let eye: Camera = Camera { vertical_fov: 2e-4, ..camera([1.5, 1.0, 0.5], [0.0; 3]) };
        let mut world = scene(what, eye);
        add(&mut world, plane(20.0), diffuse(Vec3::splat(colour)), Affine3A::IDENTITY);
        world.lights.push(light);
        let wanted = radiance.as_dvec3() * (f64::from(colour) / PI * irradiance);
        check(&gpu, &format!("{what} over a plane"), &world, 2048, wanted)?;
    }
    Ok(())
}

/// A convex object under uniform light shows its albedo; one that absorbs nothing is invisible.
#[test]
fn a_furnace() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let light = Vec3::new(0.4, 1.0, 2.5);
    let smooth = Material { roughness: 0.0, ..Material::default() };
    let glass = Material { metalness: 0.0, transmission: 1.0, thickness: 1.0, ..smooth.clone() };
    let balls = [
        ("matte", diffuse(Vec3::splat(0.6)), f64::from(0.6_f32)),
        ("mirror", smooth, 1.0),
        ("glass", glass.clone(), 1.0),
        ("bubble", Material { thickness: 0.0, ..glass }, 1.0),
    ];
    for (what, material, albedo) in balls {
        let eye = Camera { vertical_fov: 0.05, ..camera([0.0, 0.0, 5.0], [0.3, 0.2, 0.0]) };
        let mut world = scene(what, eye);
        add(&mut world, unit_ball(), material, Affine3A::IDENTITY);
        world.environment = Some(Environment {
            name: "even".to_owned(),
            width: 4,
            height: 2,
            radiance: vec![light; 8].into(),
            scale: 1.0,
            turn: 0.0,
        });
        world.environment.as_ref().context("it was just set")?.validate()?;
        check(&gpu, &format!("{what} ball in the furnace"), &world, 1024, albedo * light.as_dvec3())?;
    }
    Ok(())
}
