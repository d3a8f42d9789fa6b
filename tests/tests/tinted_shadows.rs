//! Tinted shadows of surfaces that transmit light: against closed forms and the ground truth, and without cost in scenes without such
//! surfaces.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3, Vec4};
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::{AlphaMode, Light, Material, Scene};
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions, Strategy};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::{add, camera, material, plane, scene, sun};
use magpie_tests::harness::{builtin, config_without_bounces, gpu, render};

/// Half a step of 8 bits, the format of the slot's image.
const HALF_STEP: f32 = 0.5 / 255.0;
/// Additional rounding.
const ROUNDING: f32 = 1e-4;

/// Thin smooth glass.
fn glass(colour: [f32; 3], transmission: f32, ior: f32) -> Material {
    Material { transmission, ior, double_sided: true, ..material(colour, 0.0, 0.0) }
}

fn blended(alpha: f32) -> Material {
    let base_colour = Vec4::new(0.9, 0.1, 0.4, alpha);
    Material { alpha: AlphaMode::Blend, double_sided: true, base_colour, ..material([1.0; 3], 0.0, 1.0) }
}

fn solid() -> Material {
    Material { double_sided: true, ..material([0.5; 3], 0.0, 1.0) }
}

/// Unpolarised Fresnel reflectance of one surface, by Snell's law and Fresnel's equations.
fn fresnel(cosine: f32, ior: f32) -> f32 {
    let inside = (1.0 - (1.0 - cosine * cosine) / (ior * ior)).sqrt();
    let s = (cosine - ior * inside) / (cosine + ior * inside);
    let p = (ior * cosine - inside) / (ior * cosine + inside);
    0.5 * (s * s + p * p)
}

const TOWARDS: Vec3 = Vec3::new(0.0, 1.0, 0.4);
const PICTURE: [u32; 2] = [64, 16];

/// Strips one metre wide, with different occluders 10 m above each. Returned with the transmittance of each.
fn strips() -> (Scene, Vec<Vec3>) {
    let cosine = TOWARDS.normalize().y;
    let through = |c: [f32; 3], t: f32, ior: f32| Vec3::from(c) * t * (1.0 - fresnel(cosine, ior));
    let (red, blue) = ([0.9, 0.5, 0.2], [0.3, 0.6, 1.0]);
    let left = vec![
        (vec![], Vec3::ONE),
        (vec![glass(red, 0.8, 1.5)], through(red, 0.8, 1.5)),
        (vec![glass(red, 0.8, 1.5), glass(blue, 1.0, 1.2)], through(red, 0.8, 1.5) * through(blue, 1.0, 1.2)),
        (vec![blended(0.5)], Vec3::splat(0.5)),
        (vec![blended(0.3)], Vec3::splat(0.7)),
        (vec![blended(0.8), glass(blue, 0.9, 1.5)], 0.2 * through(blue, 0.9, 1.5)),
        // Glass in a blended surface: light passes the uncovered part, and is partly transmitted by the rest.
        (
            vec![Material { transmission: 1.0, roughness: 0.0, ..blended(0.5) }],
            0.5 + 0.5 * through([0.9, 0.1, 0.4], 1.0, 1.5),
        ),
        (vec![glass(red, 0.8, 1.5), solid()], Vec3::ZERO),
        (vec![solid(), glass(red, 0.8, 1.5)], Vec3::ZERO),
        // Refracting and scattering surfaces.
        (vec![Material { thickness: 0.1, ..glass(red, 0.8, 1.5) }], Vec3::ZERO),
        (vec![Material { roughness: 0.3, ..glass(red, 0.8, 1.5) }], Vec3::ZERO),
        (vec![Material { alpha: AlphaMode::Mask(0.5), ..glass(red, 0.8, 1.5) }], Vec3::ZERO),
    ];
    let mut strips = scene("strips", camera([0.0, 8.9, 0.01], [0.0, 0.0, 0.0]));
    add(&mut strips, plane(20.0), material([0.7; 3], 0.0, 1.0), Affine3A::IDENTITY);
    let mut wanted = Vec::new();
    for (at, (occluders, left)) in left.into_iter().enumerate() {
        for (above, occluder) in occluders.into_iter().enumerate() {
            let place = Vec3::new(at as f32 - 5.5, 10.0 + 0.5 * above as f32, 0.0);
            let stretched =
                Affine3A::from_scale_rotation_translation(Vec3::new(0.5, 1.0, 20.0), glam::Quat::IDENTITY, place);
            add(&mut strips, plane(1.0), occluder, stretched);
        }
        wanted.push(left);
    }
    strips.lights.push(sun(TOWARDS));
    (strips, wanted)
}

