//! NaN and infinity: where each one comes from.
//!
//! | file | does |
//! |---|---|
//! | `watch` | adds weak passes after every pass: a scan of what it wrote, then a look at its inputs where something was found |
//! | `finding` | what one frame held that it should not, and what lay around it |
//! | `trail` | follows findings through passes and frames to the pass where they arose |
//! | `poison` | spoils an output on purpose, to test the rest |
//!
//! Scanned are images of floating-point formats, all mips and layers that the pass wrote, and buffers that were declared to be of
//! floats ([`BufferDesc::of_floats`](super::BufferDesc::of_floats)); also what comes into the frame from outside, histories
//! included, when the first pass reads it. Bounded formats cannot hold a NaN: one that a pass loses in such an output is not seen.

mod finding;
mod poison;
mod trail;
mod watch;

pub use finding::{Finding, Input, Place, Seen, Unseen, Value, Values};
pub use poison::{Bad, Poison, PoisonError};
pub use trail::{Link, Report, Trail};
pub use watch::{Scan, Scanned, SharedImports, Unscanned};

pub(super) use poison::Poisoned;
