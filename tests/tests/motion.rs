//! Motion vectors of a moving camera, against a projection in double precision.
use anyhow::Result;
use magpie::config::Config;
use magpie::frame::ViewDesc;
use magpie::graph::Extent;
use magpie::scene::{Camera, Policy, ResidentOptions, ResidentScene, Scene};
use magpie::stage::Build;
use magpie_passes::Slots;
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
    let (eye_now, eye_before) = (Eye::new(now, EXTENT), Eye::new(before, EXTENT));
    let size = [f64::from(EXTENT.width), f64::from(EXTENT.height)];
    let (mut worst, mut moved) = (0.0_f64, 0);
    for (pixel, (motion, depth)) in motion.iter().zip(&depth).enumerate() {
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
    Ok((worst, moved))
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
