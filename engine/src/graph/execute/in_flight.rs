//! A frame that was submitted.

use std::sync::Arc;

use super::{
    super::{declaration::Declaration, plan::Plan},
    Imports,
    breadcrumbs::{Breadcrumbs, QueueProgress},
    commands::Held,
    time::Clock,
};
use crate::{
    gpu::{Gpu, GpuError, SemaphoreValue, Submission},
    measure::FrameSample,
};

/// A frame that the device may still work on, with all that it needs until it is done. [`Executor::finish`](super::Executor::finish) waits for it
/// and returns what was measured; dropping it waits, too.
#[must_use]
pub struct InFlight {
    /// Dropped before all that follows.
    pub(super) end: End,
    /// The declaration of the frame.
    pub declaration: Arc<Declaration>,
    /// Its plan.
    pub plan: Arc<Plan>,
    /// As far as it is known when the frame is submitted.
    pub(super) sample: FrameSample,
    pub(super) instruments: Instruments,
    pub(super) held: Held,
    /// As long as these are held, what the host wrote for this frame is not overwritten for a later one.
    pub(super) _imports: Imports,
    /// Whether the executor that runs it began its declaration, so that it may have histories.
    pub(super) own: bool,
    pub(super) measured: bool,
    pub(super) writes_breadcrumbs: bool,
    /// For tests: whether it stopped as if the device were lost.
    pub(super) stopped: bool,
}

/// The last submission of a frame.
pub(super) struct End {
    pub gpu: Gpu,
    pub last: Submission,
}

impl End {
    /// Waits until the frame is done.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.gpu.wait(self.last)
    }
}

impl Drop for End {
    fn drop(&mut self) {
        // If it fails, the device is lost and nothing runs any more.
        let _ = self.wait();
    }
}

/// What measures a frame while it runs. Each frame in flight has its own.
pub(super) struct Instruments {
    pub clock: Clock,
    pub breadcrumbs: Breadcrumbs,
}

impl Instruments {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { clock: Clock::new(gpu)?, breadcrumbs: Breadcrumbs::new(gpu) })
    }

    /// How far each queue came in the frame; empty without breadcrumbs.
    pub fn progress(&self, written: bool, declaration: &Declaration, plan: &Plan) -> Vec<QueueProgress> {
        if written { self.breadcrumbs.progress(declaration, plan) } else { Vec::new() }
    }
}

impl InFlight {
    /// Whether the device is done with it, so that finishing it takes no time.
    pub fn is_done(&self) -> bool {
        self.end.gpu.is_done(self.end.last)
    }

    /// The semaphore value that the device reaches when the frame is done.
    pub fn done(&self) -> SemaphoreValue {
        self.end.gpu.signal_of(self.end.last)
    }
}
