//! The error of the benchmarks that render frames.
use magpie::config::ConfigError;
use magpie_passes::RenderError;
use magpie_passes::reference::ReferenceError;

/// Why `magpie bench motion`, `magpie bench pairs` or `magpie bench lights` measured nothing.
#[derive(Debug, thiserror::Error)]
pub enum FrameBenchError {
    /// Rendering a frame failed.
    #[error("{label}: {source}")]
    Render {
        /// What was rendered: a contestant, or the names of features.
        label: String,
        /// Its error.
        source: Box<RenderError>,
    },
    /// The slots do not accept the required settings.
    #[error(transparent)]
    Config(Box<ConfigError>),
    /// The slot has no output image.
    #[error("{path}: the slot `{slot}` gives no image here")]
    NoImage {
        /// Name of the path.
        path: &'static str,
        /// Name of the slot.
        slot: String,
    },
    /// What is seen cannot be compared with the truth.
    #[error("{0}")]
    Perceived(String),
    /// The ground truth failed.
    #[error("truth: {0}")]
    Truth(Box<ReferenceError>),
    /// There is no contestant or path of that name.
    #[error("nothing is named `{name}` here; there are {known}")]
    UnknownContestant {
        /// The given name.
        name: String,
        /// Names of all paths and contestants.
        known: String,
    },
    /// The scene has no camera.
    #[error("the scene has no camera")]
    NoCamera,
    /// There is no feature of that name.
    #[error("no feature is named `{name}`; there are {known}")]
    UnknownFeature {
        /// The given name.
        name: String,
        /// Names of all features.
        known: String,
    },
}

impl FrameBenchError {
    /// The error of rendering what has this label.
    pub(crate) fn render(label: &str) -> impl Fn(RenderError) -> Self + Copy {
        move |source| Self::Render { label: label.to_owned(), source: Box::new(source) }
    }
}

impl From<ConfigError> for FrameBenchError {
    fn from(error: ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}
