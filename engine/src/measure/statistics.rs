//! Order statistics of a handful of samples.

use serde::Serialize;

/// Distribution of a time over the frames; the unit is that of the field that holds it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Median; for an even number of frames, the mean of the middle two.
    pub median: f64,
    /// Minimum.
    pub min: f64,
    /// 99th percentile by nearest rank: the least value that at least 99 % of the frames do not exceed.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

impl Spread {
    /// Distribution of values in nanoseconds, divided by `unit` (1e6 gives milliseconds). `None` without samples.
    #[must_use]
    pub fn of(mut nanoseconds: Vec<u64>, unit: f64) -> Option<Self> {
        nanoseconds.sort_unstable();
        Some(Self {
            median: median(&nanoseconds)? / unit,
            min: *nanoseconds.first()? as f64 / unit,
            p99: nearest_rank(&nanoseconds, 99)? as f64 / unit,
            max: *nanoseconds.last()? as f64 / unit,
        })
    }
}

/// Median of sorted values. `None` without values.
#[must_use]
pub fn median(sorted: &[u64]) -> Option<f64> {
    let middle = sorted.len() / 2;
    let upper = *sorted.get(middle)? as f64;
    if sorted.len() % 2 == 1 {
        return Some(upper);
    }
    let lower = sorted[middle - 1] as f64;
    Some(lower + (upper - lower) / 2.0)
}

/// The `percent`-th percentile of sorted values: the value of rank `ceil(percent / 100 * n)`, counted from 1. `percent` above 100
/// counts as 100. `None` without values.
#[must_use]
pub fn nearest_rank(sorted: &[u64], percent: u32) -> Option<u64> {
    let rank = (sorted.len() * percent.min(100) as usize).div_ceil(100).max(1);
    sorted.get(rank - 1).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_value_is_every_statistic() {
        let spread = Spread::of(vec![3_000_000], 1e6).unwrap();
        assert_eq!(spread, Spread { median: 3.0, min: 3.0, p99: 3.0, max: 3.0 });
    }

    #[test]
    fn no_value_has_none() {
        assert_eq!(Spread::of(Vec::new(), 1e6), None);
        assert_eq!(nearest_rank(&[], 99), None);
    }

    #[test]
    fn an_even_count_has_the_mean_of_the_middle_two() {
        assert_eq!(median(&[1, 2, 4, 100]), Some(3.0));
        assert_eq!(median(&[1, 2]), Some(1.5));
        assert_eq!(median(&[1, 2, 9]), Some(2.0));
        assert_eq!(Spread::of(vec![4, 1, 100, 2], 1.0).unwrap().median, 3.0);
    }

    #[test]
    fn the_99th_percentile_is_the_nearest_rank() {
        let sorted: Vec<u64> = (1..=100).collect();
        assert_eq!(nearest_rank(&sorted, 99), Some(99));
        assert_eq!(nearest_rank(&sorted, 100), Some(100));
        assert_eq!(nearest_rank(&sorted, 0), Some(1));
        assert_eq!(nearest_rank(&sorted[..99], 99), Some(99)); // ceil(98.01)
        assert_eq!(nearest_rank(&(1..=200).collect::<Vec<_>>(), 99), Some(198));
        assert_eq!(nearest_rank(&(1..=101).collect::<Vec<_>>(), 99), Some(100)); // ceil(99.99)
    }
}
