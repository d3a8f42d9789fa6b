//! Lights without power: every light table of them, alone and together with real lights, in the frame and in the reference.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Environment, Light, Material, Mesh, Scene, Sphere};
use magpie_passes::reference::{Estimate, Reference, ReferenceOptions, Strategy};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene};
use magpie_tests::harness::{config_without_bounces, gpu};

const SIZE: [u32; 2] = [16, 12];

fn at(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

/// A floor with a block on it, without lights.
fn stage(name: &str) -> Scene {
    let mut s = scene(name, camera([0.0, 1.6, 3.4], [0.0, 0.3, 0.0]));
    add(&mut s, plane(4.0), material([0.7; 3], 0.0, 0.6), at(0.0, 0.0, 0.0));
    add(&mut s, block(Vec3::splat(0.3)), material([0.9, 0.8, 0.5], 1.0, 0.3), at(-0.5, 0.3, 0.1));
    s
}

/// One light of each kind with this strength and size.
fn lamps(strength: f32, size: f32) -> Vec<Light> {
    let (place, radiance) = (DVec3::new(0.4, 1.5, 0.6), Vec3::splat(strength));
    let direction = Vec3::new(-0.2, -1.0, 0.1).normalize();
    let sun = |angular_radius| Light::Directional { direction, illuminance: radiance, angular_radius };
    vec![
        Light::Point { position: place, intensity: radiance, range: None },
        Light::Spot { position: place, direction, intensity: radiance, range: Some(9.0), inner: 0.2, outer: 0.6 },
        Light::Rectangle { centre: place, half_u: Vec3::X * size, half_v: Vec3::Z * size, radiance },
        Light::Disc { centre: place, normal: direction, radius: size, radiance },
        Light::Sphere { centre: place, radius: size, radiance },
        sun(0.0),
        sun(0.1 * size),
    ]
}

fn sky(change: impl FnOnce(&mut Environment)) -> impl FnOnce(&mut Scene) {
    let mut map = environment();
    change(&mut map);
    |scene| scene.environment = Some(map)
}

fn emits(emission: Vec3) -> Material {
    Material { emission, double_sided: true, ..material([0.0; 3], 0.0, 1.0) }
}

/// Degenerate triangles.
fn thread() -> Mesh {
    let mut mesh = plane(0.5);
    mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
    mesh
}

type Change = Box<dyn FnOnce(&mut Scene)>;

/// All kinds of lights without power, by name, and how each is added to a scene.
fn dark() -> Vec<(String, Change)> {
    let mut all: Vec<(String, Change)> = vec![
        (
            "a black environment".to_owned(),
            Box::new(sky(|map| map.radiance = vec![Vec3::ZERO; map.radiance.len()].into())),
        ),
        ("an environment of scale 0".to_owned(), Box::new(sky(|map| map.scale = 0.0))),
        ("a glow without area".to_owned(), Box::new(|s| add(s, thread(), emits(Vec3::ONE), at(0.0, 1.0, 0.0)))),
        (
            "a ball without a radius".to_owned(),
            Box::new(|s| {
                let spheres = vec![Sphere { centre: Vec3::Y, radius: 0.0 }];
                add(
                    s,
                    Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() },
                    emits(Vec3::ONE),
                    at(0.0, 0.0, 0.0),
                );
            }),
        ),
        (
            "all of them".to_owned(),
            Box::new(|s| {
                s.lights.extend(lamps(0.0, 0.3));
                s.lights.extend(lamps(1.0, 0.0).drain(2..5));
                add(s, thread(), emits(Vec3::ONE), at(0.0, 1.0, 0.0));
                sky(|map| map.scale = 0.0)(s);
            }),
        ),
    ];
    for (i, lamp) in lamps(0.0, 0.3).into_iter().enumerate() {
        all.push((format!("a dark lamp, {i}"), Box::new(|s| s.lights.push(lamp))));
    }
    for (i, lamp) in lamps(1.0, 0.0).into_iter().enumerate().skip(2).take(3) {
        all.push((format!("a lamp without size, {i}"), Box::new(|s| s.lights.push(lamp))));
    }
    all
}

fn estimate(gpu: &Gpu, scene: &Scene, strategy: Strategy, samples: u32) -> Result<Estimate> {
    let [width, height] = SIZE;
    let options = ReferenceOptions { width, height, strategy, depth: 3, check: true, ..ReferenceOptions::default() };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

/// The radiance of a frame with every check on.
fn frame(gpu: &Gpu, scene: &Scene) -> Result<Vec<[f32; 4]>> {
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    // Without paths that choose among lights at random: they would choose others.
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config_without_bounces(&[])?, options)?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    let result = renderer.frame(request)?.context("no frame")?;
    ensure!(result.findings.is_empty(), "{}: {}", scene.name, result.findings[0]);
    Ok(result.images.context("no image")?.linear.values())
}

#[test]
fn alone_they_give_black() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, change) in dark() {
        let mut scene = stage(&name);
        change(&mut scene);
        for strategy in [Strategy::Power, Strategy::LightsOnly, Strategy::SurfacesOnly] {
            let seen = estimate(&gpu, &scene, strategy, 4)?;
            // The degenerate mesh and the ball of radius 0 are too thin to be visible.
            ensure!(seen.mean.iter().all(|v| *v == DVec3::ZERO), "{name}, {strategy:?}: {:?}", seen.mean);
        }
        let values = frame(&gpu, &scene)?;
        ensure!(values.iter().all(|v| v[..3] == [0.0; 3]), "{name}: the frame is not black: {values:?}");
    }
    Ok(())
}

/// A panel, lights of every kind, and a sky.
fn bright(name: &str) -> Scene {
    let mut scene = stage(name);
    scene.lights = lamps(0.4, 0.3);
    add(&mut scene, plane(0.4), emits(Vec3::new(3.0, 2.0, 1.0)), at(-0.6, 1.4, 0.3));
    scene.environment = Some(environment());
    scene
}

#[test]
fn beside_others_they_change_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let without = bright("all that shines");
    let (truth, wanted) = (estimate(&gpu, &without, Strategy::Power, 256)?, frame(&gpu, &without)?);
    ensure!(wanted.iter().all(|v| v[1] > 0.01), "the frame is dark: {wanted:?}");
    for (name, change) in dark().into_iter().filter(|(name, _)| !name.contains("environment")) {
        let mut scene = bright(&name);
        change(&mut scene);
        scene.environment.clone_from(&without.environment);
        // With independent samples, so that the difference is known from both standard errors.
        let found = estimate(&gpu, &scene, Strategy::Power, 256)?;
        let (mut off, mut variance, mut sum) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for (at, (a, b)) in found.standard_error().iter().zip(truth.standard_error()).enumerate() {
            off += found.mean[at] - truth.mean[at];
            variance += *a * *a + b * b;
            sum += truth.mean[at];
        }
        let (error, deviate) = (variance.map(f64::sqrt), (off / variance.map(f64::sqrt)).abs().max_element());
        println!("{name:<26} {:+.3} % of the light, {deviate:.2} standard errors", 100.0 * off.y / sum.y);
        ensure!(deviate < 4.5 && (error / sum).max_element() < 0.02, "{name}: {off} +- {error} of {sum}");
        // The same values, except that a table of three entries instead of two gives other sample points on the panel.
        let changed = frame(&gpu, &scene)?.iter().zip(&wanted).map(|(a, b)| (a[1] - b[1]).abs()).fold(0.0, f32::max);
        let allowed = if name.contains("ball") { 0.1 } else { 0.0 };
        ensure!(changed <= allowed, "{name}: the frame is {changed} off");
    }
    Ok(())
}
