//! Order of a sweep: every round of every configuration, or a race within a time limit.
use super::Progress;
use super::truths::SAMPLE_UNITS;
use crate::AccuracyError;
use crate::metric::Judge;
use crate::plan::Setup;
use crate::race::{MAX_ROUNDS, Runner, next};
use crate::report::{Effect, effect};
use crate::results::{Measurement, Results, Run};
use crate::truth::{Truth, TruthInfo};
use std::collections::BTreeMap;

/// Share of a limited time after which no further configuration starts its round 0: the rest is for the race.
const ERRORS_UNTIL: f64 = 0.9;

/// Measures configurations, and has a clock. Tests replace it.
pub trait Measures {
    /// Runs one round of a configuration; round 0 includes its errors.
    fn measure(&mut self, setup: &Setup, round: u32) -> Result<Measurement, AccuracyError>;

    /// Seconds since the sweep began.
    fn seconds(&self) -> f64;
}

/// Units of progress.
pub struct Units {
    pub all: u64,
    pub name: &'static str,
}

impl Units {
    /// Seconds with a time limit; else frames, with each sample of a ground truth as several.
    pub fn of(run: &Run, setups: &[&Setup], truths: usize) -> Self {
        if let Some(minutes) = run.minutes {
            return Self { all: (60.0 * minutes) as u64, name: "seconds at most" };
        }
        let frames = (0..=run.rounds).map(|round| frames_of(run, round) * setups.len() as u64).sum::<u64>();
        Self { all: truths as u64 * u64::from(run.samples) * SAMPLE_UNITS + frames, name: "steps" }
    }
}

fn frames_of(run: &Run, round: u32) -> u64 {
    u64::from(if round == 0 { run.frames.last().copied().unwrap_or(1) + run.moving_frames } else { run.timed })
}

/// Runs all missing measurements.
pub fn run(
    run: &Run,
    setups: &[&Setup],
    truths: &BTreeMap<String, Truth>,
    results: &mut Results,
    by: &mut dyn Measures,
    at: &mut Progress,
    progress: &mut dyn FnMut(&Progress),
) -> Result<(), AccuracyError> {
    if let Some(minutes) = run.minutes {
        let infos: Vec<TruthInfo> = truths.values().map(|t| t.info.clone()).collect();
        let mut course = Course { run, truths: &infos, results, by, at, progress, limit: 60.0 * minutes };
        course.errors(setups)?;
        return course.race(setups);
    }
    for round in 0..=run.rounds {
        for &setup in setups {
            at.what = match round {
                0 => format!("errors: {}", setup.label),
                _ => format!("times, round {round} of {}: {}", run.rounds, setup.label),
            };
            progress(at);
            if results.has(&setup.id, round) {
                at.skipped += frames_of(run, round);
            } else {
                results.push(by.measure(setup, round)?)?;
            }
            at.done += frames_of(run, round);
            progress(at);
        }
    }
    Ok(())
}

struct Course<'a> {
    run: &'a Run,
    truths: &'a [TruthInfo],
    results: &'a mut Results,
    by: &'a mut dyn Measures,
    at: &'a mut Progress,
    progress: &'a mut dyn FnMut(&Progress),
    /// Time limit, seconds.
    limit: f64,
}

impl Course<'_> {
    fn report(&mut self, what: String) {
        self.at.done = (self.by.seconds() as u64).min(self.at.all);
        self.at.what = what;
        (self.progress)(self.at);
    }

    /// Runs round 0 of each configuration, most informative first, until time runs out.
    fn errors(&mut self, setups: &[&Setup]) -> Result<(), AccuracyError> {
        let order: Vec<&Setup> =
            self.run.plan.best_first().into_iter().filter(|s| setups.iter().any(|mine| mine.id == s.id)).collect();
        let (mut longest, all) = (0.0_f64, order.len());
        for (at, setup) in order.into_iter().enumerate() {
            if self.results.has(&setup.id, 0) {
                continue;
            }
            let begin = self.by.seconds();
            // The default always runs, as everything else is compared with it.
            if at > 0 && begin + longest > self.limit * ERRORS_UNTIL {
                break;
            }
            self.report(format!("errors, {} of {all}: {}", at + 1, setup.label));
            let measurement = self.by.measure(setup, 0)?;
            self.results.push(measurement)?;
            // The first measurement includes loading the scene.
            longest = if at > 0 { longest.max(self.by.seconds() - begin) } else { 0.0 };
        }
        Ok(())
    }

    /// Times the rows whose place is uncertain, slot by slot, until time runs out.
    fn race(&mut self, setups: &[&Setup]) -> Result<(), AccuracyError> {
        let mut longest = 0.0_f64;
        loop {
            let mut is_decided = true;
            for slot in self.run.plan.slots() {
                let runners = self.next_of(&slot);
                let mine = self.mine(setups, &runners);
                if mine.is_empty() {
                    continue;
                }
                is_decided = false;
                let round = 1 + self.results.measurements.iter().map(|m| m.round).max().unwrap_or(0);
                for setup in mine {
                    let begin = self.by.seconds();
                    if begin + longest > self.limit {
                        return Ok(());
                    }
                    self.report(format!("times, round {round}, undecided in {slot}: {}", setup.label));
                    let measurement = self.by.measure(setup, round)?;
                    self.results.push(measurement)?;
                    longest = longest.max(self.by.seconds() - begin);
                }
            }
            if is_decided {
                self.report("every place is clear".to_owned());
                return Ok(());
            }
        }
    }

    /// Those of these configurations that this shard measures. A row whose rival belongs to another shard would never be decided, so rounds
    /// are limited.
    fn mine<'s>(&self, setups: &[&'s Setup], runners: &[String]) -> Vec<&'s Setup> {
        let default = self.run.plan.default_setup().map_or("", |s| s.id.as_str());
        let rounds = |id: &str| self.results.measurements.iter().filter(|m| m.setup == id).count();
        let goes_on = |id: &str| id == default || rounds(id) < 2 * MAX_ROUNDS;
        let known = runners.iter().filter_map(|id| setups.iter().copied().find(|s| s.id == *id));
        let mine: Vec<&Setup> = known.filter(|s| goes_on(&s.id)).collect();
        if mine.iter().all(|s| s.id == default) { Vec::new() } else { mine }
    }

    fn next_of(&self, slot: &str) -> Vec<String> {
        let Judge { metric, .. } = self.run.judge;
        let effect: Effect = effect(self.run, &self.results.measurements, self.truths, slot);
        let runners: Vec<Runner> = effect
            .rows
            .iter()
            .filter_map(|row| {
                let error = row.error(effect.judged_by).map(|c| metric.of(c))?;
                Some(Runner { setup: row.variant.setup.clone(), point: row.point(error) })
            })
            .collect();
        let frame_ms = effect.rows.first().map_or(0.0, |r| r.frame_ms);
        next(&runners, effect.floor(self.truths, effect.judged_by, metric), frame_ms)
    }
}

#[cfg(test)]
mod tests;
