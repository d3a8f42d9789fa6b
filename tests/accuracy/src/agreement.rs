//! Agreement of two reports: the ranking of the rows of each slot, and their fronts.
use crate::front::{MIN_FRAME_SHARE, Point, Standing, front};
use crate::race::MIN_CERTAINTY;
use crate::report::{Effect, Report, Row};
use serde::Serialize;
use std::fmt::Write;

/// Agreement of two reports on a slot, over the rows that both have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlotAgreement {
    /// Name of the slot.
    pub slot: String,
    /// Number of rows in both reports.
    pub rows: usize,
    /// Kendall's tau-b of the errors, -1 to 1; none where one report has the same error everywhere.
    pub error_tau: Option<f64>,
    /// Kendall's tau-b of the times.
    pub price_tau: Option<f64>,
    /// Number of rows on both fronts, each computed from the common rows only.
    pub on_both: usize,
    /// Labels of rows on the front of the first report only.
    pub on_first: Vec<String>,
    /// Labels of rows on the front of the second report only.
    pub on_second: Vec<String>,
    /// Those of `on_first` and `on_second` whose place is clear in both reports, so that the difference is not a tie.
    pub clear: Vec<String>,
    /// Labels of rows that only one report has.
    pub missing: Vec<String>,
}

/// Agreement of two reports.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Metric of the errors.
    pub metric: &'static str,
    /// Agreement by slot.
    pub slots: Vec<SlotAgreement>,
    /// Kendall's tau-b of the errors over all slots, with pairs within a slot only.
    pub error_tau: Option<f64>,
    /// The same of the times.
    pub price_tau: Option<f64>,
}

/// Pairs of items by their order in two rankings: concordant, discordant, tied in the first, tied in the second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Pairs {
    alike: f64,
    opposed: f64,
    tied: [f64; 2],
}

impl Pairs {
    /// Counts all pairs of items, each given by its two values.
    fn of(pairs: &[(f64, f64)]) -> Self {
        let mut counts = Self::default();
        for (at, (a, b)) in pairs.iter().enumerate() {
            for (c, d) in &pairs[at + 1..] {
                let (first, second) = (a.total_cmp(c) as i8, b.total_cmp(d) as i8);
                match (first, second) {
                    (0, 0) => {}
                    (0, _) => counts.tied[0] += 1.0,
                    (_, 0) => counts.tied[1] += 1.0,
                    _ if first == second => counts.alike += 1.0,
                    _ => counts.opposed += 1.0,
                }
            }
        }
        counts
    }

    fn and(self, other: Self) -> Self {
        Self {
            alike: self.alike + other.alike,
            opposed: self.opposed + other.opposed,
            tied: [self.tied[0] + other.tied[0], self.tied[1] + other.tied[1]],
        }
    }

    /// Tau-b (Kendall 1945, "The Treatment of Ties in Ranking Problems"), from -1 (reversed) to 1 (the same order).
    fn tau(self) -> Option<f64> {
        let ordered = self.alike + self.opposed;
        let pairs = ((ordered + self.tied[0]) * (ordered + self.tied[1])).sqrt();
        (pairs > 0.0).then(|| (self.alike - self.opposed) / pairs)
    }
}

/// Kendall's tau-b of two rankings, given as pairs of values of the same items; none where one of them is constant.
pub fn kendall(pairs: &[(f64, f64)]) -> Option<f64> {
    Pairs::of(pairs).tau()
}

impl Agreement {
    /// Compares two reports, matching slots and rows by name.
    pub fn of(first: &Report, second: &Report) -> Self {
        let (mut slots, mut errors, mut prices) = (Vec::new(), Pairs::default(), Pairs::default());
        for a in &first.effects {
            let Some(b) = second.effect(&a.slot) else { continue };
            let (found, [error, price]) = compare(first, a, second, b);
            slots.push(found);
            (errors, prices) = (errors.and(error), prices.and(price));
        }
        let metric = first.effects.first().map_or("", |e| e.metric.name());
        Self { metric, slots, error_tau: errors.tau(), price_tau: prices.tau() }
    }

    /// The agreement as text.
    pub fn table(&self) -> String {
        let tau = |tau: Option<f64>| tau.map_or("-".to_owned(), |t| format!("{t:.3}"));
        let mut text = format!(
            "{:<14} {:>5} {:>10} {:>10} {:>14}  differences of the fronts ({})\n",
            "slot", "rows", "tau error", "tau price", "on both fronts", self.metric
        );
        for slot in &self.slots {
            let mut differ = Vec::new();
            for (which, labels) in [("first", &slot.on_first), ("second", &slot.on_second)] {
                let mark = |l: &String| if slot.clear.contains(l) { format!("{l} (clear)") } else { l.clone() };
                differ.extend(labels.iter().map(|l| format!("{which} only: {}", mark(l))));
            }
            if !slot.missing.is_empty() {
                differ.push(format!("{} rows in one only", slot.missing.len()));
            }
            let differ = if differ.is_empty() { "none".to_owned() } else { differ.join("; ") };
            let _ = writeln!(
                text,
                "{:<14} {:>5} {:>10} {:>10} {:>14}  {differ}",
                slot.slot,
                slot.rows,
                tau(slot.error_tau),
                tau(slot.price_tau),
                slot.on_both
            );
        }
        let (errors, prices) = (tau(self.error_tau), tau(self.price_tau));
        let both: usize = self.slots.iter().map(|s| s.on_both).sum();
        let one: usize = self.slots.iter().map(|s| s.on_first.len() + s.on_second.len()).sum();
        let _ = writeln!(text, "rank agreement (Kendall's tau-b): {errors} of errors, {prices} of prices");
        let _ = writeln!(text, "fronts: {both} rows on both, {one} on one only");
        text
    }
}

