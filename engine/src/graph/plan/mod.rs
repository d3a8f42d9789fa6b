//! Planning a declared frame: pure functions on plain data, without Vulkan calls.
//!
//! | step | decides | file |
//! |---|---|---|
//! | cull | which passes run | `cull` |
//! | hazard | which pass depends on which | `hazard` |
//! | order | the order: declared, or one with less memory and more overlap | `order` |
//! | batch | the queue of each pass, and where queues wait for each other | `batch` |
//! | lifetime | first and last use of each resource | `lifetime` |
//! | alias | placement of transients in memory, and what they alias | `alias`, `pack` |
//! | barrier | barriers on each queue, and layout transitions | `barrier` |

mod alias;
mod barrier;
mod batch;
mod cull;
mod group;
mod hazard;
mod lifetime;
mod order;
mod pack;
mod subresources;

pub use alias::{Footprint, Footprints, HeapPlan, Memory, Packed, Sharing, Transient};
pub use barrier::{Barrier, Handover, Role};
pub use batch::Batch;
pub use cull::Culled;
pub use lifetime::{Lane, Lifetime};

use super::{
    declaration::{Declaration, Span},
    switches::{Queues, Switches},
};

/// How a declared frame runs.
///
/// Batches are submitted in order; each waits only for earlier ones. Inside a batch, passes run in the order of the plan, each
/// after the barriers before it. After all batches, the graphics queue waits for every queue and issues the barriers at the end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Indices of the passes to run, batch by batch. A pass depends only on passes before it.
    pub order: Vec<u32>,
    /// Passes left out, by their index, and why.
    pub culled: Vec<Culled>,
    /// Runs of passes on one queue, in the order of submission.
    pub batches: Vec<Batch>,
    /// Indices of the batches that batches wait for; see [`Batch::waits`].
    pub waits: Vec<u32>,
    /// Lifetime of each resource of the declaration; `None` if no kept pass uses it.
    pub lifetimes: Vec<Option<Lifetime>>,
    /// Resources to make for this frame, by ascending resource index.
    pub transients: Vec<Transient>,
    /// The heaps in which these are placed.
    pub heaps: Vec<HeapPlan>,
    /// Pairs of transients (later, earlier) where the later one takes over memory of the earlier one.
    pub successions: Vec<(u32, u32)>,
    /// All barriers, sorted by place.
    pub barriers: Vec<Barrier>,
    /// For each position of [`Plan::order`], the range of barriers before the pass.
    pub before: Vec<Span>,
    /// For each position of [`Plan::order`], the range of barriers after the pass, which prepare the resource for other queues.
    pub after: Vec<Span>,
    /// The range of barriers at the end of the frame, on the graphics queue.
    pub end: Span,
    /// Uses of attachments, by index in the declaration, whose results are never read, so that they need not be stored. Ascending.
    pub unstored: Vec<u32>,
    /// Memory of the transients, as placed and without aliasing.
    pub memory: Memory,
    /// Whether every pass waits for everything before it.
    pub serial: bool,
    /// Whether transients may alias.
    pub alias: bool,
    /// The queues that it was planned for.
    pub queues: Queues,
}

impl Plan {
    /// The batch of a position of [`Plan::order`].
    pub fn batch_of(&self, position: u32) -> &Batch {
        let at = self.batches.partition_point(|b| b.passes.end <= position);
        &self.batches[at]
    }

    /// The placement of a resource; `None` if it is not a transient in use.
    pub fn transient(&self, resource: u32) -> Option<&Transient> {
        let at = self.transients.binary_search_by_key(&resource, |t| t.resource).ok()?;
        Some(&self.transients[at])
    }
}

/// Plans a frame. `queues` are those of the device, and `footprints` tells the memory requirements of its objects.
pub fn plan(declaration: &Declaration, switches: &Switches, queues: Queues, footprints: &mut dyn Footprints) -> Plan {
    let queues = switches.queues(queues);
    let subresources = subresources::Subresources::new(declaration);
    let (kept, culled) = cull::cull(declaration, switches.cull);
    let lanes = batch::lanes(declaration, queues);
    let hazards = hazard::hazards(declaration, &kept, &subresources, &lanes);
    let order = order::order(declaration, kept, &hazards, &lanes, switches.reorder && !switches.serial);
    let batch::Batches { order, batches, waits } = batch::batches(order, &hazards, &lanes, queues);
    let lifetimes = lifetime::lifetimes(declaration, &order, &lanes);
    let groups = group::groups(declaration, &order, &subresources, &lanes);
    let alias = switches.alias && !switches.serial;
    let alias::Placed { transients, heaps, successions, memory } =
        alias::place(declaration, &groups, &lifetimes, alias, footprints);
    let barrier::Synchronised { barriers, before, after, end, unstored } = barrier::barriers(&barrier::Input {
        declaration,
        subresources: &subresources,
        groups: &groups,
        transients: &transients,
        successions: &successions,
        positions: order.len(),
    });
    let serial = switches.serial;
    Plan {
        order,
        culled,
        batches,
        waits,
        lifetimes,
        transients,
        heaps,
        successions,
        barriers,
        before,
        after,
        end,
        unstored,
        memory,
        serial,
        alias,
        queues,
    }
}

/// A plan for a device with one queue, with switches in the syntax of `--graph`.
#[cfg(test)]
pub(super) fn plan_with(declaration: &Declaration, words: &str) -> Plan {
    let mut switches = Switches::default();
    for word in words.split(',').filter(|w| !w.is_empty()) {
        assert!(switches.set(word), "{word}");
    }
    plan(declaration, &switches, Queues::default(), &mut Packed)
}
