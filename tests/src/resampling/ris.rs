//! Resampled importance sampling (Talbot et al. 2005): one of several candidates is chosen in proportion to a target.
//!
//! A target `p̂` is any function that is positive where the integrand `f` is. The estimate of the integral is `f(y) W`.

use super::mis::balance;
use super::reservoir::Reservoir;

/// A sample with the density that it was drawn with.
#[derive(Clone, Copy, Debug)]
pub struct Candidate<S> {
    /// The sample.
    pub sample: S,
    /// Its density `p`, which must be positive.
    pub pdf: f64,
}

/// The index that `u` falls on in the cumulative sum of weights; `None` if all are 0.
pub fn pick(weights: impl Iterator<Item = f64> + Clone, u: f64) -> Option<usize> {
    let point = u * weights.clone().sum::<f64>();
    let mut sum = 0.0;
    weights.enumerate().find_map(|(i, weight)| {
        sum += weight;
        (point < sum).then_some(i)
    })
}

/// By the cumulative distribution of all weights (Bitterli et al. 2020, algorithm 1), with one uniform number.
pub fn by_distribution<S: Copy>(candidates: &[Candidate<S>], target: impl Fn(&S) -> f64, u: f64) -> Reservoir<S> {
    let weights: Vec<f64> = candidates.iter().map(|c| target(&c.sample) / c.pdf).collect();
    let sample = pick(weights.iter().copied(), u).map(|z| candidates[z].sample);
    let confidence = candidates.len() as f64;
    let mut chosen = Reservoir { sample, weight_sum: weights.iter().sum(), confidence, weight: 0.0 };
    chosen.finish(sample.map_or(0.0, |s| target(&s)), confidence);
    chosen
}

/// As a stream into a reservoir (Bitterli et al. 2020, algorithm 3), with one uniform number per candidate.
pub fn streaming<S: Copy>(candidates: &[Candidate<S>], target: impl Fn(&S) -> f64, uniforms: &[f64]) -> Reservoir<S> {
    assert_eq!(candidates.len(), uniforms.len(), "uniform numbers");
    let mut chosen = Reservoir::empty();
    for (candidate, &u) in candidates.iter().zip(uniforms) {
        chosen.update(candidate.sample, target(&candidate.sample) / candidate.pdf, u);
    }
    chosen.finish(chosen.sample.map_or(0.0, |s| target(&s)), chosen.confidence);
    chosen
}

/// From several strategies, `counts[s]` candidates of strategy `s`, combined by the balance heuristic: a candidate has
/// the weight `m_s p̂ / p_s`, where the `m_s` add up to 1 over all candidates (Lin et al. 2022, generalised resampled
/// importance sampling).
pub fn mixed<S: Copy>(
    candidates: &[(usize, S)],
    counts: &[f64],
    pdf: impl Fn(usize, &S) -> f64,
    target: impl Fn(&S) -> f64,
    uniforms: &[f64],
) -> Reservoir<S> {
    assert_eq!(candidates.len(), uniforms.len(), "uniform numbers");
    let mut chosen = Reservoir::empty();
    for ((strategy, sample), &u) in candidates.iter().zip(uniforms) {
        let share = balance(counts, |s| pdf(s, sample), *strategy) / counts[*strategy];
        chosen.update(*sample, share * target(sample) / pdf(*strategy, sample), u);
    }
    chosen.finish(chosen.sample.map_or(0.0, |s| target(&s)), 1.0);
    chosen
}
