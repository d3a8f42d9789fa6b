//! Diffuse indirect light by resampled paths: the light of the reference with every kind of weight, less noise for the same rays, and what
//! may be reused. Statements F25 to F38 of the digest on ReSTIR.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::{Environment, Light, Material, Scene};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Bias, Shown, bias, mean_with, relmse, truth_of};
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene};
use magpie_tests::gi::{Frames, ONE_RAY, RESTIR_RAW, UNBIASED, Way, light_of, mean};
use magpie_tests::harness::{builtin, config, gpu, gpu_without_validation};
use magpie_tests::rooms;
use std::env;
use std::f32::consts::FRAC_PI_2;

const SIZE: [u32; 2] = [32, 24];
const SHOWN: Shown = Shown { size: SIZE, time: 0.0 };

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// What the slot shows of a frame, by the name of an image.
fn view(result: &FrameResult) -> Result<Vec<[f32; 4]>> {
    Ok(result.images.as_ref().context("no image")?.linear.values())
}

/// Closest-hit and any-hit rays of a pass.
fn rays(result: &FrameResult, pass: &str) -> Result<[u64; 2]> {
    let found = result.sample.passes.iter().find(|p| p.name == pass);
    found.map(|p| [p.rays_closest, p.rays_any]).with_context(|| format!("no pass {pass}"))
}

/// A floor and a wall that meet, and a lamp near them.
fn corner() -> Scene {
    let mut s = scene("corner", camera([1.6, 1.2, 1.6], [0.2, 0.15, 0.2]));
    let matte = || Material { double_sided: true, specular: 0.0, ..material([0.8; 3], 0.0, 1.0) };
    add(&mut s, plane(2.0), matte(), Affine3A::from_translation(Vec3::new(2.0, 0.0, 0.0)));
    add(&mut s, plane(2.0), matte(), Affine3A::from_rotation_z(-FRAC_PI_2));
    s.lights.push(Light::Point { position: [0.5, 0.6, 0.3].into(), intensity: Vec3::splat(2.0), range: None });
    s
}

/// A closed room whose walls shine.
fn shining(albedo: f32) -> Scene {
    let mut s = scene("shining", camera([0.7, 0.3, 0.6], [-0.6, -0.4, -0.5]));
    let wall = Material { double_sided: true, emission: Vec3::ONE, specular: 0.0, ..material([albedo; 3], 0.0, 1.0) };
    add(&mut s, block(Vec3::ONE), wall, Affine3A::IDENTITY);
    s
}

/// The light of a configuration against the reference with as many bounces, from so many runs of so many frames.
fn compared(gpu: &Gpu, scene: &Scene, changes: &[&str], bounces: u32, [runs, frames]: [u32; 2]) -> Result<Bias> {
    let limit = format!("gi.bounces={bounces}");
    let changes = [&["stages.gi=restir"], &UNBIASED[..], changes, &[limit.as_str()]].concat();
    let (mut found, mut wanted) = (Vec::new(), Vec::new());
    for seed in 1..=runs {
        let options = RenderOptions { seed, ..RenderOptions::default() };
        found.push(mean_with(options, "gi", gpu, scene, &changes, SHOWN, frames)?.0);
        let options = ReferenceOptions { only: Only::Gi, depth: bounces + 1, seed, ..ReferenceOptions::default() };
        wanted.push(truth_of(options, gpu, scene, SHOWN, frames)?.mean);
    }
    Ok(bias(&found, &wanted))
}

/// Frames with nothing but one-bounce samples, beside what a test changes.
fn frames(gpu: &Gpu, scene: &Scene, changes: &[&str], size: [u32; 2]) -> Result<Frames> {
    Frames::new(gpu, scene, RESTIR_RAW, &[&["gi.reuse=false", "gi.bounces=1"], changes].concat(), size)
}

/// One path of each pixel and frame, and no ray where reuse is off (F25).
#[test]
fn each_pixel_traces_one_sample() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let changes = ["gi.validate=0", "gi.visibility=false"];
    for (resolution, share) in [("gi.resolution=full", 1), ("gi.resolution=half", 4)] {
        let mut frames = frames(&gpu, &scene, &[&changes[..], &[resolution]].concat(), SIZE)?;
        for _ in 0..3 {
            let result = frames.frame(Some("gi.reservoirs:confidence"))?;
            let drawn = view(&result)?.iter().filter(|v| v[0] > 0.0).count() as u64;
            let [closest, any] = rays(&result, "gi.sample")?;
            ensure!(drawn > u64::from(SIZE[0] * SIZE[1] / 2 / share), "{resolution}: {drawn} samples");
            ensure!(closest == drawn && any <= drawn && any > 0, "{resolution}: {closest}, {any} rays of {drawn}");
            ensure!(rays(&result, "gi.spatial_1")? == [0, 0], "{resolution}: shadow rays that are switched off");
        }
    }
    Ok(())
}

