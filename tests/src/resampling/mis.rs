//! Merging reservoirs of several pixels or frames, and the weights that decide what the merged one expects.
//!
//! Input `i` was chosen for the target `p̂_i` of its own pixel and is resampled for the target of the *canonical*
//! input's pixel, that which is shaded. Its resampling weight is `m_i(y_i) p̂_c(y_i) W_i J_i`, where `J_i` is the
//! Jacobian of moving its sample. The result expects the integral if the `m_i` of all inputs that can have made a
//! sample add up to 1 for each sample that counts (Lin et al. 2022).

use super::reservoir::Reservoir;

/// The weights `m_i`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// `1/M`: by confidence, `M_i / Σ M_j` (Bitterli et al. 2020, algorithm 4). Biased: too dark where an input cannot
    /// make a sample that counts.
    Total,
    /// `1/Z`: by confidence among those inputs that can make the chosen sample, `Z = Σ M_j` over `p̂_j(y) > 0`
    /// (Bitterli et al. 2020, algorithm 6). Unbiased.
    Support,
    /// Each input against the canonical one (Bitterli 2022), in the defensive form with confidences (Lin et al. 2022):
    /// `m_i = M_i/M · R p̂_i / (R p̂_i + M_c p̂_c)` with `M = Σ M_j` and `R = M − M_c`; the canonical one has what is
    /// left, `m_c = M_c/M + Σ_{j≠c} M_j/M · M_c p̂_c / (R p̂_j + M_c p̂_c)`. Unbiased if the canonical input can make
    /// all that counts.
    Pairwise,
    /// The balance heuristic (Veach and Guibas 1995) with targets in place of densities, `M_i p̂_i / Σ M_j p̂_j`.
    /// Unbiased; the number of targets that it evaluates grows with the square of the number of inputs.
    Balance,
}

impl Weights {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Total, Self::Support, Self::Pairwise, Self::Balance];
    /// Those that expect the integral.
    pub const UNBIASED: [Self; 3] = [Self::Support, Self::Pairwise, Self::Balance];
}

/// The balance heuristic `n_s p_s / Σ n_j p_j` (Veach and Guibas 1995) of strategy `s`; 0 where no strategy has
/// density.
pub fn balance(counts: &[f64], pdf: impl Fn(usize) -> f64, strategy: usize) -> f64 {
    let all: f64 = counts.iter().enumerate().map(|(s, n)| n * pdf(s)).sum();
    share(counts[strategy] * pdf(strategy), all)
}

/// `part / all`, and 0 where both are 0.
fn share(part: f64, all: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / all }
}

/// A reservoir to be merged. Its sample is already as the canonical pixel sees it.
#[derive(Clone, Copy, Debug)]
pub struct Input<S> {
    /// The reservoir. Its weight is for its own pixel.
    pub reservoir: Reservoir<S>,
    /// `J_i`: how much smaller the sample's density becomes as it is moved to the canonical pixel.
    pub jacobian: f64,
}

impl<S> From<Reservoir<S>> for Input<S> {
    /// Of a sample whose density is the same for all pixels, such as a light.
    fn from(reservoir: Reservoir<S>) -> Self {
        Self { reservoir, jacobian: 1.0 }
    }
}

/// Sum `M` of the confidences.
pub fn total_confidence<S>(inputs: &[Input<S>]) -> f64 {
    inputs.iter().map(|input| input.reservoir.confidence).sum()
}

/// Sum `Z` of the confidences of those inputs whose target is positive at `sample`.
pub fn support_confidence<S>(inputs: &[Input<S>], target: impl Fn(usize, &S) -> f64, sample: &S) -> f64 {
    let can = |i: &usize| target(*i, sample) > 0.0;
    (0..inputs.len()).filter(can).map(|i| inputs[i].reservoir.confidence).sum()
}

/// The weight `m_i(y)` of an input. For [`Weights::Total`] and [`Weights::Support`] it is `M_i`: these are divided by
/// their sum after the choice.
fn weight_of<S>(
    inputs: &[Input<S>],
    canonical: usize,
    weights: Weights,
    target: &impl Fn(usize, &S) -> f64,
    i: usize,
    sample: &S,
) -> f64 {
    let confidence = |j: usize| inputs[j].reservoir.confidence;
    match weights {
        Weights::Total | Weights::Support => confidence(i),
        Weights::Balance => {
            let all = (0..inputs.len()).map(|j| confidence(j) * target(j, sample)).sum();
            share(confidence(i) * target(i, sample), all)
        }
        Weights::Pairwise => {
            let all = total_confidence(inputs);
            let rest = all - confidence(canonical);
            let own = confidence(canonical) * target(canonical, sample);
            if i != canonical {
                let other = rest * target(i, sample);
                return confidence(i) / all * share(other, other + own);
            }
            let against = |j| confidence(j) / all * share(own, rest * target(j, sample) + own);
            let others: f64 = (0..inputs.len()).filter(|&j| j != canonical).map(against).sum();
            confidence(canonical) / all + others
        }
    }
}

/// The resampling weights `m_i(y_i) p̂_c(y_i) W_i J_i` of all inputs, 0 where there is no sample. `target(i, y)` is the
/// target of input `i`'s pixel at `y`, in the measure of the canonical pixel: times the Jacobian of moving `y` back,
/// and 0 where that is impossible.
pub fn resampling_weights<S>(
    inputs: &[Input<S>],
    canonical: usize,
    weights: Weights,
    target: &impl Fn(usize, &S) -> f64,
) -> Vec<f64> {
    let weight = |i: usize| {
        let Input { reservoir, jacobian } = &inputs[i];
        let Some(sample) = &reservoir.sample else { return 0.0 };
        let contribution = reservoir.weight * jacobian;
        if contribution == 0.0 || reservoir.confidence == 0.0 {
            return 0.0;
        }
        let moved = target(canonical, sample) * contribution;
        if moved == 0.0 { 0.0 } else { weight_of(inputs, canonical, weights, target, i, sample) * moved }
    };
    (0..inputs.len()).map(weight).collect()
}

/// Merges reservoirs (Bitterli et al. 2020, algorithms 4 and 6; Ouyang et al. 2021, algorithm 4), with one uniform
/// number per input. The confidence of the result is the sum of all; caps are applied to inputs beforehand. Targets are
/// as in [`resampling_weights`].
pub fn merge<S: Copy>(
    inputs: &[Input<S>],
    canonical: usize,
    weights: Weights,
    target: impl Fn(usize, &S) -> f64,
    uniforms: &[f64],
) -> Reservoir<S> {
    assert_eq!(inputs.len(), uniforms.len(), "uniform numbers");
    let mut merged = Reservoir::empty();
    let each = resampling_weights(inputs, canonical, weights, &target);
    for ((input, weight), &u) in inputs.iter().zip(each).zip(uniforms) {
        match input.reservoir.sample {
            Some(sample) => _ = merged.take(sample, weight, input.reservoir.confidence, u),
            None => merged.confidence += input.reservoir.confidence,
        }
    }
    let Some(chosen) = merged.sample else { return merged };
    let normaliser = match weights {
        Weights::Total => merged.confidence,
        Weights::Support => support_confidence(inputs, &target, &chosen),
        Weights::Pairwise | Weights::Balance => 1.0,
    };
    merged.finish(target(canonical, &chosen), normaliser);
    merged
}
