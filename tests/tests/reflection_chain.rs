//! The chain of reflections by rays: fewer rays than pixels, reconstruction, accumulation with two sources of history, clean-up.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Light, Scene};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, mean_of};
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene, sphere, sun};
use magpie_tests::harness::{config, gpu, linear, render};

const CHAIN: [&str; 5] = [
    "stages.reflections=ray-traced",
    "reflections.denoiser=pica-pica",
    "reflections.reconstruct=true",
    "reflections.precision=32",
    "stages.gi=off",
];

/// One ray for each pixel, as it is.
const RAW: [&str; 3] = ["reflections.denoiser=none", "reflections.reconstruct=false", "reflections.reuse=false"];

const RADIANCE: &str = "reflections.resolve:radiance";

/// Stands a plane up at `z`, its front towards +z or -z.
fn upright(z: f32, towards: f32) -> Affine3A {
    let turn = Quat::from_rotation_x(towards * std::f32::consts::FRAC_PI_2);
    Affine3A::from_rotation_translation(turn, Vec3::new(0.0, 0.0, z))
}

/// An upright wall of metal that fills the picture, and a red block behind the camera.
fn wall(roughness: f32) -> Scene {
    let mut s = scene("wall", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(8.0), material([1.0; 3], 1.0, roughness), upright(0.0, 1.0));
    add(
        &mut s,
        block(Vec3::splat(0.4)),
        material([0.8, 0.1, 0.1], 0.0, 1.0),
        Affine3A::from_rotation_translation(Quat::IDENTITY, Vec3::new(0.3, 0.0, 4.0)),
    );
    s.environment = Some(environment());
    s
}

/// The last of some frames from cameras in turn, the last camera again and again, with an image of the slot.
fn last(
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    changes: &[&str],
    cameras: &[Camera],
    count: usize,
    output: &str,
) -> Result<FrameResult> {
    let config = config(&[&CHAIN[..], changes].concat())?;
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
    let (pass, image) = output.split_once(':').context("no output")?;
    let view = Some((pass, image));
    let mut last = None;
    for frame in 0..count {
        let camera = &cameras[frame.min(cameras.len() - 1)];
        let result = renderer.frame(FrameRequest { camera, time: 0.0, view, read_back: true })?.context("no frame")?;
        ensure!(result.findings.is_empty(), "frame {frame}: {}", result.findings[0]);
        last = Some(result);
    }
    last.context("no frame")
}

/// The radiance of the last frame.
fn radiance(gpu: &Gpu, scene: &Scene, size: [u32; 2], changes: &[&str], count: usize) -> Result<Vec<DVec3>> {
    colours(last(gpu, scene, size, changes, &scene.cameras[..1], count, RADIANCE)?)
}

fn colours(result: FrameResult) -> Result<Vec<DVec3>> {
    Ok(linear(result)?.values().iter().map(|v| Vec3::from_slice(v).as_dvec3()).collect())
}

fn error(found: &[DVec3], truth: &[DVec3]) -> f64 {
    let square: f64 = found.iter().zip(truth).map(|(a, b)| (*a - *b).length_squared()).sum();
    (square / truth.len() as f64).sqrt()
}

/// The mean of many raw rays.
fn truth_of(gpu: &Gpu, scene: &Scene, shown: Shown) -> Result<Vec<DVec3>> {
    Ok(mean_of("reflections", gpu, scene, &[&CHAIN[..], &RAW].concat(), shown, 256)?.0)
}

/// One ray for 2x2 pixels is exactly that, and each that hits something sends at most one shadow ray.
#[test]
fn quarter_rays_are_a_quarter() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Of a mirror no direction lies below the surface.
    let mut scene = wall(0.0);
    scene.lights.push(sun(Vec3::new(0.2, 1.0, 0.5)));
    for (pixels_per_ray, cells) in [(1, 49 * 35), (2, 25 * 35), (4, 25 * 18)] {
        let sparse = format!("reflections.pixels_per_ray={pixels_per_ray}");
        let changes = ["reflections.bounces=1", "reflections.reuse=false", &sparse];
        let frame = last(&gpu, &scene, [49, 35], &changes, &scene.cameras, 1, RADIANCE)?;
        let trace = frame.sample.passes.iter().find(|p| p.name == "reflections.trace").context("no rays")?;
        let (closest, any) = (trace.rays_closest, trace.rays_any);
        println!("{pixels_per_ray} pixels per ray: {closest} rays, {any} shadow rays");
        ensure!(
            closest == cells && any <= closest && any > 0,
            "{closest} rays and {any} shadow rays for {cells} cells"
        );
    }
    Ok(())
}

