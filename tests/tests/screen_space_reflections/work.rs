//! What rays cost, counted in look-ups of depth.
use super::rig::{floor, light, pillar, shown, unlit, upright};
use anyhow::{Result, ensure};
use glam::{Affine3A, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_tests::fixtures::{add, camera, environment, material, plane, scene};
use magpie_tests::harness::{builtin, config, gpu, render};

const SIZE: [u32; 2] = [96, 64];
const MARCH: (&str, &str) = ("reflections.march", "radiance");
const LINEAR: &str = "reflections.march=linear";

/// Rays of a frame, and their steps.
fn work(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<[u64; 2]> {
    let image = &shown(gpu, scene, changes, SIZE, 2, MARCH)?[1];
    let rays = image.iter().filter(|v| v[3] > 0.0).count() as u64;
    Ok([rays, image.iter().map(|v| v[3] as u64).sum()])
}

/// Fewer steps for longer strides, for rougher surfaces, for half resolution and for a lower limit of roughness; a quarter of the rays at half
/// resolution; the pyramid takes fewer steps than single pixels do.
#[test]
fn work_falls_with_what_is_asked_for() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let strides = ["1", "2", "4", "8"].map(|stride| {
        let (least, most) = (format!("reflections.stride={stride}"), format!("reflections.rough_stride={stride}"));
        work(&gpu, &scene, &[LINEAR, &least, &most])
    });
    let strides: Vec<[u64; 2]> = strides.into_iter().collect::<Result<_>>()?;
    println!("strides of 1, 2, 4, 8: rays and steps {strides:?}");
    ensure!(strides.windows(2).all(|w| w[1][0] == w[0][0] && w[1][1] * 10 < w[0][1] * 9), "{strides:?}");

    let grown = work(&gpu, &scene, &[LINEAR, "reflections.stride=1", "reflections.rough_stride=8"])?;
    println!("strides from 1 to 8 by roughness: {grown:?}");
    ensure!(strides[3][1] < grown[1] && grown[1] < strides[0][1], "{grown:?}");

    let whole = work(&gpu, &scene, &[])?;
    let half = work(&gpu, &scene, &["reflections.resolution=half"])?;
    println!("pyramid: {whole:?}, at half resolution {half:?}");
    ensure!(whole[1] < strides[0][1], "the pyramid takes {whole:?}, single pixels {:?}", strides[0]);
    let share = half[0] as f64 / whole[0] as f64;
    ensure!((share - 0.25).abs() < 0.02 && half[1] * 3 < whole[1], "{share} of the rays: {half:?}");

    let limits = ["0.1", "0.3", "0.6", "0.8", "1"]
        .map(|limit| work(&gpu, &scene, &[&format!("reflections.roughness_limit={limit}")]));
    let limits: Vec<[u64; 2]> = limits.into_iter().collect::<Result<_>>()?;
    println!("limits of 0.1, 0.3, 0.6, 0.8, 1: {limits:?}");
    ensure!(limits.windows(2).all(|w| w[0][0] <= w[1][0] && w[0][1] <= w[1][1]), "{limits:?}");
    ensure!(limits[0][0] < limits[2][0] && limits[2][0] < limits[4][0], "{limits:?}");
    Ok(())
}

/// Half of the picture is too rough: its pixels have no ray. Where all of it is, there is no pass that marches, and no previous frame is kept.
#[test]
fn rough_surfaces_take_no_ray() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let tiles = |left: f32, right: f32| {
        let mut s = scene("tiles", camera([0.0, 6.0, 0.01], [0.0, 0.0, 0.0]));
        for (x, roughness) in [(-20.0, left), (20.0, right)] {
            add(
                &mut s,
                plane(20.0),
                material([0.8; 3], 1.0, roughness),
                Affine3A::from_translation(Vec3::new(x, 0.0, 0.0)),
            );
        }
        s.environment = Some(environment());
        s
    };
    let [rays, _] = work(&gpu, &tiles(0.1, 0.9), &[])?;
    let pixels = u64::from(SIZE[0] * SIZE[1]);
    println!("{rays} rays for {pixels} pixels, half of them smooth");
    ensure!(rays.abs_diff(pixels / 2) < pixels / 50, "{rays} rays for {pixels} pixels");

    let all = config(&["stages.reflections=screen-space", "stages.gi=off"])?;
    let mut rough = tiles(0.9, 0.9);
    let passes = |scene: &Scene| -> Result<Vec<String>> {
        let result = render(&gpu, scene, &all, SIZE, 2, None)?;
        Ok(result.sample.passes.iter().map(|p| p.name.clone()).filter(|p| !p.starts_with("check.")).collect())
    };
    let found = passes(&rough)?;
    let own: Vec<&String> = found.iter().filter(|p| p.starts_with("reflections.")).collect();
    ensure!(own == ["reflections.blend"] && !found.contains(&"previous_radiance.keep".to_owned()), "{found:?}");
    ensure!(passes(&tiles(0.1, 0.9))?.contains(&"reflections.march".to_owned()), "nothing is marched");
    rough.environment = None;
    let found = passes(&rough)?;
    ensure!(!found.iter().any(|p| p.starts_with("reflections.")), "without a sky: {found:?}");
    for material in &mut rough.materials {
        (material.metalness, material.specular, material.roughness) = (0.0, 0.0, 0.1);
    }
    rough.environment = Some(environment());
    let found = passes(&rough)?;
    ensure!(!found.iter().any(|p| p.starts_with("reflections.")), "without a reflective surface: {found:?}");
    Ok(())
}

/// What half resolution costs in error: a blurred reflection of two colours, beside that of full resolution.
#[test]
fn half_resolution_is_near_to_full() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("half", camera([0.0, 1.2, 5.0], [0.0, 0.7, 0.0]));
    floor(&mut s, material([0.9; 3], 1.0, 0.25));
    add(&mut s, plane(20.0), unlit([0.2, 0.3, 0.6]), upright(-3.0, 0.0));
    pillar(&mut s, Vec3::new(0.5, 1.0, 0.2), Vec3::new(-0.8, 1.0, -1.0), unlit([1.0, 0.6, 0.2]));
    pillar(&mut s, Vec3::new(0.3, 0.3, 0.3), Vec3::new(0.8, 0.3, 0.5), material([0.6; 3], 1.0, 0.1));
    let last = |changes: &[&str]| -> Result<Vec<[f32; 4]>> {
        Ok(shown(&gpu, &s, changes, SIZE, 12, ("reflections.blend", "radiance"))?.swap_remove(11))
    };
    let full = last(&[])?;
    let psnr = |found: &[[f32; 4]]| {
        let square = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
        let mean = found.iter().zip(&full).map(square).sum::<f64>() / (3 * found.len()) as f64;
        -10.0 * mean.log10()
    };
    let half = psnr(&last(&["reflections.resolution=half"])?);
    let none = psnr(&last(&["reflections.roughness_limit=0.1"])?);
    println!("PSNR against full resolution: half {half:.1} dB, no rays {none:.1} dB");
    ensure!(full.iter().map(light).sum::<f64>() > 500.0, "the picture is dark");
    ensure!(half > 24.0 && half > none + 6.0, "half {half} dB, no rays {none} dB");
    Ok(())
}
