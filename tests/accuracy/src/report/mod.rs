//! The report of a sweep: every number as JSON, a row per variant as CSV, and a page to look at.
mod combination;
mod csv;
mod page;
mod text;

pub use combination::Combination;

use crate::AccuracyError;
use crate::front::{LEAST_OF_FRAME, Point, Standing, front, middle, quantile};
use crate::metrics::Comparison;
use crate::plan::Variant;
use crate::results::{Folder, IMAGES, Measurement, Run, StageCost, read_json, write_json, write_text};
use crate::truth::{SHARES, TruthInfo, truth_of};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the JSON: names and fields may be added, not changed.
const SCHEMA: u32 = 1;

/// Name of the report as JSON.
pub const REPORT_JSON: &str = "report.json";
/// Name of the report as CSV.
pub const REPORT_CSV: &str = "report.csv";
/// Name of the report as a page.
pub const REPORT_HTML: &str = "report.html";

/// A metric by which rows are ordered: 0 is no error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// Relative mean squared error.
    Relmse,
    /// Root mean squared error.
    Rmse,
    /// Symmetric mean absolute percentage error.
    Smape,
    /// FLIP over the exposures of the truth.
    FlipHdr,
    /// FLIP of what a display shows.
    FlipLdr,
    /// 1 less the structural similarity.
    Dssim,
}

impl Metric {
    /// All, the default first.
    pub const ALL: [Self; 6] = [Self::Relmse, Self::Rmse, Self::Smape, Self::FlipHdr, Self::FlipLdr, Self::Dssim];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Relmse => "relMSE",
            Self::Rmse => "RMSE",
            Self::Smape => "SMAPE",
            Self::FlipHdr => "FLIP (HDR)",
            Self::FlipLdr => "FLIP (LDR)",
            Self::Dssim => "1 - SSIM",
        }
    }

    /// In JSON.
    pub fn key(self) -> &'static str {
        match self {
            Self::Relmse => "relmse",
            Self::Rmse => "rmse",
            Self::Smape => "smape",
            Self::FlipHdr => "flip_hdr",
            Self::FlipLdr => "flip_ldr",
            Self::Dssim => "dssim",
        }
    }

    /// The error that it finds.
    pub fn of(self, comparison: &Comparison) -> f64 {
        match self {
            Self::Relmse => comparison.relmse,
            Self::Rmse => comparison.rmse,
            Self::Smape => comparison.smape,
            Self::FlipHdr => comparison.flip_hdr,
            Self::FlipLdr => comparison.flip_ldr,
            Self::Dssim => 1.0 - comparison.ssim,
        }
    }
}

/// By what a row is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Image {
    /// The slot's own image.
    Slot,
    /// The linear picture.
    Picture,
}

/// Whose time a row's price is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Price {
    /// Of the slot's own passes.
    Stage,
    /// Of the whole frame, as the slot's settings tell in the passes of others.
    Frame,
}

/// A slot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Its name.
    pub slot: String,
    /// By what its rows are judged: its own image, where that has a truth.
    pub judged_by: Image,
    /// The metric that is shown first and that a front stands for where none is named: relative error, but of a visibility, whose
    /// truth is 0 in large parts, the absolute one.
    pub metric: Metric,
    /// Whose time is the price.
    pub price: Price,
    /// Its variants.
    pub rows: Vec<Row>,
}

impl Effect {
    /// Whether a row is on the front that stands for this slot.
    pub fn is_front(&self, row: &Row) -> bool {
        row.is_front(self.judged_by, self.metric)
    }
}

/// Errors after so many frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowErrors {
    /// Frames, from 1.
    pub frame: u32,
    /// Of the slot's own image, where that has a truth.
    pub slot: Option<Comparison>,
    /// Of the linear picture.
    pub picture: Comparison,
}

