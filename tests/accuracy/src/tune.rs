//! From measured fronts to a configuration: the least error within a budget, or the least time within an error.
//!
//! Every slot takes a row of its own front. The time of a choice is the default frame's plus what each row takes more or less than its
//! slot's default; its error follows from how changes of the picture add up ([`Combination`]). Then the choice is rendered, and the
//! file says both what was promised and what was found.
use crate::AccuracyError;
use crate::measure::Bench;
use crate::plan::Setup;
use crate::report::{Combination, Effect, Price, Report, Row};
use crate::results::{Run, TRUTHS};
use crate::sweep::Subject;
use crate::truth::{PathTracer, TruthCache, TruthSource};
use magpie::config::{Catalogue, Config, STAGES, Value};
use magpie::prelude::Rays;
use magpie_passes::reference::{Only, ReferenceOptions};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Most combinations that are looked at. Where there are more, slots with many rows lose some of those in the middle.
const MOST: usize = 1_000_000;
/// Errors closer than this share count as the same: the cheaper choice is taken.
const SAME: f64 = 0.01;

/// What is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// The least error in so many milliseconds of the GPU per frame.
    Budget(f64),
    /// The least time with so much relative mean squared error of the picture.
    Error(f64),
}

/// A row of each slot.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Index of the row of each effect of the report, in its order.
    pub rows: Vec<usize>,
    /// Milliseconds of the GPU per frame that are expected.
    pub ms: f64,
    /// Relative mean squared error of the picture that is promised.
    pub relmse: f64,
}

/// What a choice came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Milliseconds of the GPU per frame, median.
    pub ms: f64,
    /// Relative mean squared error of the picture.
    pub relmse: f64,
}

/// A report to choose from.
#[derive(Debug)]
pub struct Tuner<'a> {
    report: &'a Report,
    combination: &'a Combination,
    /// Of each effect, the rows that may be chosen.
    candidates: Vec<Vec<usize>>,
    /// Of each effect, the default.
    defaults: Vec<usize>,
    frame_ms: f64,
}

impl<'a> Tuner<'a> {
    /// Reads what a report has to choose from. `path` is where it is from, for messages.
    ///
    /// # Errors
    /// [`AccuracyError::NotTunable`].
    pub fn new(report: &'a Report, path: &Path) -> Result<Self, AccuracyError> {
        let lacks = |lacks: &str| AccuracyError::NotTunable { path: path.to_owned(), lacks: lacks.to_owned() };
        let combination =
            report.combination.as_ref().ok_or_else(|| lacks("the pictures of its configurations are missing"))?;
        let (mut candidates, mut defaults) = (Vec::new(), Vec::new());
        for effect in &report.effects {
            let default = effect.rows.iter().position(|r| r.variant.is_default);
            let default = default.ok_or_else(|| lacks(&format!("the default of {} was not measured", effect.slot)))?;
            // Rows that were measured while the scene moved have no picture that adds up with the others.
            let known = |row: &Row| combination.setups.contains(&row.variant.setup);
            let on_front = |row: &Row| effect.is_front(row) && known(row);
            let front: Vec<usize> = (0..effect.rows.len()).filter(|&at| on_front(&effect.rows[at])).collect();
            candidates.push(if front.is_empty() { vec![default] } else { front });
            defaults.push(default);
        }
        while candidates.iter().map(Vec::len).product::<usize>() > MOST {
            let Some(longest) = candidates.iter_mut().max_by_key(|c| c.len()) else { break };
            let middle = longest.len() / 2;
            longest.remove(middle);
        }
        let frame_ms = report.effects.iter().zip(&defaults).map(|(e, at)| e.rows[*at].frame_ms).next();
        let frame_ms = frame_ms.ok_or_else(|| lacks("nothing was measured"))?;
        Ok(Self { report, combination, candidates, defaults, frame_ms })
    }

    /// What a choice of rows is expected to come to.
    pub fn promise(&self, rows: &[usize]) -> Choice {
        let mut ms = self.frame_ms;
        let mut setups = Vec::new();
        for ((effect, &at), &default) in self.report.effects.iter().zip(rows).zip(&self.defaults) {
            ms += effect.rows[at].ms - effect.rows[default].ms;
            setups.push(effect.rows[at].variant.setup.as_str());
        }
        Choice { rows: rows.to_vec(), ms, relmse: self.combination.relmse(setups) }
    }

