//! Chooses a configuration from measured fronts: the least error within a budget, or the least time within an error.
//!
//! Each slot chooses one of its rows. The picture of a combination is predicted by [composing](crate::compose) those of its rows, and its
//! error follows from that; its time is the default frame's plus the differences of its rows. The best prediction is rendered, and the
//! search repeated, until the best has been rendered ([`confirmed`]).
mod confirm;
mod ladder;
mod toml;

pub use confirm::{Confirmer, Found, Render, confirmed};
pub use ladder::{Rung, Step, ladder, steps, table};

use crate::AccuracyError;
use crate::compose::Composer;
use crate::display::Display;
use crate::front::middle;
use crate::metric::{Image, Metric};
use crate::report::{Effect, Report, Row, TimeScope};
use crate::results::{IMAGES, Run};
use magpie::config::Config;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Beam width of the search: combinations kept from slot to slot.
const BEAM: usize = 24;
/// Relative excess in error over a cheaper combination up to which the beam keeps one.
const SLACK: f64 = 0.1;
/// Relative distance from the front up to which combinations are kept: rendered, they may be better.
const NEAR: f64 = 0.03;
/// Width of the pictures that the search composes, pixels.
const SEARCHED: usize = 320;
/// Relative difference below which errors count as equal, and the cheaper choice is taken.
const SAME: f64 = 1e-3;

/// Goal of a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// Least error within this GPU time per frame, milliseconds.
    Budget(f64),
    /// Least time within this error of the picture.
    Error(f64),
}

/// A combination: one row per slot.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Row index for each effect of the report, in the report's order.
    pub rows: Vec<usize>,
    /// Predicted GPU time per frame, milliseconds.
    pub predicted_ms: f64,
    /// Predicted error of the picture.
    pub predicted_error: f64,
    /// Measured result, if it was rendered.
    pub found: Option<Found>,
}

impl Choice {
    /// GPU time per frame, milliseconds: measured if known, else predicted.
    pub fn ms(&self) -> f64 {
        self.found.map_or(self.predicted_ms, |f| f.ms)
    }

    /// Error of the picture: measured if known, else predicted.
    pub fn error(&self) -> f64 {
        self.found.map_or(self.predicted_error, |f| f.error)
    }
}

/// Chooses from a report.
#[derive(Debug)]
pub struct Tuner<'a> {
    report: &'a Report,
    composer: Composer,
    metric: Metric,
    /// For each effect, the rows that may be chosen.
    candidates: Vec<Vec<usize>>,
    /// For each effect, the row of the default.
    defaults: Vec<usize>,
    frame_ms: f64,
    /// Results of the search.
    choices: Vec<Choice>,
}

impl<'a> Tuner<'a> {
    /// Reads a report and its pictures from a folder, and searches by this metric of the picture.
    ///
    /// # Errors
    /// [`AccuracyError::NotTunable`], or errors of its pictures.
    pub fn new(report: &'a Report, folder: &Path, metric: Metric) -> Result<Self, AccuracyError> {
        let plan = &report.run.plan;
        let lacks = |lacks: &str| AccuracyError::NotTunable { path: folder.to_owned(), lacks: lacks.to_owned() };
        let default = plan.default_setup().ok_or_else(|| lacks("the default was not measured"))?;
        // Rows that were measured in a moving scene have no picture at the same time as the others.
        let still = plan.setups.iter().filter(|s| !s.moving).map(|s| (s.id.as_str(), s.is_whole()));
        let composer = Composer::read(&folder.join(IMAGES), Display::of(&default.config), &default.id, still)?;
        let composer = composer.ok_or_else(|| lacks("the pictures of its configurations are missing"))?;
        Self::with(report, folder, composer, metric)
    }

    /// The same with given pictures.
    pub(crate) fn with(
        report: &'a Report,
        folder: &Path,
        composer: Composer,
        metric: Metric,
    ) -> Result<Self, AccuracyError> {
        let lacks = |lacks: &str| AccuracyError::NotTunable { path: folder.to_owned(), lacks: lacks.to_owned() };
        let default_id = report.run.plan.default_setup().map_or("", |s| s.id.as_str());
        let (mut candidates, mut defaults) = (Vec::new(), Vec::new());
        for effect in &report.effects {
            let default = effect.rows.iter().position(|r| r.variant.is_default);
            let default = default.ok_or_else(|| lacks(&format!("the default of {} was not measured", effect.slot)))?;
            // The best rows by the slot's own image need not be the best in the picture of the default, where other errors may compensate
            // or hide theirs.
            let is_front = |row: &Row| {
                effect.is_front(row) || [Image::Picture, Image::Slot].iter().any(|image| row.is_front(*image, metric))
            };
            let known = |row: &Row| composer.knows(&row.variant.setup, default_id);
            let takes = |at: &usize| *at == default || (is_front(&effect.rows[*at]) && known(&effect.rows[*at]));
            candidates.push((0..effect.rows.len()).filter(takes).collect());
            defaults.push(default);
        }
        let frame_ms = report.effects.iter().zip(&defaults).map(|(e, at)| e.rows[*at].frame_ms).next();
        let frame_ms = frame_ms.ok_or_else(|| lacks("nothing was measured"))?;
        let mut tuner = Self { report, composer, metric, candidates, defaults, frame_ms, choices: Vec::new() };
        tuner.choices = tuner.search()?;
        Ok(tuner)
    }

