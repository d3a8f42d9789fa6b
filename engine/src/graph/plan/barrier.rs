//! What waits for what on each queue, and how images change layout.
//!
//! Uses of each slot are gathered into groups that need not wait for each other. Between one group and the next on the same queue
//! stands one barrier, before the first pass of the next, for all its uses together. Where groups are on different queues the wait
//! between their batches orders memory already; only a change of layout, or of ownership, is left to do, once: by the queue that
//! has the next group to itself, else by the writer's queue right after the write, else before the first of the readers.

use super::{
    super::{
        access::{Access, Domain, Layout, Queue, Uses},
        declaration::{Declaration, ImportKey, Origin, Span},
        desc::Part,
    },
    alias::{Sharing, Transient},
    group::{Group, Groups, NONE},
    slots::Slots,
};

/// One part of one resource, made ready for the uses of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Barrier {
    /// Index of the resource.
    pub resource: u32,
    /// Which mips and layers.
    pub part: Part,
    /// Uses that must be over. Their writes become visible to `to`.
    pub from: Uses,
    /// The uses that wait. [`Uses::ANY`] where other queues take over.
    pub to: Uses,
    /// Layout before; [`Layout::Undefined`] for buffers and acceleration structures.
    pub layout_from: Layout,
    /// Layout after; [`Layout::Undefined`] for buffers and acceleration structures.
    pub layout_to: Layout,
    /// Contents before are not kept.
    pub discard: bool,
    /// It is half of a change of ownership.
    pub handover: Option<Handover>,
}

/// One half of a change of ownership between queues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handover {
    /// The queue that had it.
    pub from: Queue,
    /// The queue that gets it.
    pub to: Queue,
    /// Which half.
    pub role: Role,
}

/// The halves of a change of ownership.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// On the queue that had it.
    Release,
    /// On the queue that gets it, once it has waited for the release.
    Acquire,
}

pub(super) struct Synchronised {
    pub barriers: Vec<Barrier>,
    pub before: Vec<Span>,
    pub after: Vec<Span>,
    pub end: Span,
    pub unstored: Vec<u32>,
}

/// What the step works on.
pub(super) struct Input<'a> {
    pub declaration: &'a Declaration,
    pub slots: &'a Slots,
    pub groups: &'a Groups,
    pub transients: &'a [Transient],
    pub successions: &'a [(u32, u32)],
    pub positions: usize,
}

/// Every barrier, and where it stands.
pub(super) fn barriers(input: &Input<'_>) -> Synchronised {
    let mut writer = Writer::new(input);
    for group in &input.groups.all {
        writer.open(group);
    }
    writer.leave();
    let unstored = unstored(input);
    let Writer { mut placed, .. } = writer;
    if !placed.is_sorted_by_key(|(key, _)| *key) {
        placed.sort_by_key(|(key, _)| *key);
    }
    let mut next = 0;
    let mut span_of = |key: u32| {
        let start = next;
        while placed.get(next as usize).is_some_and(|(k, _)| *k == key) {
            next += 1;
        }
        Span { start, end: next }
    };
    let (mut before, mut after) = (Vec::with_capacity(input.positions), Vec::with_capacity(input.positions));
    for position in 0..input.positions as u32 {
        before.push(span_of(before_pass(position)));
        after.push(span_of(after_pass(position)));
    }
    let end = span_of(END);
    Synchronised { barriers: placed.into_iter().map(|(_, b)| b).collect(), before, after, end, unstored }
}

/// Where a barrier stands, as a number by which they are sorted.
fn before_pass(position: u32) -> u32 {
    2 * position
}

fn after_pass(position: u32) -> u32 {
    2 * position + 1
}

const END: u32 = u32::MAX;

struct Writer<'a> {
    input: &'a Input<'a>,
    placed: Vec<(u32, Barrier)>,
    /// Of each transient that takes over memory, what was done last with that memory.
    inherited: Vec<Uses>,
}

/// A slot before the frame.
struct Start {
    layout: Layout,
    /// Uses that a change waits for.
    from: Uses,
    /// Reads that need no barrier.
    visible: Uses,
    discard: bool,
}

