//! Assigns passes to queues, and decides where queues wait for each other.
//!
//! Passes in order are gathered into batches, with one open batch per queue. A pass that depends on a pass in another queue's
//! open batch closes that batch. It then starts a new batch that waits for the other, unless its queue has already waited for it
//! or for a later one. Batches are submitted in the order in which they were closed, so each waits only for batches submitted
//! before it. Therefore nothing can deadlock, even if all queues are one queue of the device.

use super::{
    super::{
        access::{Domain, Queue},
        declaration::{Declaration, Span},
        switches::Queues,
    },
    hazard::Hazards,
};

/// Passes that one queue runs one after another without waiting for other queues in between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// The queue that runs them.
    pub queue: Queue,
    /// Range of positions in [`Plan::order`](super::Plan::order).
    pub passes: Span,
    /// Range in [`Plan::waits`](super::Plan::waits): the earlier batches of other queues that must finish before it begins.
    pub waits: Span,
}

pub(super) struct Batches {
    pub order: Vec<u32>,
    pub batches: Vec<Batch>,
    pub waits: Vec<u32>,
}

/// The queue of each pass: the requested one if it exists and can run the pass, otherwise graphics.
pub(super) fn lanes(declaration: &Declaration, queues: Queues) -> Vec<Queue> {
    let granted = |queue: Queue, domain: Domain| match queue {
        Queue::Graphics => false,
        Queue::AsyncCompute => domain != Domain::Raster,
        Queue::Transfer => domain == Domain::Copy,
    };
    let lane = |wish: Queue, domain: Domain| {
        if queues.has(wish) && granted(wish, domain) { wish } else { Queue::Graphics }
    };
    declaration.passes.iter().map(|p| lane(p.queue, p.domain)).collect()
}

const NONE: u32 = u32::MAX;
const QUEUES: usize = Queue::ALL.len();

/// A batch to which passes are still added.
#[derive(Clone, Default)]
struct Open {
    passes: Vec<u32>,
    waits: Vec<u32>,
}

struct Gathering {
    open: [Open; QUEUES],
    /// For each queue, how many batches of every queue its open batch is ordered after, as one more than the newest index.
    seen: [[u32; QUEUES]; QUEUES],
    /// The same for each closed batch, counting itself.
    seen_after: Vec<[u32; QUEUES]>,
    made: Batches,
}

/// Divides the passes in `order` into batches. The resulting order is batch by batch.
pub(super) fn batches(order: Vec<u32>, hazards: &Hazards, lanes: &[Queue], queues: Queues) -> Batches {
    let all = Span { start: 0, end: order.len() as u32 };
    let only_graphics = queues.count() == 1 || order.iter().all(|&p| lanes[p as usize] == Queue::Graphics);
    if only_graphics {
        let batch = Batch { queue: Queue::Graphics, passes: all, waits: Span::default() };
        let batches = if order.is_empty() { Vec::new() } else { vec![batch] };
        return Batches { order, batches, waits: Vec::new() };
    }
    let mut gathering = Gathering {
        open: Default::default(),
        seen: Default::default(),
        seen_after: Vec::new(),
        made: Batches { order: Vec::with_capacity(order.len()), batches: Vec::new(), waits: Vec::new() },
    };
    let mut batch_of = vec![NONE; lanes.len()];
    for pass in order {
        let lane = lanes[pass as usize];
        for &before in hazards.before(pass) {
            let other = lanes[before as usize];
            if other == lane {
                continue;
            }
            if batch_of[before as usize] == NONE {
                gathering.close(other, &mut batch_of);
            }
            let wanted = batch_of[before as usize];
            if gathering.seen[lane.index()][other.index()] <= wanted {
                if !gathering.open[lane.index()].passes.is_empty() {
                    gathering.close(lane, &mut batch_of);
                }
                gathering.wait(lane, wanted);
            }
        }
        gathering.open[lane.index()].passes.push(pass);
    }
    for queue in Queue::ALL {
        gathering.close(queue, &mut batch_of);
    }
    gathering.made
}