/// The strip that each pixel sees; none near a border.
fn strip_of(scene: &Scene, [width, height]: [u32; 2], count: usize) -> Vec<Option<usize>> {
    let camera = &scene.cameras[0];
    let slope = (0.5 * f64::from(camera.vertical_fov)).tan();
    let see = |pixel: u32| {
        let (x, y) = (f64::from(pixel % width) + 0.5, f64::from(pixel / width) + 0.5);
        let aspect = f64::from(width) / f64::from(height);
        let across = (2.0 * x / f64::from(width) - 1.0) * slope * aspect;
        let down = (2.0 * y / f64::from(height) - 1.0) * slope;
        let along = camera.world_from_camera.transform_vector3(DVec3::new(across, -down, -1.0));
        let met = camera.eye() - along * (camera.eye().y / along.y);
        let place = met.x + 6.0;
        let inside = (0.1..0.9).contains(&place.rem_euclid(1.0)) && (0.0..count as f64).contains(&place);
        inside.then_some(place as usize)
    };
    (0..width * height).map(see).collect()
}

/// A frame with every check on, with `shadows` read back.
fn shadows(gpu: &Gpu, scene: &Scene, changes: &[&str], rays: Rays, [width, height]: [u32; 2]) -> Result<FrameResult> {
    let options = RenderOptions { width, height, rays, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config_without_bounces(changes)?, options)?;
    renderer.read_slots(&["shadows", "direct"])?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    let result = renderer.frame(request)?.context("no frame")?;
    ensure!(result.findings.is_empty(), "{:?}", result.findings);
    Ok(result)
}

fn image(result: &FrameResult, slot: usize) -> Result<Vec<[f32; 4]>> {
    Ok(result.slots[slot].1.as_ref().context("no image")?.values())
}

fn truth(gpu: &Gpu, scene: &Scene, samples: u32, options: ReferenceOptions) -> Result<Estimate> {
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options)?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

fn of_shadows([width, height]: [u32; 2]) -> ReferenceOptions {
    ReferenceOptions { width, height, only: Only::Shadows, pixel: PixelSampling::Centre, ..ReferenceOptions::default() }
}

#[test]
fn light_that_is_left_is_the_closed_form() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, wanted) = strips();
    let strips = strip_of(&scene, PICTURE, wanted.len());
    for rays in Rays::ALL.into_iter().filter(|rays| gpu.check_rays(*rays).is_ok()) {
        let slot = image(&shadows(&gpu, &scene, &[], rays, PICTURE)?, 0)?;
        let truth = truth(&gpu, &scene, 1, ReferenceOptions { rays, ..of_shadows(PICTURE) })?.mean;
        let mut seen = vec![0; wanted.len()];
        let (mut worst_slot, mut worst_truth) = (0.0_f32, 0.0_f32);
        for (at, strip) in strips.iter().enumerate() {
            let Some(strip) = *strip else { continue };
            seen[strip] += 1;
            let off = |found: Vec3| (found - wanted[strip]).abs().max_element();
            let (by_slot, by_truth) = (off(Vec3::from_slice(&slot[at])), off(truth[at].as_vec3()));
            ensure!(by_slot < HALF_STEP + ROUNDING, "{rays}: strip {strip}: {:?}, wanted {}", slot[at], wanted[strip]);
            ensure!(by_truth < ROUNDING, "{rays}: strip {strip}: truth {}, wanted {}", truth[at], wanted[strip]);
            (worst_slot, worst_truth) = (worst_slot.max(by_slot), worst_truth.max(by_truth));
        }
        println!("{rays}: off by {worst_slot:.1e} in 8 bits, by {worst_truth:.1e} in the truth; pixels {seen:?}");
        ensure!(seen.iter().all(|pixels| *pixels > 20), "{seen:?}");
    }
    Ok(())
}

