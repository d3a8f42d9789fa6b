//! Placement of transients in memory.
//!
//! Transients with disjoint lifetimes may alias if they are used on the same queue, where the order of passes says when one is
//! done. Transients that several queues use, histories and imports are never aliased.

use super::{
    super::{
        access::{Queue, Uses},
        declaration::{Declaration, Shape},
    },
    group::Groups,
    lifetime::{Lane, Lifetime},
    pack::{self, Item},
};

/// Memory requirements of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Size in bytes, padding of the device included.
    pub bytes: u64,
    /// Alignment of its offset, a power of two.
    pub align: u64,
    /// Kind of memory, by the device's own number.
    pub kind: u8,
}

/// Source of memory requirements: a device, or a test.
pub trait Footprints {
    /// Memory requirements of a resource with these uses.
    fn footprint(&mut self, shape: Shape, uses: Uses, sharing: Sharing) -> Footprint;

    /// Least distance between an image and any other object, a power of two (`bufferImageGranularity`).
    fn granularity(&self) -> u64 {
        1
    }
}

/// Memory requirements as on a device that pads everything to 256 bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Packed;

impl Footprints for Packed {
    fn footprint(&mut self, shape: Shape, _: Uses, _: Sharing) -> Footprint {
        Footprint { bytes: shape.bytes().next_multiple_of(256), align: 256, kind: 0 }
    }
}

/// How queues share a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sharing {
    /// Only one queue uses it.
    Alone(Queue),
    /// Several queues use it, one after another, with ownership transfers. Chosen for attachments, whose compression depends on
    /// exclusive ownership.
    HandedOver,
    /// Several queues use it at the same time, or exclusive ownership would gain nothing.
    Concurrent,
}

impl Sharing {
    /// Why it may not alias, in words.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Alone(_) => "one queue alone uses it",
            Self::HandedOver => {
                "queues use it in turn, and as an attachment it may be compressed: ownership is handed over"
            }
            Self::Concurrent => {
                "queues read it at the same time, or it is no attachment: concurrent sharing costs nothing"
            }
        }
    }
}

/// A resource to make for this frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transient {
    /// Index of the resource.
    pub resource: u32,
    /// Everything that the frame does with it.
    pub uses: Uses,
    /// How queues share it.
    pub sharing: Sharing,
    /// Index in [`Plan::heaps`](super::Plan::heaps).
    pub heap: u32,
    /// Offset in the heap, bytes.
    pub offset: u64,
    /// Size in the heap, bytes.
    pub bytes: u64,
}

/// One heap for transients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeapPlan {
    /// Kind of memory, by the device's own number.
    pub kind: u8,
    /// Size in bytes.
    pub bytes: u64,
}

/// Memory for transients in bytes, padding of the device included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Sum of all sizes: what they would take without aliasing.
    pub unaliased: u64,
    /// Sum of the heaps: what they take as placed.
    pub aliased: u64,
    /// Largest sum of sizes alive at one time. No placement takes less.
    pub lower_bound: u64,
}

pub(super) struct Placed {
    pub transients: Vec<Transient>,
    pub heaps: Vec<HeapPlan>,
    pub successions: Vec<(u32, u32)>,
    pub memory: Memory,
}

