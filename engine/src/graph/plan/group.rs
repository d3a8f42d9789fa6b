//! Groups of uses that need no synchronisation among each other: one write, or reads of the same contents in the same layout.
//! Between consecutive groups of a subresource there is a barrier, a wait for another queue, or both.

use super::{
    super::{
        access::{Layout, Queue, Uses},
        declaration::Declaration,
    },
    subresources::Subresources,
};

pub(super) const NONE: u32 = u32::MAX;
const QUEUES: usize = Queue::ALL.len();

/// One group, with its uses and passes per queue.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    pub resource: u32,
    pub subresource: u32,
    /// Index of the previous group of the subresource, or [`NONE`].
    pub previous: u32,
    pub layout: Layout,
    pub write: bool,
    /// Index of the use in the declaration, for a write.
    pub use_index: u32,
    pub uses: [Uses; QUEUES],
    /// Positions of the first and last pass on each queue, or [`NONE`].
    pub first: [u32; QUEUES],
    pub last: [u32; QUEUES],
}

impl Group {
    /// The queue that it is on, if it is only one.
    pub fn single(&self) -> Option<Queue> {
        let mut on = Queue::ALL.into_iter().filter(|q| self.first[q.index()] != NONE);
        let queue = on.next()?;
        on.next().is_none().then_some(queue)
    }

    /// The queue with the earliest pass.
    pub fn leader(&self) -> Queue {
        let first = Queue::ALL.into_iter().min_by_key(|q| self.first[q.index()]);
        first.unwrap_or(Queue::Graphics)
    }
}

/// All groups of a plan.
pub(super) struct Groups {
    /// In the order of their first passes.
    pub all: Vec<Group>,
    /// Index of each subresource's last group, or [`NONE`].
    pub newest: Vec<u32>,
}

/// Follows each subresource through the passes in order.
pub(super) fn groups(declaration: &Declaration, order: &[u32], subresources: &Subresources, lanes: &[Queue]) -> Groups {
    let mut newest = vec![NONE; subresources.count()];
    let mut all: Vec<Group> = Vec::with_capacity(declaration.uses.len());
    for (position, &pass) in order.iter().enumerate() {
        let (position, decl) = (position as u32, &declaration.passes[pass as usize]);
        let lane = lanes[pass as usize].index();
        for use_index in decl.uses.range() {
            let u = &declaration.uses[use_index];
            let layout = declaration.resources[u.resource as usize].shape.layout(u.access);
            let (write, at) = (u.access.writes(), u.access.at(decl.domain));
            for subresource in subresources.of(u) {
                let known = newest[subresource as usize];
                let joins = !write && all.get(known as usize).is_some_and(|g| !g.write && g.layout == layout);
                if !joins {
                    newest[subresource as usize] = all.len() as u32;
                    all.push(Group {
                        resource: u.resource,
                        subresource,
                        previous: known,
                        layout,
                        write,
                        use_index: use_index as u32,
                        uses: [Uses::EMPTY; QUEUES],
                        first: [NONE; QUEUES],
                        last: [NONE; QUEUES],
                    });
                }
                let group = &mut all[newest[subresource as usize] as usize];
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
