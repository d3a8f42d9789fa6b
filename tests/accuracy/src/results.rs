//! Results on disk: a line of JSON per measurement, so that a run can be interrupted, resumed and spread over machines.
use crate::AccuracyError;
use crate::metric::Judge;
use crate::metrics::Comparison;
use crate::plan::Plan;
use crate::truth::TruthInfo;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// File name of the [`Run`].
pub const RUN_FILE: &str = "run.json";
/// File name of the [`Measurement`]s.
pub const RESULTS_FILE: &str = "results.jsonl";
/// File name of the [`TruthInfo`]s.
pub const TRUTHS_FILE: &str = "truths.json";
/// Folder of ground truths, unless another is given.
pub const TRUTHS: &str = "truths";
/// Folder of pictures.
pub const IMAGES: &str = "images";

/// The device of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DeviceName {
    /// Name according to the driver.
    pub name: String,
    /// Name and version of the driver.
    pub driver: String,
    /// `cpu`, `integrated` or `discrete`.
    pub kind: String,
}

/// Parameters of a run. Results belong together if nothing but `date` differs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Version of Magpie.
    pub magpie: String,
    /// Commit of the build.
    pub commit: String,
    /// When the run began, UTC.
    pub date: String,
    /// Device of the run.
    pub device: DeviceName,
    /// Backend for rays.
    pub rays: String,
    /// Name of the scene.
    pub scene: String,
    /// Subject of the ground truth of the picture, which identifies scene and camera.
    pub subject: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Samples per pixel of the ground truths.
    pub samples: u32,
    /// Frame counts after which errors are measured, from 1.
    pub frames: Vec<u32>,
    /// Number of timing rounds, from 1. In round 0 errors are measured, which disturbs its times.
    pub rounds: u32,
    /// Timed frames per round.
    pub timed: u32,
    /// Seed of everything random.
    pub seed: u32,
    /// Scene time per frame, seconds, if the scene moves.
    pub time_step: f64,
    /// Scene time of the compared frame, seconds.
    pub time: f64,
    /// Time limit, minutes, in which configurations race; none if each runs all its rounds.
    #[serde(default)]
    pub minutes: Option<f64>,
    /// Frames at the end in which the camera moves on the path of `magpie bench motion`; the last of them is compared.
    #[serde(default)]
    pub moving_frames: u32,
    /// Metric and image that fronts, and the race for them, are about.
    #[serde(default)]
    pub judge: Judge,
    /// The configurations to measure.
    pub plan: Plan,
}

/// Text of seconds without the digits that a round trip through a file may change.
fn nanoseconds(seconds: f64) -> String {
    format!("{seconds:.9}")
}

/// How times are taken: by fixed rounds or in a race.
fn way(run: &Run) -> &'static str {
    if run.minutes.is_some() { "a race within minutes" } else { "all rounds of each" }
}

impl Run {
    /// Checks that another run has the same parameters; only the date may differ.
    ///
    /// # Errors
    /// [`AccuracyError::Different`], which names `path` as the origin of the other.
    pub fn check_same(&self, other: &Self, path: &Path) -> Result<(), AccuracyError> {
        let pairs = [
            ("the version", self.magpie.clone(), other.magpie.clone()),
            ("the commit", self.commit.clone(), other.commit.clone()),
            ("the device", format!("{:?}", self.device), format!("{:?}", other.device)),
            ("the way to trace rays", self.rays.clone(), other.rays.clone()),
            ("the scene or its camera", self.subject.clone(), other.subject.clone()),
            ("the size", format!("{:?}", self.size), format!("{:?}", other.size)),
            ("the number of samples", self.samples.to_string(), other.samples.to_string()),
            ("the frames", format!("{:?}", self.frames), format!("{:?}", other.frames)),
            ("the way to time", way(self).to_owned(), way(other).to_owned()),
            ("the number of frames in motion", self.moving_frames.to_string(), other.moving_frames.to_string()),
            ("the number of rounds", self.rounds.to_string(), other.rounds.to_string()),
            ("the number of timed frames", self.timed.to_string(), other.timed.to_string()),
            ("the seed", self.seed.to_string(), other.seed.to_string()),
            ("the time step", nanoseconds(self.time_step), nanoseconds(other.time_step)),
            ("the moment", nanoseconds(self.time), nanoseconds(other.time)),
        ];
        let differs = pairs.into_iter().find(|(_, here, there)| here != there);
        if let Some((what, wanted, got)) = differs {
            return Err(AccuracyError::Different { path: path.to_owned(), what, got, wanted });
        }
        if self.plan != other.plan {
            let count = |plan: &Plan| format!("{} variants of {}", plan.variants.len(), plan.slots().join(", "));
            let (got, wanted) = (count(&other.plan), count(&self.plan));
            return Err(AccuracyError::Different { path: path.to_owned(), what: "the plan", got, wanted });
        }
        Ok(())
    }
}

