//! How much GPU work of different queues overlapped.

use super::{FrameSample, PassTime};

impl FrameSample {
    /// Time that queues saved by overlapping, nanoseconds: the sum of the times in which each was busy, less the time in which
    /// any was. `None` if no pass has timestamps.
    #[must_use]
    pub fn overlap_ns(&self) -> Option<u64> {
        let mut spans: Vec<(&str, [u64; 2])> = self.passes.iter().filter_map(|p| Some((p.queue, span(p)?))).collect();
        if spans.is_empty() {
            return None;
        }
        spans.sort_unstable();
        let queues = spans.chunk_by(|a, b| a.0 == b.0);
        let each: u64 = queues.map(|spans| covered(spans.iter().map(|s| s.1))).sum();
        spans.sort_unstable_by_key(|s| s.1);
        Some(each - covered(spans.iter().map(|s| s.1)))
    }
}

/// Start and end of a pass on the GPU, nanoseconds since the frame's first timestamp.
fn span(pass: &PassTime) -> Option<[u64; 2]> {
    let start = pass.gpu_start_ns?;
    Some([start, start + pass.gpu_ns?])
}

/// Length of the union of spans, which must be sorted by start.
fn covered(spans: impl Iterator<Item = [u64; 2]>) -> u64 {
    let (mut sum, mut until) = (0, 0);
    for [start, end] in spans {
        sum += end.saturating_sub(start.max(until));
        until = end.max(until);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overlap(passes: &[(&'static str, u64, u64)]) -> Option<u64> {
        let pass = |&(queue, start, end): &(&'static str, u64, u64)| PassTime {
            queue,
            gpu_start_ns: Some(start),
            gpu_ns: Some(end - start),
            ..PassTime::default()
        };
        FrameSample { passes: passes.iter().map(pass).collect(), ..FrameSample::default() }.overlap_ns()
    }

    #[test]
    fn queues_that_take_turns_save_nothing() {
        assert_eq!(overlap(&[("graphics", 0, 10), ("async compute", 10, 15), ("graphics", 15, 20)]), Some(0));
    }

    #[test]
    fn what_runs_beside_other_work_is_saved() {
        // 5..10 and 20..22 on two queues.
        let passes = [("graphics", 0, 10), ("async compute", 5, 22), ("graphics", 20, 30)];
        assert_eq!(overlap(&passes), Some(5 + 2));
        let mut backwards = passes;
        backwards.reverse();
        assert_eq!(overlap(&backwards), Some(7), "the order of the list does not matter");
        // Three queues for a time of 4: twice 4 are saved.
        assert_eq!(overlap(&[("graphics", 0, 4), ("async compute", 0, 4), ("transfer", 0, 4)]), Some(8));
    }

    #[test]
    fn passes_of_one_queue_are_not_counted_twice() {
        assert_eq!(overlap(&[("graphics", 0, 10), ("graphics", 5, 12), ("graphics", 6, 8)]), Some(0));
        assert_eq!(overlap(&[("graphics", 0, 10), ("graphics", 5, 12), ("transfer", 11, 13)]), Some(1));
    }

    #[test]
    fn without_times_nothing_is_known() {
        assert_eq!(FrameSample::default().overlap_ns(), None);
        let untimed = PassTime { gpu_ns: None, gpu_start_ns: Some(3), ..PassTime::default() };
        assert_eq!(FrameSample { passes: vec![untimed], ..FrameSample::default() }.overlap_ns(), None);
    }
}
