//! An independent path tracer on the CPU, simple and in double precision, to test the reference with.
//!
//! It follows the same definitions as the reference on the device, and shares no code with it: the surface model is written from the
//! papers' formulas, and lights, emissive surfaces and sky are all sampled at every scattering.
pub mod bsdf;
pub mod geometry;
mod integrate;
pub mod lights;
pub mod random;
pub mod sky;
pub mod surface;

#[cfg(test)]
mod bsdf_tests;
#[cfg(test)]
mod closed_forms;
#[cfg(test)]
mod pictures;

use crate::oracle::gbuffer::Eye;
use geometry::Geometry;
use glam::DVec3;
use lights::Emitters;
use magpie::graph::Extent;
use magpie::scene::{Camera, Light, Scene};
use magpie_passes::reference::{Only, PixelSampling};
use random::Random;
use rayon::prelude::*;
use sky::Sky;
use surface::Materials;

/// Options of the path tracer.
#[derive(Clone, Copy, Debug)]
pub struct CpuPathTracerOptions {
    /// Samples per pixel, at least 2.
    pub samples: u32,
    /// Seed; results with different seeds are independent.
    pub seed: u64,
    /// Greatest number of scatterings, 1 for direct light only; 0 for no limit.
    pub depth: u32,
    /// Where samples lie in a pixel.
    pub pixel: PixelSampling,
    /// Which part of the lighting to compute.
    pub only: Only,
    /// Distance up to which geometry occludes for ambient occlusion, metres.
    pub ao_range: f64,
}

impl Default for CpuPathTracerOptions {
    fn default() -> Self {
        Self { samples: 64, seed: 1, depth: 0, pixel: PixelSampling::Area, only: Only::All, ao_range: 2.0 }
    }
}

/// A scene at one time, prepared for tracing.
pub struct CpuPathTracer {
    geometry: Geometry,
    materials: Materials,
    lights: Vec<Light>,
    emitters: Emitters,
    sky: Option<Sky>,
}

impl CpuPathTracer {
    /// Prepares a scene at a time in seconds.
    ///
    /// # Panics
    /// If a material is the boundary of a volume with an index of refraction of 1, for which no microfacet refracts.
    pub fn new(scene: &Scene, time: f64) -> Self {
        let (geometry, pose) = Geometry::new(scene, time);
        let materials = Materials::new(scene);
        let emitters = Emitters::new(&geometry, &materials);
        Self { geometry, materials, lights: pose.lights, emitters, sky: Sky::new(scene) }
    }

    /// Mean and standard error of every pixel, rows from the top. Deterministic for a seed, independently of the number of threads.
    pub fn radiance(
        &self,
        camera: &Camera,
        width: u32,
        height: u32,
        options: CpuPathTracerOptions,
    ) -> Vec<(DVec3, DVec3)> {
        let eye = Eye::new(camera, Extent::new(width, height));
        let pixel = |pixel: u32| {
            let mut random = Random::new(options.seed, pixel.into());
            let (mut mean, mut squares) = (DVec3::ZERO, DVec3::ZERO);
            for n in 1..=options.samples {
                let [x, y] = match options.pixel {
                    PixelSampling::Area => [random.unit(), random.unit()],
                    PixelSampling::Centre => [0.5; 2],
                };
                let ray = eye.ray(f64::from(pixel % width) + x, f64::from(pixel / width) + y);
                let sample = self.path(eye.position, ray, f64::from(camera.near), &options, &mut random);
                // Welford 1962.
                let apart = sample - mean;
                mean += apart / f64::from(n);
                squares += apart * (sample - mean);
            }
            let n = f64::from(options.samples);
            (mean, (squares / (n * (n - 1.0))).map(f64::sqrt))
        };
        (0..width * height).into_par_iter().map(pixel).collect()
    }
}
