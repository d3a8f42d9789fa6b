//! Reflections that choose between rays, the screen and a fallback: where rays go, how many there are, and what that does to the picture.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Light, Material, Scene};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, mean_of};
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene};
use magpie_tests::harness::{config, gpu, linear};

const HYBRID: [&str; 4] =
    ["stages.reflections=hybrid", "stages.gi=off", "reflections.precision=32", "gbuffer.precision=full"];
const SIZE: [u32; 2] = [64, 48];
const PIXELS: u64 = 64 * 48;

/// Frame `count` of a scene with an image, the camera moving from each of some cameras to the next.
fn frame(
    gpu: &Gpu,
    scene: &Scene,
    changes: &[&str],
    cameras: &[Camera],
    count: usize,
    output: &str,
) -> Result<FrameResult> {
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(changes)?, options)?;
    let view = output.split_once(':');
    let mut last = None;
    for k in 0..count {
        let camera = &cameras[k.min(cameras.len() - 1)];
        let result = renderer.frame(FrameRequest { camera, time: 0.0, view, read_back: true })?.context("no frame")?;
        ensure!(result.findings.is_empty(), "frame {k}: {}", result.findings[0]);
        last = Some(result);
    }
    last.context("no frame")
}

/// The same at rest, with changes of the defaults.
fn shown(gpu: &Gpu, scene: &Scene, changes: &[&str], count: usize, output: &str) -> Result<FrameResult> {
    frame(gpu, scene, &[&HYBRID[..], changes].concat(), &scene.cameras[..1], count, output)
}

const RADIANCE: &str = "reflections.resolve:radiance";

fn colours(result: FrameResult) -> Result<Vec<DVec3>> {
    Ok(linear(result)?.values().iter().map(|v| Vec3::from_slice(v).as_dvec3()).collect())
}

fn rmse(found: &[DVec3], truth: &[DVec3]) -> f64 {
    let square: f64 = found.iter().zip(truth).map(|(a, b)| (*a - *b).length_squared()).sum();
    (square / truth.len() as f64).sqrt()
}

/// Traced rays, shadow rays and marched rays of the reflections' passes.
fn rays(result: &FrameResult) -> [u64; 3] {
    let mut sum = [0; 3];
    for pass in result.sample.passes.iter().filter(|p| p.name.starts_with("reflections.")) {
        for (sum, count) in sum.iter_mut().zip([pass.rays_closest, pass.rays_any, pass.rays_screen]) {
            *sum += count;
        }
    }
    sum
}

fn passes(result: &FrameResult) -> Vec<&str> {
    result.sample.passes.iter().map(|p| p.name.as_str()).filter(|name| name.starts_with("reflections.")).collect()
}

fn upright(towards: f32, place: Vec3) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_x(towards * std::f32::consts::FRAC_PI_2), place)
}

/// A wall that fills the picture, its left half of one material and its right half of the other, before the sky.
fn halves(left: Material, right: Material) -> Scene {
    let mut s = scene("halves", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(4.0), left, upright(1.0, Vec3::new(-4.0, 0.0, 0.0)));
    add(&mut s, plane(4.0), right, upright(1.0, Vec3::new(4.0, 0.0, 0.0)));
    s.environment = Some(environment());
    s
}

fn metal(roughness: f32) -> Material {
    material([0.9; 3], 1.0, roughness)
}

/// A floor with a block on it, of which the screen shows what the floor reflects, and a wall behind.
fn floor(roughness: f32) -> Scene {
    let mut s = scene("floor", camera([0.0, 0.7, 2.2], [0.0, 0.2, 0.0]));
    add(&mut s, plane(3.0), metal(roughness), Affine3A::IDENTITY);
    let place = |x, y, z| Affine3A::from_translation(Vec3::new(x, y, z));
    add(&mut s, block(Vec3::splat(0.3)), material([0.8, 0.15, 0.1], 0.0, 1.0), place(-0.3, 0.3, -0.3));
    add(&mut s, plane(3.0), material([0.3, 0.5, 0.7], 0.0, 1.0), upright(1.0, Vec3::new(0.0, 0.0, -1.5)));
    s.lights.push(Light::Point { position: DVec3::new(1.0, 2.0, 1.5), intensity: Vec3::splat(8.0), range: None });
    s
}

