//! The reference on the device against the CPU path tracer: another language and precision, independent formulas for the same model, and
//! other sampling strategies.
use anyhow::{Result, ensure};
use glam::DVec3;
use magpie::scene::Scene;
use magpie_passes::reference::{Only, PixelSampling, Reference, ReferenceOptions};
use magpie_tests::harness::gpu;
use magpie_tests::oracle::path::{CpuPathTracer, CpuPathTracerOptions};
use magpie_tests::oracle::scenes;
use std::env;
use std::fs;
use std::path::Path;

const SIZE: [u32; 2] = [48, 32];
/// Greatest relative difference of the means of two pictures.
const LIMIT: f64 = 0.005;
/// Side of the blocks, pixels, in which systematic differences are looked for.
const BLOCK: usize = 8;

fn samples() -> u32 {
    if env::var_os("MAGPIE_FULL").is_some() { 4096 } else { 512 }
}

/// Factor of the samples for device and CPU: small lights and paths through rough glass converge slowly.
fn patience(scene: &Scene, only: Only) -> [u32; 2] {
    match (scene.name.as_str(), only) {
        ("many lights", _) => [8, 4],
        ("glossy metal", Only::Reflections) => [16, 16],
        ("rough dielectric", _) => [3, 3],
        ("glossy metal", _) => [2, 2],
        _ => [1, 1],
    }
}

/// Both pictures: means of each pixel, and the variance of their difference.
struct Both {
    device: Vec<DVec3>,
    cpu: Vec<DVec3>,
    variance: Vec<DVec3>,
}

fn both(gpu: &magpie::gpu::Gpu, scene: &Scene, options: ReferenceOptions, samples: [u32; 2]) -> Result<Both> {
    let camera = &scene.cameras[0];
    let mut reference = Reference::new(gpu, scene, camera, options)?;
    reference.add(samples[0])?;
    let ReferenceOptions { width, height, depth, only, pixel, ao_range, .. } = options;
    let wanted =
        CpuPathTracerOptions { samples: samples[1], seed: 77, depth, pixel, only, ao_range: f64::from(ao_range) };
    let cpu = CpuPathTracer::new(scene, options.time).radiance(camera, width, height, wanted);
    let errors = reference.estimate().standard_error();
    Ok(Both {
        device: reference.estimate().mean.clone(),
        variance: errors.iter().zip(&cpu).map(|(e, (_, w))| *e * *e + *w * *w).collect(),
        cpu: cpu.into_iter().map(|(mean, _)| mean).collect(),
    })
}

impl Both {
    /// Relative difference of the pictures' means, and its standard error.
    fn difference(&self) -> (f64, f64) {
        let sum = |values: &[DVec3]| values.iter().map(|v| v.element_sum()).sum::<f64>();
        // Channels of a pixel are correlated: their standard errors add, not their variances.
        let error = self.variance.iter().map(|v| v.map(f64::sqrt).element_sum().powi(2)).sum::<f64>().sqrt();
        let scale = sum(&self.cpu).max(f64::MIN_POSITIVE);
        ((sum(&self.device) - scale) / scale, error / scale)
    }

    /// Root mean square of the blocks' deviations in standard errors, 1 without systematic differences, and the greatest deviation.
    fn blocks(&self) -> (f64, f64) {
        let [width, height] = SIZE.map(|n| n as usize);
        let (mut squares, mut count, mut greatest) = (0.0, 0.0, 0.0_f64);
        for top in (0..height).step_by(BLOCK) {
            for left in (0..width).step_by(BLOCK) {
                let (mut difference, mut variance) = (0.0, 0.0);
                for at in (0..BLOCK * BLOCK).map(|i| (top + i / BLOCK) * width + left + i % BLOCK) {
                    difference += (self.device[at] - self.cpu[at]).element_sum();
                    variance += self.variance[at].map(f64::sqrt).element_sum().powi(2);
                }
                if variance > 0.0 {
                    let deviation = difference / variance.sqrt();
                    squares += deviation * deviation;
                    count += 1.0;
                    greatest = greatest.max(deviation.abs());
                }
            }
        }
        ((squares / f64::max(count, 1.0)).sqrt(), greatest)
    }

