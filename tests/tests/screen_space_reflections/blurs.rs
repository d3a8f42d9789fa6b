//! Lobes as cones: widths, levels, the Gaussian, and edges.
use super::rig::{floor, light, pillar, shown, unlit, upright};
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use magpie::prelude::*;
use magpie::scene::Scene;
use magpie_shaders::StorageImage;
use magpie_tests::bench::Bench;
use magpie_tests::fixtures::{add, camera, material, plane, scene};
use magpie_tests::harness::gpu;

const SIZE: [u32; 2] = [96, 64];
const CONE: [&str; 2] = ["reflections.lobe=cone", "reflections.precision=32"];
/// Which of the values below is the default of `xi`.
const DEFAULT: usize = 3;
/// Distances along x, roughness along y.
const TABLE: [u32; 2] = [32, 33];

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/reflection_blur.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint to; uvec2 size; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(p, size)) return;
    float roughness = float(p.y) / float(size.y - 1u);
    float radius = cone_radius(roughness * roughness, 0.8, 0.5 * float(p.x));
    store(to, p, vec4(radius, blur_level(radius), 0.0, 1.0));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    to: StorageImage,
    size: [u32; 2],
}

/// The cone's radius is that of the formula, in a form without a quotient of zeros: 0 for a mirror and at a distance of 0, and greater for
/// rougher surfaces and farther hits. So is the level.
#[test]
fn cones_widen_with_roughness_and_distance() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel("radius.comp", GLSL)?;
    let extent = Extent::new(TABLE[0], TABLE[1]);
    let ran = bench.run(extent, &["test.radius:table"], |g, _| {
        let table = g.pass("test.radius", Queue::Graphics, |p| {
            let (table, target) = p.create("table", ImageDesc::fixed(Format::Rgba32Float, extent));
            (table.read(), move |c: &mut Record<'_>| {
                c.dispatch(kernel, &Params { to: c.id(target), size: TABLE }, extent);
            })
        });
        g.output(table);
        Ok(())
    })?;
    let values = ran.clean()?.values("test.radius:table")?;
    let at = |x: u32, y: u32| values[(y * TABLE[0] + x) as usize];
    for y in 0..TABLE[1] {
        for x in 0..TABLE[0] {
            let [radius, level, ..] = at(x, y);
            let alpha = (f64::from(y) / f64::from(TABLE[1] - 1)).powi(2);
            let cosine = ((1.0 - 0.8) / (1.0 + (alpha * alpha - 1.0) * 0.8_f64)).sqrt();
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            let wanted = if sine > 0.0 { 0.5 * f64::from(x) * (1.0 - cosine) / sine } else { 0.0 };
            ensure!((f64::from(radius) - wanted).abs() <= 1e-5 * wanted + 1e-7, "{x}, {y}: {radius}, wanted {wanted}");
            let is_point = x == 0 || y == 0;
            ensure!(
                (radius == 0.0) == is_point && (level == 0.0) == is_point,
                "{x}, {y}: radius {radius}, level {level}"
            );
            if !is_point {
                ensure!(radius > at(x - 1, y)[0] && radius > at(x, y - 1)[0], "{x}, {y}: radius {radius}");
                ensure!(level > at(x - 1, y)[1] && level > at(x, y - 1)[1], "{x}, {y}: level {level}");
            }
        }
    }
    Ok(())
}

/// A metal floor before a bright wall, of one roughness.
fn before_a_wall(roughness: f32) -> Scene {
    let mut s = scene("wall", camera([0.0, 1.0, 5.0], [0.0, 0.7, 0.0]));
    floor(&mut s, material([1.0; 3], 1.0, roughness));
    add(&mut s, plane(20.0), unlit([0.5, 0.5, 0.5]), upright(-3.0, 0.0));
    pillar(&mut s, Vec3::new(0.3, 1.0, 0.3), Vec3::new(0.0, 1.0, 0.0), unlit([1.0, 0.2, 0.1]));
    s
}

