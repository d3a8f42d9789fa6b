//! Scenes that are hard for samples of lights, and how far light is from that of the reference.
use crate::against::{Bias, Shown, bias, mean_with, truth_of};
use crate::fixtures::{add, block, camera, material, plane, scene};
use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Light, Material, Scene};
use magpie_passes::RenderOptions;
use magpie_passes::reference::{Only, ReferenceOptions};
use std::f32::consts::PI;

/// A fence of boards between three lamps and a floor: what one pixel sees, the next does not.
pub fn fence() -> Scene {
    let mut s = scene("fence", camera([0.0, 3.0, 4.5], [0.0, 0.0, 0.0]));
    add(&mut s, plane(4.0), material([0.8; 3], 0.0, 0.8), Affine3A::IDENTITY);
    for k in 0..9_u8 {
        let place = Vec3::new(0.5 * (f32::from(k) - 4.0), 0.6, 0.0);
        let board = block(Vec3::new(0.12, 0.6, 0.02));
        add(&mut s, board, material([0.6, 0.5, 0.4], 0.0, 0.6), Affine3A::from_translation(place));
    }
    for (x, colour) in [(-1.5, Vec3::new(9.0, 3.0, 2.0)), (1.0, Vec3::new(2.0, 4.0, 9.0)), (0.2, Vec3::splat(4.0))] {
        s.lights.push(Light::Point { position: [x, 1.0, -1.2].into(), intensity: colour, range: None });
    }
    s
}

/// A glossy floor, of metal behind and plastic in front, under lamps of every kind and an emissive panel: `scale` times as large as usual.
pub fn every_kind(scale: f32) -> Scene {
    let mut s = scene("every kind", camera([0.0, 1.6, 3.4], [0.0, 0.2, 0.0]));
    let at = |x: f32, y: f32, z: f32| Affine3A::from_translation(Vec3::new(x, y, z));
    add(&mut s, plane(4.0), material([0.7, 0.6, 0.5], 0.0, 0.15), at(0.0, 0.0, 4.0));
    add(&mut s, plane(4.0), material([0.9, 0.9, 0.8], 1.0, 0.15), at(0.0, 0.0, -4.0));
    add(&mut s, block(Vec3::new(0.2, 0.3, 0.2)), material([0.8; 3], 0.0, 0.5), at(-0.5, 0.3, 0.1));
    let area = scale * scale;
    let radiance = |r: f32, g: f32, b: f32| Vec3::new(r, g, b) / area;
    let panel = Material { emission: radiance(6.0, 5.0, 3.0), ..material([0.2; 3], 0.0, 1.0) };
    let down = Affine3A::from_rotation_translation(Quat::from_rotation_x(0.9 * PI), Vec3::new(0.5, 1.2, -0.6));
    add(&mut s, plane(0.4 * scale), panel, down);
    s.lights.push(Light::Sphere {
        centre: [-0.9, 0.7, -0.7].into(),
        radius: 0.15 * scale,
        radiance: radiance(4.0, 8.0, 9.0),
    });
    s.lights.push(Light::Disc {
        centre: [0.0, 1.5, 0.6].into(),
        normal: Vec3::NEG_Y,
        radius: 0.3 * scale,
        radiance: radiance(5.0, 4.0, 4.0),
    });
    s.lights.push(Light::Rectangle {
        centre: [1.2, 0.8, 0.3].into(),
        half_u: Vec3::new(0.0, 0.0, 0.3 * scale),
        half_v: Vec3::new(0.0, 0.2 * scale, 0.0),
        radiance: radiance(2.0, 6.0, 3.0),
    });
    s.lights.push(Light::Spot {
        position: [-1.2, 1.6, 0.8].into(),
        direction: Vec3::new(0.6, -1.0, -0.3).normalize(),
        intensity: Vec3::new(6.0, 2.0, 2.0),
        inner: 0.2,
        outer: 0.5,
        range: None,
    });
    s
}

/// A floor of smooth metal that shows a wide lamp behind it.
pub fn shown_lamp() -> Scene {
    let mut s = scene("shown lamp", camera([0.0, 1.0, 3.0], [0.0, 0.2, 0.0]));
    add(&mut s, plane(4.0), material([0.9; 3], 1.0, 0.1), Affine3A::IDENTITY);
    s.lights.push(Light::Rectangle {
        centre: [0.0, 1.2, -2.0].into(),
        half_u: Vec3::new(1.2, 0.0, 0.0),
        half_v: Vec3::new(0.0, 0.6, 0.0),
        radiance: Vec3::new(1.0, 1.5, 2.0),
    });
    s
}

/// Direct light of the reference, as many times as there are runs, eight samples for each of their frames.
///
/// # Errors
/// Any error of the reference.
pub fn truths(gpu: &Gpu, scene: &Scene, shown: Shown, [runs, frames]: [u32; 2]) -> Result<Vec<Vec<DVec3>>> {
    let one = |seed: u32| {
        let options = ReferenceOptions { only: Only::Direct, seed: seed + 1000, ..ReferenceOptions::default() };
        Ok(truth_of(options, gpu, scene, shown, 8 * frames)?.mean)
    };
    (0..runs).map(one).collect()
}

/// Light within three standard errors, which are at most `most`, and no error of pixels beyond noise.
///
/// # Errors
/// What differs.
pub fn agrees(what: &str, b: &Bias, most: f64) -> Result<()> {
    println!(
        "{what}: light {:.4} ± {:.4}, relMSE of the mean {:.1e} ± {:.0e}",
        b.light, b.light_error, b.relmse, b.error
    );
    ensure!(b.light_error < most, "{what}: too noisy to tell, {:.4}", b.light_error);
    ensure!((b.light - 1.0).abs() < 3.0 * b.light_error + 1e-3, "{what}: {:.4} of the light", b.light);
    ensure!(b.relmse < 4.0 * b.error + 1e-4, "{what}: relMSE {:.1e} ± {:.0e}", b.relmse, b.error);
    Ok(())
}

/// Mean of the relative errors of luminance.
pub fn error(found: &[DVec3], truth: &[DVec3]) -> f64 {
    let luminance = |v: &DVec3| v.dot(DVec3::new(0.2126, 0.7152, 0.0722));
    let one = |(f, t): (&DVec3, &DVec3)| (luminance(f) - luminance(t)).abs() / (luminance(t) + 0.01);
    found.iter().zip(truth).map(one).sum::<f64>() / truth.len() as f64
}

/// Root mean square error over the mean of the truth.
pub fn rms(found: &[DVec3], truth: &[DVec3]) -> f64 {
    let square: f64 = found.iter().zip(truth).map(|(f, t)| (*f - *t).length_squared()).sum();
    (square * truth.len() as f64).sqrt() / truth.iter().sum::<DVec3>().length()
}

/// Direct light of a configuration, whose two parts are laid over each other, against that of the reference, from so many runs of so many frames.
///
/// # Errors
/// Any error of the renderer, and values that are not finite.
pub fn compared(
    gpu: &Gpu,
    scene: &Scene,
    changes: [&[&str]; 2],
    shown: Shown,
    wanted: &[Vec<DVec3>],
    [runs, frames]: [u32; 2],
) -> Result<Bias> {
    let changes = changes.concat();
    let run = |seed: u32| {
        let options = RenderOptions { check: true, seed, ..RenderOptions::default() };
        Ok(mean_with(options, "direct", gpu, scene, &changes, shown, frames)?.0)
    };
    Ok(bias(&(0..runs).map(run).collect::<Result<Vec<_>>>()?, wanted))
}
