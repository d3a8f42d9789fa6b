//! What the graph saved.

use std::fmt;

use serde::Serialize;

use super::{super::plan::Plan, describe::bytes};

/// What the graph saved compared with running every declared pass in turn, each resource with memory of its own.
///
/// [`Display`](fmt::Display) gives two lines for people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Gains {
    /// Passes that run.
    pub passes: usize,
    /// Passes that were culled.
    pub culled: usize,
    /// Bytes of transients when each has memory of its own.
    pub unaliased: u64,
    /// Bytes of transients as placed.
    pub aliased: u64,
    /// Largest number of transient bytes alive at one time: no placement takes less.
    pub lower_bound: u64,
    /// Attachments that need not be stored to memory, because nothing reads them after the pass.
    pub unstored: usize,
    /// Barriers, each of a batch counted by itself.
    pub barriers: usize,
    /// Barriers per pass that runs; 0 if none runs.
    pub barriers_per_pass: f64,
    /// Places between passes at which barriers are issued together.
    pub barrier_calls: usize,
    /// Queues that the plan is made for.
    pub queues: usize,
    /// Batches: runs of passes that are submitted to a queue together.
    pub batches: usize,
    /// Waits of a batch for a batch of another queue.
    pub waits: usize,
    /// Sum of the busy times of all queues, less the time in which any of them was busy, milliseconds; `None` if it was not measured.
    pub overlap_ms: Option<f64>,
}

impl Gains {
    /// The savings of a plan, without the measured ones.
    pub fn of(plan: &Plan) -> Self {
        let (passes, barriers) = (plan.order.len(), plan.barriers.len());
        let calls = plan.before.iter().chain(&plan.after).chain([&plan.end]);
        Self {
            passes,
            culled: plan.culled.len(),
            unaliased: plan.memory.unaliased,
            aliased: plan.memory.aliased,
            lower_bound: plan.memory.lower_bound,
            unstored: plan.unstored.len(),
            barriers,
            barriers_per_pass: if passes == 0 { 0.0 } else { barriers as f64 / passes as f64 },
            barrier_calls: calls.filter(|span| !span.is_empty()).count(),
            queues: plan.queues.count(),
            batches: plan.batches.len(),
            waits: plan.waits.len(),
            overlap_ms: None,
        }
    }

    /// `bytes` as a fraction of the unaliased sum; 1 if nothing needs memory.
    pub fn share(&self, bytes: u64) -> f64 {
        if self.unaliased == 0 { 1.0 } else { bytes as f64 / self.unaliased as f64 }
    }

    /// Placed bytes over the lower bound, at least 1; 1 if nothing needs memory.
    pub fn over_bound(&self) -> f64 {
        if self.lower_bound == 0 { 1.0 } else { self.aliased as f64 / self.lower_bound as f64 }
    }
}

impl fmt::Display for Gains {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "transient memory: {} unaliased, {} as placed ({:.0} %, {:.2} times the lower bound of {})",
            bytes(self.unaliased),
            bytes(self.aliased),
            100.0 * self.share(self.aliased),
            self.over_bound(),
            bytes(self.lower_bound)
        )?;
        write!(
            f,
            "graph: {} passes ({} culled), {} barriers ({:.1} per pass), {}, {}",
            self.passes,
            self.culled,
            self.barriers,
            self.barriers_per_pass,
            counted(self.batches, "batch", "batches"),
            counted(self.waits, "wait between queues", "waits between queues")
        )?;
        self.overlap_ms.map_or(Ok(()), |ms| write!(f, ", {ms:.3} ms of overlap"))
    }
}

/// `1 batch`, `3 batches`.
pub(super) fn counted(n: usize, one: &str, several: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { several })
}