/// Reconstruction, accumulation, clean-up, anti-aliasing follow each other; what does not ask for them has none of them.
#[test]
fn the_chain_has_its_order() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = wall(0.3);
    let config = config(&[&CHAIN[..], &["post.anti_aliasing=taa"]].concat())?;
    let frame = render(&gpu, &scene, &config, [32, 24], 1, None)?;
    let names: Vec<&str> = frame.sample.passes.iter().map(|p| p.name.as_str()).collect();
    let at = |name: &str| names.iter().position(|n| *n == name).with_context(|| format!("no {name} in {names:?}"));
    let chain = ["trace", "reconstruct", "accumulate", "clean_up", "resolve"].map(|step| format!("reflections.{step}"));
    let mut places = chain.iter().map(|name| at(name)).collect::<Result<Vec<_>>>()?;
    places.push(at("post.taa")?);
    ensure!(places.is_sorted(), "{names:?}");
    Ok(())
}

/// The clean-up changes only pixels that are noisier than its threshold; all others stay as they are, to the last bit.
#[test]
fn the_clean_up_leaves_quiet_pixels_alone() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = wall(0.3);
    let threshold = 0.05;
    let wanted = ["reflections.accumulate:accumulated", "reflections.accumulate:frames", "reflections.clean_up:result"];
    let mut images = Vec::new();
    for output in wanted {
        let frame = last(&gpu, &scene, [48, 40], &["reflections.clean_up=0.05"], &scene.cameras, 4, output)?;
        images.push(linear(frame)?.values());
    }
    let (mean, counts) = (&images[0], &images[1]);
    let (mut quiet, mut blurred) = (0, 0);
    for ((mean, count), result) in mean.iter().zip(counts).zip(&images[2]) {
        let luminance = 0.2126 * mean[0] + 0.7152 * mean[1] + 0.0722 * mean[2];
        let noise = mean[3] / count[0].max(1.0).sqrt() / luminance.max(1e-3);
        let same = mean[..3] == result[..3];
        blurred += u32::from(!same);
        // Rounding of the threshold itself.
        if noise < threshold * 0.999 {
            quiet += 1;
            ensure!(same, "{mean:?} with noise {noise} became {result:?}");
        }
    }
    println!("{quiet} quiet pixels, {blurred} blurred");
    ensure!(quiet > 100 && blurred > 100, "{quiet} quiet pixels, {blurred} blurred");
    Ok(())
}

/// What phases of the chain leave of the error, on rough metal that reflects a block under the sky.
#[test]
fn each_phase_lowers_the_error() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = wall(0.3);
    let shown = Shown { size: [64, 48], time: 0.0 };
    let truth = truth_of(&gpu, &scene, shown)?;
    let error = |changes: &[&str], count: usize| -> Result<f64> {
        let changes = [&["reflections.reuse=false"], changes].concat();
        Ok(error(&radiance(&gpu, &scene, shown.size, &changes, count)?, &truth))
    };
    let raw_error = error(&RAW, 1)?;
    let reconstructed = error(&["reflections.denoiser=none"], 1)?;
    let accumulated = error(&["reflections.clean_up=10"], 8)?;
    let cleaned = error(&[], 8)?;
    let late = error(&[], 32)?;
    println!(
        "raw {raw_error:.4}, reconstructed {reconstructed:.4}, accumulated {accumulated:.4}, cleaned up {cleaned:.4}, \
         in frame 32 {late:.4}"
    );
    ensure!(
        raw_error > reconstructed && reconstructed > accumulated && accumulated > cleaned && cleaned > late,
        "raw {raw_error}, reconstructed {reconstructed}, accumulated {accumulated}, cleaned up {cleaned}, then {late}"
    );
    let quarter = error(&["reflections.pixels_per_ray=4"], 32)?;
    let eight = error(&[&RAW[..], &["reflections.rays=8"]].concat(), 1)?;
    println!("a denoised quarter ray {quarter:.4}, eight raw rays {eight:.4}");
    ensure!(quarter < eight, "a denoised quarter ray {quarter}, eight raw rays {eight}");
    Ok(())
}

/// While the camera goes sideways, a denoised quarter ray for each pixel of rough metal is nearer to the truth than eight raw ones.
#[test]
fn a_quarter_ray_beats_eight_raw_ones_in_motion() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = wall(0.3);
    let size = [64, 48];
    let cameras: Vec<Camera> = (0..32_u8).map(|k| camera([0.03 * f64::from(k), 0.0, 2.0], [0.0, 0.0, 0.0])).collect();
    let still = Scene { cameras: vec![cameras[31].clone()], ..scene.clone() };
    let truth = truth_of(&gpu, &still, Shown { size, time: 0.0 })?;
    let moving = |changes: &[&str]| -> Result<f64> {
        let changes = [&["reflections.reuse=false"], changes].concat();
        Ok(error(&colours(last(&gpu, &scene, size, &changes, &cameras, cameras.len(), RADIANCE)?)?, &truth))
    };
    let eight = moving(&[&RAW[..], &["reflections.rays=8"]].concat())?;
    for denoiser in ["pica-pica", "recurrent-blur"] {
        let quarter = moving(&[&format!("reflections.denoiser={denoiser}"), "reflections.pixels_per_ray=4"])?;
        println!("{denoiser}: a quarter ray {quarter:.4}, eight raw rays {eight:.4}");
        ensure!(quarter < eight, "{denoiser}: a quarter ray {quarter}, eight raw rays {eight}");
    }
    Ok(())
}

