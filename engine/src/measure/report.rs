//! The report of a run, as JSON and CSV.

use serde::{Serialize, Serializer};

use super::{Acceleration, Memory, SlotReport, Statistics, statistics::Spread};
use crate::config::Config;

/// The device that a run used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Device {
    /// Name, as the driver gives it.
    pub name: String,
    /// Driver and version.
    pub driver: String,
    /// `cpu`, `integrated`, `discrete`, `virtual` or `other`.
    pub kind: String,
}

/// What was run, and on which device.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Version of Magpie.
    pub magpie: String,
    /// Commit that it was built from.
    pub commit: String,
    /// The device that was used.
    pub device: Device,
    /// How rays were traced: `software`, `query` or `pipeline`.
    pub rays: String,
    /// Scene, as named on the command line.
    pub scene: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The complete configuration.
    pub config: Config,
}

/// A figure that only has a median.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Median {
    /// Median over the frames.
    pub median: f64,
}

/// Times of the whole frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameReport {
    /// From the first to the last timestamp, milliseconds; `None` if the device has no timestamps.
    pub gpu_ms: Option<Spread>,
    /// From declaring to the end of the wait, milliseconds.
    pub cpu_ms: Median,
}

/// Work of the graph itself, as medians over the frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GraphReport {
    /// Time to declare the frame, microseconds.
    pub declare_us: f64,
    /// Time to plan it, microseconds.
    pub plan_us: f64,
    /// Time to find or create the objects behind its resources, microseconds.
    pub bind_us: f64,
    /// Time to record it, microseconds.
    pub record_us: f64,
    /// Time to submit it, microseconds.
    pub submit_us: f64,
    /// Time to wait for the device, microseconds.
    pub wait_us: f64,
    /// Number of passes that ran.
    pub passes: u64,
    /// Number of passes that were culled.
    pub culled: u64,
    /// Number of barriers, each of a batch counted by itself.
    pub barriers: u64,
    /// Number of queues in use.
    pub queues: u64,
    /// Time that queues saved by overlapping, milliseconds; `None` without timestamps.
    pub overlap_ms: Option<f64>,
}

/// Rays per frame, by kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Rays {
    /// Closest-hit rays.
    pub closest: u64,
    /// Any-hit rays, such as shadow rays.
    pub any: u64,
    /// Rays through the depth image.
    pub screen: u64,
}

impl Rays {
    /// Rays of all kinds.
    pub fn total(self) -> u64 {
        self.closest + self.any + self.screen
    }
}

/// What a pass counts itself, by name; an object in JSON.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counts(pub Vec<(&'static str, u64)>);

impl Serialize for Counts {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(self.0.iter().copied())
    }
}

impl Counts {
    /// Whether it counts nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// One pass, over all frames in which it ran.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassReport {
    /// Full name; further passes of the same name in a frame get a suffix such as ` #2`.
    pub name: String,
    /// First part of the name, up to the dot.
    pub stage: String,
    /// Queue on which it ran: `graphics`, `async compute` or `transfer`.
    pub queue: &'static str,
    /// Number of frames in which it ran.
    pub frames: usize,
    /// GPU time, milliseconds; `None` if the queue has no timestamps.
    pub gpu_ms: Option<Spread>,
    /// Median time to record it, microseconds.
    pub cpu_us: f64,
    /// Rays per frame.
    pub rays: Rays,
    /// Bytes of images and of the frame's buffers that it reads and writes, as declared, per frame.
    pub bytes: u64,
    /// Non-finite values that it left out, summed over all these frames, so that one bad frame is not lost in a median.
    pub not_finite: u64,
    /// Draw calls per frame.
    pub draws: u64,
    /// Dispatches per frame.
    pub dispatches: u64,
    /// What it counts itself, per frame.
    #[serde(skip_serializing_if = "Counts::is_empty")]
    pub counts: Counts,
    /// Pipeline statistics per frame; `None` if they were not asked for, or if the pass only copies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub statistics: Option<Statistics>,
}

/// Everything that was measured; serialises to the JSON of `--timings`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// What was run.
    #[serde(flatten)]
    pub run: Run,
    /// Number of frames in the statistics.
    pub frames: usize,
    /// Number of warm-up frames before them.
    pub warmup: usize,
    /// Times of the whole frame.
    pub frame: FrameReport,
    /// Work of the graph itself.
    pub graph: GraphReport,
    /// Memory in use.
    pub memory: Memory,
    /// What is in the acceleration structures, and their cost.
    pub acceleration: Acceleration,
    /// What runs in each slot in the last frame, and what is idle and why; empty where nobody said.
    pub slots: Vec<SlotReport>,
    /// Passes in order of submission.
    pub passes: Vec<PassReport>,
}

/// Columns of the CSV: the names of the JSON, joined by dots. Those of `graph` describe the whole frame and are the same in every row.
pub const CSV_COLUMNS: [&str; 28] = [
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
    "rays.screen",
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
    /// An error of the serialiser.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// A header, then one row per pass (RFC 4180 quoting, lines end in a plain line feed). What was not measured is empty.
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
                pass.rays.screen.to_string(),
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
