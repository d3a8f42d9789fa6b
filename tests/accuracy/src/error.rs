//! What can go wrong.
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
        /// What was asked for.
        name: String,
        /// What can be measured.
        known: Vec<String>,
        /// The closest.
        suggestion: Suggestion,
    },
    /// A stage that has no part in the picture's accuracy.
    #[error("--stages: {name} is not measured: {why}")]
    NotMeasured {
        /// The stage.
        name: String,
        /// The reason.
        why: String,
    },
    /// A frame was not rendered.
    #[error(transparent)]
    Render(Box<RenderError>),
    /// A frame came back without what was asked for.
    #[error("{setup}: frame {frame} came back without {what}")]
    Lacks {
        /// The configuration.
        setup: String,
        /// From 1.
        frame: u32,
        /// What is missing.
        what: String,
    },
    /// The device does not time passes.
    #[error("{device}: passes have no times: accuracy can be measured, its price cannot")]
    NoTimes {
        /// The device.
        device: String,
    },
    /// The truth could not be found.
    #[error("truth of {what}: {source}")]
    Reference {
        /// Of what.
        what: &'static str,
        /// What went wrong.
        source: Box<ReferenceError>,
    },
    /// A truth's file.
    #[error(transparent)]
    Estimate(Box<EstimateFileError>),
    /// Two pictures could not be compared.
    #[error("{what}: {source}")]
    Metric {
        /// What was compared.
        what: String,
        /// Why not.
        source: MetricError,
    },
    /// A file could not be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What went wrong.
        source: std::io::Error,
    },
    /// A picture could not be read or written.
    #[error("{path}: {source}", path = path.display())]
    Image {
        /// Which.
        path: PathBuf,
        /// What went wrong.
        source: image::ImageError,
    },
    /// A file does not hold what it should.
    #[error("{path}:{line}: {source}", path = path.display())]
    Json {
        /// Which.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// Results of another run.
    #[error("{path}: {what} was {got}, now it is {wanted}: these results do not go together", path = path.display())]
    Different {
        /// The file that tells.
        path: PathBuf,
        /// What differs.
        what: &'static str,
        /// There.
        got: String,
        /// Here.
        wanted: String,
    },
    /// Results are missing.
    #[error("{path}: {missing} of {all} measurements are missing; the first is {first}", path = path.display())]
    Incomplete {
        /// Where they should be.
        path: PathBuf,
        /// How many.
        missing: usize,
        /// Of how many.
        all: usize,
        /// Of which configuration.
        first: String,
    },
    /// No results were given.
    #[error("nothing to merge: wanted at least one folder of `magpie accuracy`")]
    NothingToMerge,
    /// A report that no configuration can be chosen from.
    #[error("{path}: {lacks}", path = path.display())]
    NotTunable {
        /// The report.
        path: PathBuf,
        /// What it lacks.
        lacks: String,
    },
    /// No configuration is good enough.
    #[error("no configuration meets {wanted}; the {nearest}")]
    Unreachable {
        /// What was asked for.
        wanted: String,
        /// What comes nearest.
        nearest: String,
    },
}

impl From<RenderError> for AccuracyError {
    fn from(error: RenderError) -> Self {
        Self::Render(Box::new(error))
    }
}

impl AccuracyError {
    /// A file that could not be read or written.
    pub(crate) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::File { path, source }
    }

    /// A picture file that could not be read or written.
    pub(crate) fn image(path: &Path) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.to_owned();
        move |source| Self::Image { path, source }
    }

    /// A file that does not hold what it should, at this line.
    pub(crate) fn json(path: &Path, line: usize) -> impl FnOnce(serde_json::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Json { path, line, source }
    }

    /// Two pictures that could not be compared.
    pub(crate) fn metric(what: &str) -> impl FnOnce(MetricError) -> Self {
        let what = what.to_owned();
        move |source| Self::Metric { what, source }
    }
}