impl Gathering {
    fn wait(&mut self, lane: Queue, batch: u32) {
        let open = &mut self.open[lane.index()];
        // Waiting for a newer batch of a queue covers the older ones.
        let queue = self.made.batches[batch as usize].queue;
        open.waits.retain(|&w| self.made.batches[w as usize].queue != queue);
        open.waits.push(batch);
        for (seen, after) in self.seen[lane.index()].iter_mut().zip(self.seen_after[batch as usize]) {
            *seen = after.max(*seen);
        }
    }

    fn close(&mut self, queue: Queue, batch_of: &mut [u32]) {
        let open = std::mem::take(&mut self.open[queue.index()]);
        if open.passes.is_empty() {
            return;
        }
        let index = self.made.batches.len() as u32;
        let made = &mut self.made;
        open.passes.iter().for_each(|&p| batch_of[p as usize] = index);
        let start = (made.order.len() as u32, made.waits.len() as u32);
        made.order.extend(open.passes);
        made.waits.extend(open.waits);
        made.batches.push(Batch {
            queue,
            passes: Span { start: start.0, end: made.order.len() as u32 },
            waits: Span { start: start.1, end: made.waits.len() as u32 },
        });
        let seen = &mut self.seen[queue.index()];
        seen[queue.index()] = index + 1;
        self.seen_after.push(*seen);
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::super::plan_with;
    use super::*;

    fn step(g: &mut FrameGraph, name: &str, queue: Queue, inputs: &[Handle<Image>]) -> Handle<Image> {
        g.pass(name, queue, |p| {
            inputs.iter().for_each(|&i| drop_token(p.sample(i)));
            (p.create("x", ImageDesc::full(Format::R8Unorm)).0.read(), |_: &mut Record| {})
        })
    }

    fn drop_token<T>(_: T) {}

    #[test]
    fn queues_wait_for_each_other_as_little_as_they_can() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let a = step(&mut g, "a", Queue::Graphics, &[]);
        let b = step(&mut g, "b", Queue::Graphics, &[a]);
        let c = step(&mut g, "c", Queue::AsyncCompute, &[a]);
        let d = step(&mut g, "d", Queue::AsyncCompute, &[a, c]);
        let e = step(&mut g, "e", Queue::Graphics, &[b, d]);
        let f = step(&mut g, "f", Queue::Graphics, &[e, c]);
        g.output(f);
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "queues=2,no-reorder");
        let batches: Vec<(Queue, Vec<&str>, Vec<u32>)> = plan
            .batches
            .iter()
            .map(|b| {
                let names = plan.order[b.passes.range()].iter().map(|&p| frame.declaration.pass_name(p));
                (b.queue, names.collect(), plan.waits[b.waits.range()].to_vec())
            })
            .collect();
        assert_eq!(
            batches,
            [
                (Queue::Graphics, vec!["a", "b"], vec![]),
                (Queue::AsyncCompute, vec!["c", "d"], vec![0]),
                (Queue::Graphics, vec!["e", "f"], vec![1]),
            ]
        );
        assert_eq!(plan_with(&frame.declaration, "queues=2,no-async").batches.len(), 1);
        assert_eq!(plan_with(&frame.declaration, "queues=2,serial").batches.len(), 1);
    }

    #[test]
    fn wishes_are_granted_where_the_pass_can_run() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        g.pass("draw", Queue::AsyncCompute, |p| {
            (p.color("x", ImageDesc::full(Format::R8Unorm), [0.0; 4]).0.read(), |_: &mut Record| {})
        });
        step(&mut g, "compute", Queue::Transfer, &[]);
        let lanes = lanes(g.declaration(), Queues { async_compute: true, transfer: true });
        assert_eq!(lanes, [Queue::Graphics, Queue::Graphics]);
    }
}
