//! Motion vectors of a moving camera, against a projection in double precision.
use anyhow::{Context, Result};
use glam::DVec3;
use magpie::config::Config;
use magpie::frame::ViewDesc;
use magpie::graph::Extent;
use magpie::scene::{Camera, FloatingOrigin, Policy, ResidentOptions, ResidentScene, Scene};
use magpie::stage::Build;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_passes::stages::GBufferIn;
use magpie_tests::bench::Bench;
use magpie_tests::harness::{asset, builtin, gpu};
use magpie_tests::oracle::gbuffer::Eye;

const EXTENT: Extent = Extent { width: 240, height: 135 };

/// Largest error of the motion, pixels, and how many pixels moved by more than one.
fn worst_error(bench: &mut Bench, scene: &Scene, before: &Camera, now: &Camera) -> Result<(f64, usize)> {
    let gpu = bench.gpu.clone();
    let resident = ResidentScene::new(&gpu, scene, ResidentOptions::default())?.shared();
    let mut gbuffer = Slots::default()
        .gbuffer
        .from_config(&Build { gpu: &gpu, rays: magpie::prelude::Rays::Software }, &Config::default())?;
    let desc = ViewDesc { camera: now, extent: EXTENT, frame: 1, seed: 0, previous: Some((before, EXTENT)) };
    let wanted = ["gbuffer.draw:motion", "gbuffer.draw:depth"];
    let ran = bench.run(EXTENT, &wanted, |g, imports| {
        let mut block = magpie::gpu::Staging::new(&gpu, "view");
        let view = desc.declare(&mut block, &resident.borrow(), g, &mut imports.borrow_mut())?;
        let scene = resident.borrow_mut().declare(g, &mut imports.borrow_mut(), None, &Policy::default())?;
        let motion = gbuffer.add(g, &view, GBufferIn { scene }).motion;
        g.output(motion);
        Ok(())
    })?;
    let ran = ran.clean()?;
    let (motion, depth) = (ran.values(wanted[0])?, ran.values(wanted[1])?);
    Ok(compare(&motion, &depth, &Eye::new(now, EXTENT), &Eye::new(before, EXTENT)))
}

/// Largest error of the motion, pixels, and how many pixels moved by more than one.
fn compare(motion: &[[f32; 4]], depth: &[[f32; 4]], eye_now: &Eye, eye_before: &Eye) -> (f64, usize) {
    let size = [f64::from(EXTENT.width), f64::from(EXTENT.height)];
    let (mut worst, mut moved) = (0.0_f64, 0);
    for (pixel, (motion, depth)) in motion.iter().zip(depth).enumerate() {
        if depth[0] == 0.0 {
            assert_eq!(motion[..2], [0.0, 0.0], "background does not move");
            continue;
        }
        let world = eye_now.world_position(pixel, depth[0]);
        let (Some(here), Some(there)) = (eye_now.project(world), eye_before.project(world)) else { continue };
        let expected = [0, 1].map(|i| (here[i] - there[i]) * size[i]);
        let got = [0, 1].map(|i| f64::from(motion[i]) * size[i]);
        // Half floats keep 11 bits; what is left is compared in pixels.
        let error = (0..2).map(|i| (got[i] - expected[i]).abs() - expected[i].abs() / 2048.0).fold(0.0, f64::max);
        worst = worst.max(error);
        moved += usize::from(expected[0].hypot(expected[1]) > 1.0);
    }
    (worst, moved)
}

fn moved(camera: &Camera, step: glam::Vec3, turn: f32) -> Camera {
    let mut other = camera.clone();
    other.world_from_camera.translation += step.as_dvec3();
    other.world_from_camera.matrix3 *= glam::DMat3::from_rotation_y(turn.into());
    other
}

#[test]
fn motion_is_where_things_were() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let mut scenes = vec![builtin("courtyard")?];
    scenes.extend(asset("pica_pica_mini_diorama/scene.gltf")?);
    for scene in &scenes {
        let now = &scene.cameras[0];
        let reach = now.eye().length() as f32 * 0.02;
        for (step, turn) in
            [(glam::Vec3::X * reach, 0.0), (glam::Vec3::ZERO, 0.03), (glam::vec3(0.3, -0.2, 1.0) * reach, -0.02)]
        {
            let (worst, moving) = worst_error(&mut bench, scene, &moved(now, step, turn), now)?;
            println!(
                "{}: step {step}, turn {turn}: off by at most {worst:.4} pixels, {moving} pixels moved",
                scene.name
            );
            assert!(moving > 5000, "{}: only {moving} pixels moved", scene.name);
            assert!(worst < 0.02, "{}: {worst} pixels off", scene.name);
        }
    }
    Ok(())
}

/// Frame by frame the eye goes on by more than a cell of the origin's grid, a thousand kilometres from the world's own origin.
#[test]
fn motion_stays_right_where_the_origin_steps() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    let place = DVec3::new(7e5, 1e4, -7e5);
    for instance in &mut scene.instances {
        instance.world_from_object.translation += place;
    }
    let camera = &mut scene.cameras[0];
    camera.world_from_camera.translation += place;
    // Cells of a quarter of a metre.
    camera.near = 6e-5;
    let step = DVec3::new(0.3, -0.02, 0.41);
    let cameras: Vec<Camera> = (0..3).map(|i| moved(&scene.cameras[0], (f64::from(i) * step).as_vec3(), 0.0)).collect();
    let origins: Vec<DVec3> = {
        let mut origin = FloatingOrigin::default();
        cameras.iter().map(|c| origin.follow(c)).collect()
    };
    assert!(origins[0] != origins[1] && origins[1] != origins[2], "{origins:?}");
    let see = |output: &str| -> Result<Vec<[f32; 4]>> {
        let options = RenderOptions { width: EXTENT.width, height: EXTENT.height, check: true, ..Default::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options)?;
        let mut last = None;
        for camera in &cameras {
            let view = Some(("gbuffer.draw", output));
            let result = renderer.frame(FrameRequest { camera, time: 0.0, view, read_back: true })?;
            last = result.and_then(|r| r.images);
        }
        Ok(last.context("no image")?.linear.values())
    };
    let (motion, depth) = (see("motion")?, see("depth")?);
    let [now, before] = [2, 1].map(|i| Eye::new(&cameras[i], EXTENT));
    let (worst, moved) = compare(&motion, &depth, &now, &before);
    println!("where the origin steps: worst error {worst:.4} pixels, {moved} pixels moved");
    assert!(worst < 0.05 && moved > 10_000, "worst error {worst} pixels, {moved} moved");
    Ok(())
}
