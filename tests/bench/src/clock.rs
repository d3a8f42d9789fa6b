//! Times the phases of a frame.

use crate::allocations;
use std::time::Instant;

/// Name of the phase in which a contestant frees a frame's resources, once the device is done. Reported, but not part of the sum.
pub const RETIRE: &str = "retire";

/// Most phases in a frame, so that the clock need not allocate.
const MAX_PHASES: usize = 8;

/// Wall time of each phase of a frame, and CPU time of the calling thread over all of them.
///
/// A phase is named `declare`, `plan`, `record` or `submit`; where a library cannot be timed more finely, one name joins
/// several: `plan+record`.
#[derive(Default)]
pub struct Clock {
    laps: [(&'static str, u64); MAX_PHASES],
    count: usize,
    since: Option<Instant>,
    cpu_since: Option<u64>,
    cpu: Option<u64>,
    counts: bool,
}

impl Clock {
    /// A clock that also counts allocations, for a frame whose times are discarded.
    pub(crate) fn counting() -> Self {
        Self { counts: true, ..Self::default() }
    }

    /// Starts the clock.
    pub fn start(&mut self) {
        if self.counts {
            allocations::count(true);
        }
        self.cpu_since = thread_time();
        self.since = Some(Instant::now());
    }

    /// Ends a phase; the next one starts at once.
    pub fn lap(&mut self, phase: &'static str) {
        let now = Instant::now();
        if let Some(since) = self.since.replace(now) {
            self.note(phase, (now - since).as_nanos() as u64);
        }
    }

    /// Stops the clock before the wait for the device.
    pub fn stop(&mut self) {
        self.since = None;
        self.cpu = self.cpu_since.take().and_then(|since| thread_time()?.checked_sub(since));
        if self.counts {
            allocations::count(false);
        }
    }

    /// Times `free`, which releases the frame's resources, as [`RETIRE`].
    pub fn retire(&mut self, free: impl FnOnce()) {
        let begun = Instant::now();
        free();
        self.note(RETIRE, begun.elapsed().as_nanos() as u64);
    }

    /// CPU time of the calling thread between start and stop, nanoseconds; none if the system does not provide it.
    pub fn cpu(&self) -> Option<u64> {
        self.cpu
    }

    /// Records a phase that the contestant timed itself, nanoseconds.
    pub fn note(&mut self, phase: &'static str, nanoseconds: u64) {
        debug_assert!(self.count < MAX_PHASES, "more than {MAX_PHASES} phases: {phase}");
        if let Some(lap) = self.laps.get_mut(self.count) {
            *lap = (phase, nanoseconds);
            self.count += 1;
        }
    }

    /// The phases in order, nanoseconds.
    pub fn laps(&self) -> &[(&'static str, u64)] {
        &self.laps[..self.count]
    }

    /// Sum of all phases except [`RETIRE`], nanoseconds.
    pub fn total(&self) -> u64 {
        self.laps().iter().filter(|(phase, _)| *phase != RETIRE).map(|(_, time)| time).sum()
    }
}

/// CPU time of this thread so far, nanoseconds.
#[cfg(unix)]
fn thread_time() -> Option<u64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    u64::try_from(time.tv_sec).ok()?.checked_mul(1_000_000_000)?.checked_add(time.tv_nsec.try_into().ok()?)
}

#[cfg(not(unix))]
fn thread_time() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn sleeping_takes_no_cpu_and_retiring_is_apart() {
        let mut clock = Clock::default();
        clock.start();
        std::thread::sleep(Duration::from_millis(20));
        clock.lap("declare");
        clock.stop();
        clock.retire(|| std::thread::sleep(Duration::from_millis(5)));
        let [(_, declare), (name, retire)] = clock.laps() else { panic!("{:?}", clock.laps()) };
        assert!(*declare >= 20_000_000 && *retire >= 5_000_000 && *name == RETIRE);
        assert_eq!(clock.total(), *declare);
        assert!(clock.cpu().is_none_or(|cpu| cpu < 10_000_000), "{:?}", clock.cpu());
    }
}
