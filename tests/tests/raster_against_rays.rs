//! Primary rays through the pixel centres against the raster G-buffer: visibility, depth and normal. With every backend of the device, for
//! every kind of geometry: opaque and alpha-tested, double-sided, moving, skinned and morphing triangles, and spheres.
//!
//! Tolerances:
//! - **depth** (view depth, relative): 2e-5 for 32-bit rounding on both sides, plus the effect of 1/256 of a pixel on the surface's slope,
//!   as the raster snaps vertices to 1/256 of a pixel.
//! - **geometric normal**: 1e-3 radians. A 16-bit octahedral normal is accurate to 5e-5; the rest is for slivers.
//! - **instance**: none.
//!
//! Every pixel beyond that must have a known cause (`compare::Cause`), and at most one in a thousand may be (five, for objects with small
//! triangles).
//!
//! The raster culls back faces of materials that are not double sided, and this test's rays continue behind such a face. Rays and raster
//! read alpha at the same mip, that of the pixel's cone.
mod raster_against_rays {
    pub mod compare;
    pub mod look;
}

use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Mat3A, Quat, Vec3};
use magpie::gpu::Gpu;
use magpie::graph::Extent;
use magpie::graph::execute::Imports;
use magpie::prelude::Rays;
use magpie::scene::{
    Camera, Material, Mesh, Moment, Policy, ResidentOptions, ResidentScene, Scene, SharedScene, Sphere,
};
use magpie_tests::bench::Bench;
use magpie_tests::fixtures;
use magpie_tests::harness::{asset, builtin, gpu};
use raster_against_rays::compare::{Count, Counts, Kinds, check, compare};
use raster_against_rays::look::{Both, look};

/// The backends of the device.
fn ways(gpu: &Gpu) -> Vec<Rays> {
    let (can, cannot): (Vec<_>, Vec<_>) = Rays::ALL.into_iter().partition(|r| gpu.check_rays(*r).is_ok());
    for rays in cannot {
        eprintln!("skipped: {rays} (this device cannot trace so)");
    }
    can
}

fn resident(gpu: &Gpu, scene: &Scene, rays: Rays) -> Result<SharedScene> {
    Ok(ResidentScene::new(gpu, scene, ResidentOptions { rays, ..ResidentOptions::default() })?.shared())
}

/// Compares one picture and checks that it shows something.
fn picture(bench: &mut Bench, resident: &SharedScene, camera: &Camera, rays: Rays, policy: &Policy) -> Result<Both> {
    let both = look(bench, resident, camera, rays, policy)?;
    let seen = both.rays.iter().filter(|s| s.instance > 0).count();
    ensure!(seen > both.rays.len() / 4, "only {seen} pixels show anything");
    ensure!(both.closest >= both.rays.len() as u64, "{} rays were counted", both.closest);
    Ok(both)
}

fn add(sum: &mut Counts, counts: &Counts) {
    for (kind, count) in counts {
        sum.entry(kind).or_default().add(count);
    }
}

fn pixels_of(counts: &Counts, kind: &str) -> u32 {
    counts.get(kind).map_or(0, |c: &Count| c.cover[0].min(c.cover[1]))
}

#[test]
fn diorama() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let Some(scene) = asset("pica_pica_mini_diorama/scene.gltf")? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let kinds = Kinds::new(&scene);
    for rays in ways(&gpu) {
        let resident = resident(&gpu, &scene, rays)?;
        for camera in &scene.cameras {
            let both = picture(&mut bench, &resident, camera, rays, &Policy::default())?;
            let label = format!("diorama, {}, {rays}", camera.name);
            check(&compare(&scene, &kinds, camera, &both, &label), &label)?;
        }
    }
    Ok(())
}