    /// Every combination of candidates.
    fn all(&self) -> Vec<Choice> {
        let mut rows: Vec<Vec<usize>> = vec![Vec::new()];
        for candidates in &self.candidates {
            let with = |row: &Vec<usize>, at: usize| row.iter().copied().chain([at]).collect();
            rows = rows.iter().flat_map(|row| candidates.iter().map(move |&at| with(row, at))).collect();
        }
        rows.iter().map(|rows| self.promise(rows)).collect()
    }

    /// The combinations of which none is both cheaper and more accurate, from the cheapest to the most accurate.
    pub fn front(&self) -> Vec<Choice> {
        let mut all = self.all();
        all.sort_by(|a, b| a.ms.total_cmp(&b.ms).then(a.relmse.total_cmp(&b.relmse)).then(a.rows.cmp(&b.rows)));
        let mut front: Vec<Choice> = Vec::new();
        for choice in all {
            if front.last().is_none_or(|last| choice.relmse < last.relmse) {
                front.push(choice);
            }
        }
        front
    }

    /// The choice that meets a goal. Of choices within the budget whose errors differ by less than 1 %, the cheapest.
    ///
    /// # Errors
    /// [`AccuracyError::Unreachable`], which says what comes nearest.
    pub fn choose(&self, goal: Goal) -> Result<Choice, AccuracyError> {
        let front = self.front();
        let (cheapest, best) = (front.first(), front.last());
        match goal {
            Goal::Budget(budget) => {
                let affordable: Vec<&Choice> = front.iter().take_while(|c| c.ms <= budget).collect();
                let least = affordable.last().map(|c| c.relmse * (1.0 + SAME));
                let found = affordable.into_iter().find(|c| least.is_some_and(|least| c.relmse <= least));
                found.cloned().ok_or_else(|| AccuracyError::Unreachable {
                    wanted: format!("--budget-ms {budget}"),
                    nearest: format!("cheapest takes {:.3} ms", cheapest.map_or(f64::NAN, |c| c.ms)),
                })
            }
            Goal::Error(error) => {
                let found = front.iter().find(|c| c.relmse <= error);
                found.cloned().ok_or_else(|| AccuracyError::Unreachable {
                    wanted: format!("--max-error {error}"),
                    nearest: format!("most accurate has a relMSE of {}", figure(best.map_or(f64::NAN, |c| c.relmse))),
                })
            }
        }
    }

    /// The configuration of a choice: what was measured around, with every slot's row laid over it.
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

    /// The configuration as TOML, with a comment on every line that says what it costs and buys.
    pub fn to_toml(&self, choice: &Choice, goal: Goal, found: Option<Found>, catalogue: &Catalogue) -> String {
        let (run, config) = (&self.report.run, self.config(choice));
        let wanted = match goal {
            Goal::Budget(ms) => format!("the least error within {ms} ms"),
            Goal::Error(error) => format!("the least time within a relMSE of {error}"),
        };
        let mut toml = format!(
            "# magpie tune: {wanted}, of {} at {}x{}\n# on {} ({}), measured {}, commit {}\n",
            run.scene, run.size[0], run.size[1], run.device.name, run.device.driver, run.date, run.commit
        );
        let _ = writeln!(
            toml,
            "# promised: relMSE {} of the picture, {:.3} ms of the GPU per frame",
            figure(choice.relmse),
            choice.ms
        );
        if let Some(found) = found {
            let off = 100.0 * (found.relmse / choice.relmse - 1.0);
            let _ = writeln!(toml, "# rendered: relMSE {} ({off:+.1} %), {:.3} ms", figure(found.relmse), found.ms);
        }
        let _ = writeln!(
            toml,
            "# defaults: relMSE {}, {:.3} ms\n\n[{STAGES}]",
            figure(self.combination.relmse([])),
            self.frame_ms
        );
        let mut lines: Vec<(String, String)> = Vec::new();
        for (slot, implementation) in &config.stages {
            lines.push((format!("{slot} = \"{implementation}\""), self.about_slot(choice, slot)));
        }
        aligned(&mut toml, &lines);
        for (slot, values) in &config.settings {
            let specs = catalogue.slot(slot).and_then(|s| s.implementation(config.stages.get(slot)?));
            let lines: Vec<(String, String)> = values
                .iter()
                .map(|(key, value)| {
                    let unit = specs.and_then(|i| i.settings.iter().find(|s| s.key == key)).map_or("", |s| s.unit);
                    (format!("{key} = {}", toml_value(value)), self.about_setting(choice, slot, key, unit))
                })
                .collect();
            let _ = writeln!(toml, "\n[{slot}]");
            aligned(&mut toml, &lines);
        }
        toml
    }

