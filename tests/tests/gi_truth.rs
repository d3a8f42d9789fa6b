//! How far each implementation of `gi` is from the reference: at rest, and frame by frame from nothing.
use anyhow::{Result, ensure};
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_passes::reference::{Estimate, Only, ReferenceOptions};
use magpie_tests::against::{Shown, light_and_block_error, truth_of};
use magpie_tests::gi::{Frames, SURFELS, light_and_error, mean, ways};
use magpie_tests::harness::{asset, builtin, gpu_without_validation, save_picture};
use magpie_tests::rooms;
use std::env;
use std::time::Instant;

/// How much is computed.
#[derive(Clone, Copy)]
struct Effort {
    size: [u32; 2],
    frames: u32,
    /// Samples of each pixel of the reference.
    samples: u32,
}

const QUICK: Effort = Effort { size: [48, 36], frames: 64, samples: 256 };
const FULL: Effort = Effort { size: [96, 72], frames: 256, samples: 512 };

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// The names in `MAGPIE_ONLY`, separated by semicolons; all without it.
fn is_wanted(name: &str) -> bool {
    env::var("MAGPIE_ONLY").map_or(true, |only| only.split(';').any(|one| one == name))
}

const COURTYARD: &str = "courtyard, close";

fn courtyard() -> Result<Scene> {
    let mut scene = builtin("courtyard")?;
    scene.cameras.retain(|camera| camera.name == "close");
    ensure!(scene.cameras.len() == 1, "no camera `close`");
    Ok(scene)
}

fn scenes() -> Result<Vec<(&'static str, Scene)>> {
    let mut scenes = vec![
        ("cornell", builtin("cornell")?),
        (COURTYARD, courtyard()?),
        ("door slit, 5 cm", rooms::door_slit(0.05)),
        ("door slit, 10 cm", rooms::door_slit(0.1)),
        ("white room", rooms::white()),
        ("emissive room", rooms::emissive()),
        ("1,000 lamps", rooms::lamps(1000)),
        ("coloured wall", rooms::coloured_wall()),
    ];
    if let Some(diorama) = asset("pica_pica_mini_diorama/scene.gltf")? {
        scenes.push(("diorama", diorama));
    }
    scenes.retain(|(name, _)| is_wanted(name));
    Ok(scenes)
}

fn truth(gpu: &Gpu, scene: &Scene, effort: Effort) -> Result<Estimate> {
    let options = ReferenceOptions { only: Only::Gi, ..ReferenceOptions::default() };
    truth_of(options, gpu, scene, Shown { size: effort.size, time: 0.0 }, effort.samples)
}

/// Scenes in which surfels are compared in every run: the least light, over that of the reference, the greatest error of blocks, and the
/// greatest relMSE.
const COMPARED: [(&str, f64, f64, f64); 5] = [
    ("cornell", 0.95, 0.1, 0.02),
    ("white room", 0.95, 0.1, 0.01),
    ("emissive room", 0.95, 0.1, 0.06),
    // Light from one direction of a hundred: after 64 frames few surfels have seen it often. Where each shows what it has found as its own,
    // relMSE is 0.14 and 0.27, of bright discs.
    ("door slit, 5 cm", 0.4, 0.75, 0.05),
    ("door slit, 10 cm", 0.8, 0.45, 0.15),
];

/// Light through slits is that of many runs: after 64 frames chance makes a tenth of it.
const SEEDS_OF_SLITS: u32 = 5;

/// Surfels have the light of the reference, also where it comes through a slit, from surfaces that shine, or after many bounces.
#[test]
fn surfels_have_the_light_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let mut failed = Vec::new();
    for (name, scene) in scenes()? {
        let Some((_, least, most, most_square)) = COMPARED.into_iter().find(|(compared, ..)| *compared == name) else {
            continue;
        };
        let started = Instant::now();
        let truth = truth(&gpu, &scene, QUICK)?;
        let seeds = if name.starts_with("door slit") { SEEDS_OF_SLITS } else { 1 };
        let mut runs = Vec::new();
        for seed in 0..seeds {
            let found = Frames::seeded(&gpu, &scene, SURFELS, &[], QUICK.size, seed)?.after(QUICK.frames - 1)?;
            let [light, error] = light_and_error(&found, &truth);
            println!("{name}, seed {seed}: light {light:.3}, relMSE {error:.4}");
            runs.push([light, error, light_and_block_error(&found, &truth.mean, QUICK.size[0])[1]]);
        }
        let mean_of = |i: usize| runs.iter().map(|run| run[i]).sum::<f64>() / runs.len() as f64;
        let (light, blocks) = (mean_of(0), mean_of(2));
        // A bright disc beside the slit, in one to three runs of eight, makes nearly all of a mean; the error of blocks counts it.
        runs.sort_by(|a, b| a[1].total_cmp(&b[1]));
        let error = runs[runs.len() / 2][1];
        println!(
            "{name}: light {light:.3}, relMSE {error:.4}, blocks of 8x8 {blocks:.3}, {:.1} s",
            started.elapsed().as_secs_f64()
        );
        let right = (least..1.05).contains(&light) && blocks <= most && error <= most_square;
        if !right {
            failed.push(format!("{name}: light {light}, error of blocks {blocks}, relMSE {error}"));
        }
    }
    ensure!(failed.is_empty(), "{failed:#?}");
    Ok(())
}

