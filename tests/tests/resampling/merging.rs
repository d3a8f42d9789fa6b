//! Merging, by enumeration of everything that can happen and by random numbers.
use crate::{is_darker, is_truth, row, runs};
use magpie_tests::oracle::path::random::Random;
use magpie_tests::resampling::estimate::Estimate;
use magpie_tests::resampling::mis::{Input, Weights, merge, resampling_weights, support_confidence, total_confidence};
use magpie_tests::resampling::reservoir::Reservoir;
use magpie_tests::resampling::ris::{Candidate, streaming};

/// Four lights as a pixel sees them: 5.2 in all.
const SEEN: [f64; 4] = [3.0, 1.2, 0.6, 0.4];
/// As a neighbour sees them that is blind to the first: 1.5 of it is lost where the two are merged half and half.
const BLIND: [f64; 4] = [0.0, 0.9, 1.1, 0.2];
/// As a neighbour sees them that has the same support.
const SIMILAR: [f64; 4] = [1.0, 0.3, 2.0, 0.7];
const TRUTH: f64 = 5.2;

/// Reservoirs with their probabilities.
type Outcomes = Vec<(f64, Reservoir<usize>)>;

/// A uniform number that replaces whatever is there, and one that never does.
const REPLACE: f64 = 0.0;
const KEEP: f64 = 1.0 - f64::EPSILON;

/// Uniform numbers with which the `winner`th of `count` is chosen.
fn choosing(winner: usize, count: usize) -> Vec<f64> {
    (0..count).map(|i| if i == winner { REPLACE } else { KEEP }).collect()
}

/// All that resampling with these weights can give, `make` being the resampling itself.
fn each_choice(weights: &[f64], make: impl Fn(&[f64]) -> Reservoir<usize>) -> Outcomes {
    let sum: f64 = weights.iter().sum();
    if sum == 0.0 {
        return vec![(1.0, make(&vec![KEEP; weights.len()]))];
    }
    let possible = (0..weights.len()).filter(|&i| weights[i] > 0.0);
    possible.map(|i| (weights[i] / sum, make(&choosing(i, weights.len())))).collect()
}

/// All that a pixel can have after `count` candidates, drawn uniformly.
fn initial(seen: &[f64], count: u32) -> Outcomes {
    let lights = seen.len();
    let mut all = Vec::new();
    for number in 0..lights.pow(count) {
        let digit = |i| number / lights.pow(i) % lights;
        let candidate = |i| Candidate { sample: digit(i), pdf: 1.0 / lights as f64 };
        let candidates: Vec<_> = (0..count).map(candidate).collect();
        let weights: Vec<f64> = candidates.iter().map(|c| seen[c.sample] / c.pdf).collect();
        let choices = each_choice(&weights, |u| streaming(&candidates, |&i| seen[i], u));
        let probability = (lights as f64).powi(-(count as i32));
        all.extend(choices.into_iter().map(|(p, r)| (p * probability, r)));
    }
    all
}

/// All that merging can give; the first pixel is canonical. `pixels` are the targets and what their reservoirs can be.
fn merged(pixels: &[(&[f64], Outcomes)], weights: Weights) -> Outcomes {
    let mut tuples: Vec<(f64, Vec<Input<usize>>)> = vec![(1.0, Vec::new())];
    for (_, outcomes) in pixels {
        let longer = |(p, inputs): &(f64, Vec<Input<usize>>)| {
            let inputs = inputs.clone();
            let p = *p;
            outcomes.iter().map(move |(q, r)| (p * q, inputs.iter().copied().chain([(*r).into()]).collect()))
        };
        tuples = tuples.iter().flat_map(longer).collect();
    }
    let target = |i: usize, &light: &usize| pixels[i].0[light];
    let choices = |(p, inputs): (f64, Vec<Input<usize>>)| {
        let each = resampling_weights(&inputs, 0, weights, &target);
        let choices = each_choice(&each, |u| merge(&inputs, 0, weights, target, u));
        choices.into_iter().map(move |(q, r)| (p * q, r))
    };
    tuples.into_iter().flat_map(choices).collect()
}

