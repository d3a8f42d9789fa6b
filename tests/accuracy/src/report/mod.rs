//! The report of a sweep: all numbers as JSON, a row per variant as CSV, and an HTML page.
mod combination;
mod csv;
mod page;
mod text;

pub use combination::Combination;

pub use crate::metric::{Image, Judge, Metric};

use crate::AccuracyError;
use crate::front::{MIN_FRAME_SHARE, Point, Standing, interval, middle, quantile};
use crate::measure::AREA;
use crate::metrics::Comparison;
use crate::plan::Variant;
use crate::race::certainties;
use crate::results::{Errors, Folder, IMAGES, Measurement, Run, StageCost, read_json, write_json, write_text};
use crate::truth::{TruthInfo, truth_of};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the JSON: fields may be added to a version, not changed.
const SCHEMA: u32 = 1;

/// File name of the JSON.
pub const REPORT_JSON: &str = "report.json";
/// File name of the CSV.
pub const REPORT_CSV: &str = "report.csv";
/// File name of the page.
pub const REPORT_HTML: &str = "report.html";

/// Which time counts as a row's price.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeScope {
    /// The time of the slot's own passes.
    Stage,
    /// The time of the whole frame, for slots whose settings change the passes of others.
    Frame,
}

/// Results of a slot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Name of the slot.
    pub slot: String,
    /// Image by which its rows are judged: that of the run, or the picture if the slot has no such image.
    pub judged_by: Image,
    /// Metric of the run, which is shown first and used for fronts by default.
    pub metric: Metric,
    /// Which time is the price of its rows.
    #[serde(rename = "price")]
    pub time_scope: TimeScope,
    /// Its variants, the default first.
    pub rows: Vec<Row>,
}

impl Effect {
    /// Whether a row is on this slot's front, by `metric` and `judged_by`.
    pub fn is_front(&self, row: &Row) -> bool {
        row.is_front(self.judged_by, self.metric)
    }

    /// Noise floor of the ground truth of such an image: this metric's value for two equally converged ones.
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

/// Errors after a number of frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowErrors {
    /// Number of frames, from 1.
    pub frame: u32,
    /// Error of the slot's own image, if it has a ground truth.
    pub slot: Option<Comparison>,
    /// Error of the linear picture.
    pub picture: Comparison,
}

/// Results of a variant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The variant.
    pub variant: Variant,
    /// Its price, milliseconds: median over the rounds.
    pub ms: f64,
    /// Half of the interquartile range of the price over the rounds, milliseconds.
    pub spread_ms: f64,
    /// The price in every round, milliseconds.
    pub rounds_ms: Vec<f64>,
    /// The indices of these rounds. Rows are timed directly after one another in common rounds.
    #[serde(default)]
    pub rounds: Vec<u32>,
    /// Half of a 95 % confidence interval of the price, milliseconds.
    #[serde(default)]
    pub ms_interval: f64,
    /// Change of the judged error between the last two frames, at rest.
    #[serde(default)]
    pub error_interval: f64,
    /// Probability of its standing by `judged_by` and `metric`, 0 to 1.
    #[serde(default)]
    pub sure: f64,
    /// Times of all stages, milliseconds: medians over the rounds.
    #[serde(default)]
    pub stages_ms: BTreeMap<String, f64>,
    /// Cost of the slot's own passes: medians over the rounds, and the minimum.
    pub stage: StageCost,
    /// Time of the whole frame, milliseconds: median over the rounds.
    pub frame_ms: f64,
    /// Time of the fastest frame, milliseconds.
    pub frame_min_ms: f64,
    /// Memory of transients after aliasing, bytes.
    pub transient_bytes: u64,
    /// Memory of histories, bytes.
    pub history_bytes: u64,
    /// Memory of acceleration structures, bytes.
    pub acceleration_bytes: u64,
    /// Errors after increasing numbers of frames.
    pub errors: Vec<RowErrors>,
    /// Errors after the camera has moved, if measured.
    #[serde(default)]
    pub moving: Option<RowErrors>,
    /// Metrics, by image, whose last error is within the noise of the ground truth.
    pub within_noise: BTreeMap<Image, Vec<Metric>>,
    /// Place among the slot's rows, by image and metric, from the last errors and the price.
    pub standing: BTreeMap<Image, BTreeMap<Metric, Standing>>,
}