/// Places every transient that is used. Without `alias`, none share memory.
pub(super) fn place(
    declaration: &Declaration,
    groups: &Groups,
    lifetimes: &[Option<Lifetime>],
    alias: bool,
    footprints: &mut dyn Footprints,
) -> Placed {
    let (mut transients, mut items) = gather(declaration, groups, lifetimes, footprints);
    let mut placed =
        Placed { transients: Vec::new(), heaps: Vec::new(), successions: Vec::new(), memory: Memory::default() };
    let mut kinds: Vec<u8> = transients.iter().map(|t| t.heap as u8).collect();
    kinds.sort_unstable();
    kinds.dedup();
    for kind in kinds {
        let heap = placed.heaps.len() as u32;
        let here: Vec<u32> =
            (0..transients.len() as u32).filter(|&t| transients[t as usize].heap == u32::from(kind)).collect();
        keep_apart(declaration, &transients, &here, &mut items, footprints.granularity());
        let mut own: Vec<Item> = here.iter().map(|&t| items[t as usize]).collect();
        let bound = pack::lower_bound(&own);
        if !alias {
            own.iter_mut().for_each(|item| (item.first, item.last) = (0, u32::MAX));
        }
        let packing = pack::pack(&own);
        if alias {
            let pairs = pack::predecessors(&own, &packing).into_iter();
            let resource = |item: u32| transients[here[item as usize] as usize].resource;
            placed.successions.extend(pairs.map(|(after, before)| (resource(after), resource(before))));
        }
        for (&t, &offset) in here.iter().zip(&packing.offsets) {
            let transient = &mut transients[t as usize];
            (transient.offset, transient.bytes) = (offset, items[t as usize].bytes);
            placed.memory.unaliased += items[t as usize].bytes;
        }
        // Numbers from `DONE` on are heaps, smaller ones are still kinds of memory.
        here.iter().for_each(|&t| transients[t as usize].heap = DONE + heap);
        placed.memory.aliased += packing.bytes;
        placed.memory.lower_bound += bound;
        placed.heaps.push(HeapPlan { kind, bytes: packing.bytes });
    }
    transients.iter_mut().for_each(|t| t.heap -= DONE);
    placed.transients = transients;
    placed
}

const DONE: u32 = 1 << 8;

/// All transients in use, and the items to pack. Until placed, `heap` holds the kind of memory.
fn gather(
    declaration: &Declaration,
    groups: &Groups,
    lifetimes: &[Option<Lifetime>],
    footprints: &mut dyn Footprints,
) -> (Vec<Transient>, Vec<Item>) {
    let mut uses = vec![Uses::EMPTY; declaration.resources.len()];
    let mut at_once = vec![false; declaration.resources.len()];
    for group in &groups.all {
        let all = group.uses.into_iter().fold(Uses::EMPTY, Uses::union);
        let known = &mut uses[group.resource as usize];
        *known = known.union(all);
        at_once[group.resource as usize] |= group.single().is_none();
    }
    let (mut transients, mut items) = (Vec::new(), Vec::new());
    for (resource, (decl, life)) in declaration.resources.iter().zip(lifetimes).enumerate() {
        let Some(life) = life.filter(|_| decl.is_transient()) else { continue };
        let uses = uses[resource];
        let is_attachment = || uses.iter().any(|(access, _)| access.is_attachment());
        let sharing = match life.lane {
            Lane::One(queue) => Sharing::Alone(queue),
            Lane::Several if !at_once[resource] && is_attachment() => Sharing::HandedOver,
            Lane::Several => Sharing::Concurrent,
        };
        let Footprint { bytes, align, kind } = footprints.footprint(decl.shape, uses, sharing);
        let (first, last, lane) = match life.lane {
            Lane::One(queue) => (life.first, life.last, queue.index() as u8),
            Lane::Several => (0, u32::MAX, Queue::ALL.len() as u8),
        };
        items.push(Item { bytes, align, first, last, lane });
        transients.push(Transient { resource: resource as u32, uses, sharing, heap: kind.into(), offset: 0, bytes });
    }
    (transients, items)
}