/// Without rounds, or without neighbours, what is shown is what the pixels have themselves (F34).
#[test]
fn no_rounds_show_the_temporal_reservoirs() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let run = |changes: &[&str]| -> Result<(Vec<DVec3>, bool)> {
        let mut frames = frames(&gpu, &scene, changes, SIZE)?;
        frames.after(3)?;
        let result = frames.frame(None)?;
        let is_spatial = result.sample.passes.iter().any(|p| p.name.starts_with("gi.spatial"));
        Ok((light_of(&result)?, is_spatial))
    };
    let (none, without) = (run(&["gi.rounds=0"])?, run(&["gi.neighbours=0"])?);
    let (all, two) = (run(&[])?, run(&["gi.rounds=2"])?);
    ensure!(!none.1 && none == without, "no rounds differ from no neighbours");
    ensure!(all.1 && two.1 && all.0 != none.0 && two.0 != all.0, "rounds change nothing");
    Ok(())
}

/// Confidence never exceeds the cap, no sample its life, and none goes untraced for longer than said (F20, H7, H8); a camera cut resets all of it.
#[test]
fn reservoirs_stay_within_their_limits() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    for keep in ["gi.keep=temporal", "gi.keep=spatial"] {
        let mut frames =
            frames(&gpu, &scene, &["gi.cap=6", "gi.sample_life=20", "gi.validate=5", "gi.reach=4", keep], SIZE)?;
        let mut most = [0.0_f32; 3];
        for frame in 0..30 {
            let image = ["confidence", "age", "traced"][frame % 3];
            let values = view(&frames.frame(Some(&format!("gi.reservoirs:{image}")))?)?;
            most[frame % 3] = values.iter().fold(most[frame % 3], |most, v| most.max(v[0]));
        }
        ensure!(most[0] == 6.0, "{keep}: confidence up to {}", most[0]);
        ensure!(most[1] > 10.0 && most[1] <= 20.0, "{keep}: age up to {}", most[1]);
        ensure!(most[2] > 2.0 && most[2] < 5.0, "{keep}: untraced for up to {} frames", most[2]);
        frames.renderer.cut();
        let values = view(&frames.frame(Some("gi.reservoirs:confidence"))?)?;
        let after = values.iter().fold(0.0_f32, |most, v| most.max(v[0]));
        ensure!(after == if keep.ends_with("temporal") { 1.0 } else { 4.0 }, "{keep}: {after} after a cut");
    }
    Ok(())
}

/// How many of the pixels that are asked lie across the middle of the picture, by all offsets that may be drawn.
fn share_across(size: [u32; 2], reach: f64, by_row: bool) -> f64 {
    let ([width, height], most) = (size.map(i64::from), reach.ceil() as i64);
    let (mut all, mut across) = (0.0, 0.0);
    for (x, y) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))) {
        for (dx, dy) in (-most..=most).flat_map(|dx| (-most..=most).map(move |dy| (dx, dy))) {
            let (to_x, to_y) = (x + dx, y + dy);
            let inside = (0..width).contains(&to_x) && (0..height).contains(&to_y);
            if !inside || (dx, dy) == (0, 0) || ((dx * dx + dy * dy) as f64).sqrt() > reach {
                continue;
            }
            all += 1.0;
            let crosses =
                if by_row { (y < height / 2) != (to_y < height / 2) } else { (x < width / 2) != (to_x < width / 2) };
            across += f64::from(u8::from(crosses));
        }
    }
    across / all
}

