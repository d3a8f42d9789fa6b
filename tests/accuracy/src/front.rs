//! Pareto fronts that are robust against noise in the times.
//!
//! Errors are reproducible; times are not. The rows are visited from the least error to the greatest, and a row is on the front if it is
//! significantly cheaper than all more accurate ones. Significance is judged by the ratio of two rows' times in the same round, since load
//! on the machine affects both; the median over the rounds decides. The saving must also be a noticeable part of the frame: a tenth of a
//! pass that takes a hundredth of the frame is no reason to choose anything. Rows with nearly equal errors count as equally accurate, and
//! the cheaper one stays. Remaining ties go to the earlier row of the plan.
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Relative difference below which times count as equal.
pub const TIME_TOLERANCE: f64 = 0.06;
/// Share of the frame's time below which differences count as none, unless one of the two takes no time at all.
pub const MIN_FRAME_SHARE: f64 = 0.01;
/// Relative difference below which errors count as equal.
pub const ERROR_TOLERANCE: f64 = 0.01;

/// Error and times of a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Error, at least 0.
    pub error: f64,
    /// Time in milliseconds by round; two points are compared in their common rounds.
    pub ms: BTreeMap<u32, f64>,
}

/// Place of a row relative to the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// On the front: no row is better in both error and time.
    Front,
    /// Dominated by the row with this index.
    DominatedBy(usize),
}

impl Standing {
    /// Whether it is on the front.
    pub fn is_front(self) -> bool {
        self == Self::Front
    }
}

/// Median.
pub fn middle(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// Quantile, interpolated linearly; 0 of no values.
pub(crate) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * at.fract()
}

/// Prior standard deviation of the ratio of two times in the same round.
const USUAL: f64 = 0.05;
/// The same for round 0, in which rows run minutes apart.
const USUAL_APART: f64 = 0.15;
/// Weight of the prior, in rounds.
const KNOWN_ROUNDS: f64 = 2.0;

/// Half of a 95 % confidence interval of the median of these times, from their spread and the prior. `apart`: they are of round 0 only.
pub fn interval(values: &[f64], apart: bool) -> f64 {
    let (at, count) = (middle(values), values.len() as f64);
    let squares: f64 = values.iter().map(|v| (v - at).powi(2)).sum();
    let usual = if apart { USUAL_APART } else { USUAL };
    let variance = (KNOWN_ROUNDS * (usual * at).powi(2) + squares) / (KNOWN_ROUNDS + count);
    if values.is_empty() { 0.0 } else { 1.96 * (variance / count).sqrt() }
}