/// What a pixel with these outcomes expects to show.
fn expected(outcomes: &Outcomes, seen: &[f64]) -> f64 {
    let sum: f64 = outcomes.iter().map(|(p, _)| p).sum();
    assert!((sum - 1.0).abs() < 1e-9, "probabilities add up to {sum}");
    outcomes.iter().map(|(p, r)| p * r.shade(|&light| seen[light])).sum()
}

fn is_near(found: f64, truth: f64) {
    assert!((found - truth).abs() < 1e-9, "{found}, not {truth}");
}

/// One run: each pixel draws candidates uniformly, then all are merged for the first.
fn one_run(pixels: &[&[f64]], counts: &[usize], weights: Weights, next: &mut dyn FnMut() -> f64) -> Reservoir<usize> {
    let mut fill = |seen: &[f64], count: usize| {
        let lights = seen.len() as f64;
        let draw = |_| Candidate { sample: (next() * lights) as usize, pdf: 1.0 / lights };
        let candidates: Vec<_> = (0..count).map(draw).collect();
        let uniforms: Vec<f64> = (0..count).map(|_| next()).collect();
        streaming(&candidates, |&i| seen[i], &uniforms)
    };
    let inputs: Vec<Input<usize>> = pixels.iter().zip(counts).map(|(seen, &count)| fill(seen, count).into()).collect();
    let uniforms: Vec<f64> = inputs.iter().map(|_| next()).collect();
    merge(&inputs, 0, weights, |i, &light| pixels[i][light], &uniforms)
}

/// The enumeration itself: resampling at one pixel expects the sum over lights for any number of candidates (F04).
#[test]
fn enumeration_finds_that_resampling_expects_the_sum() {
    for count in 1..=4 {
        is_near(expected(&initial(&SEEN, count), &SEEN), TRUTH);
        is_near(expected(&initial(&BLIND, count), &BLIND), BLIND.iter().sum());
    }
}

/// F10, H7: the confidence of a merge is the sum of its inputs', and a cap is applied to an input beforehand.
#[test]
fn confidence_adds_up() {
    let of = |confidence| Reservoir { sample: Some(1), weight_sum: 0.0, confidence, weight: 2.0 };
    let none = Reservoir { sample: None, weight_sum: 0.0, confidence: 5.0, weight: 0.0 };
    for weights in Weights::ALL {
        let inputs = [of(4.0).into(), of(7.0).into(), none.into(), Reservoir::empty().into()];
        let target = |i: usize, &light: &usize| [SEEN, BLIND, SEEN, SEEN][i][light];
        assert_eq!(merge(&inputs, 0, weights, target, &[0.5; 4]).confidence, 16.0);
        assert_eq!(total_confidence(&inputs), 16.0);
        let capped = [of(4.0).into(), of(7.0).capped(6.0).into()];
        assert_eq!(merge(&capped, 0, weights, target, &[0.5; 2]).confidence, 10.0);
    }
}

/// F11: where all targets share their support, merging expects the sum over lights, with any weights and any
/// confidences.
#[test]
fn merging_is_unbiased_where_targets_share_support() {
    for weights in Weights::ALL {
        for (own, other) in [(1, 1), (2, 2), (1, 3), (3, 1)] {
            let outcomes = merged(&[(&SEEN, initial(&SEEN, own)), (&SIMILAR, initial(&SIMILAR, other))], weights);
            is_near(expected(&outcomes, &SEEN), TRUTH);
        }
        let found = runs(60_000, 100, |next| {
            one_run(&[&SEEN, &SIMILAR, &SIMILAR], &[2, 4, 1], weights, next).shade(|&i| SEEN[i])
        });
        is_truth(&format!("merge, shared support, {weights:?}"), &found, TRUTH);
    }
}