/// Neighbours across an edge of depth or of the normal are left out, and no others (F31).
#[test]
fn only_the_same_surface_lends() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let matte = || material([0.7; 3], 0.0, 1.0);
    let lamp = Light::Point { position: [0.3, 2.0, 0.4].into(), intensity: Vec3::splat(4.0), range: None };
    let made = |eye: [f64; 3], target: [f64; 3], second: Affine3A| {
        let mut s = scene("edge", camera(eye, target));
        add(&mut s, plane(20.0), matte(), Affine3A::IDENTITY);
        add(&mut s, plane(10.0), matte(), second);
        s.lights.push(lamp.clone());
        s
    };
    // From above: a step in the middle. From aside, at half a right angle to both: floor and wall.
    let step = made([0.0, 6.0, 0.0], [0.0, 0.0, 0.0], Affine3A::from_translation(Vec3::new(10.0, 0.4, 0.0)));
    let wall = Affine3A::from_rotation_translation(Quat::from_rotation_x(FRAC_PI_2), Vec3::new(0.0, 10.0, 0.0));
    let fold = made([0.0, 2.0, 2.0], [0.0, 0.0, 0.0], wall);
    let flat = made([0.0, 6.0, 0.0], [0.0, 0.0, 0.0], Affine3A::from_translation(Vec3::new(0.0, -1.0, 0.0)));
    for (what, scene, expected) in [
        ("flat", flat, 0.0),
        ("step", step, share_across(SIZE, 6.0, false)),
        ("fold", fold, share_across(SIZE, 6.0, true)),
    ] {
        let mut frames = frames(&gpu, &scene, &["gi.reach=6", "gi.neighbours=8"], SIZE)?;
        let values = view(&frames.frame(Some("gi.spatial_1:asked"))?)?;
        let [all, unlike] = [0, 1].map(|at: usize| values.iter().map(|v| f64::from(v[at])).sum::<f64>());
        println!("{what}: {:.3} of {all} neighbours are unlike, {expected:.3} lie across the edge", unlike / all);
        ensure!(all > 1000.0 && (unlike / all - expected).abs() < 0.02, "{what}: {}", unlike / all);
        ensure!(expected > 0.05 || unlike == 0.0, "{what}: {unlike}");
    }
    Ok(())
}

/// Jacobians out of range are refused, the more the narrower it is, and are counted (F30).
#[test]
fn extreme_jacobians_are_refused_and_counted() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let run = |changes: &[&str]| -> Result<[f64; 2]> {
        let mut frames = frames(&gpu, &corner(), changes, SIZE)?;
        frames.after(2)?;
        let result = frames.frame(Some("gi.spatial_1:asked"))?;
        let pass = result.sample.passes.iter().find(|p| p.name == "gi.spatial_1").context("no pass")?;
        let shown = view(&result)?;
        for (at, (name, count)) in pass.counts.iter().enumerate() {
            let sum: f64 = shown.iter().map(|v| f64::from(v[at])).sum();
            ensure!(sum == *count as f64, "{name}: {sum} in the image, {count} in the statistics");
        }
        Ok([2, 3].map(|at: usize| pass.counts[at].1 as f64))
    };
    let shares = ["gi.stretch=100", "gi.stretch=10", "gi.stretch=2"].map(|s| run(&[s]).map(|[all, no]| no / all));
    let [wide, usual, narrow] = shares;
    let (wide, usual, narrow) = (wide?, usual?, narrow?);
    println!("refused: {wide:.4} beyond 100, {usual:.4} beyond 10, {narrow:.4} beyond 2");
    ensure!(wide > 0.0 && usual > 1.5 * wide && narrow > 1.5 * usual && narrow < 0.9, "{wide}, {usual}, {narrow}");
    ensure!(run(&["gi.jacobian=false"])? == [0.0; 2], "there are Jacobians without them");
    Ok(())
}

/// The dark side of a thin wall stays as dark as without reuse; without shadow rays light leaks (F32).
#[test]
fn walls_let_no_light_through() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let size = [64, 48];
    let dark_share = |changes: &[&str]| -> Result<f64> {
        let mut frames = frames(&gpu, &rooms::open_rooms(0.01), changes, size)?;
        let mut sides = [0.0; 2];
        for _ in 0..16 {
            for (at, light) in frames.light()?.iter().enumerate() {
                let x = at % size[0] as usize;
                if x != 31 && x != 32 {
                    sides[usize::from(x < 32)] += light.element_sum();
                }
            }
        }
        // The camera's up is the world's, so it shows the lamp to the left.
        ensure!(sides[1] > 1.0, "the bright side is dark: {sides:?}");
        Ok(sides[0] / sides[1])
    };
    let (own, reused) = (dark_share(&["gi.rounds=0", "gi.cap=0"])?, dark_share(&[])?);
    let spread = dark_share(&["gi.keep=spatial", "gi.rounds=2"])?;
    let leaking = dark_share(&["gi.visibility=false"])?;
    println!(
        "dark over bright: {own:.1e} alone, {reused:.1e}, {spread:.1e} over two rounds; {leaking:.1e} without shadow rays"
    );
    ensure!(reused < 1e-3 + own && spread < 1e-3 + own, "{own}, {reused}, {spread}");
    ensure!(leaking > 5e-3, "without shadow rays there is no leak to see: {leaking}");
    Ok(())
}