/// The highlight of the sun in smooth balls before a rough mirror is found by few rays: with wider lobes it makes fewer specks, and hardly
/// less light.
#[test]
fn small_lights_make_few_specks() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = wall(0.5);
    for k in 0..5_u8 {
        let at = Vec3::new(0.5 * f32::from(k) - 1.0, 0.3 * f32::from(k % 2), 0.7);
        let ball = Affine3A::from_scale_rotation_translation(Vec3::splat(0.2), Quat::IDENTITY, at);
        add(&mut scene, sphere(32), material([0.9; 3], 1.0, 0.15), ball);
    }
    scene.environment = None;
    // Along the wall, onto what it sees of the balls.
    let sun = Light::Directional {
        direction: Vec3::new(-1.0, -0.15, 0.03).normalize(),
        illuminance: Vec3::splat(3.0),
        angular_radius: 0.0047,
    };
    scene.lights.push(sun);
    let shown = |regularization: &str, frames: u32| -> Result<Vec<DVec3>> {
        let changes = [&CHAIN[..], &RAW, &[regularization]].concat();
        Ok(mean_of("reflections", &gpu, &scene, &changes, Shown { size: [48, 36], time: 0.0 }, frames)?.0)
    };
    let (exact, widened) = ("reflections.regularization=0", "reflections.regularization=0.25");
    let light = |image: Vec<DVec3>| image.iter().map(|v| v.element_sum()).sum::<f64>();
    let brightest = |image: Vec<DVec3>| image.iter().map(|v| v.max_element()).fold(0.0, f64::max);
    let kept = light(shown(widened, 256)?) / light(shown(exact, 512)?);
    let (speck, limited) = (brightest(shown(exact, 32)?), brightest(shown(widened, 32)?));
    println!("brightest pixel after 32 rays {speck:.3}, with wider lobes {limited:.3}; light {kept:.4}");
    ensure!(limited < 0.4 * speck, "brightest {limited}, without wider lobes {speck}");
    ensure!((kept - 1.0).abs() < 0.1, "light {kept}");
    Ok(())
}

/// The recurrent blur in place of accumulation and clean-up.
#[test]
fn a_recurrent_blur_lowers_the_error() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = wall(0.3);
    let shown = Shown { size: [64, 48], time: 0.0 };
    let truth = truth_of(&gpu, &scene, shown)?;
    let error = |changes: &[&str], count: usize| -> Result<f64> {
        let changes = [&["reflections.denoiser=recurrent-blur", "reflections.reuse=false"], changes].concat();
        Ok(error(&radiance(&gpu, &scene, shown.size, &changes, count)?, &truth))
    };
    let (raw_error, eight) = (error(&RAW, 1)?, error(&[&RAW[..], &["reflections.rays=8"]].concat(), 1)?);
    for sparse in [&["reflections.reconstruct=false"][..], &[], &["reflections.pixels_per_ray=4"]] {
        let errors = [1, 8, 32].map(|count| error(sparse, count));
        let [first, eighth, late] = errors;
        let (first, eighth, late) = (first?, eighth?, late?);
        println!(
            "{sparse:?}: raw {raw_error:.4}, eight raw rays {eight:.4}, frames 1, 8, 32: {first:.4} {eighth:.4} {late:.4}"
        );
        ensure!(raw_error > first && first > eighth && eighth > late, "{sparse:?}: {first}, {eighth}, {late}");
        ensure!(late < 0.6 * eight, "{sparse:?}: {late}, eight raw rays {eight}");
    }
    Ok(())
}

