//! Collects frames and reduces them to a report.

use std::collections::{BTreeMap, HashMap};

use super::{
    FrameSample, PassTime, Statistics,
    report::{Counts, FrameReport, GraphReport, Median, PassReport, Rays, Report, Run},
    statistics::{Spread, median},
};

/// Why there is no report.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeasureError {
    /// Every frame belonged to the warm-up.
    #[error("no frame to report: {seen} came in, and the first {warmup} are the warm-up")]
    NoFrames {
        /// Number of frames that were recorded.
        seen: usize,
        /// Number of warm-up frames.
        warmup: usize,
    },
}

/// Collects the frames after the warm-up.
#[derive(Clone, Debug)]
pub struct Recorder {
    warmup: usize,
    /// Frames that are kept: the newest.
    most: usize,
    seen: usize,
    frames: Vec<FrameSample>,
    not_finite: Vec<NotFinite>,
}

/// Non-finite values that a pass left out of what it keeps or averages, over all frames, the warm-up included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotFinite {
    /// Name of the pass that read them. They arose in this pass or in one before it.
    pub pass: String,
    /// Number of values.
    pub values: u64,
    /// The first frame with any, counted from 0.
    pub first_frame: usize,
    /// Number of frames with any.
    pub frames: usize,
}

impl std::fmt::Display for NotFinite {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { pass, values, first_frame, frames } = self;
        let are = if *values == 1 { "value that was" } else { "values that were" };
        write!(f, "{pass} left out {values} {are} not finite, in frame {first_frame}")?;
        match frames - 1 {
            0 => Ok(()),
            1 => write!(f, " and 1 more"),
            more => write!(f, " and {more} more"),
        }
    }
}

impl Recorder {
    /// A recorder that skips the first `warmup` frames.
    #[must_use]
    pub fn new(warmup: usize) -> Self {
        Self { warmup, most: usize::MAX, seen: 0, frames: Vec::new(), not_finite: Vec::new() }
    }

    /// A recorder that keeps the newest `most` frames only.
    #[must_use]
    pub fn of_newest(most: usize) -> Self {
        Self { most, ..Self::new(0) }
    }

    /// Adds the next frame.
    pub fn push(&mut self, frame: FrameSample) {
        self.count_not_finite(&frame);
        self.seen += 1;
        if self.seen > self.warmup {
            if self.frames.len() >= self.most.max(1) {
                self.frames.remove(0);
            }
            self.frames.push(frame);
        }
    }

    fn count_not_finite(&mut self, frame: &FrameSample) {
        let mut counted = BTreeMap::<&str, u64>::new(); // several passes may have one name
        for pass in frame.passes.iter().filter(|p| p.not_finite > 0) {
            *counted.entry(&pass.name).or_default() += pass.not_finite;
        }
        for (name, values) in counted {
            if let Some(known) = self.not_finite.iter_mut().find(|n| n.pass == name) {
                known.values += values;
                known.frames += 1;
            } else {
                let (pass, first_frame) = (name.to_owned(), self.seen);
                self.not_finite.push(NotFinite { pass, values, first_frame, frames: 1 });
            }
        }
    }

    /// Passes that left out non-finite values, in the order in which they first did. Warm-up frames count too.
    #[must_use]
    pub fn not_finite(&self) -> &[NotFinite] {
        &self.not_finite
    }

    /// The frames after the warm-up.
    #[must_use]
    pub fn frames(&self) -> &[FrameSample] {
        &self.frames
    }

    /// Statistics over the frames. Those of a pass are over the frames in which it ran. Counts and times of the graph are
    /// medians; memory is that of the last frame.
    ///
    /// # Errors
    /// [`MeasureError::NoFrames`] if there are no frames after the warm-up.
    pub fn report(&self, run: Run) -> Result<Report, MeasureError> {
        let Some(last) = self.frames.last() else {
            return Err(MeasureError::NoFrames { seen: self.seen, warmup: self.warmup });
        };
        let of = |value: fn(&FrameSample) -> u64| middle(self.frames.iter().map(value).collect());
        let gpu = self.frames.iter().filter_map(|f| f.gpu_ns).collect();
        Ok(Report {
            run,
            frames: self.frames.len(),
            warmup: self.warmup,
            frame: FrameReport { gpu_ms: Spread::of(gpu, 1e6), cpu_ms: Median { median: of(|f| f.cpu_ns) / 1e6 } },
            graph: GraphReport {
                declare_us: of(|f| f.declare_ns) / 1e3,
                plan_us: of(|f| f.plan_ns) / 1e3,
                bind_us: of(|f| f.bind_ns) / 1e3,
                record_us: of(|f| f.record_ns) / 1e3,
                submit_us: of(|f| f.submit_ns) / 1e3,
                wait_us: of(|f| f.wait_ns) / 1e3,
                passes: of(|f| f.passes.len() as u64).round() as u64,
                culled: of(|f| u64::from(f.culled)).round() as u64,
                barriers: of(|f| u64::from(f.barriers)).round() as u64,
                queues: of(queues).round() as u64,
                overlap_ms: middle_of(self.frames.iter().filter_map(FrameSample::overlap_ns)).map(|ns| ns / 1e6),
            },
            memory: last.memory,
            acceleration: last.acceleration,
            slots: Vec::new(),
            passes: self.columns().into_iter().map(Column::report).collect(),
        })
    }