/// F12, H1: with a neighbour that is blind to a light, 1/M loses half of that light, 3.70 of 5.20. All others expect
/// 5.20. By enumeration, which leaves no doubt, and by random numbers.
#[test]
fn a_blind_neighbour_darkens_only_without_its_support() {
    for weights in Weights::ALL {
        let truth = if weights == Weights::Total { 3.7 } else { TRUTH };
        for count in [1, 2, 3] {
            let outcomes = merged(&[(&SEEN, initial(&SEEN, count)), (&BLIND, initial(&BLIND, count))], weights);
            is_near(expected(&outcomes, &SEEN), truth);
        }
        let found = runs(200_000, 200, |next| one_run(&[&SEEN, &BLIND], &[4, 4], weights, next).shade(|&i| SEEN[i]));
        row(&format!("merge, blind neighbour, {weights:?}"), &found, TRUTH);
        assert!(found.error() < 0.01 && found.deviate(truth).abs() < 3.0);
    }
}

/// The same after a further merge: what was merged becomes the neighbour of a pixel that sees what the first did not.
/// Weights stay unbiased when they are used again, with the confidences that merging gave.
#[test]
fn merging_again_stays_unbiased() {
    let first = |weights| merged(&[(&BLIND, initial(&BLIND, 1)), (&SIMILAR, initial(&SIMILAR, 2))], weights);
    for weights in Weights::UNBIASED {
        // The first light counts for nothing at the blind pixel: nothing that it keeps can be that.
        is_near(expected(&first(weights), &BLIND), BLIND.iter().sum());
        let second = merged(&[(&SEEN, initial(&SEEN, 1)), (&BLIND, first(weights))], weights);
        is_near(expected(&second, &SEEN), TRUTH);
        assert!(second.iter().all(|(_, r)| r.confidence == 4.0));
    }
}

/// Confidence of neighbours that cannot make the sample, if it is counted, darkens: each of `n` takes a share of the
/// light they are blind to, which leaves `3/(n + 1) + 2.2`. Otherwise their number is of no importance.
#[test]
fn confidence_of_blind_neighbours_darkens_the_more_there_are() {
    for neighbours in 1..=4 {
        let pixels: Vec<&[f64]> = [&SEEN[..]].into_iter().chain(vec![&BLIND[..]; neighbours]).collect();
        for weights in [Weights::Total, Weights::Support, Weights::Pairwise] {
            let found = runs(60_000, 300 + neighbours as u64, |next| {
                one_run(&pixels, &vec![2; neighbours + 1], weights, next).shade(|&i| SEEN[i])
            });
            let name = format!("{neighbours} blind neighbours, {weights:?}");
            if weights == Weights::Total {
                is_darker(&name, &found, TRUTH, 0.25);
                assert!(found.deviate(3.0 / (neighbours as f64 + 1.0) + 2.2).abs() < 3.0);
            } else {
                is_truth(&name, &found, TRUTH);
            }
        }
    }
}

/// The opposite mistake: a neighbour is left out, confidence and all, when what it happened to choose is dark here.
/// Then only lucky neighbours count, and the mean is too bright. By enumeration: a fifth light is dark here and bright
/// there.
#[test]
fn leaving_out_neighbours_by_what_they_chose_brightens() {
    let seen = [3.0, 1.2, 0.6, 0.4, 0.0];
    let neighbour = [0.0, 1.2, 0.6, 0.4, 4.0];
    let (own, other) = (initial(&seen, 2), initial(&neighbour, 2));
    let right = merged(&[(&seen, own.clone()), (&neighbour, other.clone())], Weights::Support);
    is_near(expected(&right, &seen), TRUTH);
    let without = |r: &Reservoir<usize>| r.sample.is_none_or(|light| seen[light] == 0.0);
    let skip = other.into_iter().map(|(p, r)| (p, if without(&r) { Reservoir::empty() } else { r })).collect();
    let wrong = expected(&merged(&[(&seen, own), (&neighbour, skip)], Weights::Support), &seen);
    println!("neighbours left out by what they chose: {wrong:.5} for {TRUTH}");
    assert!(wrong > TRUTH * 1.05, "{wrong}");
}