impl<'a> Writer<'a> {
    fn new(input: &'a Input<'a>) -> Self {
        let mut inherited = Vec::new();
        if !input.successions.is_empty() {
            inherited = vec![Uses::EMPTY; input.declaration.resources.len()];
            for &(after, before) in input.successions {
                for slot in input.slots.of_resource(before) {
                    // Both are on one queue.
                    if let Some(last) = input.groups.all.get(input.groups.newest[slot as usize] as usize) {
                        let uses = last.uses.into_iter().fold(Uses::EMPTY, Uses::union);
                        inherited[after as usize] = inherited[after as usize].union(uses);
                    }
                }
            }
        }
        Self { input, placed: Vec::with_capacity(input.groups.all.len()), inherited }
    }

    fn start(&self, resource: u32) -> Start {
        match self.input.declaration.resources[resource as usize].origin {
            Origin::Transient => {
                let from = self.inherited.get(resource as usize).copied().unwrap_or(Uses::EMPTY);
                Start { layout: Layout::Undefined, from, visible: Uses::EMPTY, discard: true }
            }
            Origin::Imported { key, last, .. } if last.is_empty() => {
                // Nobody knows what the caller did with it; nothing of the graph's own is in use when a frame begins.
                let from = if matches!(key, ImportKey::Caller(_)) { Uses::ANY } else { Uses::EMPTY };
                Start { layout: Layout::Undefined, from, visible: Uses::EMPTY, discard: true }
            }
            Origin::Imported { last, layout, .. } => {
                let readers: Uses = last.iter().filter(|(access, _)| !access.writes()).collect();
                let from = if readers.is_empty() { last } else { readers };
                Start { layout, from, visible: readers, discard: false }
            }
        }
    }

    /// Uses before the frame that a first group of reads goes on beside, without any barrier: what comes after it on the graphics
    /// queue must wait for them as well.
    fn beside(&self, group: &Group) -> Uses {
        let own = group.uses[Queue::Graphics.index()];
        if group.previous != NONE || group.write || own.is_empty() {
            return Uses::EMPTY;
        }
        let start = self.start(group.resource);
        if start.layout == group.layout && start.visible.includes(own) { start.visible } else { Uses::EMPTY }
    }

    /// Places what stands before a group.
    fn open(&mut self, group: &Group) {
        let input = self.input;
        let Some(previous) = input.groups.all.get(group.previous as usize) else { return self.begin(group) };
        let moves = previous.layout != group.layout;
        let beside = |queue: Queue| if queue == Queue::Graphics { self.beside(previous) } else { Uses::EMPTY };
        let sharing = || {
            let at = input.transients.binary_search_by_key(&group.resource, |t| t.resource).ok()?;
            Some(input.transients[at].sharing)
        };
        if let Some(queue) = group.single() {
            let (q, first) = (queue.index(), group.first[queue.index()]);
            match previous.single().filter(|other| *other != queue && sharing() == Some(Sharing::HandedOver)) {
                Some(other) => {
                    let handover = |role| Some(Handover { from: other, to: queue, role });
                    let between = self.barrier(group, Uses::EMPTY, Uses::EMPTY, previous.layout);
                    let from = previous.uses[other.index()];
                    let release = Barrier { from, handover: handover(Role::Release), ..between };
                    let to = group.uses[q];
                    let acquire = Barrier { from: Uses::WAITED, to, handover: handover(Role::Acquire), ..between };
                    self.place(after_pass(previous.last[other.index()]), release);
                    self.place(before_pass(first), acquire);
                }
                None => {
                    let others = previous.single() != Some(queue);
                    let waited = if others { Uses::WAITED } else { Uses::EMPTY };
                    if moves || !previous.uses[q].is_empty() {
                        let from = previous.uses[q].union(waited).union(beside(queue));
                        self.place(before_pass(first), self.barrier(group, from, group.uses[q], previous.layout));
                    }
                }
            }
            return;
        }
        // Read on several queues.
        match previous.single().filter(|_| previous.write) {
            Some(writer) => {
                let (q, from) = (writer.index(), previous.uses[writer.index()]);
                if moves {
                    let release = self.barrier(group, from, Uses::ANY, previous.layout);
                    self.place(after_pass(previous.last[q]), release);
                } else if group.first[q] != NONE {
                    let own = self.barrier(group, from, group.uses[q], previous.layout);
                    self.place(before_pass(group.first[q]), own);
                }
            }
            None => {
                let q = group.leader().index();
                let from = previous.uses[q].union(Uses::WAITED).union(beside(group.leader()));
                self.place(before_pass(group.first[q]), self.barrier(group, from, group.uses[q], previous.layout));
            }
        }
    }