/// The level that pixels read rises with roughness, and with the distance of what is reflected: where a thing touches the floor, its
/// reflection is sharp, however rough the floor is.
#[test]
fn reflections_blur_with_roughness_and_distance() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut means = Vec::new();
    for roughness in [0.08, 0.24, 0.4] {
        let scene = before_a_wall(roughness);
        let levels = &shown(&gpu, &scene, &CONE, SIZE, 2, ("reflections.cone", "radiance"))?[1];
        let distances = &shown(&gpu, &scene, &CONE, SIZE, 2, ("reflections.march", "hit_distance"))?[1];
        let met: Vec<(f32, f32)> = levels
            .iter()
            .zip(distances)
            .map(|(level, distance)| (distance[0], level[3]))
            .filter(|(distance, level)| *distance < 60000.0 && *level > 0.0)
            .collect();
        let mean = |from: f32, to: f32| {
            let part: Vec<f32> = met.iter().filter(|(d, _)| *d >= from && *d < to).map(|(_, level)| *level).collect();
            (part.iter().sum::<f32>() / part.len() as f32, part.len())
        };
        let parts = [mean(0.0, 0.15), mean(0.15, 0.6), mean(0.6, 2.0), mean(2.0, 50.0)];
        println!("roughness {roughness}: levels by distance {parts:.2?}");
        ensure!(parts.iter().all(|(_, count)| *count > 3), "{parts:?}");
        ensure!(parts.windows(2).all(|w| w[0].0 < w[1].0), "{parts:?}");
        ensure!(parts[0].0 < 0.75, "a level of {} where things touch", parts[0].0);
        means.push(parts[3].0);
    }
    ensure!(means[0] < means[1] && means[1] < means[2], "{means:?}");
    Ok(())
}

/// Two passes along an axis each are one in two dimensions: eight and eight taps instead of 64. Radiance comes multiplied with confidence.
#[test]
fn two_axes_make_the_gaussian() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = before_a_wall(0.3);
    let image = |changes: &[&str], view: (&str, &str)| -> Result<Vec<[f32; 4]>> {
        Ok(shown(&gpu, &scene, changes, SIZE, 2, view)?.swap_remove(1))
    };
    let gaussian = [CONE[0], CONE[1], "reflections.blur=gaussian"];
    let sharp = image(&gaussian, ("reflections.march", "radiance"))?;
    let confidence = image(&gaussian, ("reflections.march", "confidence"))?;
    let found = image(&gaussian, ("reflections.blur_0_down", "blurred"))?;
    let [width, height] = SIZE.map(i64::from);
    let weight = |offset: i64| (-0.5 * ((offset as f64 - 0.5) / 1.2).powi(2)).exp();
    let (mut worst, mut sum, mut whole, mut empty) = (0.0_f64, 0.0, 0, 0);
    for (index, found) in found.iter().enumerate() {
        let (x, y) = (index as i64 % (width / 2), index as i64 / (width / 2));
        let (mut total, mut weights, mut without, mut with) = ([0.0; 4], 0.0, 0, 0);
        for dy in -3..=4 {
            for dx in -3..=4 {
                let (sx, sy) = (2 * x + dx, 2 * y + dy);
                if !(0..width).contains(&sx) || !(0..height).contains(&sy) {
                    continue;
                }
                let at = (sy * width + sx) as usize;
                if sharp[at][3] == 0.0 {
                    without += 1;
                    continue;
                }
                with += 1;
                let w = weight(dx) * weight(dy);
                for c in 0..3 {
                    total[c] += w * f64::from(sharp[at][c]);
                }
                total[3] += w * 4.0 * f64::from(confidence[at][0]);
                weights += w;
            }
        }
        if with == 0 {
            ensure!(found[3] == -1.0, "{x}, {y}: {found:?} where there is no ray");
            empty += 1;
        }
        // Where some taps have no ray, the two axes do not part.
        if without > 0 {
            continue;
        }
        for c in 0..4 {
            worst = worst.max((f64::from(found[c]) - total[c] / weights).abs());
        }
        sum += light(found);
        whole += 1;
    }
    println!(
        "{whole} pixels of {:.3}, {empty} without a ray, difference from 64 taps {worst:.2e}",
        sum / f64::from(whole)
    );
    ensure!(whole > 400 && empty > 100 && sum > f64::from(whole) && worst < 2e-6, "light {sum}, difference {worst}");
    Ok(())
}

