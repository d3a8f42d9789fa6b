//! The report of a sweep: every number as JSON, a row per variant as CSV, and a page to look at.
mod combination;
mod csv;
mod page;
mod text;

pub use combination::Combination;

pub use crate::metric::{Image, Judge, Metric};

use crate::AccuracyError;
use crate::front::{LEAST_OF_FRAME, Point, Standing, interval, middle, quantile};
use crate::measure::AREA;
use crate::metrics::Comparison;
use crate::plan::Variant;
use crate::race::certainties;
use crate::results::{Errors, Folder, IMAGES, Measurement, Run, StageCost, read_json, write_json, write_text};
use crate::truth::{TruthInfo, truth_of};
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
    /// By which image its rows are judged: that of the run, or the picture where the slot has no such image.
    pub judged_by: Image,
    /// The metric that is shown first and that a front stands for where none is named: that of the run.
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

    /// What this metric finds between two truths of such an image that are equally good.
    pub fn floor(&self, truths: &[TruthInfo], image: Image, metric: Metric) -> f64 {
        let area = if self.slot == AREA { "_area" } else { "" };
        let name = match image {
            Image::Slot => truth_of(&self.slot).map_or("none", |o| o.name()).to_owned(),
            Image::Picture => format!("all{area}"),
            Image::Moving => format!("all_moving{area}"),
        };
        truths.iter().find(|t| t.only == name).map_or(0.0, |t| metric.of(&t.floor))
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
    /// Which rounds these are. Two rows were timed one after the other in those that both have.
    #[serde(default)]
    pub rounds: Vec<u32>,
    /// Half of a 95 % interval around the price, milliseconds.
    #[serde(default)]
    pub ms_interval: f64,
    /// By how much the error that rows are judged by changes from one frame to the next, at rest.
    #[serde(default)]
    pub error_interval: f64,
    /// How sure its place is among the rows, by what they are judged by: from 0 to 1.
    #[serde(default)]
    pub sure: f64,
    /// All stages, milliseconds: median over the rounds.
    #[serde(default)]
    pub stages_ms: BTreeMap<String, f64>,
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
    /// How wrong the picture is after the camera has moved, where that was measured.
    #[serde(default)]
    pub moving: Option<RowErrors>,
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
            Image::Moving => self.moving.as_ref().map(|m| &m.picture),
        }
    }

    /// As a front sees it, with this error.
    pub fn point(&self, error: f64) -> Point {
        Point { error, ms: self.rounds.iter().copied().zip(self.rounds_ms.iter().copied()).collect() }
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
    /// What a race had no time for: slot and label.
    #[serde(default)]
    pub unreached: Vec<(String, String)>,
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
        let (run, plan) = (&folder.run, &folder.run.plan);
        let of = |slot: &String| effect(run, &folder.measurements, &folder.truths, slot);
        let is_there = |v: &&Variant| folder.measurements.iter().any(|m| m.setup == v.setup && m.round == 0);
        let unreached = plan.variants.iter().filter(|v| !is_there(v)).map(|v| (v.slot.clone(), v.label.clone()));
        Ok(Self {
            schema: SCHEMA,
            run: run.clone(),
            truths: folder.truths.clone(),
            effects: plan.slots().iter().map(of).collect(),
            unreached: unreached.collect(),
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

/// What was found of a slot. Rows that were not measured are left out.
pub(crate) fn effect(run: &Run, measurements: &[Measurement], truths: &[TruthInfo], slot: &str) -> Effect {
    let variants = run.plan.variants.iter().filter(|v| v.slot == slot);
    // These change what other stages take: what rays see has no passes of its own while nothing moves, and `post` says how many
    // pixels there are.
    let price = if ["acceleration", AREA].contains(&slot) { Price::Frame } else { Price::Stage };
    let rows: Vec<Row> = variants.filter_map(|variant| row(run, measurements, variant, price)).collect();
    let Judge { metric, image } = run.judge;
    let has = |image: Image| !rows.is_empty() && rows.iter().all(|r| r.error(image).is_some());
    let judged_by = if has(image) { image } else { Image::Picture };
    let mut effect = Effect { slot: slot.to_owned(), judged_by, metric, price, rows };
    for image in Image::ALL {
        for metric in Metric::ALL {
            let floor = effect.floor(truths, image, metric);
            rank(&mut effect, image, metric, floor);
        }
    }
    effect
}

fn rank(effect: &mut Effect, image: Image, metric: Metric, floor: f64) {
    let is_judge = (image, metric) == (effect.judged_by, effect.metric);
    let errors: Option<Vec<f64>> = effect.rows.iter().map(|r| r.error(image).map(|c| metric.of(c))).collect();
    let Some(errors) = errors else { return };
    let points: Vec<Point> = errors.iter().zip(&effect.rows).map(|(error, row)| row.point(*error)).collect();
    // The default of a slot comes first.
    let least_ms = LEAST_OF_FRAME * effect.rows.first().map_or(0.0, |r| r.frame_ms);
    let (standings, sure) = certainties(&points, floor, least_ms);
    for (((row, standing), error), sure) in effect.rows.iter_mut().zip(standings).zip(errors).zip(sure) {
        row.standing.entry(image).or_default().insert(metric, standing);
        if error <= floor {
            row.within_noise.entry(image).or_default().push(metric);
        }
        if is_judge {
            row.sure = sure.sure;
            row.error_interval = change(row, image, metric);
        }
    }
}

/// By how much an error changes between the last two frames that were compared.
fn change(row: &Row, image: Image, metric: Metric) -> f64 {
    let of = |errors: &RowErrors| match image {
        Image::Slot => errors.slot.as_ref().map(|c| metric.of(c)),
        _ => Some(metric.of(&errors.picture)),
    };
    match row.errors.as_slice() {
        [.., before, last] if before.frame + 1 == last.frame => {
            of(before).zip(of(last)).map_or(0.0, |(before, last)| (last - before).abs())
        }
        _ => 0.0,
    }
}

/// A row; none where it was not measured.
fn row(run: &Run, measurements: &[Measurement], variant: &Variant, price: Price) -> Option<Row> {
    let mut all: Vec<&Measurement> = measurements.iter().filter(|m| m.setup == variant.setup).collect();
    all.sort_by_key(|m| m.round);
    all.first().filter(|m| m.round == 0)?;
    // Times of the round of errors count in a race: its frames that are read back do not.
    let of = || all.iter().filter(|m| m.round > 0 || run.minutes.is_some());
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
    let rounds_ms: Vec<f64> = match price {
        Price::Stage => stages.iter().map(|s| s.ms).collect(),
        Price::Frame => frames.clone(),
    };
    let mut stages_ms: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for (name, cost) in of().flat_map(|m| &m.cost.stages) {
        stages_ms.entry(name.clone()).or_default().push(cost.ms);
    }
    // What `post` makes is the picture, with a truth of its own.
    let errors = |e: &Errors| {
        let own = e.slots.get(&variant.slot).copied();
        let (slot, picture) = if variant.slot == AREA { (None, own.unwrap_or(e.picture)) } else { (own, e.picture) };
        RowErrors { frame: e.frame, slot, picture }
    };
    let most = |value: &dyn Fn(&Measurement) -> u64| of().map(|m| value(m)).max().unwrap_or(0);
    Some(Row {
        variant: variant.clone(),
        ms: middle(&rounds_ms),
        spread_ms: 0.5 * (quantile(&rounds_ms, 0.75) - quantile(&rounds_ms, 0.25)),
        ms_interval: interval(&rounds_ms, of().all(|m| m.round == 0)),
        error_interval: 0.0,
        sure: 0.0,
        rounds: of().map(|m| m.round).collect(),
        rounds_ms,
        stage,
        stages_ms: stages_ms.into_iter().map(|(name, ms)| (name, middle(&ms))).collect(),
        frame_ms: middle(&frames),
        frame_min_ms: least(&mut of().map(|m| m.cost.frame_min_ms)),
        transient_bytes: most(&|m| m.cost.transient_bytes),
        history_bytes: most(&|m| m.cost.history_bytes),
        acceleration_bytes: most(&|m| m.cost.acceleration_bytes),
        errors: all.iter().flat_map(|m| &m.errors).map(errors).collect(),
        moving: all.iter().find_map(|m| m.moving.as_ref()).map(errors),
        within_noise: BTreeMap::new(),
        standing: BTreeMap::new(),
    })
}

#[cfg(test)]
mod tests;