/// Cost of a stage's passes in one round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageCost {
    /// GPU time of all its passes, milliseconds, median over the frames.
    pub ms: f64,
    /// Minimum over the frames, milliseconds.
    pub min_ms: f64,
    /// GPU time of its passes except for denoising, milliseconds, median.
    pub trace_ms: f64,
    /// GPU time of its denoising, filtering and upsampling, milliseconds, median.
    pub denoise_ms: f64,
    /// Closest-hit rays per frame, median.
    pub rays_closest: u64,
    /// Any-hit rays per frame, median.
    pub rays_any: u64,
    /// Number of passes.
    pub passes: u32,
}

/// Cost of a configuration in one round.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// GPU time from the first to the last timestamp of a frame, milliseconds, median.
    pub frame_ms: f64,
    /// Minimum over the frames, milliseconds.
    pub frame_min_ms: f64,
    /// Cost by stage; stages without passes are missing.
    pub stages: BTreeMap<String, StageCost>,
    /// Memory of transients after aliasing, bytes.
    pub transient_bytes: u64,
    /// Memory of histories, bytes.
    pub history_bytes: u64,
    /// Memory of acceleration structures, bytes.
    pub acceleration_bytes: u64,
}

/// Errors after a number of frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Number of frames, from 1.
    pub frame: u32,
    /// Error of the linear picture.
    pub picture: Comparison,
    /// Errors of the slots' own images that have a ground truth; for `post` that of the picture against the ground truth averaged over
    /// pixels.
    pub slots: BTreeMap<String, Comparison>,
}

/// Result of a configuration in one round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// [`Setup::id`](crate::plan::Setup::id).
    pub setup: String,
    /// Round; in 0 errors are measured.
    pub round: u32,
    /// Its cost.
    pub cost: Cost,
    /// Its errors; in round 0 only, as they are the same in every round.
    pub errors: Vec<Errors>,
    /// Its errors after the camera has moved, if it did.
    #[serde(default)]
    pub moving: Option<Errors>,
}

/// A folder of results that is being written.
#[derive(Debug)]
pub struct Results {
    folder: PathBuf,
    file: File,
    /// Measurements so far.
    pub measurements: Vec<Measurement>,
}

/// Reads a JSON file.
pub(crate) fn read_json<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, AccuracyError> {
    let text = std::fs::read_to_string(path).map_err(AccuracyError::file(path))?;
    serde_json::from_str(&text).map_err(|e| AccuracyError::Json { path: path.to_owned(), line: e.line(), source: e })
}

/// Writes a JSON file atomically.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), AccuracyError> {
    let text = serde_json::to_string_pretty(value).map_err(AccuracyError::json(path, 0))? + "\n";
    write_text(path, &text)
}

/// Writes a text file atomically.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), AccuracyError> {
    let part = path.with_extension("part");
    std::fs::write(&part, text).map_err(AccuracyError::file(&part))?;
    std::fs::rename(&part, path).map_err(AccuracyError::file(path))
}

impl Results {
    /// Opens a folder for this run, and creates it if needed. Existing results of the same run are kept.
    ///
    /// # Errors
    /// [`AccuracyError`].
    pub fn open(folder: &Path, run: &mut Run) -> Result<Self, AccuracyError> {
        for folder in [folder, &folder.join(IMAGES)] {
            std::fs::create_dir_all(folder).map_err(AccuracyError::file(folder))?;
        }
        let path = folder.join(RUN_FILE);
        if path.exists() {
            let before: Run = read_json(&path)?;
            run.check_same(&before, &path)?;
            run.date = before.date;
        } else {
            write_json(&path, run)?;
        }
        let path = folder.join(RESULTS_FILE);
        let measurements = if path.exists() { repair(&path)? } else { Vec::new() };
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(AccuracyError::file(&path))?;
        Ok(Self { folder: folder.to_owned(), file, measurements })
    }

    /// Whether this measurement exists.
    pub fn has(&self, setup: &str, round: u32) -> bool {
        self.measurements.iter().any(|m| m.setup == setup && m.round == round)
    }

    /// Adds a measurement, also to the file.
    ///
    /// # Errors
    /// [`AccuracyError::File`].
    pub fn push(&mut self, measurement: Measurement) -> Result<(), AccuracyError> {
        let path = self.folder.join(RESULTS_FILE);
        let line = serde_json::to_string(&measurement).map_err(AccuracyError::json(&path, 0))? + "\n";
        self.file.write_all(line.as_bytes()).and_then(|()| self.file.flush()).map_err(AccuracyError::file(&path))?;
        self.measurements.push(measurement);
        Ok(())
    }
}

