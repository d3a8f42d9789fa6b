//! Results of `magpie bench lights` as a table, JSON and charts.
use super::{LightsOptions, Measured, Row};
use crate::chart::{Axis, Chart, ChartError, Colour, Line};
use magpie::gpu::Gpu;
use serde::Serialize;
use std::fmt::Write;

/// Results of a run.
#[derive(Clone, Debug, Serialize)]
pub struct LightsReport {
    /// Version of Magpie.
    pub magpie: &'static str,
    /// Commit of the build.
    pub commit: String,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Samples per pixel of the ground truth.
    pub truth_samples: u32,
    /// Results of every contestant with every number of lamps.
    pub rows: Vec<Row>,
}

impl LightsReport {
    pub(super) fn new(gpu: &Gpu, options: &LightsOptions, rows: Vec<Row>) -> Self {
        let report = gpu.report();
        Self {
            magpie: env!("CARGO_PKG_VERSION"),
            commit: options.commit.clone(),
            device: report.name.clone(),
            driver: report.driver.clone(),
            size: options.size,
            truth_samples: options.truth_samples,
            rows,
        }
    }

    /// The report as JSON.
    ///
    /// # Errors
    /// Any error of the serialiser.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }

    /// A Markdown table, a line for each number of lamps and contestant.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "direct light of a square under lamps, {}x{}, truth of {} samples\n\n",
            self.size[0], self.size[1], self.truth_samples
        );
        text += "| lamps | | ms | error | root of relMSE | that · √ms | light | ms, denoised | error | root of relMSE | frames |\n";
        text += "|---|---|---|---|---|---|---|---|---|---|---|\n";
        for Row { lamps, contestant, raw, denoised } in &self.rows {
            let ms = |of: &Measured| of.ms.map_or("-".to_owned(), |ms| format!("{ms:.2}"));
            let worth = raw.ms.map_or("-".to_owned(), |ms| format!("{:.2}", raw.relmse * ms.sqrt()));
            let _ = writeln!(
                text,
                "| {lamps} | {contestant} | {} | {:.3} | {:.2} | {worth} | {:.3} | {} | {:.3} | {:.2} | {} |",
                ms(raw),
                raw.error,
                raw.relmse,
                raw.light,
                ms(denoised),
                denoised.error,
                denoised.relmse,
                raw.frames
            );
        }
        text
    }

    /// Charts as file names without a folder and SVG texts: time, error, and error of equal time over the number of lamps.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn charts(&self) -> Result<Vec<(String, String)>, ChartError> {
        let mut names: Vec<&str> = Vec::new();
        for row in &self.rows {
            if !names.contains(&row.contestant) {
                names.push(row.contestant);
            }
        }
        let colours = [Colour::PURPLE, Colour::BLUE, Colour::VERMILION, Colour::GREEN];
        let draw = |file: &str, title: &str, y: &'static str, pick: &dyn Fn(&Row) -> Option<f64>| {
            let line = |(at, name): (usize, &&str)| Line {
                label: (*name).to_owned(),
                colour: colours[at % colours.len()],
                dashed: at >= colours.len(),
                width: 2,
                points: self
                    .rows
                    .iter()
                    .filter(|row| row.contestant == *name)
                    .filter_map(|row| Some((f64::from(row.lamps), pick(row)?)))
                    .collect(),
            };
            let lines = names.iter().enumerate().map(line).collect();
            let x = Axis { name: "lamps", log: true };
            let chart = Chart { title: title.to_owned(), x, y: Axis { name: y, log: true }, lines };
            Ok((file.to_owned(), chart.svg()?))
        };
        let worth = |row: &Row| Some(row.raw.relmse * row.raw.ms?.sqrt());
        Ok(vec![
            draw("lights-time.svg", "Time of direct light, no denoiser", "ms", &|row| row.raw.ms)?,
            draw("lights-error.svg", "Error of a frame, no denoiser", "mean relative error", &|row| {
                Some(row.raw.error)
            })?,
            draw("lights-worth.svg", "Error at equal time, no denoiser", "root of relMSE times root of ms", &worth)?,
            draw("lights-denoised.svg", "Error of a frame, denoised", "mean relative error", &|row| {
                Some(row.denoised.error)
            })?,
        ])
    }
}