/// A variant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What it is.
    pub variant: Variant,
    /// Its price, milliseconds: median over the rounds.
    pub ms: f64,
    /// Half of what the rounds spread around it, interquartile, milliseconds.
    pub spread_ms: f64,
    /// The price in every round.
    pub rounds_ms: Vec<f64>,
    /// The slot's own passes: medians over the rounds, and the least of all.
    pub stage: StageCost,
    /// The whole frame, milliseconds: median over the rounds.
    pub frame_ms: f64,
    /// The fastest frame of all.
    pub frame_min_ms: f64,
    /// Memory of transients as placed, bytes.
    pub transient_bytes: u64,
    /// Memory that is kept from frame to frame, bytes.
    pub history_bytes: u64,
    /// Acceleration structures, bytes.
    pub acceleration_bytes: u64,
    /// How wrong it is, frame by frame.
    pub errors: Vec<RowErrors>,
    /// Metrics whose last error cannot be told from none, as the truth itself is no better, by image.
    pub within_noise: BTreeMap<Image, Vec<Metric>>,
    /// Where it stands among the rows, by image and metric: of the last errors and the price.
    pub standing: BTreeMap<Image, BTreeMap<Metric, Standing>>,
}

impl Row {
    /// The last error of an image; none where it was not compared.
    pub fn error(&self, image: Image) -> Option<&Comparison> {
        let last = self.errors.last()?;
        match image {
            Image::Slot => last.slot.as_ref(),
            Image::Picture => Some(&last.picture),
        }
    }

    /// Whether nothing is better both in this error and in price.
    pub fn is_front(&self, image: Image, metric: Metric) -> bool {
        self.standing.get(&image).and_then(|s| s.get(&metric)).is_some_and(|s| s.is_front())
    }
}

/// Everything that a sweep found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of this file's names and fields.
    pub schema: u32,
    /// On what, of what, when.
    pub run: Run,
    /// What is known of the truths.
    pub truths: Vec<TruthInfo>,
    /// Slots in the order of the frame.
    pub effects: Vec<Effect>,
    /// How errors of the picture add up, for choosing a configuration; none where pictures are missing.
    pub combination: Option<Combination>,
}

impl Report {
    /// Makes the report of a folder's results.
    ///
    /// # Errors
    /// [`AccuracyError::Incomplete`] where a measurement is missing.
    pub fn build(folder: &Folder, path: &Path) -> Result<Self, AccuracyError> {
        folder.check_complete(path)?;
        let plan = &folder.run.plan;
        let effects = plan.slots().iter().map(|slot| effect(folder, slot)).collect();
        Ok(Self {
            schema: SCHEMA,
            run: folder.run.clone(),
            truths: folder.truths.clone(),
            effects,
            combination: Combination::read(plan, &path.join(IMAGES))?,
        })
    }

    /// Writes JSON, CSV and the page into a folder that holds the pictures.
    ///
    /// # Errors
    /// [`AccuracyError`].
    pub fn write(&self, folder: &Path) -> Result<(), AccuracyError> {
        write_json(&folder.join(REPORT_JSON), self)?;
        write_text(&folder.join(REPORT_CSV), &self.to_csv())?;
        write_text(&folder.join(REPORT_HTML), &self.to_html(&folder.join(IMAGES))?)
    }

    /// Reads the JSON of a folder.
    ///
    /// # Errors
    /// [`AccuracyError`].
    pub fn read(folder: &Path) -> Result<Self, AccuracyError> {
        read_json(&folder.join(REPORT_JSON))
    }

    /// The slot of that name.
    pub fn effect(&self, slot: &str) -> Option<&Effect> {
        self.effects.iter().find(|e| e.slot == slot)
    }
}