    /// Places what stands before the first group of a slot.
    fn begin(&mut self, group: &Group) {
        let start = self.start(group.resource);
        let leader = group.leader();
        let (moves, q) = (start.layout != group.layout, leader.index());
        let on_graphics = leader == Queue::Graphics;
        // Imports were last used on the graphics queue; what the others do comes after the frame before, as a whole.
        let knows = self.input.declaration.resources[group.resource as usize].is_transient() || on_graphics;
        let from = if knows { start.from } else { Uses::EMPTY };
        let seen = !group.write && start.visible.includes(group.uses[q]);
        if moves || (!from.is_empty() && !seen) {
            let barrier = self.barrier(group, from, group.uses[q], start.layout);
            self.place(before_pass(group.first[q]), Barrier { discard: start.discard, ..barrier });
        }
        let graphics = Queue::Graphics.index();
        if !on_graphics && !moves && group.first[graphics] != NONE && !start.visible.includes(group.uses[graphics]) {
            let barrier = self.barrier(group, start.from, group.uses[graphics], start.layout);
            self.place(before_pass(group.first[graphics]), barrier);
        }
    }

    /// Leaves imports as they are asked for.
    fn leave(&mut self) {
        let Input { declaration, slots, groups, .. } = *self.input;
        for (resource, decl) in declaration.resources.iter().enumerate() {
            let Origin::Imported { leave: Some(at), .. } = decl.origin else { continue };
            let resource = resource as u32;
            for slot in slots.of_resource(resource) {
                self.leave_slot(resource, slot, at, groups.all.get(groups.newest[slot as usize] as usize));
            }
        }
    }

    fn leave_slot(&mut self, resource: u32, slot: u32, at: (Access, Domain), last: Option<&Group>) {
        let layout_to = self.input.declaration.resources[resource as usize].shape.layout(at.0);
        let (layout_from, from, visible, discard) = match last {
            None => {
                let start = self.start(resource);
                (start.layout, start.from, start.visible, start.discard)
            }
            Some(group) => {
                let graphics = Queue::Graphics;
                let waited = if group.single() == Some(graphics) { Uses::EMPTY } else { Uses::WAITED };
                let own = group.uses[graphics.index()];
                let visible = if group.write { Uses::EMPTY } else { own };
                // On other queues alone: the wait at the end shows everything to everyone.
                let seen = own.is_empty() && group.layout == layout_to;
                (
                    group.layout,
                    own.union(waited).union(self.beside(group)),
                    if seen { Uses::of(at) } else { visible },
                    false,
                )
            }
        };
        let is_new = discard && last.is_none();
        if layout_from != layout_to || !visible.includes(Uses::of(at)) {
            let part = self.input.slots.part(self.input.declaration, resource, slot);
            let to = Uses::of(at);
            self.place(
                END,
                Barrier { resource, part, from, to, layout_from, layout_to, discard: is_new, handover: None },
            );
        }
    }

    fn barrier(&self, group: &Group, from: Uses, to: Uses, layout_from: Layout) -> Barrier {
        let part = self.input.slots.part(self.input.declaration, group.resource, group.slot);
        let (resource, layout_to) = (group.resource, group.layout);
        Barrier { resource, part, from, to, layout_from, layout_to, discard: false, handover: None }
    }

    /// Puts a barrier in its place, as one with those before it of neighbouring mips and layers.
    fn place(&mut self, key: u32, barrier: Barrier) {
        let mut barrier = barrier;
        while let Some((_, before)) = self.placed.last().filter(|(k, _)| *k == key)
            && let Some(both) = join(before, &barrier)
        {
            self.placed.pop();
            barrier = both;
        }
        self.placed.push((key, barrier));
    }
}

/// Two barriers as one, where they differ in nothing but neighbouring mips or layers.
fn join(a: &Barrier, b: &Barrier) -> Option<Barrier> {
    let alike = Barrier { part: b.part, ..*a } == *b;
    let (p, q) = (a.part, b.part);
    let part = if (p.layer, p.layers) == (q.layer, q.layers) && p.mip + p.mips == q.mip {
        Part { mips: p.mips + q.mips, ..p }
    } else if (p.mip, p.mips) == (q.mip, q.mips) && p.layer + p.layers == q.layer {
        Part { layers: p.layers + q.layers, ..p }
    } else {
        return None;
    };
    alike.then_some(Barrier { part, ..*a })
}