/// A mirror has a ray for each pixel, a wide lobe one for each sixteen, and what reflects nothing has none.
#[test]
fn rays_are_as_dense_as_the_lobe_asks() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let dull = Material { specular: 0.0, ..material([0.8; 3], 0.0, 0.1) };
    let count = |left: Material, right: Material| -> Result<f64> {
        let changes = ["reflections.bounces=1", "reflections.noise=1", "reflections.pixels_per_ray=16"];
        Ok(rays(&shown(&gpu, &halves(left, right), &changes, 6, RADIANCE)?)[0] as f64 / PIXELS as f64)
    };
    let (mirror, half) = (count(metal(0.0), metal(0.0))?, count(metal(0.0), dull)?);
    let (rough, mixed) = (count(metal(0.6), metal(0.6))?, count(metal(0.0), metal(0.6))?);
    println!("rays per pixel: mirror {mirror:.4}, half of it {half:.4}, rough {rough:.4}, half of each {mixed:.4}");
    ensure!(mirror == 1.0 && (half - 0.5).abs() < 0.02, "mirror {mirror}, half {half}");
    ensure!(rough > 0.04 && rough < 0.0725, "rough {rough}");
    ensure!((mixed - 0.5 * (mirror + rough)).abs() < 0.03, "half of each {mixed}");
    Ok(())
}

/// No more rays start than the budget has, in the first frame as later, and they are spread over the picture.
#[test]
fn the_budget_is_strict() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // What the mirror shows is the sky, so each ray counts once.
    let scene = halves(metal(0.0), metal(0.0));
    for (budget, least) in [(0.5, 0.47), (0.1, 0.09), (0.01, 0.005)] {
        let changes = [&format!("reflections.budget={budget}")[..]];
        for count in [1, 2, 6] {
            let traced = rays(&shown(&gpu, &scene, &changes, count, RADIANCE)?)[0];
            println!("budget {budget}, frame {count}: {traced} rays");
            let most = (budget * PIXELS as f64).ceil() as u64;
            ensure!(traced <= most && traced as f64 >= least * PIXELS as f64, "{traced} of {most}");
        }
    }
    Ok(())
}

/// What the screen shows is not traced, the rest is, and the picture stays the same.
#[test]
fn the_screen_takes_rays_off_the_tracer() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = floor(0.35);
    let changes = ["reflections.bounces=1", "reflections.pixels_per_ray=1"];
    let with = shown(&gpu, &scene, &[&changes[..], &["reflections.screen=true"]].concat(), 24, RADIANCE)?;
    let without = shown(&gpu, &scene, &changes, 24, RADIANCE)?;
    let (counts, all) = (rays(&with), rays(&without));
    let (with, without) = (colours(with)?, colours(without)?);
    let light = (without.iter().map(|v| v.length_squared()).sum::<f64>() / without.len() as f64).sqrt();
    let apart = rmse(&with, &without) / light;
    println!("{counts:?} rays with the screen, {all:?} without; the pictures are {apart:.4} apart");
    ensure!(all[2] == 0 && counts[2] > PIXELS / 8, "{} rays marched", counts[2]);
    ensure!(counts[0] + counts[2] / 3 < all[0], "{counts:?} and {all:?}");
    ensure!(apart < 0.05, "the pictures are {apart} apart");
    Ok(())
}

/// Where the screen knows nothing, hardly any ray is looked for on it after some frames.
#[test]
fn rays_are_not_marched_in_vain() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // All rays go back past the camera.
    let scene = halves(metal(0.3), metal(0.3));
    let marched = |count| -> Result<u64> {
        let changes = ["reflections.pixels_per_ray=1", "reflections.screen=true"];
        Ok(rays(&shown(&gpu, &scene, &changes, count, RADIANCE)?)[2])
    };
    let (first, late) = (marched(1)?, marched(12)?);
    println!("{first} rays marched in the first frame, {late} in frame 12");
    ensure!(late < first / 6 && late > 0, "{first} and {late}");
    Ok(())
}

/// At rest and with a moving camera the error is near that of a ray for each pixel, for fewer rays.
#[test]
fn fewer_rays_have_nearly_the_same_error() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let full = [
        "stages.reflections=ray-traced",
        "reflections.denoiser=pica-pica",
        "reflections.reconstruct=true",
        "reflections.bounces=4",
        "stages.gi=off",
        "reflections.precision=32",
        "gbuffer.precision=full",
    ];
    let raw = ["reflections.denoiser=none", "reflections.reconstruct=false", "reflections.reuse=false"];
    let scene = floor(0.2);
    let cameras: Vec<Camera> =
        (0..24_u8).map(|k| camera([0.03 * f64::from(23 - k), 0.7, 2.2], [0.0, 0.2, 0.0])).collect();
    let truth_changes = [&full[..], &raw, &["reflections.rays=8"]].concat();
    let (truth, _) = mean_of("reflections", &gpu, &scene, &truth_changes, Shown { size: SIZE, time: 0.0 }, 64)?;
    for (name, path) in [("at rest", &cameras[23..]), ("in motion", &cameras[..])] {
        let of = |changes: &[&str]| -> Result<(f64, u64)> {
            let result = frame(&gpu, &scene, changes, path, 24, RADIANCE)?;
            let [closest, any, _] = rays(&result);
            Ok((rmse(&colours(result)?, &truth), closest + any))
        };
        let ((all, all_rays), (few, few_rays)) = (of(&full)?, of(&HYBRID)?);
        println!("{name}: error {all:.4} with {all_rays} rays, {few:.4} with {few_rays}");
        ensure!(few < 1.2 * all && few_rays * 10 < all_rays * 6, "{name}: {few} of {all}, {few_rays} of {all_rays}");
    }
    Ok(())
}

