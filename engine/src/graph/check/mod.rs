//! Finds the pass and frame in which each NaN or infinity arose.
//!
//! | file | does |
//! |---|---|
//! | `scan` | adds weak passes after every pass: one scans its outputs, one reads its inputs where something was found |
//! | `finding` | what one frame held: bad values, where they are, and the inputs at that place |
//! | `tracker` | follows findings through passes and frames to the pass where they arose |
//! | `poison` | writes a NaN or infinity into an output on purpose, to test the rest |
//!
//! Scanned are images of floating-point formats, all mips and layers that the pass wrote, and buffers that were declared to hold
//! floats ([`BufferDesc::of_floats`](super::BufferDesc::of_floats)); also what a frame imports, histories included, when the
//! first pass reads it. Bounded formats cannot hold a NaN: one that is lost by storing it in such an output is not found.

mod finding;
mod poison;
mod scan;
mod tracker;

pub use finding::{Finding, Input, InputValue, NotScannable, Place, Value, Values};
pub use poison::{Poison, PoisonError, PoisonValue};
pub use scan::{Scan, Scanned, SharedImports, Unscanned};
pub use tracker::{FindingTracker, Link, Report};

pub(super) use poison::Poisoned;
