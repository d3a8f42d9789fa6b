//! From a declared frame to what runs: pure functions over plain data, no Vulkan call.
//!
//! | step | decides | file |
//! |---|---|---|
//! | cull | which passes run | `cull` |
//! | hazard | which pass must come before which | `hazard` |
//! | order | in which order: declared, or for less memory and more overlap | `order` |
//! | batch | on which queue, and where queues wait for each other | `batch` |
//! | lifetime | from when until when each resource is used | `lifetime` |
//! | alias | where in memory each transient lies, and after whom | `alias`, `pack` |
//! | barrier | what waits for what on each queue, and how images change layout | `barrier` |

mod alias;
mod barrier;
mod batch;
mod cull;
mod group;
mod hazard;
mod lifetime;
mod order;
mod pack;
mod slots;

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
/// Batches are handed to their queues in their order; each waits for batches before it. Inside of a batch, passes run in the order
/// of the plan, each after the barriers before it. After all batches the graphics queue waits for every queue and issues the
/// barriers at the end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Passes to run by their index in the declaration, batch by batch. A pass depends on passes before it only.
    pub order: Vec<u32>,
    /// Passes left out, by their index, and why.
    pub culled: Vec<Culled>,
    /// Runs of passes on one queue, in the order in which they are handed over.
    pub batches: Vec<Batch>,
    /// Batches that batches wait for; see [`Batch::waits`].
    pub waits: Vec<u32>,
    /// First and last use of each resource of the declaration; none for those that are not used.
    pub lifetimes: Vec<Option<Lifetime>>,
    /// Images, buffers and acceleration structures to make for this frame, by resource.
    pub transients: Vec<Transient>,
    /// Memory that these lie in.
    pub heaps: Vec<HeapPlan>,
    /// Pairs of transients: the first takes memory that the second held last.
    pub successions: Vec<(u32, u32)>,
    /// Every barrier.
    pub barriers: Vec<Barrier>,
    /// Of each position of [`Plan::order`], the barriers before the pass.
    pub before: Vec<Span>,
    /// Of each position of [`Plan::order`], the barriers after the pass: for other queues, which take over there.
    pub after: Vec<Span>,
    /// Barriers at the end, on the graphics queue.
    pub end: Span,
    /// Uses of attachments, by their index in the declaration, whose results nobody reads: they need not reach memory.
    pub unstored: Vec<u32>,
    /// What memory the transients take and could take.
    pub memory: Memory,
    /// Every pass waits for everything before it.
    pub serial: bool,
    /// Transients were allowed to share memory.
    pub alias: bool,
    /// Queues that it is made for.
    pub queues: Queues,
}

impl Plan {
    /// The batch of each position of [`Plan::order`].
    pub fn batch_of(&self, position: u32) -> &Batch {
        let at = self.batches.partition_point(|b| b.passes.end <= position);
        &self.batches[at]
    }

    /// The place of a resource among the transients.
    pub fn transient(&self, resource: u32) -> Option<&Transient> {
        let at = self.transients.binary_search_by_key(&resource, |t| t.resource).ok()?;
        Some(&self.transients[at])
    }
}

/// Plans a frame. `queues` are those of the device.
pub fn plan(declaration: &Declaration, switches: &Switches, queues: Queues, footprints: &mut dyn Footprints) -> Plan {
    let queues = switches.queues(queues);
    let slots = slots::Slots::new(declaration);
    let (kept, culled) = cull::cull(declaration, switches.cull);
    let lanes = batch::lanes(declaration, queues);
    let hazards = hazard::hazards(declaration, &kept, &slots, &lanes);
    let order = order::order(declaration, kept, &hazards, &lanes, switches.reorder && !switches.serial);
    let batch::Batches { order, batches, waits } = batch::batches(order, &hazards, &lanes, queues);
    let lifetimes = lifetime::lifetimes(declaration, &order, &lanes);
    let groups = group::groups(declaration, &order, &slots, &lanes);
    let alias = switches.alias && !switches.serial;
    let alias::Placed { transients, heaps, successions, memory } =
        alias::place(declaration, &groups, &lifetimes, alias, footprints);
    let barrier::Synchronised { barriers, before, after, end, unstored } = barrier::barriers(&barrier::Input {
        declaration,
        slots: &slots,
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

/// A plan for no particular device, with the words of `--graph`, separated by commas.
#[cfg(test)]
pub(super) fn plan_with(declaration: &Declaration, words: &str) -> Plan {
    let mut switches = Switches::default();
    for word in words.split(',').filter(|w| !w.is_empty()) {
        assert!(switches.set(word), "{word}");
    }
    plan(declaration, &switches, Queues::default(), &mut Packed)
}
