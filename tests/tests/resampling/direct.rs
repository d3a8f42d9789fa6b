//! ReSTIR DI on a floor with ten lights and boxes that cast shadows.
use crate::{is_darker, is_truth};
use magpie_tests::oracle::path::random::Random;
use magpie_tests::resampling::direct::{Remap, Scene, Settings, Source, Visibility, frame};
use magpie_tests::resampling::estimate::Estimate;
use magpie_tests::resampling::mis::Weights;
use magpie_tests::resampling::scenes::{floor, floor_blocks, floor_lights};

/// Four candidates by intensity over squared distance, three neighbours twice, and the frame before with up to 20 times
/// the confidence.
pub const SETTINGS: Settings = Settings {
    candidates: 4,
    source: Source::Distance,
    weights: Weights::Support,
    visibility: Visibility::Retraced,
    temporal: true,
    cap: 20.0,
    iterations: 2,
    neighbours: 3,
    radius: 2,
};

/// The scene of most tests.
pub fn scene() -> Scene {
    floor(floor_lights(), &floor_blocks())
}

/// Mean of the truths of all pixels.
pub fn truth(scene: &Scene) -> f64 {
    (0..scene.pixels.len()).map(|pixel| scene.truth(pixel)).sum::<f64>() / scene.pixels.len() as f64
}

/// The last of some frames of the same scene, over independent runs: of the picture's mean, and of each pixel.
pub struct Found {
    /// The mean of the picture.
    pub mean: Estimate,
    /// Each pixel.
    pub pixels: Vec<Estimate>,
    /// Mean squared error of the pixels, in units of the mean squared truth.
    pub squared_error: f64,
}

/// Runs a sequence of scenes from nothing, many times, and looks at its last frame.
pub fn last_of(scenes: &[(&Scene, Remap)], settings: &Settings, runs: u64, seed: u64) -> Found {
    let last = scenes[scenes.len() - 1].0;
    let mut found =
        Found { mean: Estimate::default(), pixels: vec![Estimate::default(); last.pixels.len()], squared_error: 0.0 };
    for run in 0..runs {
        let mut random = Random::new(seed, run);
        let mut before = None;
        for (scene, remap) in scenes {
            let history = before.as_ref().map(|frame| (frame, remap));
            before = Some(frame(scene, history, settings, &mut || random.unit()));
        }
        let end = before.unwrap();
        found.mean.add(end.mean());
        found.pixels.iter_mut().enumerate().for_each(|(pixel, e)| e.add(end.shade(pixel)));
    }
    let truths = (0..last.pixels.len()).map(|pixel| last.truth(pixel));
    let squares: f64 = truths.clone().map(|t| t * t).sum();
    let errors = found.pixels.iter().zip(truths).map(|(e, t)| e.variance() + (e.mean() - t).powi(2));
    found.squared_error = errors.sum::<f64>() / squares;
    found
}

/// The same scene for some frames.
pub fn still(scene: &Scene, frames: usize) -> Vec<(&Scene, Remap)> {
    vec![(scene, Remap::same(scene.lights.len())); frames]
}

/// Each pixel's mean is the truth, within four standard errors.
#[track_caller]
pub fn pixels_are_true(scene: &Scene, found: &Found) {
    for (pixel, estimate) in found.pixels.iter().enumerate() {
        let truth = scene.truth(pixel);
        if scene.pixels[pixel].is_none() {
            assert_eq!((estimate.mean(), estimate.variance()), (0.0, 0.0), "sky");
        } else {
            assert!(estimate.deviate(truth).abs() < 4.0, "pixel {pixel}: {estimate:?} for {truth}");
        }
    }
}

/// F42, F12: four frames with temporal and spatial reuse, against the sum over all lights with shadows. With 1/Z,
/// pairwise and balanced weights the mean is the truth, with shadow rays in the target or traced again.
#[test]
fn direct_light_is_the_sum_over_lights() {
    let scene = scene();
    for visibility in [Visibility::InTarget, Visibility::Retraced] {
        for (i, weights) in Weights::UNBIASED.into_iter().enumerate() {
            let settings = Settings { weights, visibility, ..SETTINGS };
            let runs = if weights == Weights::Support { 5000 } else { 2500 };
            let found = last_of(&still(&scene, 4), &settings, runs, 600 + i as u64);
            is_truth(&format!("DI, {weights:?}, {visibility:?}"), &found.mean, truth(&scene));
            pixels_are_true(&scene, &found);
        }
    }
}

/// F42: 1/M is too dark in all forms; so is every weight that takes neighbours for able to make what they do not see.
#[test]
fn biased_direct_light_is_measurably_darker() {
    let scene = scene();
    let biased = [
        (Weights::Total, Visibility::InTarget),
        (Weights::Total, Visibility::Retraced),
        (Weights::Total, Visibility::Reused),
        (Weights::Support, Visibility::Reused),
        (Weights::Pairwise, Visibility::Reused),
    ];
    for (i, (weights, visibility)) in biased.into_iter().enumerate() {
        let settings = Settings { weights, visibility, ..SETTINGS };
        let found = last_of(&still(&scene, 4), &settings, 1500, 620 + i as u64);
        is_darker(&format!("DI, {weights:?}, {visibility:?}"), &found.mean, truth(&scene), 0.03);
    }
}