#[test]
fn so_many_panes_are_dark_and_fewer_are_not() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // `MOST_SHEETS` of lib/tinted.glsl.
    for (panes, left) in [(16, 0.99_f32.powi(16)), (17, 0.0)] {
        let mut scene = scene("panes", camera([0.0, 5.0, 0.01], [0.0, 0.0, 0.0]));
        add(&mut scene, plane(20.0), material([0.7; 3], 0.0, 1.0), Affine3A::IDENTITY);
        for pane in 0..panes {
            let place = Affine3A::from_translation(Vec3::Y * (10.0 + 0.1 * pane as f32));
            add(&mut scene, plane(20.0), blended(0.01), place);
        }
        scene.lights.push(sun(TOWARDS));
        let found = image(&shadows(&gpu, &scene, &[], Rays::Software, [8, 8])?, 0)?;
        ensure!(found.iter().all(|v| (v[1] - left).abs() < HALF_STEP + ROUNDING), "{panes}: {:?}", found[0]);
        // The ground truth follows all of them.
        let truth = truth(&gpu, &scene, 1, of_shadows([8, 8]))?.mean;
        let left = 0.99_f64.powi(panes);
        ensure!(truth.iter().all(|v| (v.y - left).abs() < 1e-4), "{panes}: truth {}", truth[0]);
    }
    Ok(())
}

/// A floor under glass that covers half of it, lit by a disc light through the glass and past it.
fn window() -> Scene {
    let mut window = scene("window", camera([0.0, 0.9, 2.4], [0.0, 0.0, 0.0]));
    add(&mut window, plane(6.0), material([0.7; 3], 0.0, 1.0), Affine3A::IDENTITY);
    let place = |x: f32, y: f32| Affine3A::from_translation(Vec3::new(x, y, 0.0));
    add(&mut window, plane(1.5), glass([0.9, 0.4, 0.1], 0.9, 1.5), place(-1.5, 1.0));
    add(&mut window, plane(1.5), blended(0.4), place(1.0, 1.2));
    window.lights.push(Light::Disc {
        centre: DVec3::new(0.2, 3.0, 0.0),
        normal: Vec3::NEG_Y,
        radius: 1.2,
        radiance: Vec3::new(5.0, 4.0, 6.0),
    });
    window
}

#[test]
fn soft_tinted_shadows_converge_to_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, size, frames) = (window(), [40, 24], 64);
    let truth = truth(&gpu, &scene, 2048, of_shadows(size))?;
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let config = config_without_bounces(&["shadows.denoiser=none", "shadows.rays=8"])?;
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config, options)?;
    renderer.read_slots(&["shadows"])?;
    let mut sums = vec![DVec3::ZERO; truth.mean.len()];
    for _ in 0..frames {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{:?}", result.findings);
        for (sum, v) in sums.iter_mut().zip(image(&result, 0)?) {
            *sum += Vec3::from_slice(&v).as_dvec3() / f64::from(frames);
        }
    }
    let (mut square, mut noise, mut coloured, mut worst) = (0.0, 0.0, 0, 0.0_f64);
    for ((found, wanted), error) in sums.iter().zip(&truth.mean).zip(truth.standard_error()) {
        square += (*found - *wanted).length_squared() / 3.0;
        noise += error.length_squared() / 3.0;
        worst = worst.max((*found - *wanted).abs().max_element());
        coloured += usize::from(wanted.max_element() - wanted.min_element() > 0.1);
    }
    let [square, noise] = [square, noise].map(|sum: f64| (sum / sums.len() as f64).sqrt());
    println!("RMSE {square:.1e}, noise of the truth {noise:.1e}, worst {worst:.1e}; {coloured} pixels have a colour");
    ensure!(coloured * 10 > sums.len(), "{coloured} of {} pixels have a colour", sums.len());
    // Frames are rounded to 8 bits.
    ensure!(square < 4e-3 && worst < 3e-2, "RMSE {square:.1e}, worst {worst:.1e}");
    Ok(())
}

