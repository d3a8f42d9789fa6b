//! What the panels take of the CPU.

use std::{collections::VecDeque, time::Duration};

use super::window::SHOWN;

/// CPU times of the panels over the newest frames.
#[derive(Debug, Default)]
pub(super) struct Costs(VecDeque<[Duration; 2]>);

impl Costs {
    /// Adds a frame: the time of `egui`, and that of the rest, from meshes to statistics.
    pub(super) fn add(&mut self, egui: Duration, rest: Duration) {
        self.0.push_back([egui, rest]);
        if self.0.len() > SHOWN {
            self.0.pop_front();
        }
    }

    /// Medians of both, milliseconds.
    pub(super) fn medians(&self) -> [f64; 2] {
        [0, 1].map(|which| {
            let mut times: Vec<Duration> = self.0.iter().map(|times| times[which]).collect();
            times.sort_unstable();
            times.get(times.len() / 2).map_or(0.0, |time| 1000.0 * time.as_secs_f64())
        })
    }

    /// Means of both, milliseconds: statistics are made now and then only.
    fn means(&self) -> [f64; 2] {
        let count = self.0.len().max(1) as f64;
        [0, 1].map(|which| 1000.0 * self.0.iter().map(|times| times[which].as_secs_f64()).sum::<f64>() / count)
    }

    /// The result as a line, for frames of so many passes.
    pub(super) fn line(&self, passes: usize) -> String {
        let ([egui, rest], [_, mean]) = (self.medians(), self.means());
        format!("panels: egui {egui:.3} ms of CPU a frame, beyond it {rest:.3} (mean {mean:.3}), with {passes} passes")
    }
}
