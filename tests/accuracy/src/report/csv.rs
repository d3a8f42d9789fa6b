//! CSV of a report, a row per variant.
use super::{Image, Metric, Report, Row};
use std::fmt::Write;

/// Columns before the errors.
const COLUMNS: &str = "slot,implementation,settings,default,setup,ms,spread_ms,stage_ms,stage_min_ms,trace_ms,denoise_ms,passes,\
                       rays_closest,rays_any,frame_ms,frame_min_ms,transient_bytes,history_bytes,acceleration_bytes,frame,on_front,\
                       dominated_by";
/// Columns after the errors and presets.
const LAST: &str = "rounds,ms_interval,error_interval,sure";

impl Report {
    /// The report as CSV (RFC 4180) with a header. Errors are those after the last frame: `slot_…` of the slot's own image, empty if it has
    /// no ground truth, `picture_…` of the picture, `moving_…` of the picture after the camera has moved. `on_front` and `dominated_by`
    /// refer to the metric and image that the page shows first.
    pub fn to_csv(&self) -> String {
        let mut csv = COLUMNS.to_owned();
        for image in Image::ALL.map(Image::word) {
            for metric in Metric::ALL {
                let _ = write!(csv, ",{image}_{}", metric.key());
            }
            let _ = write!(csv, ",{image}_psnr");
        }
        let _ = writeln!(csv, ",presets,{LAST}");
        for effect in &self.effects {
            for row in &effect.rows {
                let by = row.standing.get(&effect.judged_by).and_then(|s| s.get(&effect.metric));
                let better = match by {
                    Some(crate::front::Standing::DominatedBy(at)) => effect.rows.get(*at).map(|r| &r.variant.label),
                    _ => None,
                };
                line(&mut csv, row, effect.is_front(row), better.map_or("", String::as_str));
            }
        }
        csv
    }
}

fn line(csv: &mut String, row: &Row, is_front: bool, better: &str) {
    let (variant, stage) = (&row.variant, &row.stage);
    let settings: Vec<String> = variant.settings.iter().map(|(key, value)| format!("{key}={value}")).collect();
    let _ = write!(
        csv,
        "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
        quoted(&variant.slot),
        quoted(&variant.implementation),
        quoted(&settings.join("; ")),
        variant.is_default,
        variant.setup,
        row.ms,
        row.spread_ms,
        stage.ms,
        stage.min_ms,
        stage.trace_ms,
        stage.denoise_ms,
        stage.passes,
        stage.rays_closest,
        stage.rays_any,
        row.frame_ms,
        row.frame_min_ms,
        row.transient_bytes,
        row.history_bytes,
        row.acceleration_bytes,
        row.errors.last().map_or(0, |e| e.frame),
        is_front,
        quoted(better),
    );
    for image in Image::ALL {
        let comparison = row.error(image);
        for metric in Metric::ALL {
            let _ = write!(csv, ",{}", comparison.map_or(String::new(), |c| metric.of(c).to_string()));
        }
        let _ = write!(csv, ",{}", comparison.and_then(|c| c.psnr).map_or(String::new(), |p| p.to_string()));
    }
    let presets = quoted(&variant.presets.join(" "));
    let _ = writeln!(csv, ",{presets},{},{},{},{}", row.rounds.len(), row.ms_interval, row.error_interval, row.sure);
}

/// Quotes a field if it contains special characters.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