#[test]
fn light_through_glass_is_counted_once() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = window();
    let mean = |only: Only, strategy: Strategy, samples: u32| {
        let options =
            ReferenceOptions { width: 24, height: 16, only, strategy, seed: 5, ..ReferenceOptions::default() };
        let estimate = truth(&gpu, &scene, samples, options)?;
        let count = estimate.mean.len() as f64;
        let mean = estimate.mean.iter().sum::<DVec3>() / count;
        let error = estimate.standard_error().iter().map(|e| *e * *e).sum::<DVec3>().map(f64::sqrt) / count;
        anyhow::Ok((mean, error))
    };
    for only in [Only::Direct, Only::All] {
        let (both, error) = mean(only, Strategy::Power, 128)?;
        let (alone, more) = mean(only, Strategy::SurfacesOnly, 1280)?;
        let sigma = (error * error + more * more).map(f64::sqrt);
        println!("{only:?}: {both} by lights and surfaces, {alone} by surfaces alone, {sigma} expected between them");
        ensure!((sigma / both).max_element() < 0.01, "{only:?}: too noisy to tell: {sigma} of {both}");
        ensure!(((both - alone) / sigma).abs().max_element() < 4.0, "{only:?}: {both} and {alone}, {sigma} expected");
    }
    Ok(())
}

#[test]
fn the_picture_is_that_of_light_times_what_is_left() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, wanted) = strips();
    let strips = strip_of(&scene, PICTURE, wanted.len());
    let lit = image(&shadows(&gpu, &scene, &["stages.shadows=off"], Rays::Software, PICTURE)?, 0).err();
    ensure!(lit.is_some(), "a slot that is off has no image");
    let size = ReferenceOptions { width: PICTURE[0], height: PICTURE[1], only: Only::Direct, ..of_shadows(PICTURE) };
    let direct = image(&shadows(&gpu, &scene, &[], Rays::Software, PICTURE)?, 1)?;
    let truth = truth(&gpu, &scene, 1, size)?.mean;
    let brightest = truth.iter().map(|v| v.max_element()).fold(0.0, f64::max);
    for (at, strip) in strips.iter().enumerate().filter(|(_, strip)| strip.is_some()) {
        let off = (Vec3::from_slice(&direct[at]).as_dvec3() - truth[at]).abs().max_element() / brightest;
        ensure!(off < 4e-3, "strip {strip:?}: {:?} and {}", direct[at], truth[at]);
    }
    Ok(())
}

/// Names of passes and their numbers of rays.
fn passes(result: &FrameResult) -> Vec<(String, u64, u64)> {
    result.sample.passes.iter().map(|p| (p.name.clone(), p.rays_closest, p.rays_any)).collect()
}

#[test]
fn scenes_that_stop_all_light_pay_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let courtyard = builtin("courtyard")?;
    let run = |scene: &Scene, tinted: &str| shadows(&gpu, scene, &[tinted], Rays::Software, [32, 18]);
    let [with, without] = ["shadows.tinted=true", "shadows.tinted=false"].map(|tinted| run(&courtyard, tinted));
    let (with, without) = (with?, without?);
    ensure!(passes(&with) == passes(&without), "{:?}\n{:?}", passes(&with), passes(&without));
    ensure!(image(&with, 0)? == image(&without, 0)? && image(&with, 1)? == image(&without, 1)?, "pictures differ");
    let traced = |r: &FrameResult| r.sample.passes.iter().filter(|p| p.name.starts_with("shadows.trace")).count();
    ensure!(traced(&with) == 1, "two lights share an image");

    // Blended surfaces with an alpha of 1 are solid; with the setting off nothing is tinted.
    let (strips, _) = strips();
    let mut covered = strips.clone();
    for material in &mut covered.materials {
        (material.transmission, material.base_colour.w) = (0.0, 1.0);
    }
    ensure!(passes(&run(&covered, "shadows.tinted=true")?) == passes(&run(&covered, "shadows.tinted=false")?));
    let closest = |r: &FrameResult| passes(r).iter().filter(|p| p.0 == "shadows.trace").map(|p| p.1).sum::<u64>();
    let [with, without] = [run(&strips, "shadows.tinted=true")?, run(&strips, "shadows.tinted=false")?];
    ensure!(closest(&with) > 0 && closest(&without) == 0, "{} and {}", closest(&with), closest(&without));
    Ok(())
}

