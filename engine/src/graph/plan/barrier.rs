//! Synchronisation on each queue: barriers and layout transitions.
//!
//! The uses of each subresource are gathered into groups that need no synchronisation inside. Between consecutive groups on the same queue, one
//! barrier before the first pass of the second group covers all its uses. Between groups on different queues, the semaphore wait between
//! their batches already orders memory. Only a layout transition or an ownership transfer remains, and it is done once: by the queue of
//! the next group if it has only one, else on the writer's queue right after the write, else before the first of the readers.

use super::{
    super::{
        access::{Access, Domain, Layout, Queue, Uses},
        declaration::{Declaration, ImportKey, Origin, Span},
        desc::Part,
    },
    alias::{Sharing, Transient},
    group::{Group, Groups, NONE},
    subresources::Subresources,
};

/// A barrier for one part of one resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Barrier {
    /// Index of the resource.
    pub resource: u32,
    /// Mips and layers.
    pub part: Part,
    /// Uses that must be over. Their writes become visible to `to`.
    pub from: Uses,
    /// Uses that wait. [`Uses::ANY`] if they are on other queues.
    pub to: Uses,
    /// Layout before; [`Layout::Undefined`] for buffers and acceleration structures.
    pub layout_from: Layout,
    /// Layout after; [`Layout::Undefined`] for buffers and acceleration structures.
    pub layout_to: Layout,
    /// Whether the contents before it are discarded.
    pub discard: bool,
    /// Set if it is one half of an ownership transfer.
    pub handover: Option<Handover>,
}

/// One half of an ownership transfer between queues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handover {
    /// The queue that releases the resource.
    pub from: Queue,
    /// The queue that acquires the resource.
    pub to: Queue,
    /// Which half this is.
    pub role: Role,
}

/// The two halves of an ownership transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// On the queue that gives the resource up.
    Release,
    /// On the queue that receives the resource, after it has waited for the release.
    Acquire,
}

pub(super) struct Synchronised {
    pub barriers: Vec<Barrier>,
    pub before: Vec<Span>,
    pub after: Vec<Span>,
    pub end: Span,
    pub unstored: Vec<u32>,
}

/// Input of this step.
pub(super) struct Input<'a> {
    pub declaration: &'a Declaration,
    pub subresources: &'a Subresources,
    pub groups: &'a Groups,
    pub transients: &'a [Transient],
    pub successions: &'a [(u32, u32)],
    pub positions: usize,
}

/// All barriers, sorted by place, with the range of each place.
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

/// Sort key of the place before a pass.
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
    /// For each transient that reuses memory, the last uses of the transients before it in that memory.
    inherited: Vec<Uses>,
}

/// State of a subresource before the frame.
struct Start {
    layout: Layout,
    /// Uses that a layout transition or a write must wait for.
    from: Uses,
    /// Uses that already see the contents, and need no barrier.
    visible: Uses,
    discard: bool,
}

