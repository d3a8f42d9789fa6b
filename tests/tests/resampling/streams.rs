//! Reservoirs, and resampled importance sampling at one pixel.
use crate::{is_truth, row, runs};
use magpie_tests::chi_square::chi_square;
use magpie_tests::oracle::path::random::Random;
use magpie_tests::resampling::direct::{Scene, Source};
use magpie_tests::resampling::estimate::Estimate;
use magpie_tests::resampling::reservoir::Reservoir;
use magpie_tests::resampling::ris::{Candidate, by_distribution, mixed, pick, streaming};
use magpie_tests::resampling::scenes;
use std::f64::consts::TAU;

/// What one pixel of the floor sees of ten lights, some of them behind a wall.
fn floor() -> Scene {
    scenes::floor(scenes::floor_lights(), &scenes::floor_blocks())
}

/// The pixel.
const PIXEL: usize = 7;

/// Candidates and the uniform numbers to choose with.
fn drawn(pdfs: &[f64], count: usize, next: &mut dyn FnMut() -> f64) -> (Vec<Candidate<usize>>, Vec<f64>) {
    let draw = |_| {
        let sample = pick(pdfs.iter().copied(), next()).unwrap();
        Candidate { sample, pdf: pdfs[sample] }
    };
    let candidates = (0..count).map(draw).collect();
    (candidates, (0..count).map(|_| next()).collect())
}

/// F01: a stream's item `i` is chosen with frequency `w_i / Σ w`, whatever its place in the stream.
#[test]
fn items_are_chosen_in_proportion_to_their_weights() {
    let weights = [0.02, 5.0, 0.7, 0.0, 1.3, 11.0, 0.4, 2.58];
    let streams = 1_200_000;
    let mut random = Random::new(1, 0);
    let (mut streamed, mut by_sum) = ([0.0; 8], [0.0; 8]);
    for _ in 0..streams {
        let mut reservoir = Reservoir::empty();
        for (i, &weight) in weights.iter().enumerate() {
            reservoir.update(i, weight, random.unit());
        }
        streamed[reservoir.sample.unwrap()] += 1.0;
        by_sum[pick(weights.into_iter(), random.unit()).unwrap()] += 1.0;
    }
    let sum: f64 = weights.iter().sum();
    let expected = weights.map(|weight| f64::from(streams) * weight / sum);
    for counts in [streamed, by_sum] {
        let result = chi_square(&counts, &expected);
        println!("{result:?}");
        assert!(result.deviate < 3.7, "{result:?}");
    }
    // A weight that is 2 % off is found.
    let mut off = expected;
    off[1] *= 1.02;
    off[5] -= 0.02 * expected[1];
    assert!(chi_square(&streamed, &off).deviate > 5.0);
}

/// F02, H4: items of weight 0 are never chosen, even by a uniform number of 0; a stream of zeros leaves `W = 0`.
#[test]
fn weight_0_is_never_chosen() {
    let lowest = |weights: &[f64], u: f64| {
        let mut reservoir = Reservoir::empty();
        for (i, &weight) in weights.iter().enumerate() {
            reservoir.update(i, weight, u);
        }
        reservoir
    };
    let highest = 1.0 - f64::EPSILON;
    for u in [0.0, 0.3, highest] {
        assert_eq!(lowest(&[0.0, 0.0, 2.0, 0.0], u).sample, Some(2));
        assert_eq!(pick([0.0, 0.0, 2.0, 0.0].into_iter(), u), Some(2));
        assert_eq!(pick([0.0, 0.0].into_iter(), u), None);
    }
    assert_eq!(lowest(&[1.0, 0.0, 3.0, 0.0], 0.0).sample, Some(2));
    assert_eq!(lowest(&[1.0, 0.0, 3.0, 0.0], highest).sample, Some(0));
    let candidates = [Candidate { sample: 0, pdf: 0.5 }; 4];
    for dark in [streaming(&candidates, |_| 0.0, &[0.0; 4]), by_distribution(&candidates, |_| 0.0, 0.0)] {
        assert_eq!(dark, Reservoir { sample: None, weight_sum: 0.0, confidence: 4.0, weight: 0.0 });
        assert_eq!(dark.shade(|_| f64::NAN), 0.0);
    }
}

/// F03: as a stream and by the cumulative distribution, the same candidates give the same mean.
#[test]
fn a_stream_agrees_with_the_cumulative_distribution() {
    let scene = floor();
    let pdfs = scene.source(PIXEL, Source::Intensity);
    let target = |&light: &usize| scene.unshadowed(PIXEL, light);
    let difference = runs(200_000, 2, |next| {
        let (candidates, uniforms) = drawn(&pdfs, 6, next);
        let shade = |r: Reservoir<usize>| r.shade(|&light| scene.reflected(PIXEL, light));
        let streamed = streaming(&candidates, target, &uniforms);
        let by_sum = by_distribution(&candidates, target, next());
        assert!((streamed.weight_sum / by_sum.weight_sum - 1.0).abs() < 1e-12);
        shade(streamed) - shade(by_sum)
    });
    println!("difference {:.5}, standard error {:.5}", difference.mean(), difference.error());
    assert!(difference.error() < 0.005 * scene.truth(PIXEL));
    assert!(difference.deviate(0.0).abs() < 3.0);
}

