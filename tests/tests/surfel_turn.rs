//! Surfels while the camera turns, as shipped, with TAA: what comes into sight has light, and nothing becomes brighter or darker with the view.
use anyhow::{Context, Result, ensure};
use glam::{DAffine3, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Scene};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, light_and_block_error, truth_of};
use magpie_tests::harness::{builtin, config, gpu_without_validation, save_picture};
use std::env;

/// Frames.
const FRAMES: u32 = 48;
/// Scene, camera, and degrees from frame to frame: 30 and 90 degrees per second at 60 frames per second.
const TURNS: [(&str, &str, f64); 2] = [("cornell", "default", 0.5), ("courtyard", "alcove", 1.5)];
/// Frames that are compared with the reference.
const COMPARED: [u32; 4] = [12, 24, 36, 48];

/// The camera of a frame. That of the last looks as it stands in the scene, others so many degrees to the left of the next.
fn turned(camera: &Camera, degrees: f64, frame: u32) -> Camera {
    let eye = camera.world_from_camera.translation;
    let turn = DAffine3::from_rotation_y((degrees * f64::from(FRAMES - frame)).to_radians());
    let about_eye = DAffine3::from_translation(eye) * turn * DAffine3::from_translation(-eye);
    Camera { world_from_camera: about_eye * camera.world_from_camera, ..camera.clone() }
}

/// An image of the frames that are compared.
fn turning(gpu: &Gpu, scene: &Scene, degrees: f64, image: &str, [width, height]: [u32; 2]) -> Result<Vec<Vec<DVec3>>> {
    let options = RenderOptions { width, height, check: gpu.validates(), ..RenderOptions::default() };
    let config = config(&["stages.gi=surfels", "post.anti_aliasing=taa"])?;
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
    let mut found = Vec::new();
    for frame in 1..=FRAMES {
        let camera = turned(&scene.cameras[0], degrees, frame);
        let request = FrameRequest { camera: &camera, time: 0.0, view: image.split_once(':'), read_back: true };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        if COMPARED.contains(&frame) {
            let values = result.images.context("no image")?.linear;
            found.push(values.values().iter().map(|v| Vec3::from_slice(v).as_dvec3()).collect());
        }
    }
    Ok(found)
}

/// What the reference has in the same frames.
fn truths(gpu: &Gpu, scene: &Scene, degrees: f64, only: Only, size: [u32; 2], samples: u32) -> Result<Vec<Vec<DVec3>>> {
    let options = ReferenceOptions { only, ..ReferenceOptions::default() };
    let shown = |frame| {
        let camera = turned(&scene.cameras[0], degrees, frame);
        let scene = Scene { cameras: vec![camera], ..scene.clone() };
        Ok(truth_of(options, gpu, &scene, Shown { size, time: 0.0 }, samples)?.mean)
    };
    COMPARED.into_iter().map(shown).collect()
}

/// Surfels that came into sight a few frames ago have the light of the reference, in a court, in its niche, and in a closed room.
#[test]
fn light_stays_while_the_camera_turns() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let size = [96, 54];
    for (name, camera, degrees) in TURNS {
        let mut scene = builtin(name)?;
        scene.cameras.retain(|c| c.name == camera);
        let found = turning(&gpu, &scene, degrees, "gi.gather:radiance", size)?;
        let truth = truths(&gpu, &scene, degrees, Only::Gi, size, 64)?;
        let mut lights = Vec::new();
        for ((frame, found), truth) in COMPARED.into_iter().zip(&found).zip(&truth) {
            let [light, blocks] = light_and_block_error(found, truth, size[0]);
            println!("{name}, frame {frame}: light {light:.3}, error of blocks {blocks:.3}");
            ensure!((0.9..1.06).contains(&light), "{name}, frame {frame}: light {light}");
            ensure!(blocks < 0.15, "{name}, frame {frame}: error {blocks}");
            lights.push(light);
        }
        let spread = lights.iter().fold(0.0_f64, |spread, light| spread.max((light - lights[0]).abs()));
        ensure!(spread < 0.06, "{name}: light over that of the reference changes by {spread}");
    }
    Ok(())
}

/// With `MAGPIE_FULL` a picture for a look: whole frames, and below them the reference.
#[test]
fn pictures_of_a_turn() -> Result<()> {
    if env::var_os("MAGPIE_FULL").is_none() {
        return Ok(());
    }
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let size = [240, 135];
    for (name, camera, degrees) in TURNS {
        let mut scene = builtin(name)?;
        scene.cameras.retain(|c| c.name == camera);
        let mut images = turning(&gpu, &scene, degrees, "post.taa:radiance", size)?;
        images.extend(truths(&gpu, &scene, degrees, Only::All, size, 128)?);
        save_picture(&format!("surfel_turn_{name}"), size[0], 4, &images)?;
    }
    Ok(())
}