/// The sky is a direction, as bright from everywhere: an open floor under an even sky has all of its light from the first frame on, exactly (F38).
#[test]
fn samples_of_the_sky_are_directions() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let mut s = scene("open", camera([0.0, 2.0, 3.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(50.0), Material { specular: 0.0, ..material([0.5; 3], 0.0, 1.0) }, Affine3A::IDENTITY);
    s.environment = Some(Environment { radiance: vec![Vec3::ONE; 32].into(), ..environment() });
    for source in ["gi.source=cosine", "gi.source=uniform"] {
        let mut frames = frames(&gpu, &s, &[source, "gi.rounds=2", "gi.keep=spatial"], SIZE)?;
        for _ in 0..6 {
            let result = frames.frame(Some("gi.reservoirs:weight"))?;
            let weights = view(&result)?;
            ensure!(weights.iter().all(|w| w[0].is_finite() && w[0] >= 0.0), "{source}: a weight is not finite");
            let light = light_of(&result)?;
            let floor: Vec<f64> = light.iter().map(|v| v.x).filter(|v| *v > 0.0).collect();
            let mean = floor.iter().sum::<f64>() / floor.len() as f64;
            let most = floor.iter().fold(0.0_f64, |most, v| most.max((v - 0.5).abs()));
            ensure!(floor.len() > 600 && (mean - 0.5).abs() < 0.02, "{source}: {mean} on {} pixels", floor.len());
            // Every cosine-distributed sample of an even sky is worth the same.
            ensure!(source.ends_with("uniform") || most < 2e-3, "{source}: off by {most}");
        }
    }
    Ok(())
}

/// A closed room that shines keeps its light for as long as one looks, and no emitter counts twice (F36): the closed form of so many bounces.
#[test]
fn a_closed_room_keeps_its_light() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let (albedo, blocks) = (0.8_f64, if is_full() { 10 } else { 2 });
    for keep in ["gi.keep=temporal", "gi.keep=spatial"] {
        // What the walls have scattered twice, three and four times.
        let truth: f64 = (2..=4).map(|n| albedo.powi(n)).sum();
        let changes = ["gi.reuse=false", "gi.bounces=3", "gi.regularization=0", keep];
        let mut frames = Frames::new(&gpu, &shining(albedo as f32), RESTIR_RAW, &changes, SIZE)?;
        let mut ratios = Vec::new();
        for _ in 0..blocks {
            let lights = (0..100).map(|_| Ok(mean(&frames.light()?))).collect::<Result<Vec<_>>>()?;
            ratios.push(lights.iter().sum::<f64>() / 100.0 / truth);
        }
        // A bright sample stays for a while, so a hundred frames vary by about half a percent.
        println!("{keep}: {ratios:.4?}");
        ensure!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.02), "{keep}: {ratios:?}");
    }
    Ok(())
}

/// Light of a lamp that is switched off is gone when all samples have been traced again, to the last bit (H8); without that it lasts.
#[test]
fn light_that_is_gone_leaves_nothing() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let run = |changes: &[&str]| -> Result<Vec<f64>> {
        let mut frames = frames(&gpu, &rooms::coloured_lamp(), changes, SIZE)?;
        let before = mean(&frames.after(30)?);
        frames.renderer.scale_light(0, 0.0);
        (0..24).map(|_| Ok(mean(&frames.light()?) / before)).collect()
    };
    for keep in ["gi.keep=temporal", "gi.keep=spatial"] {
        let left = run(&[keep])?;
        let gone = left.iter().position(|left| *left < 0.1).map(|at| at + 1);
        println!("{keep}: 90 % in frame {gone:?}; {left:.3?}");
        ensure!(left[0] > 0.2 && left[8..].iter().all(|left| *left == 0.0), "{keep}: {left:?}");
    }
    let left = run(&["gi.validate=0"])?;
    ensure!(left[12] > 0.3, "light goes by itself: {left:?}");
    Ok(())
}

/// Reuse lowers the error for the same rays (F37): root of relMSE, with the error of one ray scaled to as many rays.
#[test]
fn reuse_is_worth_its_rays() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    const LARGE: [u32; 2] = [128, 96];
    let scene = builtin("cornell")?;
    let options = ReferenceOptions { only: Only::Gi, depth: 3, ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &scene, Shown { size: LARGE, ..SHOWN }, 1024)?;
    let run = |way: Way, frame: u32| -> Result<[f64; 2]> {
        let mut frames = Frames::new(&gpu, &scene, way, &["gi.reuse=false", "gi.regularization=0"], LARGE)?;
        frames.after(frame - 2)?;
        let result = frames.frame(None)?;
        let [square, _] = relmse(&light_of(&result)?, &truth);
        let own = result.sample.passes.iter().filter(|p| p.name.starts_with("gi."));
        let rays: u64 = own.map(|p| p.rays_closest + p.rays_any).sum();
        Ok([square.sqrt(), rays as f64 / f64::from(LARGE[0] * LARGE[1])])
    };
    for frame in [8, 64] {
        let ([reused, more], [alone, rays]) = (run(RESTIR_RAW, frame)?, run(ONE_RAY, frame)?);
        let equal = alone * (rays / more).sqrt();
        println!(
            "frame {frame}: {reused:.3} with {more:.2} rays of each pixel; {alone:.3} with {rays:.2}, {equal:.3} with as many"
        );
        ensure!(reused < 0.5 * equal, "frame {frame}: {reused}, {equal}");
    }
    Ok(())
}

