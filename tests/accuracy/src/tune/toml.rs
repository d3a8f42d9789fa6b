//! A choice as a commented configuration file.
use super::{Choice, Goal, Tuner, figure};
use crate::report::{Effect, Row, TimeScope};
use magpie::config::{Catalogue, STAGES, Value};
use std::fmt::Write;

impl Tuner<'_> {
    /// The configuration as TOML, with comments on cost and benefit of every line.
    pub fn to_toml(&self, choice: &Choice, goal: Goal, catalogue: &Catalogue) -> String {
        let (run, config, metric) = (&self.report.run, self.config(choice), self.metric);
        let wanted = match goal {
            Goal::Budget(ms) => format!("the least {metric} within {ms} ms"),
            Goal::Error(error) => format!("the least time within a {metric} of {error}"),
        };
        let mut toml = format!(
            "# magpie tune: {wanted}, of {} at {}x{}\n# on {} ({}), measured {}, commit {}\n",
            run.scene, run.size[0], run.size[1], run.device.name, run.device.driver, run.date, run.commit
        );
        let how = if choice.found.is_some() { "rendered" } else { "not rendered" };
        let (error, ms) = (figure(choice.error()), choice.ms());
        let _ = writeln!(toml, "# promised: {metric} {error} of the picture, {ms:.3} ms of the GPU per frame ({how})");
        if let Some(found) = choice.found {
            let off = |predicted: f64, found: f64| 100.0 * (predicted / found - 1.0);
            let (error, ms) = (choice.predicted_error, choice.predicted_ms);
            let _ = writeln!(
                toml,
                "# predicted: {metric} {} ({:+.1} %), {ms:.3} ms ({:+.1} %)",
                figure(error),
                off(error, found.error),
                off(ms, found.ms)
            );
            let _ = writeln!(toml, "# brightness: {:+.2} stops beside the truth", found.stops);
        }
        let default = self.predict(&self.defaults).map_or(f64::NAN, |d| d.predicted_error);
        let _ = writeln!(toml, "# defaults: {metric} {}, {:.3} ms\n\n[{STAGES}]", figure(default), self.frame_ms);
        let mut lines: Vec<(String, String)> = Vec::new();
        for (slot, implementation) in &config.stages {
            lines.push((format!("{slot} = \"{implementation}\""), self.slot_comment(choice, slot)));
        }
        aligned(&mut toml, &lines);
        for (slot, values) in &config.settings {
            let specs = catalogue.slot(slot).and_then(|s| s.implementation(config.stages.get(slot)?));
            let lines: Vec<(String, String)> = values
                .iter()
                .map(|(key, value)| {
                    let unit = specs.and_then(|i| i.settings.iter().find(|s| s.key == key)).map_or("", |s| s.unit);
                    (format!("{key} = {}", toml_value(value)), self.setting_comment(choice, slot, key, unit))
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

    /// Cost of a slot's row, and the effect of its neighbours on the front.
    fn slot_comment(&self, choice: &Choice, slot: &str) -> String {
        let Some((place, effect)) = self.place(slot) else { return "not measured: as by default".to_owned() };
        let at = choice.rows[place];
        let row = &effect.rows[at];
        let of_what = if effect.time_scope == TimeScope::Frame { " of the whole frame" } else { "" };
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
            text += &format!("; {}", self.effect_of_change(choice, place, other));
        }
        if cheaper.is_none() && better.is_none() {
            text += "; nothing else is on its front";
        }
        text
    }

    /// `"off" would save 3.1 ms, relMSE 0.21 -> 0.45`.
    fn effect_of_change(&self, choice: &Choice, place: usize, other: usize) -> String {
        let mut rows = choice.rows.clone();
        rows[place] = other;
        let label = &self.report.effects[place].rows[other].variant.label;
        // Both are predictions, as a measured result of only one would not show the effect of the change.
        let Ok(new) = self.predict(&rows) else { return format!("\"{label}\" cannot be compared") };
        let by = new.predicted_ms - choice.predicted_ms;
        let time = if by < 0.0 { format!("would save {:.3} ms", -by) } else { format!("would cost {by:.3} ms more") };
        let (before, after) = (figure(choice.predicted_error), figure(new.predicted_error));
        format!("\"{label}\" {time}, {} {before} -> {after}", self.metric)
    }

    /// Effect of another value of a setting.
    fn setting_comment(&self, choice: &Choice, slot: &str, key: &str, unit: &str) -> String {
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
        let default = self.report.run.plan.default_setup().map_or("", |s| s.id.as_str());
        let known = |other: &Row| self.composer.knows(&other.variant.setup, default);
        match effect.rows.iter().position(|other| differs_in_key(other) && known(other)) {
            Some(other) => format!("{unit}{}", self.effect_of_change(choice, place, other)),
            None => format!("{unit}as by default"),
        }
    }
}

fn toml_value(value: &Value) -> String {
    match value {
        // A float without a decimal point would be read as an integer, which is accepted; with it the value is unchanged.
        Value::Float(x) => format!("{x:?}"),
        other => other.to_string(),
    }
}

/// Appends the lines with aligned comments.
fn aligned(toml: &mut String, lines: &[(String, String)]) {
    let width = lines.iter().map(|(line, _)| line.chars().count()).max().unwrap_or(0);
    for (line, comment) in lines {
        let _ = writeln!(toml, "{line:<width$}  # {comment}");
    }
}