#[test]
fn courtyard() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    let mut bench = Bench::new(&gpu)?;
    let kinds = Kinds::new(&scene);
    for mips in [true, false] {
        for sampler in &mut scene.samplers {
            sampler.mips = mips;
        }
        for rays in ways(&gpu) {
            let resident = resident(&gpu, &scene, rays)?;
            for camera in &scene.cameras {
                let both = picture(&mut bench, &resident, camera, rays, &Policy::default())?;
                let label = format!("courtyard, {}, {rays}, {}", camera.name, if mips { "mips" } else { "no mips" });
                let counts = compare(&scene, &kinds, camera, &both, &label);
                ensure!(pixels_of(&counts, "alpha-tested") > 5000, "{label}: too few pixels show leaves");
                check(&counts, &label)?;
            }
        }
    }
    Ok(())
}

/// Times in the loop of the carousel, seconds.
const TIMES: [f64; 4] = [0.0, 0.7, 1.9, 3.3];
/// Kinds of geometry in the carousel, with the least number of pixels of each in all pictures together.
const SHOWN: [(&str, u32); 6] = [
    ("alpha-tested", 10_000),
    ("double-sided", 10_000),
    ("moving", 10_000),
    ("morphed", 10_000),
    ("skinned", 4000),
    ("spheres", 10_000),
];

#[test]
fn carousel() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("carousel")?;
    let mut bench = Bench::new(&gpu)?;
    let kinds = Kinds::new(&scene);
    for rays in ways(&gpu) {
        let resident = resident(&gpu, &scene, rays)?;
        let mut sum = Counts::new();
        for time in TIMES {
            resident.borrow_mut().set_moment(&Moment { time, cut: true, ..Moment::default() });
            for camera in &scene.cameras[..2] {
                let both = picture(&mut bench, &resident, camera, rays, &Policy::default())?;
                let label = format!("carousel, {}, {time} s, {rays}", camera.name);
                add(&mut sum, &compare(&scene, &kinds, camera, &both, &label));
            }
        }
        check(&sum, &format!("carousel, {rays}"))?;
        for (kind, least) in SHOWN {
            ensure!(pixels_of(&sum, kind) >= least, "{kind}: only {} pixels show any", pixels_of(&sum, kind));
        }
    }
    Ok(())
}

/// Spheres that are stretched, mirrored, tiny, cut by the near plane and seen from inside, with one-sided and two-sided materials.
#[test]
fn spheres() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let eye = Vec3::new(0.3, 1.0, 6.0);
    let mut scene = fixtures::scene("spheres", fixtures::camera(eye, Vec3::new(0.0, 0.4, 0.0)));
    let grey = || fixtures::material([0.5; 3], 0.0, 0.5);
    let both_sides = || Material { double_sided: true, ..grey() };
    let mesh = |spheres: &[(Vec3, f32)]| Mesh {
        name: "spheres".to_owned(),
        spheres: spheres.iter().map(|(centre, radius)| Sphere { centre: *centre, radius: *radius }).collect(),
        ..Mesh::default()
    };
    let at = |x, y, z| Affine3A::from_translation(Vec3::new(x, y, z));
    fixtures::add(&mut scene, fixtures::plane(4.0), grey(), at(0.0, -0.7, 0.0));
    let three = mesh(&[(Vec3::ZERO, 0.7), (Vec3::X * 0.9, 0.35), (Vec3::new(0.3, 0.8, 0.4), 0.02)]);
    let stretched = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.3, 1.4, 0.7),
        Quat::from_rotation_z(0.6),
        Vec3::new(-1.3, 0.4, 0.0),
    );
    let mirrored = Affine3A { matrix3: Mat3A::from_diagonal(Vec3::new(-1.0, 0.6, 1.2)), ..at(1.4, 0.2, 0.0) };
    fixtures::add(&mut scene, three.clone(), grey(), stretched);
    fixtures::add(&mut scene, three.clone(), grey(), mirrored);
    fixtures::add(&mut scene, three, both_sides(), at(0.2, 1.5, -1.0));
    // Around the eye: a one-sided sphere, which is invisible from inside, and far behind everything a two-sided one.
    fixtures::add(&mut scene, mesh(&[(eye, 0.5)]), grey(), Affine3A::IDENTITY);
    fixtures::add(&mut scene, mesh(&[(eye, 30.0)]), both_sides(), Affine3A::IDENTITY);
    // The near plane cuts a hole into these, through which the inside is visible if they are two-sided.
    let cut = scene.cameras[0].world_from_camera.transform_point3(DVec3::new(-0.05, 0.025, -0.1)).as_vec3();
    fixtures::add(&mut scene, mesh(&[(cut, 0.012)]), both_sides(), Affine3A::IDENTITY);
    let cut = scene.cameras[0].world_from_camera.transform_point3(DVec3::new(0.05, -0.025, -0.1)).as_vec3();
    fixtures::add(&mut scene, mesh(&[(cut, 0.01)]), grey(), Affine3A::IDENTITY);
    scene.cameras[0].near = 0.1;
    let draw = scene.instances.len() as u32;

    let mut bench = Bench::new(&gpu)?;
    let kinds = Kinds::new(&scene);
    for rays in ways(&gpu) {
        let resident = resident(&gpu, &scene, rays)?;
        let both = picture(&mut bench, &resident, &scene.cameras[0], rays, &Policy::default())?;
        let label = format!("spheres, {rays}");
        let counts = compare(&scene, &kinds, &scene.cameras[0], &both, &label);
        check(&counts, &label)?;
        let shown = |instance: u32| both.raster.iter().filter(|s| s.instance == instance + 1).count();
        for instance in [1, 2, 3, 5, 6] {
            ensure!(shown(instance) > 100, "{label}: {} pixels show instance {instance}", shown(instance));
        }
        ensure!(shown(4) == 0, "{label}: a sphere of one side is seen from inside");
        ensure!(
            both.raster.iter().all(|s| (1..=draw).contains(&s.instance)),
            "{label}: a hole in the outermost sphere"
        );
        ensure!(
            (0..3).all(|p| both.raster.iter().any(|s| s.instance == 4 && s.primitive == p)),
            "{label}: a sphere is missing"
        );
    }
    Ok(())
}