/// F13, H13: merged with itself a reservoir keeps its weight; with an empty one nothing changes; empty ones stay empty.
#[test]
fn merging_with_itself_or_nothing_changes_nothing() {
    let own = streaming(&[Candidate { sample: 1, pdf: 0.25 }; 3], |&i| SEEN[i], &[0.5; 3]);
    let empty = Reservoir::<usize>::empty();
    let dark = Reservoir { weight: 0.0, ..own };
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a}, not {b}");
    for weights in Weights::ALL {
        let put = |inputs: &[Reservoir<usize>]| {
            let inputs: Vec<Input<usize>> = inputs.iter().map(|&r| r.into()).collect();
            merge(&inputs, 0, weights, |_, &light| SEEN[light], &vec![0.4; inputs.len()])
        };
        near(put(&[own, own]).weight, own.weight);
        near(put(&[own, empty]).weight, own.weight);
        near(put(&[empty, own]).weight, own.weight);
        near(put(&[empty, own, empty]).weight, own.weight);
        assert_eq!(put(&[own, empty]).confidence, own.confidence);
        assert_eq!(put(&[empty, empty]), empty);
        assert_eq!(put(&[dark, dark]).weight, 0.0);
        // The canonical one has half by confidence; in the defensive form it has half of the other half as well.
        let part = if weights == Weights::Pairwise { 0.75 } else { 0.5 };
        near(put(&[own, dark]).weight, part * own.weight);
        near(put(&[dark, own]).weight, (1.0 - part) * own.weight);
        // A pixel that sees nothing at all, and one whose own candidates were all dark.
        let nothing = merge(&[own.into(), own.into()], 0, weights, |_, _: &usize| 0.0, &[0.4; 2]);
        assert_eq!((nothing.weight, nothing.confidence), (0.0, 6.0));
        let nobody = merge(&[own.into(), own.into()], 0, weights, |i, _: &usize| [1.0, 0.0][i], &[0.4; 2]);
        assert!(nobody.weight.is_finite());
    }
    for weights in Weights::ALL {
        // The mean is never lowered: with itself, which is as dependent as can be, and with an empty one.
        for (_, reservoir) in initial(&SEEN, 2) {
            let with = |other: Reservoir<usize>| {
                let inputs = [reservoir.into(), other.into()];
                merge(&inputs, 0, weights, |_, &light| SEEN[light], &[0.7, 0.2]).shade(|&i| SEEN[i])
            };
            near(with(reservoir), reservoir.shade(|&i| SEEN[i]));
            near(with(empty), reservoir.shade(|&i| SEEN[i]));
        }
    }
}

/// F33: `Z` counts those whose target is positive at the chosen sample, and no others.
#[test]
fn support_counts_only_who_can_make_the_sample() {
    let of = |sample, confidence, weight| {
        Input::from(Reservoir { sample: Some(sample), weight_sum: 0.0, confidence, weight })
    };
    let inputs = [of(0, 1.0, 2.0), of(1, 2.0, 3.0), of(2, 4.0, 5.0)];
    let target = |i: usize, &light: &usize| [SEEN, BLIND, SIMILAR][i][light];
    assert_eq!(support_confidence(&inputs, target, &0), 5.0);
    assert_eq!(support_confidence(&inputs, target, &1), 7.0);
    // The first light is chosen; Σ w over Z p̂, where Z leaves out the blind one.
    let chosen = merge(&inputs, 0, Weights::Support, target, &choosing(0, 3));
    let sum = 3.0 * 2.0 * 1.0 + 1.2 * 3.0 * 2.0 + 0.6 * 5.0 * 4.0;
    assert_eq!(chosen.sample, Some(0));
    is_near(chosen.weight, sum / (5.0 * 3.0));
    // The second: all three can make it.
    let chosen = merge(&inputs, 0, Weights::Support, target, &choosing(1, 3));
    is_near(chosen.weight, sum / (7.0 * 1.2));
}

