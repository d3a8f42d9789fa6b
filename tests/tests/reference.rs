//! The reference path tracer against itself: convergence, accuracy of its standard error, and the sum of its parts.
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::{Light, Scene};
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions, Strategy};
use magpie_tests::harness::{builtin, config, gpu, linear, render};
use magpie_tests::oracle::scenes;
use std::env;

const SIZE: [u32; 2] = [24, 16];

fn options() -> ReferenceOptions {
    ReferenceOptions { width: SIZE[0], height: SIZE[1], check: true, ..ReferenceOptions::default() }
}

fn estimate(gpu: &Gpu, scene: &Scene, options: ReferenceOptions, samples: u32) -> Result<Estimate> {
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

/// Four different scenes: an area light, a sun with a sky, an environment map, many small lights.
fn four() -> Result<[Scene; 4]> {
    Ok([builtin("cornell")?, builtin("courtyard")?, scenes::environment_map(), scenes::many_lights()])
}

/// Root mean square difference of two independent estimates: the standard error of either, times the square root of 2.
fn apart(a: &Estimate, b: &Estimate) -> f64 {
    let square: f64 = a.mean.iter().zip(&b.mean).map(|(a, b)| (*a - *b).length_squared()).sum();
    (square / (3 * a.mean.len()) as f64).sqrt()
}

/// Difference of two independent estimates in units of their standard errors: mean square over all values that vary, 1 if the standard
/// errors are right; and the deviate of the means of the whole pictures.
fn deviation(a: &Estimate, b: &Estimate) -> (f64, f64) {
    let (errors_a, errors_b) = (a.standard_error(), b.standard_error());
    let (mut sum, mut count) = (0.0, 0.0);
    let (mut total, mut variance) = (DVec3::ZERO, DVec3::ZERO);
    for at in 0..a.mean.len() {
        let difference = a.mean[at] - b.mean[at];
        let square = errors_a[at] * errors_a[at] + errors_b[at] * errors_b[at];
        total += difference;
        variance += square;
        for axis in 0..3 {
            if square[axis] > 0.0 {
                sum += difference[axis].powi(2) / square[axis];
                count += 1.0;
            }
        }
    }
    let whole = [0, 1, 2].map(|axis| total[axis].abs() / variance[axis].sqrt());
    (sum / f64::max(count, 1.0), whole.into_iter().filter(|z| z.is_finite()).fold(0.0, f64::max))
}

fn full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

#[test]
fn the_error_falls_with_the_root_of_the_samples() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let most: u32 = if full() { 4096 } else { 256 };
    // In the courtyard smooth tiles reflect the sun in one of a million paths: 4096 samples are too few there to measure a slope.
    let scenes = four()?.map(|s| if s.name == "courtyard" { scenes::area_light() } else { s });
    for scene in scenes {
        // At pixel centres: otherwise a few pixels on the edge of a light would dominate the error.
        let pixel = PixelSampling::Centre;
        let run = |seed| Reference::new(&gpu, &scene, &scene.cameras[0], ReferenceOptions { seed, pixel, ..options() });
        let (mut one, mut other) = (run(1)?, run(2)?);
        let (mut points, mut taken, mut samples) = (Vec::new(), 0, 4);
        while samples <= most {
            one.add(samples - taken)?;
            other.add(samples - taken)?;
            taken = samples;
            points.push((f64::from(samples).ln(), apart(one.estimate(), other.estimate()).ln()));
            samples *= 2;
        }
        let n = points.len() as f64;
        let (mean_x, mean_y) =
            (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
        let slope = points.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>()
            / points.iter().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>();
        let (squares, whole) = deviation(one.estimate(), other.estimate());
        println!(
            "{:<16} slope {slope:+.4} from 4 to {most} samples; two seeds: mean square deviation {squares:.3}, of the whole {whole:.2}",
            scene.name
        );
        // Fewer points have a greater variance.
        let allowed = if full() { 0.05 } else { 0.1 };
        ensure!((slope + 0.5).abs() <= allowed, "{}: {slope}: {points:?}", scene.name);
        ensure!(whole < 4.5, "{}: the pictures of two seeds are {whole} standard errors apart", scene.name);
    }
    Ok(())
}

#[test]
fn it_knows_its_error() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Half width of a 95 % confidence interval of the difference of two.
    const WIDTH: f64 = 1.96;
    for scene in four()? {
        let seed = |seed| estimate(&gpu, &scene, ReferenceOptions { seed, ..options() }, 256);
        let (a, b) = (seed(11)?, seed(12)?);
        let (errors_a, errors_b) = (a.standard_error(), b.standard_error());
        let (mut covered, mut all) = (0, 0);
        for at in 0..a.mean.len() {
            let difference = (a.mean[at] - b.mean[at]).abs().y;
            let error = (errors_a[at].y.powi(2) + errors_b[at].y.powi(2)).sqrt();
            if error > 0.0 {
                all += 1;
                covered += u32::from(difference <= WIDTH * error);
            } else {
                ensure!(difference == 0.0, "{}: pixel {at} differs by {difference} without an error", scene.name);
            }
        }
        let share = f64::from(covered) / f64::from(all);
        println!("{:<16} {:.2} % of {all} intervals of 95 % cover", scene.name, 100.0 * share);
        ensure!((share - 0.95).abs() <= 0.02 + 2.0 * (0.95 * 0.05 / f64::from(all)).sqrt(), "{}: {share}", scene.name);
    }
    Ok(())
}