/// Frames of deformation and refits only, and their time step, which does not divide the loop.
const FRAMES: u32 = 600;
const STEP: f64 = 0.0217;

/// Ray rate, millions per second.
fn rate(both: &Both) -> f64 {
    both.nanoseconds.map_or(f64::NAN, |ns| both.closest as f64 * 1e3 / ns as f64)
}

#[test]
fn silhouettes_after_600_frames() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("carousel")?;
    let mut bench = Bench::new(&gpu)?;
    let kinds = Kinds::new(&scene);
    for rays in ways(&gpu).into_iter().filter(|r| *r != Rays::Pipeline) {
        for rebuild_every in [0, 64] {
            let policy = Policy { rebuild_every, ..Policy::default() };
            let resident = resident(&gpu, &scene, rays)?;
            // Twice, as the first picture includes pipeline creation.
            picture(&mut bench, &resident, &scene.cameras[0], rays, &policy)?;
            let before = picture(&mut bench, &resident, &scene.cameras[0], rays, &policy)?;
            for frame in 1..=FRAMES {
                let (mut g, mut imports) = (bench.executor.begin(Extent::new(1, 1)), Imports::default());
                let mut resident = resident.borrow_mut();
                resident.set_moment(&Moment { time: f64::from(frame) * STEP, ..Moment::default() });
                resident.declare(&mut g, &mut imports, None, &policy)?;
                bench.executor.run(g, &imports)?;
            }
            gpu.check_validation()?;
            let label = format!("after {FRAMES} frames, rebuilt every {rebuild_every}, {rays}");
            let mut sum = Counts::new();
            for camera in &scene.cameras[..2] {
                let after = picture(&mut bench, &resident, camera, rays, &policy)?;
                add(&mut sum, &compare(&scene, &kinds, camera, &after, &label));
                if camera.name == "default" {
                    println!("{label}: {:.3} and then {:.3} million rays per second", rate(&before), rate(&after));
                }
            }
            check(&sum, &label)?;
        }
    }
    Ok(())
}