    /// Writes device, CPU and difference (dark grey for none) side by side, for inspection.
    fn show(&self, name: &str) -> Result<()> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/images");
        fs::create_dir_all(&folder)?;
        let picture = image::RgbImage::from_fn(3 * SIZE[0], SIZE[1], |x, y| {
            let at = (y * SIZE[0] + x % SIZE[0]) as usize;
            let (device, cpu) = (self.device[at], self.cpu[at]);
            let shown = [device, cpu, DVec3::splat(0.2) + device - cpu][(x / SIZE[0]) as usize];
            image::Rgb(shown.to_array().map(|v| (255.0 * v.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8))
        });
        Ok(picture.save(folder.join(format!("cpu.{name}.png")))?)
    }
}

fn agree(name: &str, both: &Both, limit: f64) -> Result<()> {
    let (difference, error) = both.difference();
    let (spread, greatest) = both.blocks();
    println!(
        "{name:<32} {:+.3} % +- {:.3} %, blocks: root mean square deviation {spread:.2}, greatest {greatest:.2}",
        100.0 * difference,
        100.0 * error
    );
    both.show(&name.replace([' ', ','], "_"))?;
    ensure!(error < limit / 2.0, "{name}: too noisy to tell: {error}");
    ensure!(difference.abs() <= limit, "{name}: the means are {difference} apart");
    ensure!(spread < 1.5 && greatest < 5.0, "{name}: the residual has structure: {spread}, {greatest}");
    Ok(())
}

#[test]
fn six_scenes() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in scenes::all() {
        let options = ReferenceOptions { width: SIZE[0], height: SIZE[1], check: true, ..ReferenceOptions::default() };
        let [device, cpu] = patience(&scene, Only::All).map(|n| n * samples());
        agree(&scene.name, &both(&gpu, &scene, options, [2 * device, cpu])?, LIMIT)?;
    }
    Ok(())
}

/// KHR_materials_specular, in full and by parts.
#[test]
fn reflections_of_their_own() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = scenes::own_reflections();
    for (only, [device, cpu]) in [(Only::All, [2, 1]), (Only::Reflections, [4, 4])] {
        let pixel = if only == Only::All { PixelSampling::Area } else { PixelSampling::Centre };
        let options =
            ReferenceOptions { width: SIZE[0], height: SIZE[1], only, pixel, check: true, ..Default::default() };
        let samples = [device, cpu].map(|n| n * samples());
        agree(&format!("{}, {}", scene.name, only.name()), &both(&gpu, &scene, options, samples)?, LIMIT)?;
    }
    Ok(())
}

#[test]
fn every_part() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let parts = [
        (scenes::area_light(), Only::Direct),
        (scenes::area_light(), Only::Shadows),
        (scenes::area_light(), Only::AmbientOcclusion),
        (scenes::area_light(), Only::Gi),
        (scenes::environment_map(), Only::Gi),
        (scenes::glossy_metal(), Only::Reflections),
        (scenes::environment_map(), Only::Reflections),
        (scenes::glass_ball(), Only::Transparency),
    ];
    for (mut scene, only) in parts {
        // Parts filter textures of the first surface as the raster does; the CPU path tracer does not.
        scene.materials.iter_mut().for_each(|m| m.base_colour_texture = None);
        let [device, cpu] = patience(&scene, only).map(|n| n * samples());
        let options = ReferenceOptions {
            width: SIZE[0],
            height: SIZE[1],
            only,
            pixel: PixelSampling::Centre,
            ao_range: 0.5,
            check: true,
            ..ReferenceOptions::default()
        };
        // Half as many samples: twice the limit.
        agree(
            &format!("{}, {}", scene.name, only.name()),
            &both(&gpu, &scene, options, [device, cpu / 2])?,
            2.0 * LIMIT,
        )?;
    }
    Ok(())
}
