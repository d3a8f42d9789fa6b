//! Lifetime of each resource, as positions in the plan.

use super::super::{access::Queue, declaration::Declaration};

/// First and last use of a resource, as positions in the plan's order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lifetime {
    /// Position of the first pass that uses it.
    pub first: u32,
    /// Position of the last pass that uses it.
    pub last: u32,
    /// The queue or queues that use it.
    pub lane: Lane,
    /// Size of its contents in bytes, without padding.
    pub bytes: u64,
}

/// The queues that use a resource. Positions on different queues are not ordered in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// A single queue, where positions are ordered in time.
    One(Queue),
    /// More than one queue.
    Several,
}

/// Lifetime of each resource; `None` if no kept pass uses it. `queues` is the queue of each pass.
pub(super) fn lifetimes(declaration: &Declaration, order: &[u32], queues: &[Queue]) -> Vec<Option<Lifetime>> {
    let mut lifetimes: Vec<Option<Lifetime>> = vec![None; declaration.resources.len()];
    for (position, &pass) in order.iter().enumerate() {
        let (position, lane) = (position as u32, Lane::One(queues[pass as usize]));
        for u in declaration.uses_of(pass) {
            let life = lifetimes[u.resource as usize].get_or_insert_with(|| {
                let bytes = declaration.resources[u.resource as usize].bytes();
                Lifetime { first: position, last: position, lane, bytes }
            });
            life.last = position;
            if life.lane != lane {
                life.lane = Lane::Several;
            }
        }
    }
    lifetimes
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::super::plan_with;
    use super::*;

    #[test]
    fn from_first_to_last_use() {
        let mut g = FrameGraph::new(Extent::new(10, 10));
        let desc = ImageDesc::full(Format::R32Float);
        let mut image = g.pass("0", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
        for name in ["1", "2", "3"] {
            let queue = if name == "2" { Queue::AsyncCompute } else { Queue::Graphics };
            image = g.pass(name, queue, |p| {
                p.sample(image.read());
                (p.create("x", desc).0, |_: &mut Record| {})
            });
        }
        let _ = g.pass("culled", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
        g.output(image.read());
        let frame = g.finish().unwrap();
        let lives = |words: &str| plan_with(&frame.declaration, words).lifetimes;
        let graphics = Lane::One(Queue::Graphics);
        assert_eq!(lives("")[1], Some(Lifetime { first: 1, last: 2, lane: graphics, bytes: 400 }));
        assert_eq!(lives("")[3], Some(Lifetime { first: 3, last: 3, lane: graphics, bytes: 400 }));
        assert_eq!(lives("")[4], None);
        assert_eq!(lives("queues=2")[1].map(|l| l.lane), Some(Lane::Several));
        assert_eq!(lives("queues=2")[3].map(|l| l.lane), Some(graphics));
    }
}
