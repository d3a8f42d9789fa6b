//! From a declared frame to what runs: pure functions over plain data, no Vulkan call.

mod barrier;
mod cull;
mod lifetime;

pub use barrier::{Barrier, BarrierBatch};
pub use cull::Culled;
pub use lifetime::{Lifetime, Memory, Transient};

use super::declaration::Declaration;

/// How a declared frame runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Passes to run, first to last, by their index in the declaration.
    pub order: Vec<u32>,
    /// Passes left out, by their index, and why.
    pub culled: Vec<Culled>,
    /// First and last use of each resource of the declaration; none for those that are not used.
    pub lifetimes: Vec<Option<Lifetime>>,
    /// One batch before each pass of `order`, and one more at the end.
    pub barriers: Vec<BarrierBatch>,
    /// Images and buffers to make for this frame.
    pub transients: Vec<Transient>,
    /// Memory that those take.
    pub memory: Memory,
}

/// Plans a frame. Passes run in the order of declaration, which respects every dependency: a handle exists only after the pass
/// that writes it was declared, and a version cannot be read once the next is written.
pub fn plan(declaration: &Declaration) -> Plan {
    let (order, culled) = cull::cull(declaration);
    let lifetimes = lifetime::lifetimes(declaration, &order);
    let barriers = barrier::barriers(declaration, &order);
    let transients = lifetime::transients(declaration, &order);
    let memory = lifetime::memory(&transients, &lifetimes, order.len());
    Plan { order, culled, lifetimes, barriers, transients, memory }
}