    fn place(&self, slot: &str) -> Option<(usize, &Effect)> {
        self.report.effects.iter().enumerate().find(|(_, e)| e.slot == slot)
    }

    /// What a slot's row costs, and what the next ones on its front would change.
    fn about_slot(&self, choice: &Choice, slot: &str) -> String {
        let Some((place, effect)) = self.place(slot) else { return "not measured: as by default".to_owned() };
        let at = choice.rows[place];
        let row = &effect.rows[at];
        let of_what = if effect.price == Price::Frame { " of the whole frame" } else { "" };
        let mut text = format!("{:.3} ms{of_what}", row.ms);
        if effect.rows.len() < 2 {
            return text;
        }
        let others = self.candidates[place].iter().copied().filter(|&o| o != at);
        let (mut cheaper, mut better): (Option<usize>, Option<usize>) = (None, None);
        for other in others {
            let ms = |at: usize| effect.rows[at].ms;
            if ms(other) < ms(at) && cheaper.is_none_or(|c| ms(other) > ms(c)) {
                cheaper = Some(other);
            }
            if ms(other) >= ms(at) && better.is_none_or(|b| ms(other) < ms(b)) {
                better = Some(other);
            }
        }
        for other in [cheaper, better].into_iter().flatten() {
            text += &format!("; {}", self.instead(choice, place, other));
        }
        if cheaper.is_none() && better.is_none() {
            text += "; nothing else is on its front";
        }
        text
    }

    /// `"off" would save 3.1 ms, relMSE 0.21 -> 0.45`.
    fn instead(&self, choice: &Choice, place: usize, other: usize) -> String {
        let mut rows = choice.rows.clone();
        rows[place] = other;
        let (new, label) = (self.promise(&rows), &self.report.effects[place].rows[other].variant.label);
        let by = new.ms - choice.ms;
        let time = if by < 0.0 { format!("would save {:.3} ms", -by) } else { format!("would cost {by:.3} ms more") };
        format!("\"{label}\" {time}, relMSE {} -> {}", figure(choice.relmse), figure(new.relmse))
    }

    /// What another value of a setting would change.
    fn about_setting(&self, choice: &Choice, slot: &str, key: &str, unit: &str) -> String {
        let unit = if unit.is_empty() { String::new() } else { format!("{unit}; ") };
        let Some((place, effect)) = self.place(slot) else { return format!("{unit}not measured: as by default") };
        let row = &effect.rows[choice.rows[place]];
        if !row.variant.settings.contains_key(key) {
            return format!("{unit}does not trade accuracy for time");
        }
        let differs_in_key = |other: &Row| {
            let (a, b) = (&row.variant, &other.variant);
            a.implementation == b.implementation
                && a.settings.len() == b.settings.len()
                && a.settings.iter().all(|(k, value)| (b.settings.get(k) == Some(value)) == (k != key))
        };
        let known = |other: &Row| self.combination.setups.contains(&other.variant.setup);
        match effect.rows.iter().position(|other| differs_in_key(other) && known(other)) {
            Some(other) => format!("{unit}{}", self.instead(choice, place, other)),
            None => format!("{unit}as by default"),
        }
    }
}

/// Renders a choice as the report's rows were rendered, and says what it came to.
///
/// # Errors
/// [`AccuracyError::Different`] where scene or camera are not those of the report, and whatever rendering says.
pub fn verify(
    subject: &Subject<'_>,
    report: &Report,
    folder: &Path,
    config: &Config,
    rays: Rays,
) -> Result<Found, AccuracyError> {
    let run = &report.run;
    let [width, height] = run.size;
    let options =
        ReferenceOptions { width, height, seed: run.seed, time: run.time, rays, ..ReferenceOptions::default() };
    let mut tracer = PathTracer::new(subject.gpu, subject.scene, subject.camera, options);
    let (got, wanted) = (run.subject.clone(), tracer.subject(Only::All));
    if got != wanted {
        return Err(AccuracyError::Different { path: folder.to_owned(), what: "the scene or its camera", got, wanted });
    }
    let cache = TruthCache::new(&folder.join(TRUTHS), run.samples, run.seed)?;
    let truth = cache.get(&mut tracer, Only::All, &mut |_| {})?;
    let truths = BTreeMap::from([(String::new(), truth)]);
    let setup = Setup {
        id: "tuned".to_owned(),
        label: "tuned".to_owned(),
        config: config.clone(),
        slots: Vec::new(),
        moving: false,
    };
    let mut bench = Bench::new(subject.gpu, subject.scene, subject.camera, rays, subject.slots);
    let (first, _) = bench.measure(&setup, 0, run, &truths)?;
    let mut times = Vec::new();
    for round in 1..=run.rounds {
        times.push(bench.measure(&setup, round, run, &truths)?.0.cost.frame_ms);
    }
    let lacks = || AccuracyError::Lacks { setup: setup.label.clone(), frame: 1, what: "an error".to_owned() };
    let relmse = first.errors.last().ok_or_else(lacks)?.picture.relmse;
    Ok(Found { ms: crate::front::middle(&times), relmse })
}

