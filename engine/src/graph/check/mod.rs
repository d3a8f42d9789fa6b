//! Finds the pass and frame in which each NaN or infinity arose.
//!
//! | file | does |
//! |---|---|
//! | `watch` | adds weak passes after every pass: one scans its outputs, one reads its inputs where something was found |
//! | `finding` | what one frame held: bad values, where they are, and the inputs at that place |
//! | `trail` | follows findings through passes and frames to the pass where they arose |
//! | `poison` | writes a NaN or infinity into an output on purpose, to test the rest |
//!
//! Scanned are images of floating-point formats, all mips and layers that the pass wrote, and buffers that were declared to hold
//! floats ([`BufferDesc::of_floats`](super::BufferDesc::of_floats)); also what a frame imports, histories included, when the
//! first pass reads it. Bounded formats cannot hold a NaN: one that is lost by storing it in such an output is not found.

mod finding;
mod poison;
mod trail;
mod watch;

pub use finding::{Finding, Input, Place, Seen, Unseen, Value, Values};
pub use poison::{Bad, Poison, PoisonError};
pub use trail::{Link, Report, Trail};
pub use watch::{Scan, Scanned, SharedImports, Unscanned};

pub(super) use poison::Poisoned;
