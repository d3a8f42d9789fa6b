//! Measurements: times and counts of every frame and pass, their statistics, and the files and tables that show them.
//!
//! The executor returns one [`FrameSample`] per frame. A [`Recorder`] keeps those after the warm-up and makes a [`Report`].

mod overlap;
mod recorder;
mod report;
mod slots;
mod statistics;
mod table;
mod trace;

use serde::Serialize;

pub use recorder::{MeasureError, NotFinite, Recorder};
pub use report::{CSV_COLUMNS, Counts, Device, FrameReport, GraphReport, Median, PassReport, Rays, Report, Run};
pub use slots::{PartReport, SlotReport, slot_reports, slot_table};
pub use statistics::{Spread, median, nearest_rank};
pub use table::pass_table;
pub use trace::chrome_trace;

/// One pass of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassTime {
    /// Full name, such as `shadows.trace`.
    pub name: String,
    /// First part of the name, up to the dot, such as `shadows`.
    pub stage: String,
    /// Queue on which it ran: `graphics`, `async compute` or `transfer`.
    pub queue: &'static str,
    /// GPU time, nanoseconds; `None` if the queue has no timestamps.
    pub gpu_ns: Option<u64>,
    /// Start on the GPU, nanoseconds since the frame's first timestamp.
    pub gpu_start_ns: Option<u64>,
    /// Time to record it on the CPU, nanoseconds.
    pub cpu_ns: u64,
    /// Start of recording, nanoseconds since the frame's [`start_ns`](FrameSample::start_ns).
    pub cpu_start_ns: Option<u64>,
    /// Number of draw calls.
    pub draws: u32,
    /// Number of dispatches and traces.
    pub dispatches: u32,
    /// Bytes that it reads and writes, as declared: [`Declaration::traffic`](crate::graph::Declaration::traffic).
    pub bytes: u64,
    /// Number of closest-hit rays.
    pub rays_closest: u64,
    /// Number of any-hit rays, such as shadow rays.
    pub rays_any: u64,
    /// Number of rays through the depth image.
    pub rays_screen: u64,
    /// Number of non-finite values that its shaders left out of what they keep or average.
    pub not_finite: u64,
    /// What the pass counts itself, such as surfels: [`Record::counts`](crate::graph::Record::counts).
    pub counts: Vec<(&'static str, u64)>,
    /// Thread that recorded it; 0 is the one that ran the frame.
    pub thread: u32,
    /// Shader invocations; `None` if they were not counted, or if the pass only copies.
    pub statistics: Option<Statistics>,
}

/// Pipeline statistics of a pass, as the device counts them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Statistics {
    /// Vertices of its draws.
    pub input_vertices: u64,
    /// Vertex shader invocations; fewer than vertices if results are reused.
    pub vertex_invocations: u64,
    /// Triangles after clipping.
    pub clipping_primitives: u64,
    /// Fragment shader invocations; helper invocations may count.
    pub fragment_invocations: u64,
    /// Compute shader invocations.
    pub compute_invocations: u64,
}

/// Times, counts and memory of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameSample {
    /// Start of planning on the CPU, nanoseconds since the executor was made.
    pub start_ns: Option<u64>,
    /// First timestamp of the GPU, nanoseconds since the executor was made; `None` if its clock cannot be compared with the CPU's.
    pub gpu_begin_ns: Option<u64>,
    /// From the first to the last timestamp, nanoseconds; `None` if the device has no timestamps.
    pub gpu_ns: Option<u64>,
    /// Time that the CPU spent on the frame, waiting for the device included, nanoseconds.
    pub cpu_ns: u64,
    /// Time to declare the frame, nanoseconds.
    pub declare_ns: u64,
    /// Time to plan it, nanoseconds; next to nothing for a cached plan.
    pub plan_ns: u64,
    /// Time to find or create the objects behind its resources, nanoseconds.
    pub bind_ns: u64,
    /// Time to record it, nanoseconds.
    pub record_ns: u64,
    /// Time to submit it, nanoseconds.
    pub submit_ns: u64,
    /// Time to wait for the device after submission, nanoseconds.
    pub wait_ns: u64,
    /// When that wait began, nanoseconds since the executor was made; `None` if it followed the submission at once, in the same call.
    pub wait_start_ns: Option<u64>,
    /// Number of queues that it was planned for.
    pub queues: u32,
    /// The passes that ran, in order of submission.
    pub passes: Vec<PassTime>,
    /// Waits between queues, as indices in `passes`: the pass that had to end, and the pass that could then begin.
    pub waits: Vec<(u32, u32)>,
    /// Number of passes that were culled.
    pub culled: u32,
    /// Number of barriers, each of a batch counted by itself.
    pub barriers: u32,
    /// Memory in use.
    pub memory: Memory,
    /// What is in the acceleration structures, and their cost.
    pub acceleration: Acceleration,
}

/// Memory in use, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Memory {
    /// Heaps of the transients, as allocated.
    pub transient_bytes: u64,
    /// Largest sum of the transients alive at one time: no placement takes less.
    pub transient_lower_bound: u64,
    /// Sum of all transients: what they would take without aliasing.
    pub transient_unaliased: u64,
    /// Histories, kept buffers and kept images.
    pub history_bytes: u64,
    /// Geometry, tables, materials and textures of the scene.
    pub scene_bytes: u64,
    /// Acceleration structures of both levels.
    pub acceleration_bytes: u64,
}

/// The acceleration structures of a scene, and which of its instances are in them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Acceleration {
    /// Instances in the top level.
    pub traced: u32,
    /// Instances culled because they are too far away.
    pub far: u32,
    /// Instances culled because they are outside the enlarged frustum.
    pub outside: u32,
    /// Instances culled because their solid angle is too small.
    pub small: u32,
    /// Size of all bottom levels, bytes.
    pub bottom_bytes: u64,
    /// Size of all bottom levels before compaction, bytes.
    pub uncompacted_bytes: u64,
    /// Size of the top level, bytes.
    pub top_bytes: u64,
    /// Time to build all bottom levels when the scene was loaded, milliseconds: device time if the driver builds them, otherwise
    /// host time.
    pub bottom_ms: f64,
    /// Time to build the top level, milliseconds: host time of the newest build if Magpie builds it, or device time of the build
    /// when the scene was loaded if the driver does.
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
