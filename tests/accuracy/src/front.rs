//! Pareto fronts that do not change from run to run.
//!
//! Errors are the same every time; times are not. So a front is walked from the least error to the greatest, and a row belongs to it if
//! it is cheaper than all that are more accurate, by more than the times can be told apart. What is told apart is the ratio of two
//! rows' times in the same round, since a machine that is busy in one round is so for both; the median over the rounds decides. What is
//! saved has to show in the frame as well: a tenth of a pass of a hundredth of the frame is no reason to choose anything.
//! Rows whose errors are alike count as equally accurate, and the cheaper one stays. What cannot be told apart either way is decided by
//! the order of the plan.
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Times closer than this share count as the same.
pub const LEAST_TIME: f64 = 0.06;
/// Times closer than this share of the whole frame's count as the same, but that no passes are less than any.
pub const LEAST_OF_FRAME: f64 = 0.01;
/// Errors closer than this share count as the same.
pub const LEAST_ERROR: f64 = 0.01;

/// A row as a front sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// How wrong it is, at least 0.
    pub error: f64,
    /// What it took, milliseconds, by the round; two points are compared in the rounds that both have.
    pub ms: BTreeMap<u32, f64>,
}

/// Where a row stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// Nothing is better in both.
    Front,
    /// Dominated by the row of this index.
    DominatedBy(usize),
}

impl Standing {
    /// Whether nothing is better in both.
    pub fn is_front(self) -> bool {
        self == Self::Front
    }
}

/// Median over the rounds.
pub fn middle(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// Quantile between the nearest two values; 0 of none.
pub(crate) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * at.fract()
}

/// Standard deviation of the ratio of two times in one round, where nothing else is known.
const USUAL: f64 = 0.05;
/// The same in round 0, in which rows are minutes apart.
const USUAL_APART: f64 = 0.15;
/// As many rounds as that knowledge counts.
const KNOWN_ROUNDS: f64 = 2.0;

/// Half of a 95 % interval around the median of these times, from how they spread and from what is usual. `apart`: of the round of
/// errors only.
pub fn interval(values: &[f64], apart: bool) -> f64 {
    let (at, count) = (middle(values), values.len() as f64);
    let squares: f64 = values.iter().map(|v| (v - at).powi(2)).sum();
    let usual = if apart { USUAL_APART } else { USUAL };
    let variance = (KNOWN_ROUNDS * (usual * at).powi(2) + squares) / (KNOWN_ROUNDS + count);
    if values.is_empty() { 0.0 } else { 1.96 * (variance / count).sqrt() }
}

/// Share of a normal distribution below so many standard deviations (Abramowitz and Stegun 1964, 26.2.17; to 8e-8).
fn normal(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let terms = [0.319_381_53, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let tail = terms.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
    let upper = tail * (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    if x >= 0.0 { 1.0 - upper } else { upper }
}

impl Point {
    /// Times of both in the rounds that both have. Round 0 counts where there is no other.
    fn pairs(&self, other: &Self) -> Vec<(f64, f64)> {
        let pair = |(round, a): (&u32, &f64)| other.ms.get(round).map(|b| (*a, *b));
        let later: Vec<_> = self.ms.range(1..).filter_map(pair).collect();
        if later.is_empty() { self.ms.range(..1).filter_map(pair).collect() } else { later }
    }

    /// Whether the two have run in the same round after the one of their errors.
    fn has_run_beside(&self, other: &Self) -> bool {
        self.ms.range(1..).any(|(round, _)| other.ms.contains_key(round))
    }

    /// How sure it is that this is cheaper than another, from 0 to 1: one half where the ratio of their times is just what
    /// [`Point::is_cheaper`] asks for, or where they have no round in common.
    pub fn surely_cheaper(&self, other: &Self, least_ms: f64) -> f64 {
        let pairs = self.pairs(other);
        if pairs.is_empty() {
            return 0.5;
        }
        if pairs.iter().all(|(a, _)| *a <= 0.0) {
            return if pairs.iter().any(|(_, b)| *b > 0.0) { 1.0 } else { 0.0 };
        }
        let least = middle(&pairs.iter().map(|(_, b)| *b).collect::<Vec<_>>());
        let share = (1.0 - LEAST_TIME).min(1.0 - least_ms / least.max(1e-12));
        if share <= 0.0 {
            return 0.0; // it would have to cost nothing
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

    /// Cheaper than another by more than can be mistaken: the median ratio of the times is below 1 by [`LEAST_TIME`], and by the
    /// interquartile range of the ratios where that is more; and the median difference is at least `least_ms`, where it does cost
    /// anything.
    pub fn is_cheaper(&self, other: &Self, least_ms: f64) -> bool {
        let pairs = self.pairs(other);
        let saved: Vec<f64> = pairs.iter().map(|(a, b)| b - a).collect();
        if pairs.iter().any(|(a, _)| *a > 0.0) && middle(&saved) < least_ms {
            return false;
        }
        let ratios: Vec<f64> = pairs.iter().filter(|(_, b)| *b > 0.0).map(|(a, b)| a / b).collect();
        if ratios.is_empty() {
            return false; // nothing is cheaper than what costs nothing
        }
        let spread = quantile(&ratios, 0.75) - quantile(&ratios, 0.25);
        middle(&ratios) < 1.0 - LEAST_TIME.max(spread)
    }

    /// Of the same error as another that is at most as wrong.
    fn is_as_accurate(&self, better: &Self, floor: f64) -> bool {
        self.error - better.error <= LEAST_ERROR * better.error || (self.error <= floor && better.error <= floor)
    }
}

/// Finds the front. Errors at or below `floor`, the truth's own noise, count as the same, and so do times that differ by less than
/// `least_ms`. Earlier points win what is undecided.
pub fn front(points: &[Point], floor: f64, least_ms: f64) -> Vec<Standing> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].error.total_cmp(&points[b].error).then(a.cmp(&b)));
    let mut standing = vec![Standing::Front; points.len()];
    let mut kept: Vec<usize> = Vec::new();
    for at in order {
        let point = &points[at];
        let better = kept.iter().copied().find(|&k| !point.is_cheaper(&points[k], least_ms));
        let Some(better) = better else {
            // Cheaper than all before it; those that are no more accurate than it fall behind.
            for &k in kept.iter().filter(|&&k| point.is_as_accurate(&points[k], floor)) {
                standing[k] = Standing::DominatedBy(at);
            }
            kept.retain(|&k| standing[k].is_front());
            kept.push(at);
            continue;
        };
        // Equally fast and equally accurate: the one that comes first in the plan stays.
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
    // Whoever fell behind a row that fell behind itself is dominated by the last of that chain.
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
        // Below the truth's noise all errors are alike.
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
        // Times swing by a factor of three from round to round, and by 6 % from row to row.
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
        // The same ratio from times that jump about is worth less; rounds apart are worth nothing.
        assert!(sure(&[9.0, 6.0, 12.0], &[10.0, 9.0, 9.0]) < sure(&[9.0; 3], &[10.0; 3]));
        let once = |round: u32, ms: f64| Point { error: 0.0, ms: [(round, ms)].into() };
        assert_eq!(once(7, 1.0).surely_cheaper(&point(&[10.0]), 0.0), 0.5);
        // In round 0 rows are minutes apart.
        assert!(once(0, 9.0).surely_cheaper(&once(0, 10.0), 0.0) < one);
        assert_eq!((sure(&[0.0], &[1.0]), sure(&[0.0], &[0.0]), sure(&[1.0], &[0.0])), (1.0, 0.0, 0.0));
        // A saving below what shows in the frame is none.
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
