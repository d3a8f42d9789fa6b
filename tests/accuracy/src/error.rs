//! The crate's error type.
use crate::metrics::MetricError;
use magpie::config::Suggestion;
use magpie_passes::RenderError;
use magpie_passes::reference::{EstimateFileError, ReferenceError};
use std::path::{Path, PathBuf};

/// Why a sweep, a report or a recommendation could not be made.
#[derive(Debug, thiserror::Error)]
pub enum AccuracyError {
    /// A stage that was asked for does not exist.
    #[error("--stages: unknown stage \"{name}\"{suggestion}; known: {}", known.join(", "))]
    UnknownStage {
        /// The name that was given.
        name: String,
        /// Names of the stages that can be measured.
        known: Vec<String>,
        /// The most similar name.
        suggestion: Suggestion,
    },
    /// A stage whose implementations do not differ in the picture.
    #[error("--stages: {name} is not measured: {why}")]
    NotMeasured {
        /// Name of the stage.
        name: String,
        /// Why it is not measured.
        why: String,
    },
    /// Rendering a frame failed.
    #[error(transparent)]
    Render(Box<RenderError>),
    /// A frame was rendered without the requested output.
    #[error("{setup}: frame {frame} came back without {what}")]
    Lacks {
        /// Label of the configuration.
        setup: String,
        /// Frame number, from 1.
        frame: u32,
        /// The output that is missing.
        what: String,
    },
    /// The device has no timestamps.
    #[error("{device}: passes have no times: accuracy can be measured, its price cannot")]
    NoTimes {
        /// Name of the device.
        device: String,
    },
    /// The reference path tracer failed.
    #[error("truth of {what}: {source}")]
    Reference {
        /// The image that was traced.
        what: &'static str,
        /// Its error.
        source: Box<ReferenceError>,
    },
    /// A file of a ground truth could not be read or written.
    #[error(transparent)]
    Estimate(Box<EstimateFileError>),
    /// Two pictures could not be compared.
    #[error("{what}: {source}")]
    Metric {
        /// Which configuration, frame and image.
        what: String,
        /// The metric's error.
        source: MetricError,
    },
    /// A file could not be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A picture could not be read or written.
    #[error("{path}: {source}", path = path.display())]
    Image {
        /// Path of the file.
        path: PathBuf,
        /// The decoder's or encoder's error.
        source: image::ImageError,
    },
    /// A JSON file could not be parsed.
    #[error("{path}:{line}: {source}", path = path.display())]
    Json {
        /// Path of the file.
        path: PathBuf,
        /// Line number, from 1; 0 when writing.
        line: usize,
        /// The parser's error.
        source: serde_json::Error,
    },
    /// Results belong to a different run.
    #[error("{path}: {what} was {got}, now it is {wanted}: these results do not go together", path = path.display())]
    Different {
        /// Path of the file that differs.
        path: PathBuf,
        /// Field that differs.
        what: &'static str,
        /// Its value in the file.
        got: String,
        /// Its value in this run.
        wanted: String,
    },
    /// Results are missing.
    #[error("{path}: {missing} of {all} measurements are missing; the first is {first}", path = path.display())]
    Incomplete {
        /// Folder of the results.
        path: PathBuf,
        /// Number of missing measurements.
        missing: usize,
        /// Number of all measurements.
        all: usize,
        /// Label of the first missing one.
        first: String,
    },
    /// No folders were given to merge.
    #[error("nothing to merge: wanted at least one folder of `magpie accuracy`")]
    NothingToMerge,
    /// A report lacks what tuning needs.
    #[error("{path}: {lacks}", path = path.display())]
    NotTunable {
        /// Path of the report.
        path: PathBuf,
        /// What is missing.
        lacks: String,
    },
    /// No configuration meets the goal.
    #[error("no configuration meets {wanted}; the {nearest}")]
    Unreachable {
        /// The goal, as given on the command line.
        wanted: String,
        /// The closest that can be reached.
        nearest: String,
    },
}

impl From<RenderError> for AccuracyError {
    fn from(error: RenderError) -> Self {
        Self::Render(Box::new(error))
    }
}

impl AccuracyError {
    /// Maps an I/O error of this path to [`Self::File`].
    pub(crate) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::File { path, source }
    }

    /// Maps an image error of this path to [`Self::Image`].
    pub(crate) fn image(path: &Path) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.to_owned();
        move |source| Self::Image { path, source }
    }

    /// Maps a JSON error in this file and line to [`Self::Json`].
    pub(crate) fn json(path: &Path, line: usize) -> impl FnOnce(serde_json::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Json { path, line, source }
    }

    /// Maps a metric's error to [`Self::Metric`].
    pub(crate) fn metric(what: &str) -> impl FnOnce(MetricError) -> Self {
        let what = what.to_owned();
        move |source| Self::Metric { what, source }
    }
}