fn effect(folder: &Folder, slot: &str) -> Effect {
    let judged_by = if truth_of(slot).is_some() { Image::Slot } else { Image::Picture };
    // What rays see has no passes of its own while nothing moves; other stages trace faster or slower for it.
    let price = if slot == "acceleration" { Price::Frame } else { Price::Stage };
    let variants = folder.run.plan.variants.iter().filter(|v| v.slot == slot);
    let mut rows: Vec<Row> = variants.map(|variant| row(folder, variant, price)).collect();
    for image in [Image::Slot, Image::Picture] {
        let only = if image == Image::Slot { truth_of(slot).map_or("", |o| o.name()) } else { "all" };
        let floor = folder.truths.iter().find(|t| t.only == only).map(|t| &t.floor);
        for metric in Metric::ALL {
            rank(&mut rows, image, metric, floor.map_or(0.0, |f| metric.of(f)));
        }
    }
    let metric = if SHARES.contains(&slot) { Metric::Rmse } else { Metric::Relmse };
    Effect { slot: slot.to_owned(), judged_by, metric, price, rows }
}

fn rank(rows: &mut [Row], image: Image, metric: Metric, floor: f64) {
    let errors: Option<Vec<f64>> = rows.iter().map(|r| r.error(image).map(|c| metric.of(c))).collect();
    let Some(errors) = errors else { return };
    let points: Vec<Point> =
        errors.iter().zip(&*rows).map(|(error, row)| Point { error: *error, ms: row.rounds_ms.clone() }).collect();
    // The default of a slot comes first.
    let least_ms = LEAST_OF_FRAME * rows.first().map_or(0.0, |r| r.frame_ms);
    for ((row, standing), error) in rows.iter_mut().zip(front(&points, floor, least_ms)).zip(errors) {
        row.standing.entry(image).or_default().insert(metric, standing);
        if error <= floor {
            row.within_noise.entry(image).or_default().push(metric);
        }
    }
}

fn row(folder: &Folder, variant: &Variant, price: Price) -> Row {
    let mut all: Vec<&Measurement> = folder.measurements.iter().filter(|m| m.setup == variant.setup).collect();
    all.sort_by_key(|m| m.round);
    let of = || all.iter().filter(|m| m.round > 0);
    let stages: Vec<StageCost> = of().map(|m| m.cost.stages.get(&variant.slot).copied().unwrap_or_default()).collect();
    let mid = |value: &dyn Fn(&StageCost) -> f64| middle(&stages.iter().map(value).collect::<Vec<_>>());
    let least = |values: &mut dyn Iterator<Item = f64>| values.reduce(f64::min).unwrap_or(0.0);
    let stage = StageCost {
        ms: mid(&|s| s.ms),
        min_ms: least(&mut stages.iter().map(|s| s.min_ms)),
        trace_ms: mid(&|s| s.trace_ms),
        denoise_ms: mid(&|s| s.denoise_ms),
        rays_closest: mid(&|s| s.rays_closest as f64).round() as u64,
        rays_any: mid(&|s| s.rays_any as f64).round() as u64,
        passes: stages.iter().map(|s| s.passes).max().unwrap_or(0),
    };
    let frames: Vec<f64> = of().map(|m| m.cost.frame_ms).collect();
    let rounds_ms = match price {
        Price::Stage => stages.iter().map(|s| s.ms).collect(),
        Price::Frame => frames.clone(),
    };
    let errors = all.iter().flat_map(|m| &m.errors).map(|e| RowErrors {
        frame: e.frame,
        slot: e.slots.get(&variant.slot).copied(),
        picture: e.picture,
    });
    let most = |value: &dyn Fn(&Measurement) -> u64| of().map(|m| value(m)).max().unwrap_or(0);
    Row {
        variant: variant.clone(),
        ms: middle(&rounds_ms),
        spread_ms: 0.5 * (quantile(&rounds_ms, 0.75) - quantile(&rounds_ms, 0.25)),
        rounds_ms,
        stage,
        frame_ms: middle(&frames),
        frame_min_ms: least(&mut of().map(|m| m.cost.frame_min_ms)),
        transient_bytes: most(&|m| m.cost.transient_bytes),
        history_bytes: most(&|m| m.cost.history_bytes),
        acceleration_bytes: most(&|m| m.cost.acceleration_bytes),
        errors: errors.collect(),
        within_noise: BTreeMap::new(),
        standing: BTreeMap::new(),
    }
}

#[cfg(test)]
mod tests;
