//! The low-discrepancy sequence of `shaders/lib/sequence.glsl` on the device: stratified, uniform, independent between pixels and
//! dimensions, and with less error than random points.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie_shaders::StorageImage;
use magpie_tests::bench::Bench;
use magpie_tests::chi_square::chi_square;
use magpie_tests::harness::gpu;

/// Points per pixel, and number of pixels, 16 to a row.
const POINTS: usize = 1024;
const PIXELS: usize = 256;

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/sequence.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint points; uvec2 dimensions; uint seed; };
void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 pixel = ivec2(at.y & 15, at.y >> 4);
    vec2 first = sequence2(pixel, uint(at.x), dimensions.x, seed);
    store(points, at, vec4(first, sequence2(pixel, uint(at.x), dimensions.y, seed)));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    points: StorageImage,
    dimensions: [u32; 2],
    seed: u32,
}

/// The points of each pixel for two dimensions, in xy and zw.
fn points(dimensions: [u32; 2], seed: u32) -> Result<Option<Vec<Vec<[f32; 4]>>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel("sequence.comp", GLSL)?;
    let extent = Extent::new(POINTS as u32, PIXELS as u32);
    let ran = bench.run(extent, &["test.points:points"], |g, _| {
        let made = g.pass("test.points", Queue::Graphics, |p| {
            let (points, target) = p.create("points", ImageDesc::full(Format::Rgba32Float));
            (points.read(), move |c: &mut Record<'_>| {
                c.dispatch(kernel, &Params { points: c.id(target), dimensions, seed }, extent);
            })
        });
        g.output(made);
        Ok(())
    })?;
    Ok(Some(ran.values("test.points:points")?.chunks(POINTS).map(<[_]>::to_vec).collect()))
}

/// Whether these 2^k points have one in each cell of every grid of 2^k cells.
fn is_stratified(points: &[[f32; 2]]) -> bool {
    let k = points.len().ilog2();
    (0..=k).all(|across| {
        let (columns, rows) = (1_u32 << across, 1_u32 << (k - across));
        let mut full = vec![false; points.len()];
        for [x, y] in points {
            let (column, row) = ((x * columns as f32) as u32, (y * rows as f32) as u32);
            full[(row * columns + column) as usize] = true;
        }
        full.into_iter().all(|cell| cell)
    })
}

#[test]
fn every_block_of_points_is_stratified_in_every_way() -> Result<()> {
    let Some(pixels) = points([0, 3], 0)? else { return Ok(()) };
    ensure!(!is_stratified(&[[0.1, 0.1], [0.2, 0.9]]) && is_stratified(&[[0.1, 0.9], [0.6, 0.2]]), "the check itself");
    for (at, points) in pixels.iter().enumerate() {
        ensure!(points.iter().flatten().all(|x| (0.0..1.0).contains(x)), "pixel {at}: a number is not in 0..1");
        for size in (0..=10).map(|k| 1 << k) {
            for (block, points) in points.chunks(size).enumerate() {
                for half in [0, 2] {
                    let pairs: Vec<[f32; 2]> = points.iter().map(|p| [p[half], p[half + 1]]).collect();
                    ensure!(is_stratified(&pairs), "pixel {at}, numbers {half}: {size} points from {}", block * size);
                }
            }
        }
    }
    Ok(())
}

/// Compares counts in a grid of 16 by 16 cells with a uniform distribution.
fn even(what: &str, points: impl Iterator<Item = [f32; 2]>) -> Result<()> {
    let mut counts = vec![0.0; 256];
    points.for_each(|[x, y]| counts[(y * 16.0) as usize * 16 + (x * 16.0) as usize] += 1.0);
    let expected = vec![counts.iter().sum::<f64>() / 256.0; 256];
    let result = chi_square(&counts, &expected);
    println!("{what}: chi square {:.1} of {} ({:+.2})", result.statistic, result.freedom, result.deviate);
    ensure!(result.deviate < 4.0, "{what}: {result:?}");
    Ok(())
}

#[test]
fn a_point_is_uniform_and_says_nothing_of_another() -> Result<()> {
    // One point per pixel; further seeds provide as many pixels as needed.
    let mut all = Vec::new();
    for seed in 0..32 {
        let Some(pixels) = points([0, 3], seed)? else { return Ok(()) };
        all.extend(pixels);
    }
    for index in [0, 1, 7, 1000] {
        even(&format!("point {index}"), all.iter().map(|p| [p[index][0], p[index][1]]))?;
        even(&format!("point {index}, two dimensions"), all.iter().map(|p| [p[index][0], p[index][2]]))?;
        even(&format!("point {index}, two dimensions, second number"), all.iter().map(|p| [p[index][1], p[index][3]]))?;
    }
    // Neighbouring pixels, and the same pixel with another seed.
    let next = |step: usize| (0..all.len() - step).map(move |at| (at, at + step));
    for (what, step) in [("neighbours in a row", 1), ("neighbours in a column", 16), ("two seeds", PIXELS)] {
        even(what, next(step).map(|(a, b)| [all[a][0][0], all[b][0][0]]))?;
        even(what, next(step).map(|(a, b)| [all[a][5][1], all[b][5][1]]))?;
    }
    Ok(())
}

/// Root mean square error over all pixels of the estimated area of a quarter disc.
fn error_of(pixels: &[Vec<[f32; 4]>], count: usize) -> (f64, f64) {
    let truth = std::f64::consts::FRAC_PI_4;
    let share = |points: &[[f32; 4]]| {
        points.iter().filter(|p| p[0] * p[0] + p[1] * p[1] < 1.0).count() as f64 / count as f64 - truth
    };
    let errors: Vec<f64> = pixels.iter().map(|points| share(&points[..count])).collect();
    let n = errors.len() as f64;
    (errors.iter().sum::<f64>() / n, (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt())
}

#[test]
fn means_converge_faster_than_those_of_random_points() -> Result<()> {
    let Some(pixels) = points([0, 3], 5)? else { return Ok(()) };
    let p = std::f64::consts::FRAC_PI_4;
    for (count, most) in [(1, 1.2), (4, 0.8), (16, 0.6), (64, 0.45), (256, 0.32), (1024, 0.23)] {
        let random = (p * (1.0 - p) / count as f64).sqrt();
        let (bias, error) = error_of(&pixels, count);
        println!(
            "{count:5} points: error {error:.5}, of random ones {random:.5}; mean of all pixels off by {bias:+.5}"
        );
        ensure!(error < most * random, "{count} points: {error} against {random}");
        ensure!(bias.abs() < 4.0 * random / (PIXELS as f64).sqrt(), "{count} points: biased by {bias}");
    }
    Ok(())
}