/// Beyond the limits the fallback stands alone, without any ray pass; up to them there is no step.
#[test]
fn the_fallback_stands_where_rays_are_not_worth_it() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let rough = halves(metal(0.8), material([0.5; 3], 0.0, 0.7));
    let limit = "reflections.roughness_limit=0.5";
    let result = shown(&gpu, &rough, &[limit], 2, RADIANCE)?;
    ensure!(passes(&result) == ["reflections.resolve"], "{:?}", passes(&result));
    let found = colours(result)?;
    let sky = [&["stages.reflections=sky"][..], &HYBRID[1..]].concat();
    let wanted = colours(frame(&gpu, &rough, &sky, &rough.cameras, 1, "reflections.sky:radiance")?)?;
    let apart = rmse(&found, &wanted);
    ensure!(apart < 1e-4 && wanted.iter().any(|v| v.x > 0.1), "{apart} from the sky's");

    let result = shown(&gpu, &rough, &[limit, "reflections.fallback=probe"], 4, RADIANCE)?;
    ensure!(!passes(&result).contains(&"reflections.trace"), "{:?}", passes(&result));
    ensure!(colours(result)?.iter().any(|v| v.x > 0.1), "probes show nothing");

    // Half of the picture is beyond the limit: half of the rays are left.
    let count = |limit: &str| -> Result<u64> {
        let changes = [limit, "reflections.bounces=1", "reflections.pixels_per_ray=1"];
        Ok(rays(&shown(&gpu, &halves(metal(0.0), metal(0.8)), &changes, 3, RADIANCE)?)[0])
    };
    let (all, half) = (count("reflections.roughness_limit=1")?, count(limit)?);
    println!("{all} rays, with a limit of roughness {half}");
    ensure!(all > 9 * PIXELS / 10 && half.abs_diff(PIXELS / 2) < PIXELS / 40, "{all} and {half}");
    // A surface that reflects hardly anything has no ray either.
    let faint = Material { specular: 0.2, ..material([0.5; 3], 0.0, 0.3) };
    let result = shown(&gpu, &halves(faint.clone(), faint), &["reflections.faint=0.5"], 3, RADIANCE)?;
    ensure!(rays(&result) == [0; 3], "{:?}", rays(&result));
    Ok(())
}

/// The picture of sources has the colour of each: rays, the screen, the fallback, nothing.
#[test]
fn sources_are_shown() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let dull = Material { specular: 0.0, ..material([0.8; 3], 0.0, 0.1) };
    let share = |scene: &Scene, changes: &[&str], is: fn(&DVec3) -> bool| -> Result<f64> {
        let found = colours(shown(&gpu, scene, changes, 12, "reflections.sources:colours")?)?;
        Ok(found.iter().filter(|c| is(c)).count() as f64 / found.len() as f64)
    };
    let traced = |c: &DVec3| c.x > 0.9 && c.y < 0.5;
    let on_screen = |c: &DVec3| c.x > 0.9 && c.y > 0.6;
    let fallback = |c: &DVec3| c.z > 0.4;
    let nothing = |c: &DVec3| c.element_sum() == 0.0;
    let mirror = share(&halves(metal(0.0), dull.clone()), &[], traced)?;
    let none = share(&halves(metal(0.0), dull), &[], nothing)?;
    let rough = share(&halves(metal(0.0), metal(0.9)), &["reflections.roughness_limit=0.5"], fallback)?;
    let seen = share(&floor(0.35), &["reflections.pixels_per_ray=1", "reflections.screen=true"], on_screen)?;
    println!("traced {mirror:.3}, nothing {none:.3}, fallback {rough:.3}, on the screen {seen:.3}");
    ensure!([mirror, none, rough].iter().all(|s| (s - 0.5).abs() < 0.02), "{mirror}, {none}, {rough}");
    ensure!(seen > 0.1, "on the screen {seen}");
    Ok(())
}
