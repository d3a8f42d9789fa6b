//! Reflections by rays against the reference.
use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::scene::Scene;
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_tests::against::{Shown, light_and_block_error, mean_of, truth_of};
use magpie_tests::fixtures::{add, camera, environment, material, plane, scene};
use magpie_tests::harness::{builtin, config, gpu, linear, render};

const SHOWN: Shown = Shown { size: [48, 40], time: 0.0 };
/// Rays as they are, without other effects.
const RAW: [&str; 9] = [
    "reflections.regularization=0",
    "stages.reflections=ray-traced",
    "reflections.denoiser=none",
    "reflections.reuse=false",
    "reflections.precision=32",
    "gbuffer.precision=full",
    "stages.shadows=off",
    "stages.gi=off",
    "direct.emitter_rays=0",
];

/// A scene all of whose surfaces have the same roughness and metalness.
fn coated(name: &str, roughness: f32, metalness: f32) -> Result<Scene> {
    let mut scene = builtin(name)?;
    for material in &mut scene.materials {
        (material.roughness, material.metalness) = (roughness, metalness);
        (material.metallic_roughness_texture, material.normal_texture) = (None, None);
    }
    Ok(scene)
}

/// Rays of three bounces find what the reference finds with four scatterings, on metal and dielectrics of every roughness: the whole light,
/// and where it is.
#[test]
fn rays_converge_to_the_reference() -> Result<()> {
    const BOUNCES: u32 = 3;
    let Some(gpu) = gpu()? else { return Ok(()) };
    let bounces = format!("reflections.bounces={BOUNCES}");
    let changes: Vec<&str> = RAW.into_iter().chain([bounces.as_str()]).collect();
    for (name, metalness, roughness) in [
        ("cornell", 0.0, 0.1),
        ("cornell", 0.0, 0.6),
        ("cornell", 1.0, 0.0),
        ("cornell", 1.0, 0.3),
        ("courtyard", 0.0, 0.1),
        ("courtyard", 0.0, 0.6),
        ("courtyard", 1.0, 1.0),
    ] {
        let scene = coated(name, roughness, metalness)?;
        let (found, _) = mean_of("reflections", &gpu, &scene, &changes, SHOWN, 96)?;
        let options = ReferenceOptions { only: Only::Reflections, depth: BOUNCES + 1, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &scene, SHOWN, 192)?;
        let [light, error] = light_and_block_error(&found, &truth.mean, SHOWN.size[0]);
        println!("{name}, metalness {metalness}, roughness {roughness}: light {light:.4}, error of blocks {error:.4}");
        ensure!((light - 1.0).abs() < 0.03, "{name}, metalness {metalness}, roughness {roughness}: light {light}");
        // Measured 0.01 to 0.11: the noise of the few pixels that reflect a lamp.
        ensure!(error < 0.15, "{name}, metalness {metalness}, roughness {roughness}: blocks {error}");
    }
    Ok(())
}