#[test]
fn parts_make_up_the_whole() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in [builtin("cornell")?, scenes::environment_map(), scenes::rough_dielectric()] {
        let part = |only, seed| {
            estimate(&gpu, &scene, ReferenceOptions { only, seed, pixel: PixelSampling::Centre, ..options() }, 256)
        };
        let whole = part(Only::All, 1)?;
        // Squared errors add: the sum of the parts as one estimate.
        let mut sum = Estimate {
            mean: vec![DVec3::ZERO; whole.mean.len()],
            squares: vec![DVec3::ZERO; whole.mean.len()],
            ..whole
        };
        for (only, seed) in [(Only::Direct, 2), (Only::Gi, 3), (Only::Reflections, 4), (Only::Transparency, 5)] {
            let part = part(only, seed)?;
            for at in 0..sum.mean.len() {
                sum.mean[at] += part.mean[at];
                sum.squares[at] += part.squares[at];
            }
        }
        // The background belongs to no part.
        let ids = part(Only::AmbientOcclusion, 6)?;
        let (whole, sum) = without_background(part(Only::All, 1)?, sum, &ids);
        let (squares, deviate) = deviation(&whole, &sum);
        println!(
            "{:<16} whole against sum: mean square deviation {squares:.3}, of the picture {deviate:.2}",
            scene.name
        );
        ensure!(deviate < 4.5 && squares < 1.4, "{}: {squares}, {deviate}", scene.name);
    }
    Ok(())
}

/// Removes pixels without a surface from both; their ambient occlusion is exactly 1 without variance.
fn without_background(mut a: Estimate, mut b: Estimate, open: &Estimate) -> (Estimate, Estimate) {
    for at in 0..a.mean.len() {
        if open.mean[at] == DVec3::ONE && b.mean[at] == DVec3::ZERO {
            (a.mean[at], a.squares[at]) = (DVec3::ZERO, DVec3::ZERO);
        }
    }
    b.squares.iter_mut().zip(&a.squares).filter(|(_, a)| **a == DVec3::ZERO).for_each(|(b, _)| *b = DVec3::ZERO);
    (a, b)
}

#[test]
fn every_strategy_finds_the_same() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in [scenes::area_light(), scenes::environment_map(), scenes::glossy_metal()] {
        let by =
            |strategy, seed, samples| estimate(&gpu, &scene, ReferenceOptions { strategy, seed, ..options() }, samples);
        let power = by(Strategy::Power, 1, 256)?;
        for (name, other) in
            [("balance", by(Strategy::Balance, 2, 256)?), ("surfaces only", by(Strategy::SurfacesOnly, 3, 1024)?)]
        {
            let (squares, whole) = deviation(&power, &other);
            println!(
                "{:<16} power against {name}: mean square deviation {squares:.3}, of the whole {whole:.2}",
                scene.name
            );
            // Paths rarely hit small lights, so a thousand samples underestimate their standard error.
            ensure!(whole < 4.5 && squares < 2.0, "{}, {name}: {squares}, {whole}", scene.name);
        }
    }
    Ok(())
}