/// In a closed box of rough metal that is lit by what the previous frame showed, a blur that is fed back neither adds light nor loses any.
#[test]
fn a_recurrent_blur_keeps_the_light_of_a_box() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = magpie_tests::harness::builtin("cornell")?;
    for m in &mut scene.materials {
        (m.roughness, m.metalness) = (0.7, 1.0);
    }
    let light = |denoiser: &str, frames: usize| -> Result<f64> {
        let changes = ["reflections.reconstruct=false", "reflections.bounces=1", denoiser];
        let config = config(&[&CHAIN[..], &changes].concat())?;
        let mut renderer = Renderer::new(
            &gpu,
            &scene,
            &Slots::default(),
            &config,
            RenderOptions { width: 32, height: 24, ..RenderOptions::default() },
        )?;
        renderer.read_slots(&["reflections"])?;
        let mut sum = 0.0;
        for frame in 0..frames {
            let read_back = frame >= frames / 2;
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back };
            let result = renderer.frame(request)?.context("no frame")?;
            let Some((_, Some(image))) = result.slots.into_iter().next() else { continue };
            sum += image.values().iter().map(|v| f64::from(v[0] + v[1] + v[2])).sum::<f64>();
        }
        Ok(sum / (frames - frames / 2) as f64)
    };
    let raw = light("reflections.denoiser=none", 192)?;
    let (soon, late) =
        (light("reflections.denoiser=recurrent-blur", 192)?, light("reflections.denoiser=recurrent-blur", 768)?);
    println!("of the light of raw rays: {:.4} over 192 frames, {:.4} over 768", soon / raw, late / raw);
    ensure!((soon / raw - 1.0).abs() < 0.02 && (late / raw - 1.0).abs() < 0.02, "{raw}, {soon}, {late}");
    Ok(())
}

/// Every pixel of a mirror shows what its own ray found, even where only a quarter of them have one per frame.
#[test]
fn mirrors_stay_sharp() -> Result<()> {
    ["reflections.denoiser=pica-pica", "reflections.denoiser=recurrent-blur"]
        .iter()
        .try_for_each(|d| mirrors_stay_sharp_with(d))
}

fn mirrors_stay_sharp_with(denoiser: &str) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = wall(0.0);
    let shown =
        |changes: &[&str], count: usize| radiance(&gpu, &scene, [64, 48], &[&[denoiser], changes].concat(), count);
    let raw = shown(&["reflections.denoiser=none", "reflections.reconstruct=false"], 1)?;
    let first = shown(&[], 1)?;
    let changed = raw.iter().zip(&first).filter(|(a, b)| a.distance(**b) > 2e-3 * a.length()).count();
    // After some frames the edges of the block are as sharp as with a ray for each pixel.
    let (full, settled) = (shown(&[], 24)?, shown(&["reflections.pixels_per_ray=4"], 24)?);
    let size = full.iter().map(|v| v.length()).sum::<f64>();
    let error = full.iter().zip(&settled).map(|(a, b)| a.distance(*b)).sum::<f64>() / size;
    println!(
        "{denoiser}: {changed} pixels changed with a ray for each; with quarter rays the error is {error:.4} of the light"
    );
    ensure!(changed == 0, "{changed} pixels of a mirror are filtered");
    ensure!(error < 0.02, "with quarter rays the error is {error} of the light");
    Ok(())
}

/// While the camera goes sideways before a mirror, the history follows what the mirror shows, not its surface.
#[test]
fn history_follows_the_reflection() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Which of six lamps a hit is lit by is random: all the noise that a mirror has.
    let mut scene = wall(0.0);
    scene.environment = None;
    add(&mut scene, plane(8.0), material([0.8; 3], 0.0, 1.0), upright(6.0, -1.0));
    for k in 0..6_u8 {
        let position = DVec3::new(f64::from(k) - 2.5, 1.5, 4.5 - f64::from(k % 3));
        scene.lights.push(Light::Point { position, intensity: Vec3::splat(4.0), range: None });
    }
    let size = [64, 48];
    let cameras: Vec<Camera> = (0..24_u8).map(|k| camera([0.04 * f64::from(k), 0.0, 2.0], [0.0, 0.0, 0.0])).collect();
    let still = Scene { cameras: vec![cameras[23].clone()], ..scene.clone() };
    let truth = truth_of(&gpu, &still, Shown { size, time: 0.0 })?;
    let moving = |denoiser: &str| -> Result<f64> {
        let changes = ["reflections.reuse=false", denoiser];
        Ok(error(&colours(last(&gpu, &scene, size, &changes, &cameras, cameras.len(), RADIANCE)?)?, &truth))
    };
    let (raw, surface) = (moving("reflections.denoiser=none")?, moving("reflections.denoiser=svgf")?);
    let image = moving("reflections.denoiser=pica-pica")?;
    let blurred = moving("reflections.denoiser=recurrent-blur")?;
    println!(
        "raw {raw:.4}, history of the surface {surface:.4}, of surface and image {image:.4}, blurred {blurred:.4}"
    );
    ensure!(image < 0.6 * surface && image < 0.6 * raw, "raw {raw}, surface {surface}, image {image}");
    ensure!(blurred < 0.6 * surface && blurred < 0.6 * raw, "raw {raw}, surface {surface}, blurred {blurred}");
    Ok(())
}