impl Row {
    /// The last error of an image; none if it was not compared.
    pub fn error(&self, image: Image) -> Option<&Comparison> {
        let last = self.errors.last()?;
        match image {
            Image::Slot => last.slot.as_ref(),
            Image::Picture => Some(&last.picture),
            Image::Moving => self.moving.as_ref().map(|m| &m.picture),
        }
    }

    /// Its point for fronts, with this error.
    pub fn point(&self, error: f64) -> Point {
        Point { error, ms: self.rounds.iter().copied().zip(self.rounds_ms.iter().copied()).collect() }
    }

    /// Whether it is on the front by this image and metric.
    pub fn is_front(&self, image: Image, metric: Metric) -> bool {
        self.standing.get(&image).and_then(|s| s.get(&metric)).is_some_and(|s| s.is_front())
    }
}

/// Results of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of the format, `SCHEMA`.
    pub schema: u32,
    /// Device, scene and parameters of the run.
    pub run: Run,
    /// Quality of each ground truth.
    pub truths: Vec<TruthInfo>,
    /// Results by slot, in the order of the frame.
    pub effects: Vec<Effect>,
    /// Rows that a race had no time for: slot and label.
    #[serde(default)]
    pub unreached: Vec<(String, String)>,
    /// Additive model of the picture's errors; none if pictures are missing.
    pub combination: Option<Combination>,
}

impl Report {
    /// Builds the report from a folder's results.
    ///
    /// # Errors
    /// [`AccuracyError::Incomplete`] if a measurement is missing.
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

    /// Writes JSON, CSV and the page to the folder that holds the pictures.
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

    /// Results of the slot of that name.
    pub fn effect(&self, slot: &str) -> Option<&Effect> {
        self.effects.iter().find(|e| e.slot == slot)
    }
}

/// Results of a slot. Rows that were not measured are left out.
pub(crate) fn effect(run: &Run, measurements: &[Measurement], truths: &[TruthInfo], slot: &str) -> Effect {
    let variants = run.plan.variants.iter().filter(|v| v.slot == slot);
    // These two change the times of other stages: acceleration structures have no passes of their own while nothing moves, and `post` sets
    // the resolution.
    let time_scope = if ["acceleration", AREA].contains(&slot) { TimeScope::Frame } else { TimeScope::Stage };
    let rows: Vec<Row> = variants.filter_map(|variant| row(run, measurements, variant, time_scope)).collect();
    let Judge { metric, image } = run.judge;
    let has = |image: Image| !rows.is_empty() && rows.iter().all(|r| r.error(image).is_some());
    let judged_by = if has(image) { image } else { Image::Picture };
    let mut effect = Effect { slot: slot.to_owned(), judged_by, metric, time_scope, rows };
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
    let least_ms = MIN_FRAME_SHARE * effect.rows.first().map_or(0.0, |r| r.frame_ms);
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

/// Change of an error between the last two compared frames; 0 if they are not consecutive.
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

/// Results of a variant; none if it was not measured.
fn row(run: &Run, measurements: &[Measurement], variant: &Variant, time_scope: TimeScope) -> Option<Row> {
    let mut all: Vec<&Measurement> = measurements.iter().filter(|m| m.setup == variant.setup).collect();
    all.sort_by_key(|m| m.round);
    all.first().filter(|m| m.round == 0)?;
    // In a race the times of round 0 count too; frames that were read back are not among them.
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
    let rounds_ms: Vec<f64> = match time_scope {
        TimeScope::Stage => stages.iter().map(|s| s.ms).collect(),
        TimeScope::Frame => frames.clone(),
    };
    let mut stages_ms: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for (name, cost) in of().flat_map(|m| &m.cost.stages) {
        stages_ms.entry(name.clone()).or_default().push(cost.ms);
    }
    // The image of `post` is the picture, with a ground truth of its own.
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