#[test]
fn it_goes_on_where_it_stopped() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let straight = estimate(&gpu, &scene, options(), 48)?;
    ensure!(straight == estimate(&gpu, &scene, options(), 48)?, "the same run twice differs");
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("half.exr");
    let subject = options().subject(&scene, &scene.cameras[0]);
    estimate(&gpu, &scene, options(), 32)?.save(&path, &subject)?;
    let mut rest = Reference::new(&gpu, &scene, &scene.cameras[0], options())?;
    rest.resume(&Estimate::load(&path, Some(&subject))?)?;
    rest.add(16)?;
    let resumed = rest.estimate();
    ensure!(resumed.samples == 48);
    for at in 0..straight.mean.len() {
        let scale = straight.mean[at].abs().max_element().max(1e-3);
        ensure!((straight.mean[at] - resumed.mean[at]).abs().max_element() <= 1e-6 * scale, "pixel {at}");
    }
    // Another seed gives independent samples, and both together are as good as twice as many.
    let other = estimate(&gpu, &scene, ReferenceOptions { seed: 9, ..options() }, 48)?;
    ensure!(apart(&straight, &other) > 0.0);
    let mut both = straight.clone();
    both.merge(&other)?;
    let mean = |e: &Estimate| e.standard_error().iter().map(|e| e.length_squared()).sum::<f64>();
    let gain = mean(&both) / mean(&straight);
    ensure!(both.samples == 96 && (0.35..0.75).contains(&gain), "variance times {gain}");
    Ok(())
}

#[test]
fn every_way_to_trace_gives_the_same_paths() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in [builtin("courtyard")?, scenes::glass_ball()] {
        let by = |rays| estimate(&gpu, &scene, ReferenceOptions { rays, ..options() }, 32);
        let software = by(Rays::Software)?;
        for rays in [Rays::Query, Rays::Pipeline] {
            let other = by(rays)?;
            // The same random numbers: only paths that graze an edge differ.
            let same = software
                .mean
                .iter()
                .zip(&other.mean)
                .filter(|(a, b)| (**a - **b).abs().max_element() <= 1e-4 * a.length())
                .count();
            let share = same as f64 / software.mean.len() as f64;
            let (_, whole) = deviation(&software, &other);
            println!(
                "{}: {:.1} % of the pixels are the same by {rays}; the whole differs by {whole:.2}",
                scene.name,
                100.0 * share
            );
            ensure!(share > 0.5 && whole < 1.0, "{}, {rays}: {share}, {whole}", scene.name);
        }
    }
    Ok(())
}

/// With a sun without angular size and no other light, the raster's direct light with ray-traced shadows is exact.
#[test]
fn a_parallel_sun_is_exact_in_the_raster_too() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    scene.lights.truncate(1);
    // The raster filters textures differently.
    for material in &mut scene.materials {
        material.base_colour_texture = None;
        material.metallic_roughness_texture = None;
        material.normal_texture = None;
    }
    let Some(Light::Directional { angular_radius, .. }) = scene.lights.first_mut() else { anyhow::bail!("no sun") };
    *angular_radius = 0.0;
    let size = [160, 90];
    let centre = ReferenceOptions {
        width: size[0],
        height: size[1],
        pixel: PixelSampling::Centre,
        check: true,
        ..ReferenceOptions::default()
    };
    for (only, pass, output) in
        [(Only::Shadows, "shadows.trace", "visibility"), (Only::Direct, "direct.shade", "radiance")]
    {
        let truth = estimate(&gpu, &scene, ReferenceOptions { only, depth: 1, ..centre }, 2)?;
        let raster = linear(render(&gpu, &scene, &config(&["shadows.edges=hard"])?, size, 1, Some((pass, output)))?)?;
        let mut wrong = 0;
        for (truth, raster) in truth.mean.iter().zip(raster.values()) {
            let raster = DVec3::new(f64::from(raster[0]), f64::from(raster[1]), f64::from(raster[2]));
            // The sun only; the lantern has a size.
            let first = |v: DVec3| if only == Only::Shadows { DVec3::splat(v.x) } else { v };
            let (truth, raster) = (first(*truth), first(raster));
            // Textures and normals differ in filtering and formats; hard shadows are 0 or 1.
            wrong += u32::from((truth - raster).abs().max_element() > 0.05 * truth.max_element().max(0.05));
        }
        let share = f64::from(wrong) / f64::from(size[0] * size[1]);
        println!("{}: {:.2} % of the pixels differ from the raster's", only.name(), 100.0 * share);
        ensure!(share < 0.01, "{}: {share}", only.name());
    }
    Ok(())
}

#[test]
fn a_picture_of_another_size_is_refused() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut reference = Reference::new(&gpu, &scene, &scene.cameras[0], options())?;
    let error = reference.resume(&Estimate::new(3, 5)).err().context("taken")?;
    ensure!(error.to_string().contains("24 x 16") && error.to_string().contains("3 x 5"), "{error}");
    Ok(())
}
