//! Runs of uses that need not wait for each other: one write, or reads of the same contents in the same layout. Between one group of
//! a slot and the next stands a barrier, a wait for another queue, or both.

use super::{
    super::{
        access::{Layout, Queue, Uses},
        declaration::Declaration,
    },
    slots::Slots,
};

pub(super) const NONE: u32 = u32::MAX;
const QUEUES: usize = Queue::ALL.len();

/// A group, with what each queue has of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    pub resource: u32,
    pub slot: u32,
    /// The group of the same slot before it, or [`NONE`].
    pub previous: u32,
    pub layout: Layout,
    pub write: bool,
    /// Of a write, the index of its use in the declaration.
    pub use_index: u32,
    pub uses: [Uses; QUEUES],
    /// Positions of the first and last passes, or [`NONE`].
    pub first: [u32; QUEUES],
    pub last: [u32; QUEUES],
}

impl Group {
    /// The one queue that it is on.
    pub fn single(&self) -> Option<Queue> {
        let mut on = Queue::ALL.into_iter().filter(|q| self.first[q.index()] != NONE);
        let queue = on.next()?;
        on.next().is_none().then_some(queue)
    }

    /// The queue whose pass comes first.
    pub fn leader(&self) -> Queue {
        let first = Queue::ALL.into_iter().min_by_key(|q| self.first[q.index()]);
        first.unwrap_or(Queue::Graphics)
    }
}

/// The groups of a plan.
pub(super) struct Groups {
    /// By the position of their first pass.
    pub all: Vec<Group>,
    /// Of each slot, its last group, or [`NONE`].
    pub newest: Vec<u32>,
}

/// Follows each slot through the passes.
pub(super) fn groups(declaration: &Declaration, order: &[u32], slots: &Slots, lanes: &[Queue]) -> Groups {
    let mut newest = vec![NONE; slots.count()];
    let mut all: Vec<Group> = Vec::with_capacity(declaration.uses.len());
    for (position, &pass) in order.iter().enumerate() {
        let (position, decl) = (position as u32, &declaration.passes[pass as usize]);
        let lane = lanes[pass as usize].index();
        for use_index in decl.uses.range() {
            let u = &declaration.uses[use_index];
            let (layout, write, at) = (declaration.layout_of(u), u.access.writes(), u.access.at(decl.domain));
            for slot in slots.of(u) {
                let known = newest[slot as usize];
                let joins = !write && all.get(known as usize).is_some_and(|g| !g.write && g.layout == layout);
                if !joins {
                    newest[slot as usize] = all.len() as u32;
                    all.push(Group {
                        resource: u.resource,
                        slot,
                        previous: known,
                        layout,
                        write,
                        use_index: use_index as u32,
                        uses: [Uses::EMPTY; QUEUES],
                        first: [NONE; QUEUES],
                        last: [NONE; QUEUES],
                    });
                }
                let group = &mut all[newest[slot as usize] as usize];
                group.uses[lane].insert(at);
                if group.first[lane] == NONE {
                    group.first[lane] = position;
                }
                group.last[lane] = position;
            }
        }
    }
    Groups { all, newest }
}