    /// Gathers the samples of each pass. A pass that first runs in a later frame is inserted after its predecessor in that frame.
    /// If a name occurs several times in a frame, each occurrence is a pass of its own.
    fn columns(&self) -> Vec<Column<'_>> {
        let mut columns: Vec<Column<'_>> = Vec::new();
        for frame in &self.frames {
            let (mut after, mut seen) = (0, HashMap::<&str, usize>::new());
            for pass in &frame.passes {
                let count = seen.entry(&pass.name).or_default();
                let occurrence = *count;
                *count += 1;
                let is_it = |c: &Column<'_>| c.occurrence == occurrence && c.samples[0].name == pass.name;
                // Nearly always it follows the one before, as in other frames.
                let place = Some(after).filter(|place| columns.get(*place).is_some_and(is_it));
                let place = place.or_else(|| columns.iter().position(is_it)).unwrap_or_else(|| {
                    columns.insert(after, Column { occurrence, samples: vec![] });
                    after
                });
                columns[place].samples.push(pass);
                after = place + 1;
            }
        }
        columns
    }
}

/// All samples of one pass, at least one.
struct Column<'a> {
    occurrence: usize,
    samples: Vec<&'a PassTime>,
}

impl Column<'_> {
    fn report(self) -> PassReport {
        let first = self.samples[0];
        let of = |value: fn(&PassTime) -> u64| middle(self.samples.iter().map(|p| value(p)).collect());
        let name = match self.occurrence {
            0 => first.name.clone(),
            n => format!("{} #{}", first.name, n + 1),
        };
        PassReport {
            name,
            stage: first.stage.clone(),
            queue: first.queue,
            frames: self.samples.len(),
            gpu_ms: Spread::of(self.samples.iter().filter_map(|p| p.gpu_ns).collect(), 1e6),
            cpu_us: of(|p| p.cpu_ns) / 1e3,
            rays: Rays {
                closest: of(|p| p.rays_closest).round() as u64,
                any: of(|p| p.rays_any).round() as u64,
                screen: of(|p| p.rays_screen).round() as u64,
            },
            bytes: of(|p| p.bytes).round() as u64,
            not_finite: self.samples.iter().map(|p| p.not_finite).sum(),
            draws: of(|p| u64::from(p.draws)).round() as u64,
            dispatches: of(|p| u64::from(p.dispatches)).round() as u64,
            counts: counts(&self.samples),
            statistics: statistics(&self.samples),
        }
    }
}

/// Number of different queues on which the passes of a frame ran.
fn queues(frame: &FrameSample) -> u64 {
    let passes = &frame.passes;
    let first = |at: usize| !passes[..at].iter().any(|p| p.queue == passes[at].queue);
    (0..passes.len()).filter(|&at| first(at)).count() as u64
}

/// Medians of what the pass counts itself, over the frames in which it does.
fn counts(samples: &[&PassTime]) -> Counts {
    let mut names: Vec<&'static str> = Vec::new();
    for (name, _) in samples.iter().flat_map(|p| &p.counts) {
        if !names.contains(name) {
            names.push(name);
        }
    }
    let of = |name: &'static str| {
        let values = samples.iter().flat_map(|p| &p.counts).filter(|(n, _)| *n == name).map(|(_, count)| *count);
        (name, middle_of(values).unwrap_or_default().round() as u64)
    };
    Counts(names.into_iter().map(of).collect())
}

/// Median invocation counts, over the frames that have any; `None` if none has.
fn statistics(samples: &[&PassTime]) -> Option<Statistics> {
    let counted: Vec<Statistics> = samples.iter().filter_map(|p| p.statistics).collect();
    let of = |value: fn(&Statistics) -> u64| middle_of(counted.iter().map(value)).map(|n| n.round() as u64);
    Some(Statistics {
        input_vertices: of(|s| s.input_vertices)?,
        vertex_invocations: of(|s| s.vertex_invocations)?,
        clipping_primitives: of(|s| s.clipping_primitives)?,
        fragment_invocations: of(|s| s.fragment_invocations)?,
        compute_invocations: of(|s| s.compute_invocations)?,
    })
}

/// Median of at least one value.
fn middle(values: Vec<u64>) -> f64 {
    middle_of(values.into_iter()).unwrap_or_default()
}

/// Median; `None` without values.
fn middle_of(values: impl Iterator<Item = u64>) -> Option<f64> {
    let mut values: Vec<u64> = values.collect();
    // Most counts are the same in every frame.
    let first = *values.first()?;
    if values.iter().any(|value| *value != first) {
        values.sort_unstable();
    }
    median(&values)
}