/// The denoised frame is nearer to the mean of many frames than one raw frame is, from the first frame on; a mirror stays as sharp as it is.
#[test]
fn the_denoiser_helps_and_leaves_mirrors_sharp() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = coated("cornell", 0.3, 1.0)?;
    let (wanted, _) = mean_of("reflections", &gpu, &scene, &RAW, SHOWN, 192)?;
    let last = |scene: &Scene, denoiser: &str, frames: u32| -> Result<Vec<DVec3>> {
        let changes: Vec<&str> = RAW.into_iter().filter(|c| !c.contains("denoiser")).chain([denoiser]).collect();
        let view = Some(("reflections.resolve", "radiance"));
        let image = linear(render(&gpu, scene, &config(&changes)?, SHOWN.size, frames, view)?)?;
        Ok(image.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).collect())
    };
    let error = |denoiser: &str, frames: u32| -> Result<f64> {
        let found = last(&scene, denoiser, frames)?;
        // Of display values, so that single bright pixels do not decide.
        let shown = |v: DVec3| v / (DVec3::ONE + v);
        let square: f64 = found.iter().zip(&wanted).map(|(f, w)| (shown(*f) - shown(*w)).length_squared()).sum();
        Ok((square / wanted.len() as f64).sqrt())
    };
    let raw = error("reflections.denoiser=none", 8)?;
    let (first, eighth) = (error("reflections.denoiser=svgf", 1)?, error("reflections.denoiser=svgf", 8)?);
    println!("error of a raw frame {raw:.4}, denoised {first:.4}, in the eighth frame {eighth:.4}");
    ensure!(first < raw && eighth < 0.7 * raw, "raw {raw}, denoised {first}, in the eighth frame {eighth}");

    // Nothing is blurred across the picture: the first frame of a mirror is the raw one.
    let mirror = coated("cornell", 0.0, 1.0)?;
    let (sharp, filtered) =
        (last(&mirror, "reflections.denoiser=none", 1)?, last(&mirror, "reflections.denoiser=svgf", 1)?);
    let changed = sharp.iter().zip(&filtered).filter(|(a, b)| a.distance(**b) > 1e-3 * a.length() + 1e-6).count();
    ensure!(sharp.iter().any(|v| *v != DVec3::ZERO) && changed == 0, "{changed} pixels of a mirror are filtered");
    Ok(())
}

/// A camera before a mirror, and a red board behind the camera.
#[test]
fn a_mirror_shows_what_is_behind_the_camera() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("mirror", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
    let upright =
        |z: f32, turn: f32| Affine3A::from_rotation_translation(Quat::from_rotation_x(turn), Vec3::new(0.0, 0.0, z));
    add(&mut s, plane(3.0), material([1.0; 3], 1.0, 0.0), upright(0.0, std::f32::consts::FRAC_PI_2));
    add(&mut s, plane(3.0), material([0.8, 0.1, 0.1], 0.0, 1.0), upright(4.0, -std::f32::consts::FRAC_PI_2));
    s.environment = Some(environment());
    let shown = Shown { size: [16, 16], time: 0.0 };
    let redness = |changes: &[&str]| -> Result<f64> {
        let (found, _) = mean_of("reflections", &gpu, &s, changes, shown, 32)?;
        Ok(found[8 * 16 + 8].x / found[8 * 16 + 8].y)
    };
    let (sky, rays) = (redness(&["stages.reflections=sky"])?, redness(&RAW)?);
    println!("red over green: {sky:.2} from the sky, {rays:.2} from rays");
    ensure!(rays > 4.0 && sky < 2.0, "red over green: {sky} from the sky, {rays} from rays");
    Ok(())
}

/// In a closed box of rough metal light goes on for long. Hits that take the previous frame's light must neither add nor lose any.
#[test]
fn light_that_goes_round_stays_bounded() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = coated("cornell", 0.7, 1.0)?;
    let shown = Shown { size: [32, 24], time: 0.0 };
    let truth = truth_of(
        ReferenceOptions { only: Only::Reflections, ..ReferenceOptions::default() },
        &gpu,
        &scene,
        shown,
        1024,
    )?;
    let light = |values: &[DVec3]| values.iter().map(|v| v.element_sum()).sum::<f64>();
    let share = |reuse: &str, frames: u32| -> Result<f64> {
        let changes = [
            "stages.reflections=ray-traced",
            "stages.gi=off",
            "reflections.denoiser=none",
            "reflections.bounces=1",
            reuse,
        ];
        Ok(light(&mean_of("reflections", &gpu, &scene, &changes, shown, frames)?.0) / light(&truth.mean))
    };
    let (once, soon) = (share("reflections.reuse=false", 64)?, share("reflections.reuse=true", 64)?);
    let later = share("reflections.reuse=true", 384)?;
    println!(
        "of the light of all bounces: one bounce {once:.3}, with the previous frame {soon:.3}, over 384 frames {later:.3}"
    );
    ensure!(once < soon && (later / soon - 1.0).abs() < 0.03, "{once}, {soon}, {later} of the light");
    ensure!(soon > 0.7 && later < 1.05, "{once}, {soon}, {later} of the light");
    Ok(())
}
