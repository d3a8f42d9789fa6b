//! Light that surfels pass on to each other for long: it neither fades nor grows, and recovers from a frame with light beyond all measure.
use anyhow::{Result, ensure};
use glam::{Affine3A, Vec3};
use magpie::gpu::Gpu;
use magpie::graph::check::{Place, Poison, PoisonValue};
use magpie::scene::{Material, Scene};
use magpie_shaders::scene as shared;
use magpie_tests::fixtures::{add, block, camera, material, scene};
use magpie_tests::gi::{Frames, SURFELS, light_of, mean};
use magpie_tests::harness::gpu_without_validation;
use magpie_tests::rooms;
use std::env;
use std::mem::offset_of;
use std::time::Instant;

const SIZE: [u32; 2] = [16, 12];
/// Frames after which light is printed.
const MARKS: [u32; 7] = [50, 100, 250, 500, 1000, 2500, 5000];

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// A closed room whose walls shine.
fn shining(albedo: f32) -> Scene {
    let mut s = scene("shining", camera([0.7, 0.3, 0.6], [-0.6, -0.4, -0.5]));
    let wall = Material { double_sided: true, emission: Vec3::ONE, specular: 0.0, ..material([albedo; 3], 0.0, 1.0) };
    add(&mut s, block(Vec3::ONE), wall, Affine3A::IDENTITY);
    s
}

/// Light in a closed room that shines goes to emission over (1 - albedo), less what is not in the slot, and stays there.
#[test]
fn light_in_closed_rooms_goes_to_its_end_and_stays() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    // Room for several times the frames that light needs to spread.
    let cases: &[(f32, u32)] = if is_full() {
        &[(0.5, 5000), (0.8, 5000), (0.95, 5000), (0.99, 5000)]
    } else {
        &[(0.5, 100), (0.8, 250), (0.95, 250)]
    };
    let mut failed = Vec::new();
    for &(albedo, last) in cases {
        let started = Instant::now();
        // What walls have scattered at least twice: the pixel's own wall, and one that is lit by walls.
        let truth = f64::from(albedo * albedo / (1.0 - albedo));
        let mut frames =
            Frames::new(&gpu, &shining(albedo), SURFELS, &["gi.surfel_radius=0.1", "gi.surfels=2048"], SIZE)?;
        let (mut most, mut ratios, mut now) = (0.0_f64, Vec::new(), 0.0);
        for frame in 1..=last {
            now = mean(&frames.light()?) / truth;
            most = most.max(now);
            if MARKS.contains(&frame) {
                ratios.push(now);
            }
        }
        println!(
            "albedo {albedo}: {ratios:.4?}, at most {most:.4}, after {last} frames {now:.4}, {:.1} s",
            started.elapsed().as_secs_f64()
        );
        let approaches = ratios.windows(2).all(|pair| (pair[1] - 1.0).abs() < (pair[0] - 1.0).abs().max(0.02));
        // In so few frames the light in rooms of high albedo has not yet spread.
        let has_spread = f64::from(last) * f64::from(1.0 - albedo) > 20.0;
        if most > 1.05 || !approaches || (has_spread && (now - 1.0).abs() > 0.05) || now < 0.5 {
            failed.push(format!("albedo {albedo}: {ratios:?}, at most {most}, in the end {now}"));
        }
    }
    ensure!(failed.is_empty(), "{failed:#?}");
    Ok(())
}

/// What happens to the lamp in one frame.
#[derive(Clone, Copy, Debug)]
enum Burst {
    /// Its intensity is read as this.
    Bad(PoisonValue),
    /// It is brighter by so much.
    Bright(f32),
}

/// What comes after a burst.
struct Recovery {
    /// Frames until the light is within 10 % of what it was, and stays there; of those that are looked at.
    after: Option<u32>,
    /// Light over what it was, of each frame.
    ratios: Vec<f64>,
}

fn recovery(gpu: &Gpu, burst: Burst, last: u32) -> Result<Recovery> {
    let scene = rooms::coloured_lamp();
    let mut frames = Frames::new(gpu, &scene, SURFELS, &["gi.surfels=8192"], [32, 24])?;
    let before = mean(&frames.after(39)?);
    ensure!(before > 0.01, "the room is dark: {before}");
    match burst {
        Burst::Bad(value) => {
            let after = |at: usize, bytes: usize| at.next_multiple_of(16) + bytes;
            let instances = size_of::<shared::Scene>().next_multiple_of(16);
            let lights = after(instances, scene.instances.len() * size_of::<shared::Instance>()).next_multiple_of(16);
            let place = Place::Element((lights + offset_of!(shared::Light, intensity)) as u64 / 4);
            let (pass, output) = ("scene.update".to_owned(), "scene.state".to_owned());
            // Tables are written where something changes.
            frames.renderer.scale_light(0, 0.999);
            frames.renderer.poison(Poison { pass, output, place, value });
            let result = frames.frame(None)?;
            ensure!(result.sample.passes.iter().any(|p| p.name == "scene.update"), "no table was written");
        }
        Burst::Bright(factor) => {
            frames.renderer.scale_light(0, factor);
            frames.frame(None)?;
        }
    }
    frames.renderer.scale_light(0, 1.0);
    let (mut recovered, mut ratios) = (None, Vec::new());
    for frame in 1..=last {
        let light = light_of(&frames.frame(None)?)?;
        ensure!(frame < 3 || light.iter().all(|v| v.is_finite()), "{burst:?}: not finite after {frame} frames");
        let ratio = mean(&light) / before;
        if (ratio - 1.0).abs() > 0.1 || !ratio.is_finite() {
            recovered = None;
        } else if recovered.is_none() {
            recovered = Some(frame);
        }
        ratios.push(ratio);
    }
    let course: Vec<f64> =
        (0..).map(|k| 1 << k).take_while(|at| *at <= ratios.len()).map(|at| ratios[at - 1]).collect();
    println!("{burst:?}: after 1, 2, 4, … frames {course:.3?}; within 10 % after {recovered:?}");
    Ok(Recovery { after: recovered, ratios })
}

/// A lamp that is infinite or not a number in one frame leaves nothing behind, and one that is brighter fades.
#[test]
fn light_recovers_from_one_bad_frame() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let last = if is_full() { 600 } else { 80 };
    let mut failed = Vec::new();
    for burst in
        [Burst::Bad(PoisonValue::Nan), Burst::Bad(PoisonValue::Infinity), Burst::Bright(100.0), Burst::Bright(1e8)]
    {
        let Recovery { after, ratios } = recovery(&gpu, burst, last)?;
        let recovers = match burst {
            Burst::Bad(_) => after.is_some_and(|frames| frames <= 4),
            // However bright, a sample is limited to some times what is known nearby; means then begin anew.
            Burst::Bright(_) => after.is_some_and(|frames| frames <= 64),
        };
        if !recovers {
            failed.push(format!("{burst:?}: within 10 % after {after:?} frames, after 64 it is {}", ratios[63]));
        }
    }
    ensure!(failed.is_empty(), "{failed:#?}");
    Ok(())
}