/// Whether each of these rows is on the front of these rows.
fn fronts(report: &Report, effect: &Effect, rows: &[&Row]) -> Vec<bool> {
    let points: Vec<Point> = rows.iter().map(|row| row.point(error(effect, row))).collect();
    let floor = effect.floor(&report.truths, effect.judged_by, effect.metric);
    let least_ms = MIN_FRAME_SHARE * effect.rows.first().map_or(0.0, |r| r.frame_ms);
    front(&points, floor, least_ms).into_iter().map(Standing::is_front).collect()
}

fn error(effect: &Effect, row: &Row) -> f64 {
    row.error(effect.judged_by).map_or(f64::NAN, |c| effect.metric.of(c))
}

/// Compares the results of a slot in two reports.
fn compare(first: &Report, a: &Effect, second: &Report, b: &Effect) -> (SlotAgreement, [Pairs; 2]) {
    let has = |effect: &Effect, row: &Row| effect.rows.iter().any(|r| r.variant.label == row.variant.label);
    let rows: Vec<(&Row, &Row)> =
        a.rows.iter().filter_map(|r| Some((r, b.rows.iter().find(|o| o.variant.label == r.variant.label)?))).collect();
    let errors = Pairs::of(&rows.iter().map(|(x, y)| (error(a, x), error(b, y))).collect::<Vec<_>>());
    let prices = Pairs::of(&rows.iter().map(|(x, y)| (x.ms, y.ms)).collect::<Vec<_>>());
    let label = |row: &Row| row.variant.label.clone();
    let of_first = fronts(first, a, &rows.iter().map(|r| r.0).collect::<Vec<_>>());
    let of_second = fronts(second, b, &rows.iter().map(|r| r.1).collect::<Vec<_>>());
    let placed = || rows.iter().zip(of_first.iter().copied().zip(of_second.iter().copied()));
    let only = |wanted: (bool, bool)| {
        placed().filter(|(_, fronts)| *fronts == wanted).map(|((x, _), _)| label(x)).collect::<Vec<_>>()
    };
    let clear = placed()
        .filter(|((x, y), (on_first, on_second))| {
            on_first != on_second && x.sure >= MIN_CERTAINTY && y.sure >= MIN_CERTAINTY
        })
        .map(|((x, _), _)| label(x))
        .collect();
    let lacks = a.rows.iter().filter(|r| !has(b, r)).chain(b.rows.iter().filter(|r| !has(a, r)));
    let found = SlotAgreement {
        slot: a.slot.clone(),
        rows: rows.len(),
        error_tau: errors.tau(),
        price_tau: prices.tau(),
        on_both: only((true, true)).len(),
        on_first: only((true, false)),
        on_second: only((false, true)),
        clear,
        missing: lacks.map(label).collect(),
    };
    (found, [errors, prices])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::report;

    #[test]
    fn tau_is_that_of_the_paper() {
        let same: Vec<(f64, f64)> = (0..5).map(|i| (f64::from(i), f64::from(i * i))).collect();
        let reversed: Vec<(f64, f64)> = same.iter().map(|(a, b)| (*a, -b)).collect();
        assert_eq!((kendall(&same), kendall(&reversed)), (Some(1.0), Some(-1.0)));
        // One pair of six in the other order: (5 - 1) / 6.
        let one = [(1.0, 1.0), (2.0, 2.0), (3.0, 4.0), (4.0, 3.0)];
        assert!((kendall(&one).unwrap() - 4.0 / 6.0).abs() < 1e-12);
        // A tie in one of them: 5 pairs in order, one tied there: 5 / sqrt(5 * 6).
        let tied = [(1.0, 1.0), (2.0, 2.0), (3.0, 3.0), (4.0, 3.0)];
        assert!((kendall(&tied).unwrap() - 5.0 / 30.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(kendall(&[(1.0, 1.0), (1.0, 2.0)]), None);
        assert_eq!(kendall(&[]), None);
    }

    #[test]
    fn reports_are_compared_row_by_row() {
        let first = report();
        let same = Agreement::of(&first, &first);
        assert_eq!((same.error_tau, same.price_tau), (Some(1.0), Some(1.0)));
        assert!(same.slots.iter().all(|s| s.on_first.is_empty() && s.on_second.is_empty() && s.missing.is_empty()));
        assert!(same.table().contains("rank agreement (Kendall's tau-b): 1.000 of errors"), "{}", same.table());

        let mut second = report();
        let shadows = second.effects.iter_mut().find(|e| e.slot == "shadows").unwrap();
        // One ray now costs more than a more accurate row; the row without cost is missing.
        let cheap = &mut shadows.rows[2];
        let label = cheap.variant.label.clone();
        cheap.ms *= 100.0;
        cheap.rounds_ms.iter_mut().for_each(|ms| *ms *= 100.0);
        shadows.rows.iter_mut().for_each(|r| r.sure = 1.0);
        shadows.rows.remove(3);
        let differ = Agreement::of(&first, &second);
        let shadows = differ.slots.iter().find(|s| s.slot == "shadows").unwrap();
        assert_eq!((shadows.rows, shadows.missing.len()), (3, 1));
        assert_eq!((&shadows.on_first, shadows.on_second.len()), (&vec![label.clone()], 0));
        assert!(shadows.price_tau.unwrap() < 1.0 && shadows.error_tau == Some(1.0));
        assert!(differ.table().contains(&format!("first only: {label}")), "{}", differ.table());
    }
}