/// Reads measurements and drops a last line that an interrupted run left incomplete.
fn repair(path: &Path) -> Result<Vec<Measurement>, AccuracyError> {
    let text = std::fs::read_to_string(path).map_err(AccuracyError::file(path))?;
    let whole = text.rfind('\n').map_or(0, |at| at + 1);
    if whole < text.len() {
        write_text(path, &text[..whole])?;
    }
    let parse = |(at, line): (usize, &str)| serde_json::from_str(line).map_err(AccuracyError::json(path, at + 1));
    text[..whole].lines().enumerate().map(parse).collect()
}

/// Contents of a results folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Folder {
    /// Parameters of the run.
    pub run: Run,
    /// Its measurements.
    pub measurements: Vec<Measurement>,
    /// Quality of its ground truths.
    pub truths: Vec<TruthInfo>,
}

impl Folder {
    /// Reads a results folder.
    ///
    /// # Errors
    /// [`AccuracyError`].
    pub fn read(folder: &Path) -> Result<Self, AccuracyError> {
        let run = read_json(&folder.join(RUN_FILE))?;
        let truths = read_json(&folder.join(TRUTHS_FILE))?;
        Ok(Self { run, measurements: repair(&folder.join(RESULTS_FILE))?, truths })
    }

    /// Checks that no measurement is missing. Of a race only the default is required.
    ///
    /// # Errors
    /// [`AccuracyError::Incomplete`].
    pub fn check_complete(&self, path: &Path) -> Result<(), AccuracyError> {
        let have: BTreeSet<(&str, u32)> = self.measurements.iter().map(|m| (m.setup.as_str(), m.round)).collect();
        let default = self.run.plan.default_setup();
        let races = self.run.minutes.is_some();
        let setups = || self.run.plan.setups.iter().filter(|s| !races || Some(*s) == default);
        let rounds = if races { 0 } else { self.run.rounds };
        let all = || setups().flat_map(|s| (0..=rounds).map(move |round| (s, round)));
        let missing: Vec<_> = all().filter(|(s, round)| !have.contains(&(s.id.as_str(), *round))).collect();
        match missing.first() {
            None => Ok(()),
            Some((setup, _)) => Err(AccuracyError::Incomplete {
                path: path.to_owned(),
                missing: missing.len(),
                all: all().count(),
                first: setup.label.clone(),
            }),
        }
    }
}

/// Merges the folders of a run's shards into `out`: results, quality of the ground truths, pictures.
///
/// # Errors
/// [`AccuracyError::Different`] if they are not of the same run, [`AccuracyError::Incomplete`] if a measurement is missing.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Folder, AccuracyError> {
    let Some(first) = folders.first() else { return Err(AccuracyError::NothingToMerge) };
    let mut all = Folder::read(first)?;
    for folder in &folders[1..] {
        let other = Folder::read(folder)?;
        all.run.check_same(&other.run, &folder.join(RUN_FILE))?;
        for measurement in other.measurements {
            if !all.measurements.iter().any(|m| (&m.setup, m.round) == (&measurement.setup, measurement.round)) {
                all.measurements.push(measurement);
            }
        }
        for truth in other.truths {
            match all.truths.iter().find(|t| t.only == truth.only) {
                Some(known) if known.hash != truth.hash => {
                    let (got, wanted, path) = (truth.hash, known.hash.clone(), folder.join(TRUTHS_FILE));
                    return Err(AccuracyError::Different { path, what: "a truth", got, wanted });
                }
                Some(_) => {}
                None => all.truths.push(truth),
            }
        }
        all.run.date = all.run.date.min(other.run.date);
    }
    all.check_complete(out)?;
    // In the order of the plan, independent of the machines' speed.
    let place = |m: &Measurement| all.run.plan.setups.iter().position(|s| s.id == m.setup);
    all.measurements.sort_by_key(|m| (m.round, place(m)));
    let images = out.join(IMAGES);
    std::fs::create_dir_all(&images).map_err(AccuracyError::file(&images))?;
    for folder in folders.iter().map(|f| f.join(IMAGES)).filter(|f| *f != images) {
        for entry in std::fs::read_dir(&folder).map_err(AccuracyError::file(&folder))? {
            let from = entry.map_err(AccuracyError::file(&folder))?.path();
            if let Some(name) = from.file_name().filter(|_| from.is_file()) {
                std::fs::copy(&from, images.join(name)).map_err(AccuracyError::file(&from))?;
            }
        }
    }
    write_json(&out.join(RUN_FILE), &all.run)?;
    write_json(&out.join(TRUTHS_FILE), &all.truths)?;
    let lines: Result<Vec<String>, _> = all.measurements.iter().map(serde_json::to_string).collect();
    let path = out.join(RESULTS_FILE);
    let lines = lines.map_err(AccuracyError::json(&path, 0))?;
    write_text(&path, &(lines.join("\n") + "\n"))?;
    Ok(all)
}

#[cfg(test)]
mod tests;