    /// Predicted GPU time, milliseconds. Each slot's own passes take the time of its row; a row that affects other slots (resolution,
    /// acceleration structures) scales theirs.
    fn predicted_ms(&self, rows: &[usize]) -> f64 {
        let chosen = || self.report.effects.iter().zip(rows.iter().zip(&self.defaults));
        let Some(default) = chosen().next().map(|(effect, (_, d))| &effect.rows[*d]) else { return 0.0 };
        let rest = |row: &Row| row.frame_ms - row.stages_ms.values().sum::<f64>();
        let mut ms = rest(default);
        for (stage, usual) in &default.stages_ms {
            let mut own = *usual;
            for (effect, (at, d)) in chosen() {
                let (row, d) = (&effect.rows[*at], &effect.rows[*d]);
                if effect.slot == *stage && effect.time_scope == TimeScope::Stage {
                    own = row.ms * speed(effect, row, d);
                } else if effect.time_scope == TimeScope::Frame && at_differs(row, d) {
                    let (now, before) = (row.stages_ms.get(stage), d.stages_ms.get(stage));
                    let ratio = now.zip(before).filter(|(_, b)| **b > 0.0).map(|(now, before)| now / before);
                    own *= ratio.map_or(1.0, |ratio| ratio * speed(effect, row, d));
                }
            }
            ms += own;
        }
        // Slots without passes by default, and time between passes that rows with `TimeScope::Frame` change.
        for (effect, (at, d)) in chosen() {
            let (row, d) = (&effect.rows[*at], &effect.rows[*d]);
            match effect.time_scope {
                TimeScope::Stage if !default.stages_ms.contains_key(&effect.slot) => {
                    ms += row.ms * speed(effect, row, d)
                }
                TimeScope::Frame if at_differs(row, d) => ms += rest(row) * speed(effect, row, d) - rest(d),
                _ => {}
            }
        }
        ms.max(0.0)
    }

    fn setups<'s>(&'s self, rows: &'s [usize]) -> impl Iterator<Item = &'s str> {
        self.report.effects.iter().zip(rows).map(|(effect, at)| effect.rows[*at].variant.setup.as_str())
    }

    /// Predicted time and error of a combination.
    ///
    /// # Errors
    /// [`AccuracyError::Metric`] if its picture cannot be compared.
    pub fn predict(&self, rows: &[usize]) -> Result<Choice, AccuracyError> {
        self.predict_by(&self.composer, rows)
    }

    fn predict_by(&self, composer: &Composer, rows: &[usize]) -> Result<Choice, AccuracyError> {
        let error = composer.error(self.metric, self.setups(rows));
        let predicted_error = error.map_err(AccuracyError::metric("the picture of a combination"))?;
        Ok(Choice { rows: rows.to_vec(), predicted_ms: self.predicted_ms(rows), predicted_error, found: None })
    }

    /// Searches for Pareto-optimal combinations: a beam search slot by slot, then exchanges of single rows.
    fn search(&self) -> Result<Vec<Choice>, AccuracyError> {
        let small = self.composer.at_most(SEARCHED);
        let mut seen: BTreeMap<Vec<usize>, Choice> = BTreeMap::new();
        let first = self.predict_by(&small, &self.defaults)?;
        seen.insert(first.rows.clone(), first.clone());
        let mut beam = vec![first];
        for place in 0..self.candidates.len() {
            let all = self.exchanged(&small, &beam, &[place], &mut seen)?;
            beam = thinned(near_front(all, SLACK), BEAM);
        }
        let front = thinned(near_front(seen.values().cloned().collect(), 0.0), BEAM);
        let places: Vec<usize> = (0..self.candidates.len()).collect();
        self.exchanged(&small, &front, &places, &mut seen)?;
        let all: Vec<Choice> = seen.into_values().collect();
        let mut best = near_front(all.clone(), 0.0);
        let near: Vec<Choice> = near_front(all, NEAR).into_iter().filter(|c| !best.contains(c)).collect();
        best.extend(thinned(near, 4 * BEAM));
        best.par_iter().map(|choice| self.predict(&choice.rows)).collect()
    }