/// F04, F05, F07: for each number of candidates and each way to draw them the mean is the sum over all lights, and more
/// candidates vary less.
#[test]
fn the_mean_is_the_sum_over_lights_for_any_number_of_candidates() {
    let scene = floor();
    let truth = scene.truth(PIXEL);
    for (seed, source) in [(10, Source::Uniform), (20, Source::Intensity), (30, Source::Distance)] {
        let pdfs = scene.source(PIXEL, source);
        let mut least = f64::INFINITY;
        for count in [1, 2, 4, 8, 32] {
            let found = runs(100_000, seed + count, |next| {
                let (candidates, uniforms) = drawn(&pdfs, count as usize, next);
                let chosen = streaming(&candidates, |&light| scene.unshadowed(PIXEL, light), &uniforms);
                chosen.shade(|&light| scene.reflected(PIXEL, light))
            });
            is_truth(&format!("RIS, {source:?}, M = {count}"), &found, truth);
            println!("variance {:.5}", found.variance());
            assert!(found.variance() < 0.97 * least, "{source:?}, {count}: {} and {least}", found.variance());
            least = found.variance();
        }
    }
}

/// F06, H3: `W = w_sum / (M p̂)`, the shade is `f W`, and where the target is 0 so is `W`, while the confidence stays.
#[test]
fn the_contribution_weight_is_the_sum_over_the_target() {
    let candidates = [(0, 0.5), (1, 0.25), (2, 0.25)].map(|(sample, pdf)| Candidate { sample, pdf });
    let target = |&i: &usize| [1.0, 3.0, 0.0][i];
    let chosen = streaming(&candidates, target, &[0.5, 0.9, 0.0]);
    // Weights 2, 12 and 0: the second is kept because 0.9 · 14 is not below 12.
    assert_eq!((chosen.sample, chosen.weight_sum, chosen.confidence), (Some(0), 14.0, 3.0));
    assert_eq!(chosen.weight, 14.0 / (3.0 * 1.0));
    assert_eq!(chosen.shade(|_| 7.0), 7.0 * (14.0 / 3.0));
    let mut moved = chosen;
    moved.finish(0.0, 3.0);
    assert_eq!((moved.weight, moved.confidence, moved.shade(|_| 7.0)), (0.0, 3.0, 0.0));
}

/// F08: candidates of a light and of a lobe, combined by the balance heuristic, for a small, a middle and a large
/// light: a cap of the sphere around the axis of a lobe `cosᵉ`, with a closed form. Either strategy alone varies more
/// for one of them.
#[test]
fn candidates_of_light_and_lobe_combine_for_any_size_of_light() {
    const EXPONENT: f64 = 20.0;
    let lobe = |cosine: f64| (EXPONENT + 1.0) / TAU * cosine.powf(EXPONENT);
    for (seed, name, angle) in [(40, "small", 0.05_f64), (50, "middle", 0.4), (60, "large", 1.5)] {
        let edge = angle.cos();
        let truth = 1.0 - edge.powf(EXPONENT + 1.0);
        let pdf = |strategy: usize, &cosine: &f64| match strategy {
            0 if cosine >= edge => 1.0 / (TAU * (1.0 - edge)),
            0 => 0.0,
            _ => lobe(cosine),
        };
        let draw = |strategy: usize, u: f64| match strategy {
            0 => 1.0 - u * (1.0 - edge),
            _ => (1.0 - u).powf(1.0 / (EXPONENT + 1.0)),
        };
        let reflected = |&cosine: &f64| if cosine >= edge { lobe(cosine) } else { 0.0 };
        let sampled = |counts: [f64; 2], at| {
            runs(60_000, at, |next| {
                let strategies = (0..2).flat_map(|s| (0..counts[s] as usize).map(move |_| s));
                let candidates: Vec<_> = strategies.map(|s| (s, draw(s, next()))).collect();
                let uniforms: Vec<f64> = candidates.iter().map(|_| next()).collect();
                mixed(&candidates, &counts, pdf, reflected, &uniforms).shade(reflected)
            })
        };
        let [light, both, lobe_only] = [([4.0, 0.0], seed), ([2.0, 2.0], seed + 1), ([0.0, 4.0], seed + 2)]
            .map(|(counts, at)| sampled(counts, at));
        is_truth(&format!("balance heuristic, {name} light"), &both, truth);
        row(&format!("candidates of the {name} light alone"), &light, truth);
        row(&format!("of the lobe alone, {name} light"), &lobe_only, truth);
        let worse = light.variance().max(lobe_only.variance());
        assert!(both.variance() < 0.8 * worse, "{name}: {} and {worse}", both.variance());
    }
}

/// The standard error that all of these tests rely on is what it says: deviates of uniform numbers have variance 1.
#[test]
fn three_standard_errors_hold_in_nearly_all_repetitions() {
    let one = |seed| runs(400, seed, |next| next()).deviate(0.5);
    let deviates = Estimate::of((0..2000).map(|seed| one(1000 + seed)));
    println!("deviates: mean {:.3}, variance {:.3}", deviates.mean(), deviates.variance());
    assert!(deviates.mean().abs() < 0.1 && (deviates.variance() - 1.0).abs() < 0.15);
}
