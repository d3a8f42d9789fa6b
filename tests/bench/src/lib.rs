//! The benchmarks. [`rays`] is `magpie bench rays`, [`motion`] is `magpie bench motion`, [`pairs`] is `magpie bench pairs`, [`lights`] is
//! `magpie bench lights`; the rest is `magpie bench graph`: CPU cost per pass of a frame graph, compared with hand-written Vulkan and other graphs.
//!
//! Every [`Contestant`] does the same [`Work`]; [`run`] lets them take turns and makes a [`Report`]. `docs/bench.md` describes the method.

mod allocations;
mod chart;
mod clock;
mod contestant;
mod floor;
mod frame_error;
pub mod lights;
mod magpie;
pub mod motion;
pub mod pairs;
pub mod rays;
mod report;
mod run;
#[cfg(feature = "peers")]
mod vk_graph;
#[cfg(feature = "peers")]
mod vulkano;
mod work;

pub use self::magpie::Magpie;
#[cfg(feature = "peers")]
pub use self::vk_graph::VkGraph;
#[cfg(feature = "peers")]
pub use self::vulkano::Taskgraph;
pub use allocations::allocations;
pub use chart::ChartError;
pub use clock::{Clock, RETIRE};
pub use contestant::{BenchError, Contestant, Frame};
pub use floor::Floor;
pub use frame_error::FrameBenchError;
pub use report::{Entry, Growth, LeftOut, Phase, Report, Row};
pub use run::{MAX_PASSES, MAX_REPEAT, Options, QUICK_PASSES, run};
pub use work::{Variant, Work};