impl<'a> Writer<'a> {
    fn new(input: &'a Input<'a>) -> Self {
        let mut inherited = Vec::new();
        if !input.successions.is_empty() {
            let earlier = earlier_writes(input);
            inherited = vec![Uses::EMPTY; input.declaration.resources.len()];
            for &(after, before) in input.successions {
                let inherited = &mut inherited[after as usize];
                *inherited = inherited.union(earlier[after as usize]);
                for subresource in input.subresources.of_resource(before) {
                    // Both are on the same queue, or they would not alias.
                    if let Some(last) = input.groups.all.get(input.groups.newest[subresource as usize] as usize) {
                        *inherited = inherited.union(last.uses.into_iter().fold(Uses::EMPTY, Uses::union));
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
                // What the caller did with it is unknown. Resources of the graph itself are idle when a frame begins.
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

    /// Uses from before the frame that the group joins without a barrier, because both only read in the same layout. The next
    /// barrier on the graphics queue must wait for them as well.
    fn beside(&self, group: &Group) -> Uses {
        let own = group.uses[Queue::Graphics.index()];
        if group.previous != NONE || group.write || own.is_empty() {
            return Uses::EMPTY;
        }
        let start = self.start(group.resource);
        if start.layout == group.layout && start.visible.includes(own) { start.visible } else { Uses::EMPTY }
    }

    /// Places the barriers before a group.
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
                    let acquire =
                        Barrier { from: Uses::OTHER_QUEUES, to, handover: handover(Role::Acquire), ..between };
                    self.place(after_pass(previous.last[other.index()]), release);
                    self.place(before_pass(first), acquire);
                }
                None => {
                    let others = previous.single() != Some(queue);
                    let waited = if others { Uses::OTHER_QUEUES } else { Uses::EMPTY };
                    if moves || !previous.uses[q].is_empty() {
                        let from = previous.uses[q].union(waited).union(beside(queue));
                        self.place(before_pass(first), self.barrier(group, from, group.uses[q], previous.layout));
                    }
                }
            }
            return;
        }
        // The group reads on several queues.
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
                let from = previous.uses[q].union(Uses::OTHER_QUEUES).union(beside(group.leader()));
                self.place(before_pass(group.first[q]), self.barrier(group, from, group.uses[q], previous.layout));
            }
        }
    }

    /// Places the barriers before the first group of a subresource.
    fn begin(&mut self, group: &Group) {
        let start = self.start(group.resource);
        let leader = group.leader();
        let (moves, q) = (start.layout != group.layout, leader.index());
        let on_graphics = leader == Queue::Graphics;
        // Imports were last used on the graphics queue. Work on other queues starts after the whole previous frame, so it need
        // not wait again.
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

    /// Places the barriers at the end of the frame that leave imports in the state asked for.
    fn leave(&mut self) {
        let Input { declaration, subresources, groups, .. } = *self.input;
        for (resource, decl) in declaration.resources.iter().enumerate() {
            let Origin::Imported { leave: Some(at), .. } = decl.origin else { continue };
            let resource = resource as u32;
            for subresource in subresources.of_resource(resource) {
                self.leave_subresource(
                    resource,
                    subresource,
                    at,
                    groups.all.get(groups.newest[subresource as usize] as usize),
                );
            }
        }
    }

    fn leave_subresource(&mut self, resource: u32, subresource: u32, at: (Access, Domain), last: Option<&Group>) {
        let layout_to = self.input.declaration.resources[resource as usize].shape.layout(at.0);
        let (layout_from, from, visible, discard) = match last {
            None => {
                let start = self.start(resource);
                (start.layout, start.from, start.visible, start.discard)
            }
            Some(group) => {
                let graphics = Queue::Graphics;
                let waited = if group.single() == Some(graphics) { Uses::EMPTY } else { Uses::OTHER_QUEUES };
                let own = group.uses[graphics.index()];
                let visible = if group.write { Uses::EMPTY } else { own };
                // Only other queues used it: the wait at the end of the frame makes it visible to everything but the host.
                let seen = own.is_empty() && group.layout == layout_to && at.0 != Access::HostRead;
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
            let part = self.input.subresources.part(self.input.declaration, resource, subresource);
            let to = Uses::of(at);
            self.place(
                END,
                Barrier { resource, part, from, to, layout_from, layout_to, discard: is_new, handover: None },
            );
        }
    }

    fn barrier(&self, group: &Group, from: Uses, to: Uses, layout_from: Layout) -> Barrier {
        let part = self.input.subresources.part(self.input.declaration, group.resource, group.subresource);
        let (resource, layout_to) = (group.resource, group.layout);
        Barrier { resource, part, from, to, layout_from, layout_to, discard: false, handover: None }
    }

    /// Appends a barrier, merged with the last ones of the same place if they cover neighbouring mips or layers.
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

/// For each resource, the kinds of writes to all that was in its memory before it in this frame. Not only those of its direct predecessors:
/// an image barrier covers the memory of its image alone, which may be less than what the image was given, and what an earlier one wrote
/// to the rest of it has not been made available since.
fn earlier_writes(input: &Input<'_>) -> Vec<Uses> {
    let mut own = vec![Uses::EMPTY; input.declaration.resources.len()];
    for group in input.groups.all.iter().filter(|group| group.write) {
        let uses = group.uses.into_iter().fold(Uses::EMPTY, Uses::union);
        let own = &mut own[group.resource as usize];
        *own = own.union(uses.iter().filter(|(access, _)| access.writes()).collect());
    }
    let mut earlier = vec![Uses::EMPTY; own.len()];
    // Chains of predecessors are short, and each round goes one further.
    loop {
        let mut grows = false;
        for &(after, before) in input.successions {
            let all = earlier[after as usize].union(earlier[before as usize]).union(own[before as usize]);
            grows |= all != earlier[after as usize];
            earlier[after as usize] = all;
        }
        if !grows {
            return earlier;
        }
    }
}

/// Two barriers as one, if they differ only in their parts and these are adjacent.
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

/// Attachments whose results nothing reads: the last use of transients that are not outputs of the frame.
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
        let is_last = input.groups.newest[group.subresource as usize] == index as u32;
        if is_last && !wanted() { &mut unstored } else { &mut stored }.push(group.use_index);
    }
    // If mips or layers are tracked separately, one attachment has several groups.
    unstored.sort_unstable();
    unstored.dedup();
    stored.sort_unstable();
    unstored.retain(|u| stored.binary_search(u).is_err());
    unstored
}

#[cfg(test)]
#[path = "barrier_tests.rs"]
mod tests;