    /// These choices and all that differ from them in one of these slots.
    fn exchanged(
        &self,
        composer: &Composer,
        of: &[Choice],
        places: &[usize],
        seen: &mut BTreeMap<Vec<usize>, Choice>,
    ) -> Result<Vec<Choice>, AccuracyError> {
        let mut all: Vec<Vec<usize>> = Vec::new();
        for choice in of {
            for &place in places {
                for &row in &self.candidates[place] {
                    let mut rows = choice.rows.clone();
                    rows[place] = row;
                    all.push(rows);
                }
            }
        }
        all.sort();
        all.dedup();
        let new: Vec<&Vec<usize>> = all.iter().filter(|rows| !seen.contains_key(*rows)).collect();
        let found: Result<Vec<Choice>, _> = new.par_iter().map(|rows| self.predict_by(composer, rows)).collect();
        seen.extend(found?.into_iter().map(|choice| (choice.rows.clone(), choice)));
        Ok(all.iter().filter_map(|rows| seen.get(rows)).cloned().collect())
    }

    /// Stores the measured result of a choice.
    pub fn record_result(&mut self, choice: &Choice, found: Found) {
        if let Some(known) = self.choices.iter_mut().find(|c| c.rows == choice.rows) {
            known.found = Some(found);
        }
    }

    /// The Pareto-optimal choices, from the cheapest to the most accurate. Predictions that were not rendered are corrected by the
    /// deviations of the most similar ones that were.
    pub fn front(&self) -> Vec<Choice> {
        let expected = |choice: &Choice| {
            let (ms, error) = if choice.found.is_some() { (1.0, 1.0) } else { self.deviation(&choice.rows) };
            Choice {
                predicted_ms: choice.predicted_ms * ms,
                predicted_error: choice.predicted_error * error,
                ..choice.clone()
            }
        };
        near_front(self.choices.iter().map(expected).collect(), 0.0)
    }

    /// Factors by which time and error of a combination are expected to deviate from their predictions: the geometric means over the
    /// rendered choices that differ from it in the fewest slots, to the power of one over the number of those slots. So two choices that
    /// differ in one slot compare as predicted after one of them was rendered, and a deviation says little about choices unlike it.
    fn deviation(&self, rows: &[usize]) -> (f64, f64) {
        let differing = |c: &Choice| c.rows.iter().zip(rows).filter(|(a, b)| a != b).count().max(1);
        let rendered: Vec<(usize, &Choice, Found)> =
            self.choices.iter().filter_map(|c| Some((differing(c), c, c.found?))).collect();
        let Some(fewest) = rendered.iter().map(|(slots, ..)| *slots).min() else { return (1.0, 1.0) };
        let factor = |of: &dyn Fn(&Choice, &Found) -> f64| {
            let nearest = rendered.iter().filter(|(slots, ..)| *slots == fewest);
            let logs: Vec<f64> = nearest.map(|(_, c, f)| of(c, f).ln()).filter(|log| log.is_finite()).collect();
            (logs.iter().sum::<f64>() / (logs.len().max(1) * fewest) as f64).exp()
        };
        (factor(&|c, f| f.ms / c.predicted_ms), factor(&|c, f| f.error / c.predicted_error))
    }

    /// The choice that meets a goal. Of choices within the budget whose errors differ by less than 0.1 %, the cheapest.
    ///
    /// # Errors
    /// [`AccuracyError::Unreachable`], which says what comes closest.
    pub fn choose(&self, goal: Goal) -> Result<Choice, AccuracyError> {
        let chosen = self.choose_of(&self.front(), goal)?;
        // With its original prediction, not the corrected one.
        let own = self.choices.iter().find(|c| c.rows == chosen.rows);
        Ok(own.cloned().unwrap_or(chosen))
    }

    /// The same among the choices that were rendered.
    ///
    /// # Errors
    /// As [`Tuner::choose`].
    pub fn choose_rendered(&self, goal: Goal) -> Result<Choice, AccuracyError> {
        let rendered = self.choices.iter().filter(|c| c.found.is_some()).cloned().collect();
        self.choose_of(&near_front(rendered, 0.0), goal)
    }

