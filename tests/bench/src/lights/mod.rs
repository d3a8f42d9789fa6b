//! Direct light of many lamps, `magpie bench lights`: time and error of each implementation of the slot `direct` over the number of lamps.
mod report;
mod square;

pub use report::LightsReport;

use crate::FrameBenchError;
use magpie::config::Config;
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::reference::{Only, PixelSampling, Reference, ReferenceError, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use serde::Serialize;
use square::square;
use std::time::{Duration, Instant};

/// Frames of a contestant: more than the histories that reservoirs and denoisers count.
pub const FRAMES: u32 = 24;
/// The last of them, over which errors are averaged.
const COMPARED: u32 = 8;
/// Greatest number of lamps.
pub const MAX_LAMPS: u32 = 100_000;
/// What is added to the squared truth in relMSE.
const EPSILON: f64 = 1e-4;
/// What is added to the truth in the relative error.
const LEAST: f64 = 1e-2;

/// Options of `magpie bench lights`.
#[derive(Clone, Debug)]
pub struct LightsOptions {
    /// Numbers of lamps.
    pub lamps: Vec<u32>,
    /// Labels of the contestants that take part; empty for all.
    pub only: Vec<String>,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Samples per pixel of the ground truth.
    pub truth_samples: u32,
    /// A contestant that takes longer is measured over fewer frames, at least two.
    pub patience: Duration,
    /// Backend for rays.
    pub rays: Rays,
    /// Seed of everything random.
    pub seed: u32,
    /// Configuration of everything else.
    pub config: Config,
    /// Commit of the build, for the report.
    pub commit: String,
}

/// A way to compute direct light.
#[derive(Clone, Copy, Debug)]
pub struct Contestant {
    /// Its label.
    pub label: &'static str,
    /// What is set for it.
    settings: &'static [&'static str],
}

/// The contestants.
pub const CONTESTANTS: [Contestant; 8] = [
    Contestant { label: "all-lights", settings: &["stages.direct=all-lights"] },
    Contestant { label: "clustered", settings: &["stages.direct=clustered"] },
    Contestant {
        label: "power",
        settings: &["stages.direct=ris", "direct.source=power", "direct.candidates=1", "direct.lobe=0"],
    },
    Contestant {
        label: "light-tree 1",
        settings: &["stages.direct=light-tree", "direct.split_lights=1", "direct.lobe=0"],
    },
    Contestant { label: "light-tree", settings: &["stages.direct=light-tree"] },
    Contestant { label: "ris by power", settings: &["stages.direct=ris", "direct.source=power"] },
    Contestant { label: "ris", settings: &["stages.direct=ris"] },
    Contestant { label: "restir", settings: &["stages.direct=restir"] },
];

/// Time and error of a contestant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Least GPU time of a frame, milliseconds: of the passes of direct light, shadows and the light tree. `None` where the device has no clock.
    pub ms: Option<f64>,
    /// Mean of the relative error of the slot `direct` in the last frames, against the reference.
    pub error: f64,
    /// Root of the relMSE, on which single bright pixels weigh more.
    pub relmse: f64,
    /// Mean light over that of the reference.
    pub light: f64,
    /// Frames that were rendered.
    pub frames: u32,
}

/// What was measured of a contestant with a number of lamps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Number of lamps.
    pub lamps: u32,
    /// Label of the contestant.
    pub contestant: &'static str,
    /// Without a denoiser.
    pub raw: Measured,
    /// With the one that the configuration names.
    pub denoised: Measured,
}

/// The ground truth of direct light, three values for each pixel.
fn truth(gpu: &Gpu, scene: &Scene, options: &LightsOptions) -> Result<Vec<[f64; 3]>, ReferenceError> {
    let reference = ReferenceOptions {
        width: options.size[0],
        height: options.size[1],
        only: Only::Direct,
        pixel: PixelSampling::Centre,
        rays: options.rays,
        seed: options.seed ^ 77,
        ..ReferenceOptions::default()
    };
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], reference)?;
    reference.add(options.truth_samples)?;
    Ok(reference.estimate().mean.iter().map(|v| v.to_array()).collect())
}

/// Mean relative error, root of the relMSE, and the share of the truth's light.
fn compare(found: &[[f64; 3]], truth: &[[f64; 3]]) -> [f64; 3] {
    let (mut error, mut square, mut light, mut wanted) = (0.0, 0.0, 0.0, 0.0);
    for (found, truth) in found.iter().flatten().zip(truth.iter().flatten()) {
        error += (found - truth).abs() / (truth + LEAST);
        square += (found - truth).powi(2) / (truth * truth + EPSILON);
        light += found;
        wanted += truth;
    }
    let count = (3 * truth.len()) as f64;
    [error / count, (square / count).sqrt(), light / wanted]
}