/// The estimates of a chain of frames at one pixel, one candidate each, that reuse their history with at most `cap` of
/// confidence. What the pixel sees may change from frame to frame; the target is what `SIMILAR` makes of it, which is
/// never proportional to it.
fn chain(seen: &[[f64; 4]], weights: Weights, cap: f64, next: &mut dyn FnMut() -> f64) -> Vec<f64> {
    let target = |frame: usize, light: usize| if seen[frame][light] > 0.0 { SIMILAR[light] } else { 0.0 };
    let mut history = Reservoir::<usize>::empty();
    let mut shades = Vec::new();
    #[allow(clippy::needless_range_loop)]
    for frame in 0..seen.len() {
        let candidate = Candidate { sample: (next() * 4.0) as usize, pdf: 0.25 };
        let current = streaming(&[candidate], |&light| target(frame, light), &[next()]);
        let inputs = [current.into(), history.capped(cap).into()];
        let before = frame.saturating_sub(1);
        history = merge(&inputs, 0, weights, |i, &light| target([frame, before][i], light), &[next(), next()]);
        assert_eq!(history.confidence, 1.0 + (frame as f64).min(cap));
        shades.push(history.shade(|&light| seen[frame][light]));
    }
    shades
}

/// Mean and error of each frame, and the correlation of the last two, over many restarts.
fn restarts(seen: &[[f64; 4]], weights: Weights, cap: f64, seed: u64) -> (Vec<Estimate>, f64) {
    let mut frames = vec![Estimate::default(); seen.len()];
    let (mut last, mut sum) = (Estimate::default(), Estimate::default());
    for run in 0..60_000 {
        let mut random = Random::new(seed, run);
        let shades = chain(seen, weights, cap, &mut || random.unit());
        frames.iter_mut().zip(&shades).for_each(|(frame, &shade)| frame.add(shade));
        let two = &shades[shades.len() - 2..];
        last.add(two[1]);
        sum.add(two[0] + two[1]);
    }
    let before = frames[seen.len() - 2].variance();
    let covariance = 0.5 * (sum.variance() - last.variance() - before);
    (frames, covariance / (last.variance() * before).sqrt())
}

/// Each frame that reuses its history expects the truth over many restarts, though the frames of one run depend on each
/// other: by nine tenths with a cap of 16.
#[test]
fn a_correlated_history_expects_the_truth() {
    for weights in Weights::ALL {
        let (frames, correlation) = restarts(&[SEEN; 12], weights, 16.0, 400);
        println!("correlation of two frames {correlation:.3}");
        assert!(correlation > 0.7, "{correlation}");
        frames.iter().for_each(|frame| assert!(frame.deviate(TRUTH).abs() < 3.0, "{frame:?}"));
        is_truth(&format!("history, frame 12, {weights:?}"), &frames[11], TRUTH);
    }
}

/// A light that is out in every second frame: the history was chosen for a target that is zero there, and is weighted
/// by that target, not by this frame's. Only 1/M loses light, in those frames in which it is on again.
#[test]
fn a_blinking_light_expects_the_truth_in_each_frame() {
    let out: [f64; 4] = [0.0, SEEN[1], SEEN[2], SEEN[3]];
    let seen = [SEEN, out, SEEN, out, SEEN, out];
    for weights in Weights::ALL {
        let (frames, _) = restarts(&seen, weights, 4.0, 500);
        for (i, frame) in frames.iter().enumerate() {
            let truth = seen[i].iter().sum();
            let name = format!("blinking light, frame {}, {weights:?}", i + 1);
            assert!(frame.error() < 0.01 * truth);
            if weights == Weights::Total && i > 0 && i % 2 == 0 {
                is_darker(&name, frame, truth, 0.3);
            } else {
                is_truth(&name, frame, truth);
            }
        }
    }
}
