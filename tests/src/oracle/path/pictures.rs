//! Whole pictures of the CPU path tracer, compared with another renderer and with each other.
use super::{CpuPathTracer, CpuPathTracerOptions};
use crate::oracle::scenes::{all, cornell_diffuse};
use glam::DVec3;
use std::env;

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// Mean and standard error of each quarter of a picture: upper left, upper right, lower left, lower right.
fn quarters(pixels: &[(DVec3, DVec3)], width: usize, height: usize) -> [(DVec3, DVec3); 4] {
    [0, 1, 2, 3].map(|quarter| {
        let inside =
            |i: usize| usize::from(i % width >= width / 2) + 2 * usize::from(i / width >= height / 2) == quarter;
        let own: Vec<_> = pixels.iter().enumerate().filter(|(i, _)| inside(*i)).map(|(_, p)| p).collect();
        let n = own.len() as f64;
        (own.iter().map(|p| p.0).sum::<DVec3>() / n, own.iter().map(|p| p.1 * p.1).sum::<DVec3>().map(f64::sqrt) / n)
    })
}

/// Output of `tests/mitsuba/cornell.py` with Mitsuba 3.9.1: 96 x 96 pixels, 8 runs of 1024 samples, 6 scatterings.
const MITSUBA: [[f64; 3]; 4] = [
    [0.67803, 0.39134, 0.12650],
    [0.58415, 0.45180, 0.13020],
    [0.18470, 0.07416, 0.02280],
    [0.11243, 0.11227, 0.02244],
];

#[test]
fn the_cornell_box_is_that_of_mitsuba() {
    let scene = cornell_diffuse();
    let samples = if is_full() { 4096 } else { 256 };
    let options = CpuPathTracerOptions { samples, depth: 6, ..CpuPathTracerOptions::default() };
    let pixels = CpuPathTracer::new(&scene, 0.0).radiance(&scene.cameras[0], 96, 96, options);
    for (got, want) in quarters(&pixels, 96, 96).iter().zip(MITSUBA.map(DVec3::from)) {
        println!("{:.5} ± {:.5}, want {want}", got.0, got.1);
        assert!((got.1 / want).max_element() < 0.003, "{} ± {}", got.0, got.1);
        assert!((got.0 / want - 1.0).abs().max_element() < 0.01, "{} ± {}, want {want}", got.0, got.1);
    }
}

/// The small scenes converge quickly: their means are soon known to 0.5 %, and no single pixel dominates.
#[test]
fn the_small_scenes_converge() {
    let samples = if is_full() { 2048 } else { 192 };
    for scene in all() {
        let cpu = CpuPathTracer::new(&scene, 0.0);
        let options = CpuPathTracerOptions { samples, ..CpuPathTracerOptions::default() };
        let pixels = cpu.radiance(&scene.cameras[0], 48, 32, options);
        let n = pixels.len() as f64;
        let mean = pixels.iter().map(|p| p.0).sum::<DVec3>() / n;
        let variance = pixels.iter().map(|p| p.1 * p.1).sum::<DVec3>();
        let error = variance.map(f64::sqrt) / n;
        let worst = pixels.iter().map(|p| (p.1 * p.1 / variance).max_element()).fold(0.0, f64::max);
        println!("{}: {mean:.4} ± {error:.5}, {worst:.3} of the variance in one pixel", scene.name);
        assert!(mean.min_element() > 0.05 && (error / mean).max_element() < 0.005, "{}: {mean} ± {error}", scene.name);
        assert!(worst < 0.25, "{}: {worst} of the variance lies in one pixel", scene.name);
    }
}
