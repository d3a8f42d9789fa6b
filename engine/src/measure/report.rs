//! The report of a run, as JSON and CSV.

use serde::Serialize;

use super::{Acceleration, Memory, SlotReport, Statistics, statistics::Spread};
use crate::config::Config;

/// The device of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Device {
    /// As the driver names it.
    pub name: String,
    /// Driver and version.
    pub driver: String,
    /// `cpu`, `integrated` or `discrete`.
    pub kind: String,
}

/// What was run, on what.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Version of Magpie.
    pub magpie: String,
    /// Commit that it was built from.
    pub commit: String,
    /// The device.
    pub device: Device,
    /// Ray backend.
    pub rays: String,
    /// Scene, as named on the command line.
    pub scene: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The whole configuration.
    pub config: Config,
}

/// A figure of which only the median is given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Median {
    /// Middle value.
    pub median: f64,
}

/// Times of the whole frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameReport {
    /// From the first to the last timestamp, milliseconds.
    pub gpu_ms: Option<Spread>,
    /// Milliseconds.
    pub cpu_ms: Median,
}

/// The graph's own work, medians over the frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GraphReport {
    /// Declaring, microseconds.
    pub declare_us: f64,
    /// Planning, microseconds.
    pub plan_us: f64,
    /// Finding or making the objects behind the resources, microseconds.
    pub bind_us: f64,
    /// Recording, microseconds.
    pub record_us: f64,
    /// Handing over, microseconds.
    pub submit_us: f64,
    /// Waiting for the device, microseconds.
    pub wait_us: f64,
    /// Passes that ran.
    pub passes: u64,
    /// Passes that were culled.
    pub culled: u64,
    /// Barriers.
    pub barriers: u64,
    /// Queues in use.
    pub queues: u64,
    /// What these saved by working at the same time, milliseconds; none where passes have no times.
    pub overlap_ms: Option<f64>,
}

/// Rays per frame, by kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Rays {
    /// Looked for the closest hit.
    pub closest: u64,
    /// Looked for any hit.
    pub any: u64,
}

/// One pass over all frames in which it ran.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassReport {
    /// Full name; the second of that name in a frame has ` #2` behind it.
    pub name: String,
    /// Slot that declared it.
    pub stage: String,
    /// Queue on which it ran.
    pub queue: &'static str,
    /// Frames in which it ran.
    pub frames: usize,
    /// Milliseconds; none where the queue has no timestamps.
    pub gpu_ms: Option<Spread>,
    /// Median time to record it, microseconds.
    pub cpu_us: f64,
    /// Rays per frame.
    pub rays: Rays,
    /// Bytes of images and of the frame's buffers that it reads and writes, as declared, per frame.
    pub bytes: u64,
    /// Values that were not finite and that it left out, in all these frames together: one bad frame is not to be lost in a median.
    pub not_finite: u64,
    /// Draw calls per frame.
    pub draws: u64,
    /// Dispatches per frame.
    pub dispatches: u64,
    /// What its shaders did per frame, in a run that asked for it; none where it only copies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub statistics: Option<Statistics>,
}

/// Everything that was measured; serialises to the JSON of `--timings`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// What was run.
    #[serde(flatten)]
    pub run: Run,
    /// Frames in the figures.
    pub frames: usize,
    /// Frames before them.
    pub warmup: usize,
    /// Whole frame.
    pub frame: FrameReport,
    /// The graph's own work.
    pub graph: GraphReport,
    /// Memory in use.
    pub memory: Memory,
    /// What rays see, and what that takes.
    pub acceleration: Acceleration,
    /// What runs in each slot in the last frame, and what is idle and why; empty where nobody said.
    pub slots: Vec<SlotReport>,
    /// Passes in order of submission.
    pub passes: Vec<PassReport>,
}

/// Columns of the CSV: the names of the JSON, joined by dots. Those of `graph` are of the whole frame, the same in every row.
pub const CSV_COLUMNS: [&str; 27] = [
    "name",
    "stage",
    "queue",
    "frames",
    "gpu_ms.median",
    "gpu_ms.min",
    "gpu_ms.p99",
    "gpu_ms.max",
    "cpu_us",
    "rays.closest",
    "rays.any",
    "bytes",
    "not_finite",
    "draws",
    "dispatches",
    "statistics.input_vertices",
    "statistics.vertex_invocations",
    "statistics.clipping_primitives",
    "statistics.fragment_invocations",
    "statistics.compute_invocations",
    "graph.declare_us",
    "graph.plan_us",
    "graph.bind_us",
    "graph.record_us",
    "graph.submit_us",
    "graph.wait_us",
    "graph.overlap_ms",
];

impl Report {
    /// The JSON of `--timings`.
    ///
    /// # Errors
    /// What the serialiser says.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// One row per pass under a row of names (RFC 4180 quoting, lines end in a plain line feed). What was not measured is
    /// empty.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = CSV_COLUMNS.join(",") + "\n";
        for pass in &self.passes {
            let time = |of: fn(&Spread) -> f64| pass.gpu_ms.as_ref().map_or(String::new(), |s| of(s).to_string());
            let counted =
                |of: fn(&Statistics) -> u64| pass.statistics.as_ref().map_or(String::new(), |s| of(s).to_string());
            let graph = &self.graph;
            let row: [String; CSV_COLUMNS.len()] = [
                quoted(&pass.name),
                quoted(&pass.stage),
                quoted(pass.queue),
                pass.frames.to_string(),
                time(|s| s.median),
                time(|s| s.min),
                time(|s| s.p99),
                time(|s| s.max),
                pass.cpu_us.to_string(),
                pass.rays.closest.to_string(),
                pass.rays.any.to_string(),
                pass.bytes.to_string(),
                pass.not_finite.to_string(),
                pass.draws.to_string(),
                pass.dispatches.to_string(),
                counted(|s| s.input_vertices),
                counted(|s| s.vertex_invocations),
                counted(|s| s.clipping_primitives),
                counted(|s| s.fragment_invocations),
                counted(|s| s.compute_invocations),
                graph.declare_us.to_string(),
                graph.plan_us.to_string(),
                graph.bind_us.to_string(),
                graph.record_us.to_string(),
                graph.submit_us.to_string(),
                graph.wait_us.to_string(),
                graph.overlap_ms.map_or(String::new(), |ms| ms.to_string()),
            ];
            text += &row.join(",");
            text.push('\n');
        }
        text
    }
}

fn quoted(field: &str) -> String {
    if field.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

#[cfg(test)]
mod tests;
