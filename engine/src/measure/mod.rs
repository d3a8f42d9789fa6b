//! Measurements: what every frame and pass took, their statistics, and the files and tables that show them.
//!
//! Execution fills one [`FrameSample`] per frame; a [`Recorder`] keeps those after the warm-up and makes a [`Report`].

mod overlap;
mod recorder;
mod report;
mod slots;
mod statistics;
mod table;
mod trace;

use serde::Serialize;

pub use recorder::{MeasureError, NotFinite, Recorder};
pub use report::{CSV_COLUMNS, Device, FrameReport, GraphReport, Median, PassReport, Rays, Report, Run};
pub use slots::{PartReport, SlotReport, slot_reports, slot_table};
pub use statistics::{Spread, median, nearest_rank};
pub use table::pass_table;
pub use trace::chrome_trace;

/// One pass of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassTime {
    /// Full name, such as `shadows.trace`.
    pub name: String,
    /// Slot that declared it, such as `shadows`.
    pub stage: String,
    /// Queue on which it ran: `graphics`, `async compute` or `transfer`.
    pub queue: &'static str,
    /// GPU time, nanoseconds; none where the queue has no timestamps.
    pub gpu_ns: Option<u64>,
    /// Begin on the GPU, nanoseconds since the frame's first timestamp.
    pub gpu_start_ns: Option<u64>,
    /// Time to record it on the CPU, nanoseconds.
    pub cpu_ns: u64,
    /// Begin of recording, nanoseconds since the frame's [`start_ns`](FrameSample::start_ns).
    pub cpu_start_ns: Option<u64>,
    /// Draw calls.
    pub draws: u32,
    /// Dispatches and traces.
    pub dispatches: u32,
    /// Bytes that it reads and writes, as declared: [`Declaration::traffic`](crate::graph::Declaration::traffic).
    pub bytes: u64,
    /// Rays that looked for the closest hit.
    pub rays_closest: u64,
    /// Rays that looked for any hit.
    pub rays_any: u64,
    /// Values that were not finite, and that its shaders left out of what they keep or average.
    pub not_finite: u64,
    /// Thread that recorded it: 0 is the one that ran the frame.
    pub thread: u32,
    /// What its shaders did; none where nobody asked, or it only copies.
    pub statistics: Option<Statistics>,
}

/// What the shaders of a pass did, as the device counts it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Statistics {
    /// Vertices that came in.
    pub input_vertices: u64,
    /// Runs of vertex shaders; fewer than vertices where results are shared.
    pub vertex_invocations: u64,
    /// Triangles that were left after clipping.
    pub clipping_primitives: u64,
    /// Runs of fragment shaders; helpers may count.
    pub fragment_invocations: u64,
    /// Runs of compute shaders.
    pub compute_invocations: u64,
}

/// One frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameSample {
    /// Begin of planning on the CPU, nanoseconds since the run began.
    pub start_ns: Option<u64>,
    /// The GPU's first timestamp, nanoseconds since the run began; none where its clock cannot be compared with the CPU's.
    pub gpu_begin_ns: Option<u64>,
    /// From the first to the last timestamp, nanoseconds; none where the device has no timestamps.
    pub gpu_ns: Option<u64>,
    /// Whole frame on the CPU, nanoseconds.
    pub cpu_ns: u64,
    /// Declaring the graph, nanoseconds.
    pub declare_ns: u64,
    /// Planning it, nanoseconds; a cached plan takes next to nothing.
    pub plan_ns: u64,
    /// Finding or making the objects behind its resources, between planning and recording, nanoseconds.
    pub bind_ns: u64,
    /// Recording it, nanoseconds.
    pub record_ns: u64,
    /// Handing it to the device, nanoseconds.
    pub submit_ns: u64,
    /// Waiting for the device after that, nanoseconds.
    pub wait_ns: u64,
    /// Queues that it was planned for.
    pub queues: u32,
    /// What ran, in order of submission.
    pub passes: Vec<PassTime>,
    /// Where a queue waited for another: the pass that had to end and the one that then could begin, by their index in `passes`.
    pub waits: Vec<(u32, u32)>,
    /// Passes that were declared and culled.
    pub culled: u32,
    /// Barriers, batched ones counted one by one.
    pub barriers: u32,
    /// Memory in use.
    pub memory: Memory,
    /// What rays see, and what that takes.
    pub acceleration: Acceleration,
}

/// Memory in use, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Memory {
    /// Heaps of the transients, as placed.
    pub transient_bytes: u64,
    /// What the transients alive at the same time need at least.
    pub transient_lower_bound: u64,
    /// What they would take without aliasing.
    pub transient_unaliased: u64,
    /// Kept from frame to frame.
    pub history_bytes: u64,
    /// Geometry, materials and textures.
    pub scene_bytes: u64,
    /// Acceleration structures.
    pub acceleration_bytes: u64,
}

/// The acceleration structures of a scene, and how many of its instances are in them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Acceleration {
    /// Instances that rays see.
    pub traced: u32,
    /// Instances left out: too far away.
    pub far: u32,
    /// Instances left out: outside of the expanded frustum.
    pub outside: u32,
    /// Instances left out: they look too small.
    pub small: u32,
    /// Bytes of all bottom levels.
    pub bottom_bytes: u64,
    /// The same before compaction.
    pub uncompacted_bytes: u64,
    /// Bytes of the top level.
    pub top_bytes: u64,
    /// Milliseconds to build all bottom levels when the scene was loaded: of the device where the driver builds, else of the host.
    pub bottom_ms: f64,
    /// Milliseconds to build the newest top level: of the host where Magpie builds it; of the device, when the scene was loaded,
    /// where the driver does.
    pub top_ms: f64,
}

impl std::fmt::Display for Acceleration {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let megabytes = |bytes: u64| bytes as f64 / 1e6;
        let left_out = self.far + self.outside + self.small;
        write!(f, "rays see {} of {} instances", self.traced, self.traced + left_out)?;
        if left_out > 0 {
            write!(f, " (left out: {} far, {} outside, {} small)", self.far, self.outside, self.small)?;
        }
        write!(f, "; bottom levels {:.2} MB", megabytes(self.bottom_bytes))?;
        if self.uncompacted_bytes > self.bottom_bytes {
            write!(f, " (compacted from {:.2} MB)", megabytes(self.uncompacted_bytes))?;
        }
        let (bottom, top) = (self.bottom_ms, self.top_ms);
        write!(f, ", built in {bottom:.1} ms; top level {:.2} MB, built in {top:.2} ms", megabytes(self.top_bytes))
    }
}
