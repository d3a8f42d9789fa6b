//! The report as text.
use super::{Effect, Image, Report, RowErrors};
use crate::front::Standing;

impl Report {
    /// A table per slot: every row with its error, at rest and in motion, and its price, each with its uncertainty, and the dominating row
    /// for those that are not on the front.
    pub fn table(&self) -> String {
        let mut tables: Vec<String> = self.effects.iter().map(table).collect();
        if !self.unreached.is_empty() {
            let labels: Vec<String> =
                self.unreached.iter().map(|(slot, label)| format!("  {slot}: {label}\n")).collect();
            tables.push(format!("no time was left for\n{}", labels.concat()));
        }
        tables.join("\n")
    }
}

fn table(effect: &Effect) -> String {
    let (image, metric) = (effect.judged_by, effect.metric);
    let width = effect.rows.iter().map(|r| r.variant.label.chars().count()).max().unwrap_or(0);
    let of = |errors: Option<&RowErrors>| errors.map_or("-".to_owned(), |e| format!("{:.5}", metric.of(&e.picture)));
    let mut text = format!(
        "{}: {} of {}, each with what another frame changes; of the picture in motion; milliseconds with their 95 % interval; rounds; \
         how sure the place is\n",
        effect.slot,
        metric.name(),
        image.name()
    );
    for (at, row) in effect.rows.iter().enumerate() {
        let error = row.error(image).map_or(f64::NAN, |c| metric.of(c));
        let standing = row.standing.get(&image).and_then(|s| s.get(&metric));
        let noise = row.within_noise.get(&image).is_some_and(|m| m.contains(&metric));
        let place = match standing {
            Some(Standing::DominatedBy(by)) => format!("dominated by {}", by + 1),
            Some(Standing::Front) => "on the front".to_owned(),
            None => String::new(),
        };
        let (label, noise) = (&row.variant.label, if noise { ", within the truth's noise" } else { "" });
        let default = if row.variant.is_default { ", default" } else { "" };
        let moving = if image == Image::Moving { "-".to_owned() } else { of(row.moving.as_ref()) };
        text += &format!(
            "  {:>2} {label:<width$} {error:>9.5} ±{:<8.5} {moving:>8} {:>10.3} ±{:<7.3} {:>2} {:>4.0} %  {place}{noise}{default}\n",
            at + 1,
            row.error_interval,
            row.ms,
            row.ms_interval,
            row.rounds.len(),
            100.0 * row.sure,
        );
    }
    text
}