/// Cumulative distribution function of the standard normal distribution (Abramowitz and Stegun 1964, 26.2.17; to 8e-8).
fn normal(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let terms = [0.319_381_53, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let tail = terms.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
    let upper = tail * (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    if x >= 0.0 { 1.0 - upper } else { upper }
}

impl Point {
    /// Times of both in their common rounds. Round 0 is used only if there is no other.
    fn pairs(&self, other: &Self) -> Vec<(f64, f64)> {
        let pair = |(round, a): (&u32, &f64)| other.ms.get(round).map(|b| (*a, *b));
        let later: Vec<_> = self.ms.range(1..).filter_map(pair).collect();
        if later.is_empty() { self.ms.range(..1).filter_map(pair).collect() } else { later }
    }

    /// Whether the two have a common round other than round 0.
    fn has_run_beside(&self, other: &Self) -> bool {
        self.ms.range(1..).any(|(round, _)| other.ms.contains_key(round))
    }

    /// Probability that this is cheaper than `other` by the margin of [`Point::is_cheaper`]; 0.5 without common rounds.
    pub fn surely_cheaper(&self, other: &Self, least_ms: f64) -> f64 {
        let pairs = self.pairs(other);
        if pairs.is_empty() {
            return 0.5;
        }
        if pairs.iter().all(|(a, _)| *a <= 0.0) {
            return if pairs.iter().any(|(_, b)| *b > 0.0) { 1.0 } else { 0.0 };
        }
        let least = middle(&pairs.iter().map(|(_, b)| *b).collect::<Vec<_>>());
        let share = (1.0 - TIME_TOLERANCE).min(1.0 - least_ms / least.max(1e-12));
        if share <= 0.0 {
            return 0.0; // the saving could not be reached
        }
        let logs: Vec<f64> = pairs.iter().filter(|(a, b)| *a > 0.0 && *b > 0.0).map(|(a, b)| (a / b).ln()).collect();
        let (at, count) = (middle(&logs), logs.len() as f64);
        if logs.is_empty() {
            return 0.0;
        }
        let squares: f64 = logs.iter().map(|x| (x - at).powi(2)).sum();
        let usual = if self.has_run_beside(other) { USUAL } else { USUAL_APART };
        let variance = (KNOWN_ROUNDS * usual * usual + squares) / (KNOWN_ROUNDS + count);
        normal((share.ln() - at) / (variance / count).sqrt())
    }

    /// Whether this is significantly cheaper than `other`: the median ratio of the times is below 1 by [`TIME_TOLERANCE`], or by the ratios'
    /// interquartile range if that is more, and the median saving is at least `least_ms`, unless this takes no time at all.
    pub fn is_cheaper(&self, other: &Self, least_ms: f64) -> bool {
        let pairs = self.pairs(other);
        let saved: Vec<f64> = pairs.iter().map(|(a, b)| b - a).collect();
        if pairs.iter().any(|(a, _)| *a > 0.0) && middle(&saved) < least_ms {
            return false;
        }
        let ratios: Vec<f64> = pairs.iter().filter(|(_, b)| *b > 0.0).map(|(a, b)| a / b).collect();
        if ratios.is_empty() {
            return false; // `other` takes no time
        }
        let spread = quantile(&ratios, 0.75) - quantile(&ratios, 0.25);
        middle(&ratios) < 1.0 - TIME_TOLERANCE.max(spread)
    }

    /// Whether the error counts as equal to that of `better`, which is not greater.
    fn is_as_accurate(&self, better: &Self, floor: f64) -> bool {
        self.error - better.error <= ERROR_TOLERANCE * better.error || (self.error <= floor && better.error <= floor)
    }
}

/// Computes the front. Errors up to `floor`, the noise of the ground truth, count as equal, and so do times that differ by less than
/// `least_ms`. Ties go to the earlier point.
pub fn front(points: &[Point], floor: f64, least_ms: f64) -> Vec<Standing> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].error.total_cmp(&points[b].error).then(a.cmp(&b)));
    let mut standing = vec![Standing::Front; points.len()];
    let mut kept: Vec<usize> = Vec::new();
    for at in order {
        let point = &points[at];
        let better = kept.iter().copied().find(|&k| !point.is_cheaper(&points[k], least_ms));
        let Some(better) = better else {
            // Cheaper than all points so far, it dominates those that are not more accurate.
            for &k in kept.iter().filter(|&&k| point.is_as_accurate(&points[k], floor)) {
                standing[k] = Standing::DominatedBy(at);
            }
            kept.retain(|&k| standing[k].is_front());
            kept.push(at);
            continue;
        };
        // Equally fast and equally accurate: the earlier one in the plan stays.
        let is_tie = point.is_as_accurate(&points[better], floor) && !points[better].is_cheaper(point, least_ms);
        let others_are_dearer = kept.iter().all(|&k| k == better || point.is_cheaper(&points[k], least_ms));
        if is_tie && at < better && others_are_dearer {
            standing[better] = Standing::DominatedBy(at);
            kept.retain(|&k| k != better);
            kept.push(at);
        } else {
            standing[at] = Standing::DominatedBy(better);
        }
    }
    // Chains of dominated rows are resolved to their last row.
    for at in 0..standing.len() {
        let mut hops = 0;
        while let Standing::DominatedBy(by) = standing[at] {
            match standing[by] {
                Standing::DominatedBy(next) if next != at && hops < points.len() => {
                    standing[at] = Standing::DominatedBy(next)
                }
                _ => break,
            }
            hops += 1;
        }
    }
    standing
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(of: &[(f64, f64)]) -> Vec<Point> {
        of.iter().map(|(error, ms)| Point { error: *error, ms: (1..=5).map(|round| (round, *ms)).collect() }).collect()
    }

    #[test]
    fn what_is_worse_in_both_is_dominated_and_by_whom() {
        // error, milliseconds
        let found = front(&points(&[(0.1, 10.0), (0.2, 5.0), (0.3, 6.0), (0.4, 1.0), (0.5, 20.0)]), 0.0, 0.0);
        use Standing::{DominatedBy, Front};
        assert_eq!(found, [Front, Front, DominatedBy(1), Front, DominatedBy(0)]);
    }

    #[test]
    fn what_costs_nothing_is_always_on_the_front() {
        let found = front(&points(&[(0.1, 3.0), (0.9, 0.0), (1.0, 0.0)]), 0.0, 0.0);
        assert_eq!(found, [Standing::Front, Standing::Front, Standing::DominatedBy(1)]);
    }

    #[test]
    fn of_equal_errors_the_cheaper_stays_and_of_equal_rows_the_first() {
        let found = front(&points(&[(0.1, 3.0), (0.1005, 2.0), (0.0999, 2.05)]), 0.0, 0.0);
        assert_eq!(found, [Standing::DominatedBy(1), Standing::Front, Standing::DominatedBy(1)]);
        // Below the noise of the ground truth all errors count as equal.
        let found = front(&points(&[(0.1, 3.0), (0.05, 5.0)]), 0.2, 0.0);
        assert_eq!(found, [Standing::Front, Standing::DominatedBy(0)]);
    }

    #[test]
    fn what_saves_next_to_nothing_is_not_cheaper_unless_it_costs_nothing() {
        let found = front(&points(&[(0.1, 3.0), (0.2, 2.5), (0.3, 1.9), (0.4, 0.2), (0.5, 0.0)]), 0.0, 1.0);
        use Standing::{DominatedBy, Front};
        assert_eq!(found, [Front, DominatedBy(0), Front, Front, Front]);
    }

    #[test]
    fn noise_of_the_machine_does_not_change_a_front() {
        // Times vary by a factor of three from round to round, and by 6 % from row to row.
        let truth = [(0.1, 10.0), (0.11, 9.9), (0.2, 5.0), (0.21, 5.1), (0.4, 1.0), (0.5, 1.02), (1.0, 0.0)];
        let calm = front(&points(&truth), 0.0, 0.0);
        for seed in 0..200_u32 {
            let mut state = seed;
            let mut random = || {
                state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                f64::from(state >> 8) / f64::from(1 << 24)
            };
            let rounds: Vec<f64> = (0..9).map(|_| 1.0 + 2.0 * random()).collect();
            let noisy: Vec<Point> = truth
                .iter()
                .map(|(error, ms)| {
                    let ms = (1..).zip(rounds.iter().map(|busy| ms * busy * (0.97 + 0.06 * random()))).collect();
                    Point { error: *error, ms }
                })
                .collect();
            assert_eq!(front(&noisy, 0.0, 0.0), calm, "seed {seed}");
        }
    }

    #[test]
    fn certainty_grows_with_rounds_and_with_distance() {
        let point = |ms: &[f64]| Point { error: 0.0, ms: (1..).zip(ms.iter().copied()).collect() };
        let sure = |a: &[f64], b: &[f64]| point(a).surely_cheaper(&point(b), 0.0);
        assert!(sure(&[5.0], &[10.0]) > 0.99 && sure(&[20.0], &[10.0]) < 0.01);
        let one = sure(&[9.0], &[10.0]);
        assert!((0.6..0.95).contains(&one) && sure(&[9.0; 9], &[10.0; 9]) > 0.98, "{one}");
        // Scattered times lower the probability, and rounds that are not shared give none.
        assert!(sure(&[9.0, 6.0, 12.0], &[10.0, 9.0, 9.0]) < sure(&[9.0; 3], &[10.0; 3]));
        let once = |round: u32, ms: f64| Point { error: 0.0, ms: [(round, ms)].into() };
        assert_eq!(once(7, 1.0).surely_cheaper(&point(&[10.0]), 0.0), 0.5);
        // In round 0 rows are minutes apart.
        assert!(once(0, 9.0).surely_cheaper(&once(0, 10.0), 0.0) < one);
        assert_eq!((sure(&[0.0], &[1.0]), sure(&[0.0], &[0.0]), sure(&[1.0], &[0.0])), (1.0, 0.0, 0.0));
        // A saving of less than `least_ms` counts as none.
        assert!(point(&[5.0; 9]).surely_cheaper(&point(&[10.0; 9]), 6.0) < 0.05);
        assert!((normal(1.96) - 0.975).abs() < 1e-4 && (normal(-1.0) - 0.158_655).abs() < 1e-5);
        assert!(interval(&[10.0; 9], false) < interval(&[10.0], false) && interval(&[], false) == 0.0);
        assert!(interval(&[10.0], true) > 2.0 * interval(&[10.0], false) && interval(&[10.0], false) > 0.5);
    }

    #[test]
    fn quantiles_lie_between_values() {
        assert_eq!(middle(&[3.0, 1.0, 2.0, 10.0]), 2.5);
        assert_eq!((quantile(&[1.0], 0.9), quantile(&[], 0.5)), (1.0, 0.0));
    }
}