/// Whether this is the device of the report; its times mean nothing on another.
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

fn toml_value(value: &Value) -> String {
    match value {
        // A float without a point would be read as a whole number, which is fine; with one it is what it was.
        Value::Float(x) => format!("{x:?}"),
        other => other.to_string(),
    }
}

/// Lines with their comments below each other.
fn aligned(toml: &mut String, lines: &[(String, String)]) {
    let width = lines.iter().map(|(line, _)| line.chars().count()).max().unwrap_or(0);
    for (line, comment) in lines {
        let _ = writeln!(toml, "{line:<width$}  # {comment}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made_up::{catalogue, report};

    #[test]
    fn the_budget_buys_the_least_error_and_the_choice_is_on_the_front() {
        let report = report();
        let tuner = Tuner::new(&report, Path::new("made up")).unwrap();
        let front = tuner.front();
        assert!(front.len() > 2, "{front:#?}");
        for pair in front.windows(2) {
            assert!(pair[0].ms < pair[1].ms && pair[0].relmse > pair[1].relmse);
        }
        let all = tuner.all();
        for budget in [front[0].ms, front[1].ms, 0.5 * (front[1].ms + front[2].ms), 1000.0] {
            let choice = tuner.choose(Goal::Budget(budget)).unwrap();
            assert!(choice.ms <= budget && front.contains(&choice));
            let least = all.iter().filter(|c| c.ms <= budget).map(|c| c.relmse).fold(f64::INFINITY, f64::min);
            assert!(choice.relmse <= least * 1.01, "{budget}: {} {least}", choice.relmse);
            for (effect, at) in report.effects.iter().zip(&choice.rows) {
                assert!(effect.is_front(&effect.rows[*at]));
            }
        }
        let message = tuner.choose(Goal::Budget(0.001)).unwrap_err().to_string();
        assert!(message.contains("--budget-ms 0.001") && message.contains("cheapest takes"), "{message}");
    }

    #[test]
    fn an_error_is_met_at_the_least_price() {
        let report = report();
        let tuner = Tuner::new(&report, Path::new("made up")).unwrap();
        let front = tuner.front();
        let wanted = front[1].relmse;
        let choice = tuner.choose(Goal::Error(wanted)).unwrap();
        assert_eq!(choice, front[1]);
        assert!(tuner.choose(Goal::Error(1e-12)).unwrap_err().to_string().contains("most accurate has a relMSE"));
    }

    #[test]
    fn the_default_promises_what_was_measured() {
        let report = report();
        let tuner = Tuner::new(&report, Path::new("made up")).unwrap();
        let defaults = tuner.promise(&tuner.defaults);
        assert!((defaults.ms - 40.0).abs() < 1e-9);
        assert!((defaults.relmse - report.combination.as_ref().unwrap().products[0][0]).abs() < 1e-12);
        assert_eq!(tuner.config(&defaults), report.run.plan.default_setup().unwrap().config);
    }

    #[test]
    fn the_file_reads_back_and_every_line_has_a_comment() {
        let report = report();
        let tuner = Tuner::new(&report, Path::new("made up")).unwrap();
        for goal in [Goal::Budget(35.0), Goal::Budget(100.0), Goal::Error(0.4)] {
            let choice = tuner.choose(goal).unwrap();
            let found = Found { ms: choice.ms, relmse: 1.1 * choice.relmse };
            let text = tuner.to_toml(&choice, goal, Some(found), &catalogue());
            let config = Config::from_toml(&text, "tuned").unwrap();
            catalogue().check(&config, "tuned").unwrap();
            assert_eq!(config, tuner.config(&choice), "{text}");
            assert!(text.contains("(+10.0 %)"), "{text}");
            for line in text.lines().filter(|l| l.contains(" = ")) {
                assert!(line.contains("  # "), "{line}");
            }
        }
        let text = tuner.to_toml(&tuner.choose(Goal::Budget(100.0)).unwrap(), Goal::Budget(100.0), None, &catalogue());
        assert!(text.contains("would save"), "{text}");
    }
}