    fn choose_of(&self, front: &[Choice], goal: Goal) -> Result<Choice, AccuracyError> {
        let (cheapest, best) = (front.first(), front.last());
        match goal {
            Goal::Budget(budget) => {
                let affordable: Vec<&Choice> = front.iter().take_while(|c| c.ms() <= budget).collect();
                let least = affordable.last().map(|c| c.error() * (1.0 + SAME));
                let found = affordable.into_iter().find(|c| least.is_some_and(|least| c.error() <= least));
                found.cloned().ok_or_else(|| AccuracyError::Unreachable {
                    wanted: format!("--budget-ms {budget}"),
                    nearest: format!("cheapest takes {:.3} ms", cheapest.map_or(f64::NAN, Choice::ms)),
                })
            }
            Goal::Error(error) => {
                let found = front.iter().find(|c| c.error() <= error);
                found.cloned().ok_or_else(|| AccuracyError::Unreachable {
                    wanted: format!("--max-error {error}"),
                    nearest: format!(
                        "most accurate has a {} of {}",
                        self.metric.name(),
                        figure(best.map_or(f64::NAN, Choice::error))
                    ),
                })
            }
        }
    }

    /// The configuration of a choice: the base with the rows of all slots applied.
    pub fn config(&self, choice: &Choice) -> Config {
        let default = self.report.run.plan.default_setup().map(|s| s.config.clone());
        let mut config = default.unwrap_or_default();
        for (effect, &at) in self.report.effects.iter().zip(&choice.rows) {
            let variant = &effect.rows[at].variant;
            let slot = &effect.slot;
            let before = config.stages.insert(slot.clone(), variant.implementation.clone());
            if before.as_deref() != Some(&variant.implementation) {
                config.settings.remove(slot);
            }
            if !variant.settings.is_empty() {
                config.settings.entry(slot.clone()).or_default().extend(variant.settings.clone());
            }
        }
        config
    }

    /// Lists what differs from the defaults.
    pub fn describe_changes(&self, choice: &Choice) -> String {
        let all = self.report.effects.iter().zip(choice.rows.iter().zip(&self.defaults));
        let describe = |(effect, (at, default)): (&Effect, (&usize, &usize))| {
            (at != default).then(|| format!("{}: {}", effect.slot, effect.rows[*at].variant.label))
        };
        let changes: Vec<String> = all.filter_map(describe).collect();
        if changes.is_empty() { "none".to_owned() } else { changes.join("; ") }
    }
}

fn at_differs(row: &Row, default: &Row) -> bool {
    row.variant.setup != default.variant.setup
}

/// Factor that converts a row's times to the machine's speed at the default's: from their common rounds; without any, and for a slot that
/// does not affect the passes of others, from the time of those passes.
fn speed(effect: &Effect, row: &Row, default: &Row) -> f64 {
    let (a, b) = (row.point(0.0).ms, default.point(0.0).ms);
    let ratio = |(round, ms): (&u32, &f64)| b.get(round).filter(|b| **b > 0.0).map(|b| ms / b);
    let mut ratios: Vec<f64> = a.range(1..).filter_map(ratio).collect();
    if ratios.is_empty() && effect.time_scope == TimeScope::Stage {
        let others = |row: &Row| -> f64 { row.stages_ms.iter().filter(|s| *s.0 != effect.slot).map(|s| s.1).sum() };
        return if others(row) > 0.0 { others(default) / others(row) } else { 1.0 };
    }
    if ratios.is_empty() {
        ratios = a.iter().filter_map(ratio).collect();
    }
    if ratios.is_empty() || row.ms <= 0.0 { 1.0 } else { middle(&ratios) * default.ms / row.ms }
}

/// Choices whose error exceeds that of the best cheaper one by at most this share, cheapest first.
fn near_front(mut all: Vec<Choice>, slack: f64) -> Vec<Choice> {
    all.sort_by(|a, b| a.ms().total_cmp(&b.ms()).then(a.error().total_cmp(&b.error())).then(a.rows.cmp(&b.rows)));
    let mut least = f64::INFINITY;
    all.retain(|choice| {
        let keeps = choice.error() < least || choice.error() < least * (1.0 + slack);
        least = least.min(choice.error());
        keeps
    });
    all
}

/// At most `most` of them, evenly spaced, the first and the last included.
fn thinned(all: Vec<Choice>, most: usize) -> Vec<Choice> {
    let count = all.len();
    if count <= most || most < 2 {
        return all;
    }
    (0..most).map(|i| all[i * (count - 1) / (most - 1)].clone()).collect()
}

/// Whether this is the report's device; its times do not apply to others.
pub fn is_same_device(run: &Run, name: &str) -> bool {
    run.device.name == name
}

/// Four significant digits.
fn figure(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let digits = (3 - x.abs().log10().floor() as i32).clamp(0, 12) as usize;
    format!("{x:.digits$}")
}

#[cfg(test)]
mod tests;
