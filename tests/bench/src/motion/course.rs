//! What was measured of one contestant on one path.
use serde::Serialize;

/// What the passes of the slot cost.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Least time over the frames of the path, milliseconds; none without timestamps.
    pub ms: Option<f64>,
    /// Bytes that are read and written, as declared, over pixels.
    pub traffic: f64,
    /// Bytes that are kept for the next frame, over pixels.
    pub kept: f64,
}

/// Results of one contestant on one path: means over all runs, each with a seed of its own.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Course {
    /// Name of the path.
    pub path: &'static str,
    /// Label of the contestant.
    pub label: &'static str,
    /// Root mean square error of each frame.
    pub errors: Vec<f64>,
    /// Perceived difference of each frame; none but in the first, the eighth, the 32nd and the last.
    pub perceived: Vec<Option<f64>>,
    /// Cost of the slot.
    pub cost: Cost,
    /// Root mean square change of the error since the frame before, of each frame but the first: flicker.
    pub flicker: Vec<f64>,
    /// Mean value of each frame's image.
    pub means: Vec<f64>,
    /// Mean value of each frame's ground truth.
    pub true_means: Vec<f64>,
    /// Of a lasting change of light, from the frame in which it is done: how much of the way from the picture before to that after each frame has gone, by
    /// blocks of 8x8 pixels. Empty where nothing changes for good.
    pub gone: Vec<f64>,
    /// Of each run, the share that was late after 40 frames: what was missing then of what is seen in the last quarter of the frames. Empty where nothing
    /// changes for good, or that quarter begins before.
    pub late: Vec<f64>,
}

/// The frame after a lasting change, from 1, for which it is told what was late.
pub(super) const LATE: usize = 40;

impl Course {
    /// The first frame, from 1, in which the mean has covered this share of its way to the final value: the delay after a switch.
    #[must_use]
    pub fn frame_of(&self, share: f64) -> Option<usize> {
        let end = *self.true_means.last()?;
        self.means.iter().position(|mean| *mean >= share * end).map(|at| at + 1)
    }

    /// The frame after a lasting change, from 1, from which on the picture is never farther than `left` of the change from the one after it. None if there
    /// is no such frame, or no such change.
    #[must_use]
    pub fn settled_within(&self, left: f64) -> Option<usize> {
        let last = self.gone.iter().rposition(|gone| (gone - 1.0).abs() > left).map_or(0, |at| at + 1);
        (last < self.gone.len()).then_some(last + 1)
    }

    /// Share of a lasting change that is missing in a frame after it, from 1.
    #[must_use]
    pub fn missing_in(&self, frame: usize) -> Option<f64> {
        Some(1.0 - self.gone.get(frame.checked_sub(1)?)?)
    }

    /// Mean share of a lasting change that is missing in the last quarter of the frames after it: what is never found, where light that is late has come.
    #[must_use]
    pub fn missing_at_the_end(&self) -> Option<f64> {
        let last = &self.gone[self.gone.len() - self.gone.len().div_ceil(4)..];
        (!last.is_empty()).then(|| 1.0 - last.iter().sum::<f64>() / last.len() as f64)
    }

    /// Mean share of a lasting change that was late after 40 frames, and its standard error; none of a single run.
    #[must_use]
    pub fn lateness(&self) -> Option<(f64, Option<f64>)> {
        let count = self.late.len() as f64;
        let mean = self.late.iter().sum::<f64>() / count;
        let squares = self.late.iter().map(|late| (late - mean).powi(2)).sum::<f64>();
        let error = (count > 1.0).then(|| (squares / (count - 1.0) / count).sqrt());
        (count > 0.0).then_some((mean, error))
    }

    /// Adds what was late, from what has been seen in each frame.
    pub(super) fn told(mut self) -> Self {
        let at_rest = self.gone.len() - self.gone.len().div_ceil(4);
        if at_rest >= LATE
            && let (Some(missing), Some(end)) = (self.missing_in(LATE), self.missing_at_the_end())
        {
            self.late.push(1.0 - (1.0 - missing) / (1.0 - end));
        }
        self
    }

    /// Means of all numbers of several runs on the same path; the least time of all. None of no runs.
    pub(super) fn mean_of(runs: Vec<Self>) -> Option<Self> {
        let mut first = runs.first()?.clone();
        let count = runs.len() as f64;
        let mean = |of: &dyn Fn(&Self) -> &Vec<f64>| -> Vec<f64> {
            (0..of(&first).len()).map(|at| runs.iter().map(|run| of(run)[at]).sum::<f64>() / count).collect()
        };
        let [errors, flicker, means, gone] =
            [mean(&|c| &c.errors), mean(&|c| &c.flicker), mean(&|c| &c.means), mean(&|c| &c.gone)];
        let noticed = |at: usize| runs.iter().map(|run| run.perceived[at]).sum::<Option<f64>>().map(|sum| sum / count);
        let perceived = (0..first.perceived.len()).map(noticed).collect();
        let ms = runs.iter().filter_map(|run| run.cost.ms).reduce(f64::min);
        let late = runs.iter().flat_map(|run| run.late.clone()).collect();
        first.cost.ms = ms;
        Some(Self { errors, perceived, flicker, means, gone, late, ..first })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(gone: Vec<f64>) -> Course {
        let cost = Cost { ms: Some(2.0), traffic: 8.0, kept: 4.0 };
        let (errors, flicker, means, true_means) = (vec![0.5; gone.len()], vec![], vec![1.0], vec![1.0]);
        let perceived = (0..gone.len()).map(|at| (at == 0).then_some(0.25)).collect();
        Course { path: "switch", label: "", errors, perceived, cost, flicker, means, true_means, gone, late: vec![] }
            .told()
    }

    #[test]
    fn a_change_is_followed_by_what_is_missing() {
        let course = course(vec![0.5, 0.95, 1.25, 0.95, 1.0]);
        assert_eq!(course.settled_within(0.1), Some(4));
        assert_eq!(course.settled_within(0.01), Some(5));
        assert_eq!((course.missing_in(1), course.missing_in(0), course.missing_in(6)), (Some(0.5), None, None));
        assert!(course.missing_at_the_end().is_some_and(|missing| (missing - 0.025).abs() < 1e-9));
        assert_eq!(course.lateness(), None);
        assert_eq!(Course { gone: vec![0.5], ..course }.settled_within(0.1), None);
    }

    #[test]
    fn light_that_is_never_found_is_not_late() {
        // A tenth is never found, and in frame 40 a fifth of what there is to find has not come.
        let of = |share: f64| course([vec![0.9 * share; 40], vec![0.9; 60]].concat());
        let (mean, error) = of(0.8).lateness().unwrap();
        assert!((mean - 0.2).abs() < 1e-9 && error.is_none(), "{mean}");
        let runs = Course::mean_of(vec![of(0.7), of(0.9)]).unwrap();
        let (mean, error) = runs.lateness().unwrap();
        assert!((mean - 0.2).abs() < 1e-9 && (error.unwrap() - 0.1).abs() < 1e-9, "{mean} {error:?}");
        assert!((runs.gone[0] - 0.72).abs() < 1e-9 && runs.gone.len() == 100, "{}", runs.gone[0]);
        assert_eq!((runs.perceived[0], runs.perceived[1], runs.errors[7]), (Some(0.25), None, 0.5));
        assert_eq!((runs.cost.ms, Course::mean_of(vec![])), (Some(2.0), None));
        // The last quarter begins before frame 40.
        assert_eq!(course(vec![1.0; 52]).lateness(), None);
    }
}
