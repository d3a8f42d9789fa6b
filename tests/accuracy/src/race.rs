//! Chooses which configurations to time next: those whose place on a front is still uncertain, and their rivals.
//!
//! Every configuration is rendered once for its error, and those frames give its first times. After that, rows of a slot whose place is
//! certain enough stop; the others run another round together with their rivals, one directly after another, so that load on the machine
//! affects all of them alike.
use crate::front::{MIN_FRAME_SHARE, Point, Standing, front};

/// Probability from which on a row's place counts as certain.
pub const MIN_CERTAINTY: f64 = 0.95;
/// Rounds after which a row stops in any case, round 0 not counted.
pub const MAX_ROUNDS: usize = 9;

/// Least rounds of rows on a front, so that their times are known as well as their order.
pub const MIN_ROUNDS: usize = 3;

/// A row of a slot in the race.
#[derive(Clone, Debug, PartialEq)]
pub struct Runner {
    /// Id of the configuration.
    pub setup: String,
    /// Its error and times.
    pub point: Point,
}

/// Certainty of a row's place, and the row that it depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certainty {
    /// Probability of the row's standing, 0 to 1.
    pub sure: f64,
    /// The row whose comparison decides; none if no row is more accurate.
    pub rival: Option<usize>,
}

/// Certainty of each row's standing; parameters as of [`front`].
pub fn certainties(points: &[Point], floor: f64, least_ms: f64) -> (Vec<Standing>, Vec<Certainty>) {
    let standing = front(points, floor, least_ms);
    let sure = (0..points.len()).map(|at| certainty(points, &standing, at, least_ms)).collect();
    (standing, sure)
}

fn certainty(points: &[Point], standing: &[Standing], at: usize, least_ms: f64) -> Certainty {
    let point = &points[at];
    let is_before = |k: usize| (points[k].error, k) < (point.error, at);
    let better = (0..points.len()).filter(|&k| k != at && is_before(k) && standing[k].is_front());
    let compared = better.map(|k| (k, point.surely_cheaper(&points[k], least_ms)));
    if standing[at].is_front() {
        // It must be cheaper than all that are more accurate.
        let worst = compared.min_by(|a, b| a.1.total_cmp(&b.1));
        return Certainty { sure: worst.map_or(1.0, |w| w.1), rival: worst.map(|w| w.0) };
    }
    let Standing::DominatedBy(by) = standing[at] else { return Certainty { sure: 1.0, rival: None } };
    // It is dominated if it is not cheaper than one row that is more accurate, or as accurate and earlier in the plan, or if a row is as
    // accurate and cheaper.
    let tied = (by, point.surely_cheaper(&points[by], least_ms));
    let beaten = compared.chain([tied]).map(|(k, sure)| (k, 1.0 - sure));
    let beaten = beaten.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((by, 0.0));
    let by_cheaper = (by, points[by].surely_cheaper(point, least_ms));
    let (rival, sure) = if beaten.1 >= by_cheaper.1 { beaten } else { by_cheaper };
    Certainty { sure, rival: Some(rival) }
}

