//! The report on a terminal.
use super::{Effect, Report};
use crate::front::Standing;

impl Report {
    /// A table per slot: every row with its error and its price, and what dominates those that are not on the front.
    pub fn table(&self) -> String {
        let tables: Vec<String> = self.effects.iter().map(table).collect();
        tables.join("\n")
    }
}

fn table(effect: &Effect) -> String {
    let image = effect.judged_by;
    let of = match image {
        super::Image::Slot => "its own image",
        super::Image::Picture => "the picture",
    };
    let width = effect.rows.iter().map(|r| r.variant.label.chars().count()).max().unwrap_or(0);
    let mut text = format!("{}: {} of {of}, milliseconds\n", effect.slot, effect.metric.name());
    for (at, row) in effect.rows.iter().enumerate() {
        let error = row.error(image).map_or(f64::NAN, |c| effect.metric.of(c));
        let standing = row.standing.get(&image).and_then(|s| s.get(&effect.metric));
        let noise = row.within_noise.get(&image).is_some_and(|m| m.contains(&effect.metric));
        let place = match standing {
            Some(Standing::DominatedBy(by)) => format!("dominated by {}", by + 1),
            Some(Standing::Front) => "on the front".to_owned(),
            None => String::new(),
        };
        let (label, noise) = (&row.variant.label, if noise { ", within the truth's noise" } else { "" });
        let default = if row.variant.is_default { ", default" } else { "" };
        text += &format!("  {:>2} {label:<width$} {error:>12.6} {:>10.3}  {place}{noise}{default}\n", at + 1, row.ms);
    }
    text
}
