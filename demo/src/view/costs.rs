//! What the panels take of the CPU.

use std::{collections::VecDeque, time::Duration};

use super::window::SHOWN;

/// CPU times of the panels over the newest frames: of `egui`, of bringing what it draws into the frame, and of keeping frames and their statistics.
#[derive(Debug, Default)]
pub(super) struct Costs(VecDeque<[Duration; 3]>);

impl Costs {
    /// Adds a frame.
    pub(super) fn add(&mut self, times: [Duration; 3]) {
        self.0.push_back(times);
        if self.0.len() > SHOWN {
            self.0.pop_front();
        }
    }

    /// Medians of all three, milliseconds.
    pub(super) fn medians(&self) -> [f64; 3] {
        [0, 1, 2].map(|which| {
            let mut times: Vec<Duration> = self.0.iter().map(|times| times[which]).collect();
            times.sort_unstable();
            times.get(times.len() / 2).map_or(0.0, |time| 1000.0 * time.as_secs_f64())
        })
    }

    /// Means of all three, milliseconds: statistics are made now and then only.
    fn means(&self) -> [f64; 3] {
        let count = self.0.len().max(1) as f64;
        [0, 1, 2].map(|which| 1000.0 * self.0.iter().map(|times| times[which].as_secs_f64()).sum::<f64>() / count)
    }

    /// The result as a line, for frames of so many passes.
    pub(super) fn line(&self, passes: usize) -> String {
        let ([egui, overlay, statistics], [_, overlay_mean, statistics_mean]) = (self.medians(), self.means());
        format!(
            "panels: egui {egui:.3} ms of CPU a frame, overlay {overlay:.3} (mean {overlay_mean:.3}), statistics {statistics:.3} \
             (mean {statistics_mean:.3}), with {passes} passes"
        )
    }
}