#[test]
fn what_is_denoised_is_finite_and_keeps_its_colours() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = window();
    for changes in [&["shadows.history=8"][..], &["shadows.resolution=half"]] {
        let config = config_without_bounces(changes)?;
        let options = RenderOptions { width: 32, height: 20, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config, options)?;
        renderer.read_slots(&["shadows"])?;
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let mut last = Vec::new();
        for _ in 0..6 {
            let result = renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "{changes:?}: {:?}", result.findings);
            last = image(&result, 0)?;
        }
        let truth = truth(&gpu, &scene, 256, of_shadows([32, 20]))?.mean;
        let square = |(v, t): (&[f32; 4], &DVec3)| (Vec3::from_slice(v).as_dvec3() - *t).length_squared() / 3.0;
        let error = (last.iter().zip(&truth).map(square).sum::<f64>() / truth.len() as f64).sqrt();
        let none = truth.iter().map(|t| square((&[1.0; 4], t))).sum::<f64>() / truth.len() as f64;
        println!("{changes:?}: RMSE {error:.3}, that of white {:.3}", none.sqrt());
        ensure!(error < 0.08 && none.sqrt() > 0.3, "{changes:?}: RMSE {error:.3}, that of white {:.3}", none.sqrt());
    }
    Ok(())
}

#[test]
fn eight_lights_keep_their_shadows() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Point lights, as larger ones are lit from their centres here.
    let mut scene = window();
    scene.lights.clear();
    for at in 0..8 {
        let (position, intensity) = (DVec3::new(f64::from(at) - 3.5, 2.5, -0.5), Vec3::splat(2.0));
        scene.lights.push(Light::Point { position, intensity, range: None });
    }
    let config = config_without_bounces(&["shadows.most_lights=8", "shadows.denoiser=none"])?;
    let result = render(&gpu, &scene, &config, [16, 9], 1, None)?;
    for light in 0..8 {
        let name = if light == 0 { "shadows.trace".to_owned() } else { format!("shadows.trace_{}", light + 1) };
        ensure!(result.sample.passes.iter().any(|p| p.name == name), "no {name}");
    }
    // With maps lights share images, and nothing is tinted.
    let maps = render(&gpu, &scene, &config_without_bounces(&["stages.shadows=hybrid"])?, [16, 9], 1, None)?;
    ensure!(!maps.sample.passes.iter().any(|p| p.name == "shadows.trace_2"), "a hybrid has one group");

    // All eight lights in the picture: without a sky, it equals the ground truth.
    let options = ReferenceOptions { width: 32, height: 18, only: Only::Direct, ..of_shadows([32, 18]) };
    let truth = truth(&gpu, &scene, 128, options)?.mean;
    let changes = ["shadows.most_lights=8"];
    let hard = shadows(&gpu, &scene, &changes, Rays::Software, [32, 18])?;
    let (mut found, mut wanted) = (DVec3::ZERO, DVec3::ZERO);
    for (a, b) in image(&hard, 1)?.iter().zip(&truth) {
        (found, wanted) = (found + Vec3::from_slice(a).as_dvec3(), wanted + *b);
    }
    let ratio = found / wanted;
    println!("eight lights: {ratio} of the truth");
    ensure!((ratio - DVec3::ONE).abs().max_element() < 0.01, "{ratio} of the truth");
    Ok(())
}