/// A dark pillar of rough metal before a floor that reflects a bright wall. The Gaussian lets the floor's reflection into the pillar's edges,
/// the blur along surfaces does not: with it the pillar looks as it does before a floor that reflects nothing.
#[test]
fn a_blur_along_surfaces_does_not_bleed() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let with = |floor_roughness: f32, blur: &str| -> Result<[Vec<[f32; 4]>; 2]> {
        let mut s = scene("bleed", camera([0.0, 1.6, 5.0], [0.0, 0.6, 0.0]));
        floor(&mut s, material([1.0; 3], 1.0, floor_roughness));
        add(&mut s, plane(20.0), unlit([4.0; 3]), upright(-3.0, 0.0));
        pillar(&mut s, Vec3::new(0.5, 0.9, 0.1), Vec3::new(0.0, 0.9, 1.0), material([0.9; 3], 1.0, 0.35));
        let changes = [CONE[0], CONE[1], blur];
        let image = shown(&gpu, &s, &changes, SIZE, 2, ("reflections.cone", "radiance"))?.swap_remove(1);
        let ids = shown(&gpu, &s, &changes, SIZE, 1, ("gbuffer.draw", "ids"))?.swap_remove(0);
        Ok([image, ids])
    };
    let leak = |blur: &str| -> Result<[f64; 2]> {
        let ([bright, ids], [dark, _]) = (with(0.3, blur)?, with(0.9, blur)?);
        // The pillar is the third instance. Its front reflects what is behind the camera, its top the wall above.
        let front: Vec<usize> = (0..ids.len()).filter(|&i| ids[i][0] == 3.0 && i / 96 > 30).collect();
        let sum = |image: &[[f32; 4]]| front.iter().map(|&i| light(&image[i])).sum::<f64>() / front.len() as f64;
        Ok([sum(&bright), sum(&dark)])
    };
    let ([gaussian, alone], [guided, guided_alone]) =
        (leak("reflections.blur=gaussian")?, leak("reflections.blur=bilateral")?);
    println!(
        "light on the pillar: Gaussian {gaussian:.4} ({alone:.4} with a dull floor), bilateral {guided:.4} ({guided_alone:.4})"
    );
    let (leaks, kept) = (gaussian - alone, guided - guided_alone);
    ensure!(leaks > 0.05, "the Gaussian leaks {leaks}");
    ensure!(kept.abs() < 0.05 * leaks, "the bilateral blur leaks {kept}, the Gaussian {leaks}");
    Ok(())
}

/// The cone's free parameter, fitted: of several values the default makes the picture that is nearest to the mean of many directions sampled
/// from the lobe, over several roughnesses.
#[test]
fn the_cone_is_as_wide_as_the_lobe() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let values = ["0", "0.3", "0.4", "0.5", "0.6", "0.7", "0.9"];
    let mut errors = vec![0.0; values.len()];
    for roughness in [0.15, 0.25, 0.35] {
        let scene = before_a_wall(roughness);
        let sampled = ["reflections.denoiser=none", CONE[1]];
        let frames = shown(&gpu, &scene, &sampled, SIZE, 48, ("reflections.march", "radiance"))?;
        let mut mean = vec![[0.0; 3]; frames[0].len()];
        for frame in &frames[1..] {
            for (sum, v) in mean.iter_mut().zip(frame) {
                (0..3).for_each(|c| sum[c] += f64::from(v[c]) / 47.0);
            }
        }
        let all: f64 = mean.iter().map(|v| v.iter().sum::<f64>()).sum();
        for (value, error) in values.iter().zip(&mut errors) {
            let xi = format!("reflections.xi={value}");
            let blurred = &shown(&gpu, &scene, &[CONE[0], CONE[1], &xi], SIZE, 2, ("reflections.cone", "radiance"))?[1];
            let square = |(a, b): (&[f64; 3], &[f32; 4])| (0..3).map(|c| (a[c] - f64::from(b[c])).powi(2)).sum::<f64>();
            let own = mean.iter().zip(blurred).map(square).sum::<f64>();
            println!("roughness {roughness}, xi {value}: {:.4}", (own / mean.len() as f64).sqrt());
            *error += own;
        }
        ensure!(all > 1000.0, "the reflection is dark: {all}");
    }
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    println!("squared errors of xi {values:?}: {errors:.3?}");
    ensure!(errors[DEFAULT] <= 1.05 * least && errors[0] > 1.15 * least, "{errors:.3?}");
    Ok(())
}