/// Where floor and wall meet, all unbiased weights give the light of the reference; 1/M is darker, and without the Jacobian light is in the
/// wrong places (F26 to F30).
#[test]
fn the_light_of_a_corner_is_that_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let runs = if is_full() { [12, 256] } else { [6, 128] };
    let run = |changes: &[&str]| -> Result<Bias> {
        let bias = compared(&gpu, &corner(), changes, 1, runs)?;
        let Bias { light, light_error, relmse, error } = bias;
        println!("{changes:?}: light {light:.4} +- {light_error:.4}, relMSE {relmse:.1e} +- {error:.0e}");
        Ok(bias)
    };
    for changes in [&[][..], &["gi.weights=unbiased"], &["gi.source=uniform"], &["gi.rounds=2", "gi.keep=spatial"]] {
        let bias = run(changes)?;
        let apart = (bias.light - 1.0).abs();
        ensure!(bias.light_error < 0.01 && apart < 3.0 * bias.light_error + 1e-3, "{changes:?}: {}", bias.light);
        ensure!(bias.relmse < 3.0 * bias.error + 1e-4, "{changes:?}: {} +- {}", bias.relmse, bias.error);
    }
    let biased = run(&["gi.weights=biased"])?;
    ensure!(biased.light < 0.97, "1/M is not darker: {}", biased.light);
    let without = run(&["gi.jacobian=false"])?;
    ensure!(without.relmse > 3e-3, "the Jacobian changes nothing: {}", without.relmse);
    Ok(())
}

/// The same in whole scenes, at half resolution of the rays too.
#[test]
fn the_light_of_scenes_is_that_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu_without_validation()?.filter(|_| is_full()) else { return Ok(()) };
    for name in ["cornell", "courtyard"] {
        for changes in [&[][..], &["gi.weights=unbiased"], &["gi.rounds=2", "gi.keep=spatial"]] {
            let Bias { light, light_error, relmse, error } = compared(&gpu, &builtin(name)?, changes, 2, [12, 256])?;
            println!("{name} {changes:?}: light {light:.4} +- {light_error:.4}, relMSE {relmse:.1e} +- {error:.0e}");
            ensure!((light - 1.0).abs() < 3.0 * light_error + 2e-3, "{name} {changes:?}: {light} +- {light_error}");
        }
    }
    Ok(())
}

/// With TAA, a moving camera and validation: every backend finds the same light, at full and at half resolution.
#[test]
fn ray_backends_agree_while_the_camera_moves() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    for resolution in ["gi.resolution=full", "gi.resolution=half"] {
        let mut means = Vec::new();
        for rays in [Rays::Software, Rays::Query, Rays::Pipeline] {
            let options = RenderOptions { width: 64, height: 36, check: true, rays, ..RenderOptions::default() };
            let config = config(&["stages.gi=restir", "post.anti_aliasing=taa", resolution])?;
            let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config, options)?;
            renderer.read_slots(&["gi"])?;
            let mut camera = scene.cameras[0].clone();
            let mut sum = 0.0;
            for frame in 0..14 {
                camera.world_from_camera.translation.x += 0.02;
                let request =
                    FrameRequest { camera: &camera, time: f64::from(frame) * 0.02, view: None, read_back: true };
                let result = renderer.frame(request)?.context("no frame")?;
                ensure!(result.findings.is_empty(), "{rays:?}, {resolution}: {:?}", result.findings);
                let light = light_of(&result)?;
                ensure!(light.iter().all(|v| v.is_finite()), "{rays:?}, {resolution}: frame {frame} is not finite");
                sum += mean(&light);
            }
            means.push(sum / 14.0);
        }
        println!("{resolution}: {means:.5?}");
        ensure!(means.iter().all(|m| *m > 0.0 && (m / means[0] - 1.0).abs() < 0.01), "{resolution}: {means:?}");
    }
    Ok(())
}
