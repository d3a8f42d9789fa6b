//! The stop watch of one frame.

use crate::allocations;
use std::time::Instant;

/// Name of the phase in which a contestant frees what the frame used, after the device is done. Shown, but not part of the sum.
pub const RETIRE: &str = "retire";

/// Phases of a frame; the clock itself allocates nothing.
const MOST: usize = 8;

/// Times the phases of one frame: each on the wall, and all together as the time that the calling thread was on a CPU.
///
/// A phase is named `declare`, `plan`, `record` or `submit`; where a library cannot be timed more finely, one name joins
/// several: `plan+record`.
#[derive(Default)]
pub struct Clock {
    laps: [(&'static str, u64); MOST],
    count: usize,
    since: Option<Instant>,
    cpu_since: Option<u64>,
    cpu: Option<u64>,
    counts: bool,
}

impl Clock {
    /// A clock that counts allocations as well, for a frame whose times are not kept.
    pub(crate) fn counting() -> Self {
        Self { counts: true, ..Self::default() }
    }

    /// Begins.
    pub fn start(&mut self) {
        if self.counts {
            allocations::count(true);
        }
        self.cpu_since = thread_time();
        self.since = Some(Instant::now());
    }

    /// Ends a phase; the next one begins at once.
    pub fn lap(&mut self, phase: &'static str) {
        let now = Instant::now();
        if let Some(since) = self.since.replace(now) {
            self.note(phase, (now - since).as_nanos() as u64);
        }
    }

    /// Stops before the wait for the device.
    pub fn stop(&mut self) {
        self.since = None;
        self.cpu = self.cpu_since.take().and_then(|since| thread_time()?.checked_sub(since));
        if self.counts {
            allocations::count(false);
        }
    }

    /// Times `free`, which gives back what the frame used, as [`RETIRE`].
    pub fn retire(&mut self, free: impl FnOnce()) {
        let begun = Instant::now();
        free();
        self.note(RETIRE, begun.elapsed().as_nanos() as u64);
    }

    /// Time of the calling thread on a CPU between start and stop, nanoseconds; none where the system does not tell.
    pub fn cpu(&self) -> Option<u64> {
        self.cpu
    }

    /// Notes a phase that the contestant timed itself, nanoseconds.
    pub fn note(&mut self, phase: &'static str, nanoseconds: u64) {
        debug_assert!(self.count < MOST, "more than {MOST} phases: {phase}");
        if let Some(lap) = self.laps.get_mut(self.count) {
            *lap = (phase, nanoseconds);
            self.count += 1;
        }
    }

    /// The phases in their order, nanoseconds.
    pub fn laps(&self) -> &[(&'static str, u64)] {
        &self.laps[..self.count]
    }

    /// Sum of the phases but [`RETIRE`], nanoseconds.
    pub fn total(&self) -> u64 {
        self.laps().iter().filter(|(phase, _)| *phase != RETIRE).map(|(_, time)| time).sum()
    }
}

/// Time that this thread has been on a CPU, nanoseconds.
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