/// Surfels take light from each other in every frame, and it does not grow by that: light is after 256 frames what it was after 64.
#[test]
fn light_stays_what_it_is() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let mut frames = Frames::new(&gpu, &builtin("cornell")?, SURFELS, &[], FULL.size)?;
    let early = mean(&frames.after(63)?);
    let late = mean(&frames.after(191)?);
    println!("Cornell: light {early:.4} in frame 64, {late:.4} in frame 256");
    ensure!((late / early - 1.0).abs() < 0.03, "light {early} in frame 64, {late} in frame 256");
    Ok(())
}

/// Mean radiance of the pictures, to which those of a scene are brightened alike.
const BRIGHTNESS: f64 = 0.18;

/// All of them as a table, with `MAGPIE_FULL`, and of each scene a picture of the reference and of each way.
#[test]
fn all_ways_against_the_reference() -> Result<()> {
    if !is_full() {
        return Ok(());
    }
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    println!("| scene | way | light | relMSE | blocks of 8x8 |\n|---|---|---|---|---|");
    for (name, scene) in scenes()? {
        let truth = truth(&gpu, &scene, FULL)?;
        let mut pictures = vec![truth.mean.clone()];
        for way in ways() {
            let found = Frames::new(&gpu, &scene, way, &[], FULL.size)?.after(FULL.frames - 1)?;
            let [_, blocks] = light_and_block_error(&found, &truth.mean, FULL.size[0]);
            let [light, error] = light_and_error(&found, &truth);
            ensure!(light.is_finite() && error.is_finite() && light >= 0.0, "{name}, {}: {light}, {error}", way.label);
            println!("| {name} | {} | {light:.3} | {error:.4} | {blocks:.3} |", way.label);
            pictures.push(found);
        }
        let brighter = BRIGHTNESS / mean(&truth.mean);
        pictures.iter_mut().flatten().for_each(|radiance| *radiance *= brighter);
        save_picture(&format!("gi_truth {name}"), FULL.size[0], pictures.len() as u32, &pictures)?;
    }
    Ok(())
}

/// From nothing the error falls, and the picture is soon covered for good.
#[test]
fn light_comes_from_nothing() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let effort = if is_full() { FULL } else { Effort { frames: 32, ..QUICK } };
    for (name, scene) in [("cornell", builtin("cornell")?), (COURTYARD, courtyard()?)] {
        let truth = truth(&gpu, &scene, effort)?;
        let mut frames = Frames::new(&gpu, &scene, SURFELS, &[], effort.size)?;
        let (mut lights, mut errors, mut uncovered) = (Vec::new(), Vec::new(), Vec::new());
        println!("{name}: frame, light, relMSE, blocks of 8x8, uncovered, surfels");
        for frame in 1..=effort.frames {
            let (found, counters) = frames.counted()?;
            uncovered.push(counters.uncovered);
            if frame.is_power_of_two() {
                let [_, blocks] = light_and_block_error(&found, &truth.mean, effort.size[0]);
                let [light, error] = light_and_error(&found, &truth);
                println!(
                    "| {frame} | {light:.3} | {error:.4} | {blocks:.3} | {:.4} | {} |",
                    counters.uncovered, counters.live
                );
                lights.push(light);
                errors.push(blocks);
            }
        }
        let (last, light) = (errors.len() - 1, lights[lights.len() - 1]);
        ensure!(errors[last] < 0.5 * errors[0] && errors[last] < 0.2, "{name}: errors {errors:?}");
        ensure!((light - 1.0).abs() < 0.05, "{name}: light {light}");
        for (frame, pair) in (2..).zip(uncovered.windows(2)) {
            ensure!(pair[1] <= pair[0].max(0.005), "{name}, frame {frame}: uncovered {} after {}", pair[1], pair[0]);
        }
        ensure!(uncovered[31] < 0.005, "{name}: {} uncovered after 32 frames", uncovered[31]);
    }
    Ok(())
}