/// Ids of a slot's rows that run another round, in order; empty if every place is certain or out of rounds. Rows on the front run together
/// with the default, the first row, until their times are known. `frame_ms` is the default's frame time.
pub fn next(runners: &[Runner], floor: f64, frame_ms: f64) -> Vec<String> {
    let points: Vec<Point> = runners.iter().map(|r| r.point.clone()).collect();
    let (standing, sure) = certainties(&points, floor, MIN_FRAME_SHARE * frame_ms);
    let rounds = |at: usize| points[at].ms.keys().filter(|round| **round > 0).count();
    let mut runs = vec![false; runners.len()];
    for (at, certainty) in sure.iter().enumerate() {
        if certainty.sure < MIN_CERTAINTY
            && let Some(rival) = certainty.rival
            && rounds(at).min(rounds(rival)) < MAX_ROUNDS
        {
            (runs[at], runs[rival]) = (true, true);
        }
    }
    for at in (1..points.len()).filter(|&at| standing[at].is_front() && rounds(at) < MIN_ROUNDS) {
        (runs[at], runs[0]) = (true, true);
    }
    runners.iter().zip(runs).filter(|(_, runs)| *runs).map(|(r, _)| r.setup.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    struct Random(u32);

    impl Random {
        /// Uniform in 0 to 1.
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f64::from(self.0 >> 8) / f64::from(1 << 24)
        }
    }

    /// Error and milliseconds of twenty rows: a front of five, four near it, the rest far off.
    fn rows() -> Vec<(f64, f64)> {
        let mut rows = vec![(0.10, 40.0), (0.12, 22.0), (0.20, 12.0), (0.30, 5.0), (0.50, 0.0)];
        rows.extend([(0.11, 41.0), (0.125, 23.0), (0.21, 12.3), (0.32, 5.1)]);
        rows.extend((0..11).map(|i| (0.15 + 0.03 * f64::from(i), 60.0 + 5.0 * f64::from(i))));
        rows
    }

    /// A time on a machine that is up to twice as slow from round to round, with 4 % of noise.
    fn time(ms: f64, busy: f64, random: &mut Random) -> f64 {
        ms * busy * (0.96 + 0.08 * random.next())
    }

    #[test]
    fn a_race_ends_at_the_front_of_the_long_run_with_a_fraction_of_its_rounds() {
        let rows = rows();
        let exact = |(error, ms): &(f64, f64)| Point { error: *error, ms: [(0, *ms)].into() };
        let wanted = front(&rows.iter().map(exact).collect::<Vec<_>>(), 0.0, 0.01);
        let mut used = Vec::new();
        for seed in 0..50 {
            let mut random = Random(seed);
            let mut runners: Vec<Runner> = (0..rows.len())
                .map(|at| {
                    let ms = BTreeMap::from([(0, time(rows[at].1, 1.0 + 0.05 * random.next(), &mut random))]);
                    Runner { setup: at.to_string(), point: Point { error: rows[at].0, ms } }
                })
                .collect();
            let (mut round, mut timed) = (0, 0);
            loop {
                let next = next(&runners, 0.0, 1.0);
                if next.is_empty() {
                    break;
                }
                round += 1;
                let busy = 1.0 + random.next();
                for setup in next {
                    let at: usize = setup.parse().unwrap();
                    runners[at].point.ms.insert(round, time(rows[at].1, busy, &mut random));
                    timed += 1;
                }
            }
            let points: Vec<Point> = runners.into_iter().map(|r| r.point).collect();
            let found = front(&points, 0.0, 0.01);
            let is_front = |s: &[Standing]| s.iter().map(|s| s.is_front()).collect::<Vec<_>>();
            assert_eq!(is_front(&found), is_front(&wanted), "seed {seed}");
            used.push(timed);
        }
        let most = *used.iter().max().unwrap();
        assert!(most < rows.len() * MAX_ROUNDS / 2, "{most} of {}", rows.len() * MAX_ROUNDS);
        assert!(used.iter().any(|n| *n > 0), "near rows are not decided by one round");
    }

    #[test]
    fn what_is_far_off_runs_no_more_and_what_is_near_runs_with_its_rival() {
        let runner = |name: &str, error: f64, ms: f64| Runner {
            setup: name.to_owned(),
            point: Point { error, ms: [(0, ms)].into() },
        };
        let runners =
            [runner("best", 0.1, 10.0), runner("near", 0.2, 9.5), runner("far", 0.3, 30.0), runner("cheap", 0.4, 2.0)];
        // The cheap row's place is certain, but not its time.
        assert_eq!(next(&runners, 0.0, 1.0), ["best", "near", "cheap"]);
        let mut enough = runners.clone();
        for round in 1..=MIN_ROUNDS as u32 {
            enough[3].point.ms.insert(round, 2.0);
        }
        assert_eq!(next(&enough, 0.0, 1.0), ["best", "near"]);
        for round in 1..=MAX_ROUNDS as u32 {
            enough[0].point.ms.insert(round, 10.0);
            enough[1].point.ms.insert(round, 9.4);
        }
        assert!(next(&enough, 0.0, 1.0).is_empty(), "a tie ends as well");
        assert!(next(&[], 0.0, 1.0).is_empty());
        // As accurate and not noticeably cheaper: the order of the plan decides, not the tiny difference in error.
        let alike = [runner("first", 0.2, 2.6), runner("second", 0.1999, 2.0)];
        assert!(next(&alike, 0.0, 300.0).is_empty(), "a saving that does not show in the frame");
    }
}
