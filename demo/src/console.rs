//! Standard output, standard error and the log.

use std::{
    io::{self, ErrorKind, Write},
    sync::{Mutex, PoisonError},
};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use log::{Level, LevelFilter, Log, Metadata, Record};

use crate::{args::Loudness, exit::Failure};

/// Writes to standard output. A closed pipe, as with `head`, is not an error.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::running(error).context("standard output")),
        _ => Ok(()),
    }
}

/// Writes an error message to standard error.
pub(crate) fn complain(message: &str) {
    say(&format!("error: {message}"));
}

/// Writes a line to standard error, above the progress bar if one is drawn.
fn say(line: &str) {
    let write = || {
        // There is nowhere to report an error of stderr.
        let _ = writeln!(io::stderr().lock(), "{line}");
    };
    match &*BAR.lock().unwrap_or_else(PoisonError::into_inner) {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// A progress bar on standard error; cleared on drop.
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// Draws nothing with `--quiet` or when standard error is not a terminal.
    pub(crate) fn new(frames: u64, loudness: &Loudness) -> Self {
        Self::of(frames, "frames", loudness)
    }

    /// The same for `count` steps of something other than frames.
    pub(crate) fn of(count: u64, what: &str, loudness: &Loudness) -> Self {
        let target = if loudness.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template(&format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {what}, {{eta}} left"));
        let bar = ProgressBar::with_draw_target(Some(count), target)
            .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
            .with_message("rendering");
        *BAR.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.clone());
        Self(bar)
    }

    /// Advances by one.
    pub(crate) fn step(&self) {
        self.advance(1);
    }

    /// Advances by `by`.
    pub(crate) fn advance(&self, by: u64) {
        self.0.inc(by);
    }

    /// Shows `done`, of which `skipped` come from an earlier run and are left out of the estimate of the remaining time.
    pub(crate) fn show(&self, done: u64, skipped: u64, what: &str) {
        let before = self.0.position();
        if before < skipped && done <= skipped {
            self.0.reset_eta();
        }
        self.0.set_position(done);
        self.0.set_message(what.to_owned());
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
        *BAR.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

struct Sink;

impl Log for Sink {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= log::max_level()
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        match record.level() {
            Level::Error => say(&format!("error: {}", record.args())),
            Level::Warn => say(&format!("warning: {}", record.args())),
            Level::Info => say(&format!("info: {}", record.args())),
            Level::Debug | Level::Trace => say(&format!("debug: {}: {}", record.target(), record.args())),
        }
    }

    fn flush(&self) {}
}

/// Sends the log to standard error, unless the program that uses this library has installed a logger already.
pub(crate) fn listen(loudness: &Loudness) {
    let level = match (loudness.quiet, loudness.verbose) {
        (true, _) => LevelFilter::Error,
        (false, 0) => LevelFilter::Info,
        (false, _) => LevelFilter::Debug,
    };
    if log::set_logger(&Sink).is_ok() {
        log::set_max_level(level);
    }
}