/// If a heap holds images and other objects, pads all of them to the granularity.
fn keep_apart(declaration: &Declaration, transients: &[Transient], here: &[u32], items: &mut [Item], granularity: u64) {
    let is_image = |t: &u32| declaration.resources[transients[*t as usize].resource as usize].shape.is_image();
    if granularity > 1 && here.iter().any(is_image) && !here.iter().all(is_image) {
        for &t in here {
            let item = &mut items[t as usize];
            item.align = item.align.max(granularity);
            item.bytes = item.bytes.next_multiple_of(granularity);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::super::plan_with;
    use super::*;

    fn chain(g: &mut FrameGraph, queues: [Queue; 4]) -> Handle<Image> {
        let desc = ImageDesc::full(Format::R32Float);
        let mut image: Option<Handle<Image>> = None;
        for (i, queue) in queues.into_iter().enumerate() {
            image = Some(g.pass(&i.to_string(), queue, |p| {
                image.map(|i| p.sample(i));
                (p.create("x", desc).0.read(), |_: &mut Record| {})
            }));
        }
        image.unwrap()
    }

    #[test]
    fn a_chain_needs_two_images_at_a_time() {
        let mut g = FrameGraph::new(Extent::new(16, 16));
        let last = chain(&mut g, [Queue::Graphics; 4]);
        g.output(last);
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "");
        assert_eq!(plan.memory, Memory { unaliased: 4 * 1024, aliased: 2 * 1024, lower_bound: 2 * 1024 });
        assert_eq!(plan.heaps, [HeapPlan { kind: 0, bytes: 2048 }]);
        assert_eq!(plan.successions, [(2, 0), (3, 1)]);
        let own = plan_with(&frame.declaration, "no-alias");
        assert_eq!(own.memory, Memory { unaliased: 4 * 1024, aliased: 4 * 1024, lower_bound: 2 * 1024 });
        assert!(own.successions.is_empty());
    }

    #[test]
    fn queues_do_not_share() {
        let mut g = FrameGraph::new(Extent::new(16, 16));
        let last = chain(&mut g, [Queue::Graphics, Queue::AsyncCompute, Queue::AsyncCompute, Queue::Graphics]);
        g.output(last);
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "queues=2");
        let sharing: Vec<Sharing> = plan.transients.iter().map(|t| t.sharing).collect();
        let alone = Sharing::Alone;
        assert_eq!(
            sharing,
            [Sharing::Concurrent, alone(Queue::AsyncCompute), Sharing::Concurrent, alone(Queue::Graphics)]
        );
        assert!(plan.successions.is_empty());
    }

    #[test]
    fn attachments_that_queues_use_in_turn_are_handed_over() {
        let mut g = FrameGraph::new(Extent::new(16, 16));
        let (drawn, other) = g.pass("draw", Queue::Graphics, |p| {
            let (drawn, _) = p.color("drawn", ImageDesc::full(Format::R32Float), [0.0; 4]);
            let (other, _) = p.color("other", ImageDesc::full(Format::R32Float), [0.0; 4]);
            ((drawn.read(), other.read()), |_: &mut Record| {})
        });
        for (name, queue) in [("a", Queue::AsyncCompute), ("b", Queue::Graphics)] {
            let x = g.pass(name, queue, |p| {
                p.sample(other);
                if queue == Queue::AsyncCompute {
                    p.sample(drawn);
                }
                (p.create("x", ImageDesc::full(Format::R32Float)).0.read(), |_: &mut Record| {})
            });
            g.output(x);
        }
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "queues=2");
        assert_eq!(plan.transient(0).map(|t| t.sharing), Some(Sharing::HandedOver));
        assert_eq!(plan.transient(1).map(|t| t.sharing), Some(Sharing::Concurrent));
        let handed = plan.barriers.iter().filter(|b| b.handover.is_some()).count();
        assert_eq!(handed, 2, "one to release, one to acquire");
    }

    #[test]
    fn mips_and_layers_count_and_imports_do_not() {
        let mut g = FrameGraph::new(Extent::new(4, 2));
        let desc = ImageDesc { mips: 3, layers: 2, ..ImageDesc::full(Format::R8Unorm) };
        let buffer = g.import_buffer("b", BufferDesc::new(100), Access::HostRead, ImportKey::Caller(0));
        g.pass("fill", Queue::Graphics, |p| {
            let _ = p.write_buffer(buffer);
            let _ = p.create("x", desc);
            ((), |_: &mut Record| {})
        });
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "");
        assert_eq!(plan.lifetimes[1].map(|l| l.bytes), Some(2 * (8 + 2 + 1)));
        assert_eq!(plan.memory, Memory { unaliased: 256, aliased: 256, lower_bound: 256 });
    }
}
