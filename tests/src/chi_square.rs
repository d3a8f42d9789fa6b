//! Pearson's χ² goodness-of-fit test.

/// Result of a test.
#[derive(Clone, Copy, Debug)]
pub struct ChiSquare {
    /// Sum of squared deviations over expected counts.
    pub statistic: f64,
    /// Degrees of freedom: bins, after merging small ones, less one.
    pub freedom: f64,
    /// The statistic as a standard normal deviate (Wilson and Hilferty 1931): above 3.7 in one of ten thousand true cases.
    pub deviate: f64,
}

/// Bins with a smaller expected count are merged.
const MIN_EXPECTED: f64 = 10.0;

/// Tests counts against expected counts of the same sum.
pub fn chi_square(counts: &[f64], expected: &[f64]) -> ChiSquare {
    assert_eq!(counts.len(), expected.len(), "bins");
    let (mut statistic, mut bins) = (0.0, 0.0);
    let mut rest = (0.0, 0.0);
    let mut add = |count: f64, expected: f64| {
        statistic += (count - expected).powi(2) / expected;
        bins += 1.0;
    };
    for (&count, &expect) in counts.iter().zip(expected) {
        if expect < MIN_EXPECTED {
            rest = (rest.0 + count, rest.1 + expect);
        } else {
            add(count, expect);
        }
    }
    if rest.1 >= MIN_EXPECTED {
        add(rest.0, rest.1);
    } else {
        // The merged bins are too small to test, but must not exceed their expectation by far.
        assert!(rest.0 <= MIN_EXPECTED * 4.0, "{} samples where {} are expected", rest.0, rest.1);
    }
    let freedom: f64 = f64::max(bins - 1.0, 1.0);
    let spread = 2.0 / (9.0 * freedom);
    let deviate = ((statistic / freedom).cbrt() - (1.0 - spread)) / spread.sqrt();
    ChiSquare { statistic, freedom, deviate }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fair_dice_pass_and_loaded_ones_do_not() {
        let roll = |loaded: f64| {
            let mut counts = [0.0; 6];
            let mut state = 1_u64;
            for _ in 0..60_000 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let u = (state >> 11) as f64 / (1_u64 << 53) as f64;
                let face = if u < loaded { 5 } else { (((u - loaded) / (1.0 - loaded)) * 6.0) as usize };
                counts[face] += 1.0;
            }
            chi_square(&counts, &[10_000.0; 6]).deviate
        };
        assert!(roll(0.0).abs() < 3.7);
        assert!(roll(0.02) > 5.0);
    }
}
