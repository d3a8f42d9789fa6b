//! How a command fails, and the exit status of each kind.

use std::{error::Error, ffi::OsString};

use clap::error::ErrorKind;
use magpie::{
    config::ConfigError,
    gpu::GpuError,
    scene::{BuiltinError, SceneError},
    slot::SlotError,
};

use crate::console;

/// A command that did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Wrong command-line usage.
    #[error("{0}")]
    Usage(String),
    /// A file, name or value that was given is invalid.
    #[error("{0:#}")]
    Input(anyhow::Error),
    /// No usable Vulkan device.
    #[error("{0:#}")]
    NoDevice(anyhow::Error),
    /// Ctrl-C, or a signal that asks to end.
    #[error("interrupted")]
    Interrupted,
    /// Any other error while running.
    #[error("{0:#}")]
    Run(anyhow::Error),
}

impl Failure {
    /// [`Failure::Input`] from any error.
    pub fn input(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Input(anyhow::Error::new(error))
    }

    /// [`Failure::Input`] with this message.
    pub fn bad(message: impl Into<String>) -> Self {
        Self::Input(anyhow::Error::msg(message.into()))
    }

    /// [`Failure::Run`] from any error.
    pub fn running(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Run(anyhow::Error::new(error))
    }

    /// Adds the file or argument concerned to the message.
    #[must_use]
    pub fn context(self, what: impl Into<String>) -> Self {
        let what = what.into();
        match self {
            Self::Interrupted => Self::Interrupted,
            Self::Usage(message) => Self::Usage(format!("{what}: {message}")),
            Self::Input(error) => Self::Input(error.context(what)),
            Self::NoDevice(error) => Self::NoDevice(error.context(what)),
            Self::Run(error) => Self::Run(error.context(what)),
        }
    }

    /// The exit status: 1 while running, 2 for usage and input, 3 without a device, 130 when interrupted.
    #[must_use]
    pub const fn status(&self) -> u8 {
        match self {
            Self::Run(_) => 1,
            Self::Usage(_) | Self::Input(_) => 2,
            Self::NoDevice(_) => 3,
            Self::Interrupted => 130,
        }
    }

    /// The whole chain of causes in one line. A cause whose text its parent already contains is left out.
    #[must_use]
    pub fn message(&self) -> String {
        let error = match self {
            Self::Usage(message) => return message.clone(),
            Self::Interrupted => return self.to_string(),
            Self::Input(error) | Self::NoDevice(error) | Self::Run(error) => error,
        };
        let mut text = String::new();
        for cause in error.chain().map(ToString::to_string) {
            if text.is_empty() {
                text = cause;
            } else if !text.contains(&cause) {
                text = format!("{text}: {cause}");
            }
        }
        text
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::input(error)
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::input(error)
    }
}

impl From<BuiltinError> for Failure {
    fn from(error: BuiltinError) -> Self {
        Self::input(error)
    }
}

impl From<SlotError> for Failure {
    fn from(error: SlotError) -> Self {
        match error {
            SlotError::UnknownImplementation { .. } | SlotError::Setting { .. } | SlotError::Unsuitable { .. } => {
                Self::input(error)
            }
            SlotError::NotDescribed { .. }
            | SlotError::SettingTwice { .. }
            | SlotError::Construct { .. }
            | SlotError::NoDevice
            | SlotError::Other(_) => Self::running(error),
        }
    }
}

impl From<GpuError> for Failure {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::NoLoader { .. }
            | GpuError::NoDevice { .. }
            | GpuError::UnknownDevice { .. }
            | GpuError::MissingLayer { .. }
            | GpuError::MissingExtension { .. }
            | GpuError::NoDisplay { .. }
            | GpuError::Unsuited { .. }
            | GpuError::Rays { .. } => Self::NoDevice(anyhow::Error::new(error)),
            other => Self::running(other),
        }
    }
}

/// Prints clap's error or the help that was asked for, and returns the exit status.
pub(crate) fn report_usage(error: &clap::Error, given: &[OsString]) -> u8 {
    // Clap does not say which argument is not UTF-8.
    let odd = given.iter().position(|argument| argument.to_str().is_none());
    if let (ErrorKind::InvalidUtf8, Some(at)) = (error.kind(), odd) {
        let line: Vec<_> = given[..=at].iter().map(|a| a.to_string_lossy()).collect();
        console::complain(&format!("argument {at}: wanted UTF-8 text, got {:?} in: {}", given[at], line.join(" ")));
        return 2;
    }
    if error.use_stderr() {
        // There is nowhere to report an error of stderr.
        let _ = error.print();
        return 2;
    }
    match console::print(&error.render().to_string()) {
        Ok(()) => 0,
        Err(failure) => failure.status(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_status() {
        let gpu = |refusals| Failure::from(GpuError::NoDevice { refusals });
        assert_eq!(gpu(vec![]).status(), 3);
        assert_eq!(Failure::from(GpuError::DeviceLost { during: "vkQueueSubmit2" }).status(), 1);
        assert_eq!(Failure::Usage("x".to_owned()).status(), 2);
        assert_eq!(Failure::from(ConfigError::Assignment { got: "x".to_owned() }).status(), 2);
        assert_eq!(Failure::from(SlotError::other("lost")).status(), 1);
        assert_eq!(Failure::running(std::io::Error::other("disk")).status(), 1);
    }

    #[test]
    fn the_message_is_the_chain_without_repetition() {
        let failure = Failure::bad("wanted 1, got 2").context("--frames").context("magpie");
        assert_eq!(failure.message(), "magpie: --frames: wanted 1, got 2");
        let quoting = anyhow::Error::msg("disk full").context("a.png: disk full");
        assert_eq!(Failure::Run(quoting).message(), "a.png: disk full");
    }
}