/// Whether a pass belongs to direct light.
fn counts(pass: &str) -> bool {
    ["direct.", "shadows.", "light_tree."].iter().any(|slot| pass.starts_with(slot))
}

fn measure(
    gpu: &Gpu,
    scene: &Scene,
    label: &str,
    config: &Config,
    truth: &[[f64; 3]],
    options: &LightsOptions,
) -> Result<Measured, FrameBenchError> {
    let failed = FrameBenchError::render(label);
    let [width, height] = options.size;
    let render = RenderOptions { width, height, seed: options.seed, rays: options.rays, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), config, render).map_err(failed)?;
    renderer.read_slots(&["direct"]).map_err(failed)?;
    let begin = Instant::now();
    let (mut times, mut compared) = (Vec::new(), Vec::new());
    for frame in 1..=FRAMES {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let Some(result) = renderer.frame(request).map_err(failed)? else { break };
        let passes = result.sample.passes.iter().filter(|p| counts(&p.name));
        // The first frame compiles pipelines, and fits the tree.
        if frame > 1 {
            times.extend(passes.map(|p| p.gpu_ns).sum::<Option<u64>>());
        }
        let is_late = frame > 1 && begin.elapsed() > options.patience;
        if is_late || frame > FRAMES - COMPARED {
            let image = result.slots.first().and_then(|(_, image)| image.as_ref());
            let found: Vec<[f64; 3]> = image
                .map(|image| image.values().iter().map(|v| [v[0], v[1], v[2]].map(f64::from)).collect())
                .unwrap_or_default();
            compared.push((frame, compare(&found, truth)));
        }
        if is_late {
            break;
        }
    }
    let mean = |which: usize| compared.iter().map(|(_, values)| values[which]).sum::<f64>() / compared.len() as f64;
    Ok(Measured {
        ms: times.iter().min().map(|ns| *ns as f64 * 1e-6),
        error: mean(0),
        relmse: mean(1),
        light: mean(2),
        frames: compared.last().map_or(0, |(frame, _)| *frame),
    })
}

/// Measures every contestant with every number of lamps.
///
/// # Errors
/// [`FrameBenchError`].
pub fn run(
    gpu: &Gpu,
    options: &LightsOptions,
    mut progress: impl FnMut(&str),
) -> Result<LightsReport, FrameBenchError> {
    for name in &options.only {
        if !CONTESTANTS.iter().any(|c| c.label == name) {
            let known = CONTESTANTS.map(|c| c.label).join(", ");
            return Err(FrameBenchError::UnknownContestant { name: name.clone(), known });
        }
    }
    let takes_part = |c: &&Contestant| options.only.is_empty() || options.only.iter().any(|name| name == c.label);
    let mut rows = Vec::new();
    for &lamps in &options.lamps {
        progress(&format!("truth of {lamps} lamps"));
        let Some(scene) = square(lamps) else { return Err(FrameBenchError::NoCamera) };
        let truth = truth(gpu, &scene, options).map_err(|error| FrameBenchError::Truth(Box::new(error)))?;
        for contestant in CONTESTANTS.iter().filter(takes_part) {
            progress(&format!("{lamps} lamps, {}", contestant.label));
            let mut config = options.config.clone();
            for setting in contestant.settings {
                config.set(setting)?;
            }
            let denoised = measure(gpu, &scene, contestant.label, &config, &truth, options)?;
            config.set("direct.denoiser=none")?;
            let raw = measure(gpu, &scene, contestant.label, &config, &truth, options)?;
            rows.push(Row { lamps, contestant: contestant.label, raw, denoised });
        }
    }
    Ok(LightsReport::new(gpu, options, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_to_the_truth() {
        let truth = [[1.0, 2.0, 4.0]];
        assert_eq!(compare(&truth, &truth), [0.0, 0.0, 1.0]);
        let [error, relmse, light] = compare(&[[1.1, 2.2, 4.4]], &truth);
        assert!((error - 0.1).abs() < 1e-3 && (relmse - 0.1).abs() < 1e-5, "{error} {relmse}");
        assert!((light - 1.1).abs() < 1e-12, "{light}");
        // Black is no good picture of anything.
        assert!(compare(&[[0.0; 3]], &truth)[..2].iter().all(|error| (error - 1.0).abs() < 0.01));
    }

    #[test]
    fn lamps_have_the_same_power_whatever_their_number() {
        let power = |lamps| {
            let scene = square(lamps).unwrap();
            assert_eq!(scene.lights.len(), lamps as usize);
            let of = |light: &magpie::scene::Light| match light {
                magpie::scene::Light::Sphere { radius, radiance, .. } => radius * radius * radiance.element_sum(),
                _ => 0.0,
            };
            scene.lights.iter().map(of).sum::<f32>()
        };
        assert!((power(10_000) / power(100) - 1.0).abs() < 0.02);
    }
}