/// Attachments of which nobody reads any part after the pass: ended transients that are no output of the frame.
fn unstored(input: &Input<'_>) -> Vec<u32> {
    let declaration = input.declaration;
    let (mut unstored, mut stored) = (Vec::new(), Vec::new());
    for (index, group) in input.groups.all.iter().enumerate() {
        let u = &declaration.uses[group.use_index as usize];
        let is_transient = || declaration.resources[group.resource as usize].is_transient();
        if !group.write || !u.access.is_attachment() || !is_transient() {
            continue;
        }
        let wanted = || declaration.outputs.iter().any(|o| o.resource == u.resource && Some(o.version) == u.writes);
        let is_last = input.groups.newest[group.slot as usize] == index as u32;
        if is_last && !wanted() { &mut unstored } else { &mut stored }.push(group.use_index);
    }
    // An image whose mips or layers are used apart has several groups for one attachment.
    unstored.sort_unstable();
    unstored.dedup();
    stored.sort_unstable();
    unstored.retain(|u| stored.binary_search(u).is_err());
    unstored
}

#[cfg(test)]
mod tests {
    use super::super::{super::*, plan_with};
    use super::*;

    fn use_as(g: &mut FrameGraph, name: &str, image: Handle<Image>, how: Access) {
        let keep = g.import_buffer(name, BufferDesc::new(4), Access::HostRead, ImportKey::Caller(0));
        let _ = g.pass(name, Queue::Graphics, |p| {
            match how {
                Access::Sample => {
                    p.sample(image);
                }
                Access::StorageRead => {
                    p.storage(image);
                }
                other => panic!("no test reads as {other}"),
            }
            (p.write_buffer(keep).0, |_: &mut Record| {})
        });
    }

