//! Denoised shadows in motion, frame by frame against the ground truth of that frame: moving camera, object and light, and a light that is
//! switched.
use anyhow::{Context, Result, ensure};
use glam::{DQuat, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Animation, Camera, Channel, Interpolation, Light, Local, Node, Property, Scene};
use magpie_bench::motion::stand;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::camera;
use magpie_tests::harness::{config_without_bounces, gpu};

#[allow(dead_code, reason = "shared with the tests of maps")]
#[path = "shadow_maps/rig.rs"]
mod rig;
use rig::{SIZE, things};

const FRAME: f64 = 1.0 / 60.0;
/// Default position and orientation of a node that moves an object.
const HERE: (DVec3, DQuat) = (DVec3::ZERO, DQuat::IDENTITY);

/// A disc light beside the objects of the scene.
fn lamp(radius: f32) -> Light {
    Light::Disc {
        centre: DVec3::new(2.5, 5.0, 1.5),
        normal: Vec3::new(-0.45, -0.85, -0.27).normalize(),
        radius,
        radiance: Vec3::splat(12.0),
    }
}

/// State of the scene in a frame.
struct Moment {
    camera: Camera,
    time: f64,
    factor: f32,
}

fn still(time: f64) -> Moment {
    Moment { camera: camera(DVec3::new(0.5, 4.0, 7.0), DVec3::new(0.0, 0.3, 0.0)), time, factor: 1.0 }
}

/// A renderer that renders frames of a path.
struct Run {
    renderer: Renderer,
}

impl Run {
    fn new(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<Self> {
        let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config_without_bounces(changes)?, options)?;
        renderer.read_slots(&["shadows"])?;
        Ok(Self { renderer })
    }

    /// Visibility of the first light.
    fn frame(&mut self, moment: &Moment) -> Result<Vec<f64>> {
        self.renderer.scale_light(0, moment.factor);
        let request = FrameRequest { camera: &moment.camera, time: moment.time, view: None, read_back: true };
        let result = self.renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{:?}", result.findings);
        let image = result.slots[0].1.as_ref().context("no shadows")?;
        Ok(image.values().iter().map(|v| f64::from(v[0])).collect())
    }
}

/// The mean of 128 rays per pixel.
fn truth(gpu: &Gpu, scene: &Scene, moment: &Moment) -> Result<Vec<f64>> {
    let mut run = Run::new(gpu, scene, &["shadows.denoiser=none", "shadows.rays=8"])?;
    let mut sums = run.frame(moment)?;
    for _ in 1..16 {
        sums.iter_mut().zip(run.frame(moment)?).for_each(|(sum, v)| *sum += v);
    }
    Ok(sums.into_iter().map(|sum| sum / 16.0).collect())
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// Errors of one ray per pixel, and of its denoised result, in each frame.
fn errors(gpu: &Gpu, scene: &Scene, path: &[Moment]) -> Result<Vec<[f64; 2]>> {
    let (mut noisy, mut denoised) = (Run::new(gpu, scene, &["shadows.denoiser=none"])?, Run::new(gpu, scene, &[])?);
    let mut errors = Vec::new();
    for moment in path {
        let truth = truth(gpu, scene, moment)?;
        errors.push([rms(&noisy.frame(moment)?, &truth), rms(&denoised.frame(moment)?, &truth)]);
    }
    Ok(errors)
}

fn stays_below(name: &str, errors: &[[f64; 2]]) -> Result<()> {
    for (frame, [noisy, denoised]) in errors.iter().enumerate() {
        println!("{name}, frame {}: one ray {noisy:.4}, denoised {denoised:.4}", frame + 1);
    }
    for (frame, [noisy, denoised]) in errors.iter().enumerate().skip(3) {
        ensure!(denoised < noisy, "{name}, frame {}: {denoised} is no less than {noisy}", frame + 1);
    }
    Ok(())
}

/// Adds a node that moves by `amount` in a second, and back in the next.
fn swings(scene: &mut Scene, (from, rotation): (DVec3, DQuat), amount: Vec3) -> u32 {
    let node = scene.nodes.len() as u32;
    let local = Local::Trs { translation: from, rotation, scale: DVec3::ONE };
    scene.nodes.push(Node { name: "swing".to_owned(), local, ..Node::default() });
    let places = [from.as_vec3(), from.as_vec3() + amount, from.as_vec3()];
    scene.animations.push(Animation {
        name: "swing".to_owned(),
        duration: 2.0,
        channels: vec![Channel {
            node,
            property: Property::Translation,
            interpolation: Interpolation::Linear,
            times: vec![0.0, 1.0, 2.0],
            values: places.iter().flat_map(|p| p.to_array()).collect(),
        }],
    });
    node
}

#[test]
fn denoised_shadows_are_better_than_a_ray_while_things_move() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let frames = 10;

    let scene = things(&[lamp(0.5)]);
    let turning = |k: i32| {
        let angle = 0.02 * f64::from(k);
        let eye = DVec3::new(0.5 + 7.0 * angle.sin(), 4.0, 7.0 * angle.cos());
        Moment { camera: camera(eye, DVec3::new(0.0, 0.3, 0.0)), ..still(0.0) }
    };
    stays_below("camera", &errors(&gpu, &scene, &(0..frames).map(turning).collect::<Vec<_>>())?)?;

    let moments: Vec<Moment> = (0..frames).map(|k| still(FRAME * f64::from(k))).collect();
    let mut scene = things(&[lamp(0.5)]);
    let node = swings(&mut scene, HERE, Vec3::new(1.5, 0.0, 0.0));
    scene.instances[1].node = Some(node);
    stays_below("thing", &errors(&gpu, &scene, &moments)?)?;

    let mut scene = things(&[lamp(0.5)]);
    let node = swings(&mut scene, stand(&lamp(0.5)), Vec3::new(-2.0, 0.0, 1.0));
    scene.light_nodes = vec![Some(node)];
    stays_below("light", &errors(&gpu, &scene, &moments)?)
}