    fn draw_with(g: &mut FrameGraph, name: &str, image: Handle<Image>) {
        let drawn = g.pass(name, Queue::Graphics, |p| {
            p.sample(image);
            (p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]).0, |_: &mut Record| {})
        });
        g.output(drawn.read());
    }

    fn made(g: &mut FrameGraph) -> WriteHandle<Image> {
        let desc = ImageDesc::full(Format::Rgba16Float);
        g.pass("make", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}))
    }

    /// Barriers of one resource: before each pass and after it, and at the end.
    fn barriers_of(g: FrameGraph, resource: u32, words: &str) -> Vec<Vec<Barrier>> {
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, words);
        let both = plan.before.iter().zip(&plan.after).flat_map(|(before, after)| [*before, *after]);
        let of = |span: Span| plan.barriers[span.range()].iter().copied().filter(|b| b.resource == resource).collect();
        both.chain([plan.end]).map(of).collect()
    }

    /// The same where nothing stands after passes.
    fn before(g: FrameGraph, resource: u32) -> Vec<Vec<Barrier>> {
        let all = barriers_of(g, resource, "");
        assert!(all.iter().skip(1).step_by(2).all(Vec::is_empty), "on one queue nothing stands after a pass");
        all.into_iter().step_by(2).collect()
    }

    const WRITE: (Access, Domain) = (Access::StorageWrite, Domain::Compute);
    const CHANGE: (Access, Domain) = (Access::StorageReadWrite, Domain::Compute);
    const SAMPLE: (Access, Domain) = (Access::Sample, Domain::Compute);
    const DRAW: (Access, Domain) = (Access::Sample, Domain::Raster);

    fn first() -> Barrier {
        Barrier { discard: true, ..step(&[], &[WRITE], (Layout::Undefined, Layout::General)) }
    }

    fn step(from: &[(Access, Domain)], to: &[(Access, Domain)], layouts: (Layout, Layout)) -> Barrier {
        Barrier {
            resource: 0,
            part: Part { mip: 0, mips: 1, layer: 0, layers: 1 },
            from: from.iter().copied().collect(),
            to: to.iter().copied().collect(),
            layout_from: layouts.0,
            layout_to: layouts.1,
            discard: false,
            handover: None,
        }
    }

    #[test]
    fn readers_in_one_layout_share_one_barrier() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        use_as(&mut g, "a", x.read(), Access::Sample);
        use_as(&mut g, "b", x.read(), Access::Sample);
        draw_with(&mut g, "c", x.read());
        draw_with(&mut g, "d", x.read());
        let to_read = step(&[WRITE], &[SAMPLE, DRAW], (Layout::General, Layout::ShaderRead));
        assert_eq!(before(g, 0), [vec![first()], vec![to_read], vec![], vec![], vec![], vec![]]);
    }

    #[test]
    fn a_write_waits_for_all_readers() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        use_as(&mut g, "a", x.read(), Access::Sample);
        draw_with(&mut g, "b", x.read());
        let x = g.pass("change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        g.output(x.read());
        let to_write = step(&[SAMPLE, DRAW], &[CHANGE], (Layout::ShaderRead, Layout::General));
        assert_eq!(before(g, 0)[3], [to_write]);
    }

    #[test]
    fn writes_wait_for_writes() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        let x = g.pass("change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        let x = g.pass("again", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        g.output(x.read());
        let general = (Layout::General, Layout::General);
        let expected = [
            vec![first()],
            vec![step(&[WRITE], &[CHANGE], general)],
            vec![step(&[CHANGE], &[CHANGE], general)],
            vec![],
        ];
        assert_eq!(before(g, 0), expected);
    }

    #[test]
    fn storage_reads_stay_in_the_layout_of_the_write() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        use_as(&mut g, "a", x.read(), Access::StorageRead);
        let read = step(&[WRITE], &[(Access::StorageRead, Domain::Compute)], (Layout::General, Layout::General));
        assert_eq!(before(g, 0), [vec![first()], vec![read], vec![]]);
    }

    #[test]
    fn one_buffer_read_in_three_ways() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let buffer =
            g.pass("make", Queue::Graphics, |p| (p.create_buffer("b", BufferDesc::new(64)).0, |_: &mut Record| {}));
        let drawn = g.pass("draw", Queue::Graphics, |p| {
            p.read(buffer.read());
            p.read(buffer.read());
            p.index(buffer.read());
            p.indirect(buffer.read());
            (p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]).0, |_: &mut Record| {})
        });
        g.output(drawn.read());
        let made = [(Access::BufferWrite, Domain::Compute)];
        let reads = [Access::BufferRead, Access::Index, Access::Indirect].map(|access| (access, Domain::Raster));
        let expected = step(&made, &reads, (Layout::Undefined, Layout::Undefined));
        assert_eq!(before(g, 0), [vec![], vec![expected], vec![]], "new memory that nobody had needs no barrier");
    }

    #[test]
    fn imports_continue_from_their_last_use_and_are_left_as_asked() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc::full(Format::Rgba16Float);
        let state = ImageState::last(Access::Sample, Domain::Compute);
        let x = g.import_image("x", desc, state, ImportKey::Caller(3));
        g.leave(x.read(), Access::CopyRead, Domain::Copy);
        use_as(&mut g, "a", x.read(), Access::Sample);
        draw_with(&mut g, "b", x.read());
        let again = step(&[SAMPLE], &[SAMPLE, DRAW], (Layout::ShaderRead, Layout::ShaderRead));
        let layouts = (Layout::ShaderRead, Layout::TransferSource);
        let left = step(&[SAMPLE, DRAW], &[(Access::CopyRead, Domain::Copy)], layouts);
        assert_eq!(before(g, 0), [vec![again], vec![], vec![left]]);
    }

    #[test]
    fn a_buffer_left_for_the_host() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let buffer = g.import_buffer("readback", BufferDesc::new(64), Access::HostRead, ImportKey::Caller(0));
        let buffer = g.pass("fill", Queue::Graphics, |p| (p.write_buffer(buffer).0, |_: &mut Record| {}));
        g.leave(buffer.read(), Access::HostRead, Domain::Copy);
        let (host, fill) = ((Access::HostRead, Domain::Copy), (Access::BufferReadWrite, Domain::Compute));
        let no_layout = (Layout::Undefined, Layout::Undefined);
        assert_eq!(before(g, 0), [vec![step(&[host], &[fill], no_layout)], vec![step(&[fill], &[host], no_layout)]]);
    }

    #[test]
    fn an_import_without_contents_is_discarded_once() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc::full(Format::Rgba16Float);
        let x = g.import_image("x", desc, ImageState::UNDEFINED, ImportKey::Caller(0));
        let x = g.pass("fill", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        g.leave(x.read(), Access::Sample, Domain::Compute);
        let discard = Barrier { from: Uses::ANY, to: Uses::of(CHANGE), ..first() };
        let left = step(&[CHANGE], &[SAMPLE], (Layout::General, Layout::ShaderRead));
        assert_eq!(before(g, 0), [vec![discard], vec![left]]);
    }

    #[test]
    fn buffers_have_no_layout() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = BufferDesc::new(64);
        let target = g.import_buffer("target", desc, Access::CopyWrite, ImportKey::Caller(0));
        let source = g.import_buffer("source", desc, Access::BufferRead, ImportKey::Caller(1));
        let _ = g.pass("copy", Queue::Transfer, |p| {
            p.copy_from(source.read());
            (p.copy_to(target).0, |_: &mut Record| {})
        });
        let write = (Access::CopyWrite, Domain::Copy);
        let no_layout = (Layout::Undefined, Layout::Undefined);
        assert_eq!(before(g, 0), [vec![step(&[write], &[write], no_layout)], vec![]]);
    }

    #[test]
    fn mips_change_layout_apart_and_together() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc { mips: 3, ..ImageDesc::full(Format::R32Float) };
        let x = g.pass("0", Queue::Graphics, |p| (p.create_part("x", desc, Part::mip(0)).0, |_: &mut Record| {}));
        let x = (1..3).fold(x, |x, mip| {
            g.pass(&mip.to_string(), Queue::Graphics, |p| {
                p.sample_part(x.read(), Part::mip(mip - 1));
                (p.write_part(x, Part::mip(mip)).0, |_: &mut Record| {})
            })
        });
        use_as(&mut g, "all", x.read(), Access::StorageRead);
        let part = |mip: u16, mips: u16| Part { mip, mips, layer: 0, layers: 1 };
        let found = before(g, 0);
        let moved = |b: &Barrier| (b.part, b.layout_from, b.layout_to);
        let moves: Vec<Vec<_>> = found.iter().map(|batch| batch.iter().map(moved).collect()).collect();
        let (undefined, general, read) = (Layout::Undefined, Layout::General, Layout::ShaderRead);
        assert_eq!(
            moves,
            [
                vec![(part(0, 1), undefined, general)],
                vec![(part(0, 1), general, read), (part(1, 1), undefined, general)],
                vec![(part(1, 1), general, read), (part(2, 1), undefined, general)],
                vec![(part(0, 2), read, general), (part(2, 1), general, general)],
                vec![],
            ]
        );
    }

    #[test]
    fn readers_on_several_queues_find_the_layout_changed_by_the_writer() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        for (name, queue) in [("a", Queue::AsyncCompute), ("b", Queue::Graphics)] {
            let made = g.pass(name, queue, |p| {
                p.sample(x.read());
                (p.create("y", ImageDesc::full(Format::R32Float)).0, |_: &mut Record| {})
            });
            g.output(made.read());
        }
        let release = Barrier { to: Uses::ANY, ..step(&[WRITE], &[], (Layout::General, Layout::ShaderRead)) };
        let found = barriers_of(g, 0, "queues=2,no-reorder");
        assert_eq!(found, [vec![first()], vec![release], vec![], vec![], vec![], vec![], vec![]]);
    }

    #[test]
    fn who_takes_over_memory_waits_for_who_had_it() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let mut buffer =
            g.pass("0", Queue::Graphics, |p| (p.create_buffer("b", BufferDesc::new(256)).0, |_: &mut Record| {}));
        for name in ["1", "2"] {
            buffer = g.pass(name, Queue::Graphics, |p| {
                p.read(buffer.read());
                (p.create_buffer("b", BufferDesc::new(256)).0, |_: &mut Record| {})
            });
        }
        g.output(buffer.read());
        let (read, write) = ((Access::BufferRead, Domain::Compute), (Access::BufferWrite, Domain::Compute));
        let taken = Barrier { discard: true, ..step(&[read], &[write], (Layout::Undefined, Layout::Undefined)) };
        assert_eq!(before(g, 2), [vec![], vec![], vec![Barrier { resource: 2, ..taken }], vec![]]);
    }

    #[test]
    fn attachments_that_nobody_reads_are_not_stored() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let drawn = g.pass("draw", Queue::Graphics, |p| {
            let (drawn, _) = p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]);
            let _ = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0);
            (drawn, |_: &mut Record| {})
        });
        g.output(drawn.read());
        let frame = g.finish().unwrap();
        assert_eq!(plan_with(&frame.declaration, "").unstored, [1]);
    }
}