/// Response to a light that is switched on: mean visibility over its final value, per frame.
fn switch(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<Vec<f64>> {
    let wanted: f64 = truth(gpu, scene, &still(0.0))?.iter().sum();
    let mut run = Run::new(gpu, scene, changes)?;
    for _ in 0..40 {
        run.frame(&Moment { factor: 0.0, ..still(0.0) })?;
    }
    (0..24).map(|_| Ok(run.frame(&still(0.0))?.iter().sum::<f64>() / wanted)).collect()
}

#[test]
fn a_switched_light_is_seen_at_once_with_the_adaptive_history() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Without a second light that stays on, there would be no shadows to keep a history of.
    let faint = Light::Point { position: DVec3::new(0.0, 9.0, 0.0), intensity: Vec3::splat(1e-3), range: None };
    let scene = things(&[lamp(0.5), faint]);
    let adaptive = switch(&gpu, &scene, &[])?;
    let fixed = switch(&gpu, &scene, &["shadows.adaptive=false"])?;
    println!("adaptive: {adaptive:.3?}\nfixed: {fixed:.3?}");
    let seen = |shares: &[f64]| shares.iter().position(|x| *x > 0.9).map_or(shares.len() + 1, |at| at + 1);
    println!("90 % are seen in frame {} with the adaptive history, {} without", seen(&adaptive), seen(&fixed));
    ensure!(seen(&adaptive) <= 8 && seen(&fixed) > 8, "{} and {}", seen(&adaptive), seen(&fixed));
    Ok(())
}

#[test]
fn thirty_frames_after_a_thing_has_left_nothing_is_left_of_its_shadow() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = things(&[lamp(0.5)]);
    let node = swings(&mut scene, HERE, Vec3::new(60.0, 0.0, 0.0));
    scene.instances[1].node = Some(node);
    let mut run = Run::new(&gpu, &scene, &[])?;
    for _ in 0..40 {
        run.frame(&still(0.0))?;
    }
    let (before, after) = (truth(&gpu, &scene, &still(0.0))?, truth(&gpu, &scene, &still(1.0))?);
    // Where the shadow was before: remaining darkness.
    let energy = |seen: &[f64]| -> f64 {
        (0..seen.len()).filter(|i| after[*i] - before[*i] > 0.5).map(|i| (after[i] - seen[i]).max(0.0)).sum()
    };
    let whole = energy(&before);
    let mut remaining = Vec::new();
    for _ in 0..31 {
        remaining.push(energy(&run.frame(&still(1.0))?) / whole);
    }
    println!("{remaining:.3?}");
    ensure!(whole > 50.0, "{whole} of shadow were there");
    ensure!(remaining[30] < 0.01, "{} is left after 30 frames", remaining[30]);
    Ok(())
}
