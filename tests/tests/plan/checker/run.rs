//! Executes a plan on queues that are synchronised by semaphores only.
//!
//! Each queue counts its commands: that is its time. What a queue knows of the others through semaphores is a vector of times
//! ([`Model::seen`], a vector clock); a wait joins the vectors of the batches that it waits for. All that a vector covers is complete, and
//! its writes are visible to everything on that queue. Within a queue only barriers order commands: each cell (one mip of one layer of an
//! image; a buffer; an acceleration structure) keeps its events since the last write, and for each event the uses that are ordered after it
//! and see it. A barrier orders, for the cells that it names, the events at `from`, and those that `from` itself is ordered after, before
//! `to`. Layout transitions and queue ownership transfers are writes in between.
//!
//! This is stricter than Vulkan, where a barrier on one resource also orders the execution of all others: here each resource needs its own
//! barriers. Memory is the exception: a transient that reuses bytes begins with the events of their previous owner.

use magpie::graph::{
    Declaration, ImportKey, Layout, Origin, Queue, Shape, Span, Use,
    plan::{Barrier, Plan, Role, Sharing},
};

use super::{
    Checked, PlanFault, PlanRequest, Versions,
    access::{self, Scope, Set},
    covers, wrong,
};

/// Time before the first command of the frame.
const BEFORE: i64 = 0;
/// Not even the previous frame is known to be complete.
const NOTHING: i64 = -1;
const QUEUES: usize = 3;
const GRAPHICS: usize = 0;

#[derive(Clone, Copy, Debug)]
enum What {
    BeforeFrame,
    Pass(u32),
    Change(u32),
}

/// A use, a layout transition or ownership transfer, or an event before the frame.
#[derive(Clone, Copy, Debug)]
struct Event {
    what: What,
    queue: usize,
    time: i64,
    /// The kind of use; none for transitions and unknown uses.
    pair: Set,
    write: bool,
    /// For each queue, the uses that are ordered after it and see its writes.
    before: [Set; QUEUES],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Nothing,
    Version(u32),
    /// Written by an attachment without a store operation.
    Unstored(u32),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    Nobody,
    Has(usize),
    /// Released but not yet acquired, with the layouts of the release.
    Between(usize, usize, Layout, Layout),
}

struct Cell {
    resource: u32,
    /// Mip and layer.
    at: (u32, u32),
    is_image: bool,
    layout: Layout,
    content: Content,
    owner: Owner,
    used: bool,
    events: Vec<Event>,
}

/// Placement of a transient: heap, first byte and end, in whole pages where images and other resources share the heap.
type Place = (u32, u64, u64);

struct Model<'a> {
    d: &'a Declaration,
    plan: &'a Plan,
    versions: Versions<'a>,
    /// The cells of each resource.
    cells_of: Vec<Span>,
    cells: Vec<Cell>,
    sharing: Vec<Option<Sharing>>,
    places: Vec<Option<Place>>,
    clock: [i64; QUEUES],
    seen: [[i64; QUEUES]; QUEUES],
    /// Transients in the order of their first use or barrier.
    begun: Vec<u32>,
    /// Transients whose memory was reused, and by which resource.
    ended: Vec<Option<u32>>,
}

pub fn check(d: &Declaration, plan: &Plan, request: &PlanRequest<'_>) -> Checked {
    let mut model = Model::new(d, plan, request)?;
    let mut signals: Vec<[i64; QUEUES]> = Vec::new();
    let mut newest: [Option<usize>; QUEUES] = [None; QUEUES];
    for (index, batch) in plan.batches.iter().enumerate() {
        let q = batch.queue as usize;
        plan.waits[batch.waits.range()].iter().for_each(|&w| model.wait(q, signals[w as usize]));
        for position in batch.passes.range() {
            let pass = plan.order[position];
            model.stop(q, plan.before[position])?;
            model.pass(q, pass)?;
            model.stop(q, plan.after[position])?;
        }
        let mut signal = model.seen[q];
        signal[q] = model.clock[q];
        signals.push(signal);
        newest[q] = Some(index);
    }
    // The end of the frame waits for every queue.
    newest.iter().skip(1).flatten().for_each(|&batch| model.wait(GRAPHICS, signals[batch]));
    model.stop(GRAPHICS, plan.end)?;
    model.leave()?;
    model.check_unstored()?;
    if !request.switches.alias || request.switches.serial {
        model.check_apart()?;
    }
    model.check_successions()
}

impl<'a> Model<'a> {
    fn new(d: &'a Declaration, plan: &'a Plan, request: &PlanRequest<'_>) -> Result<Self, PlanFault> {
        let (mut cells, mut cells_of) = (Vec::new(), Vec::new());
        for (resource, decl) in (0..).zip(&d.resources) {
            let start = cells.len() as u32;
            let (mips, layers, is_image) = match decl.shape {
                Shape::Image { mips, layers, .. } => (mips, layers, true),
                Shape::Buffer { .. } | Shape::Accel { .. } => (1, 1, false),
            };
            let all = (0..layers).flat_map(|layer| (0..mips).map(move |mip| (mip, layer)));
            cells.extend(all.map(|at| Cell::before_frame(decl.origin, resource, at, is_image)));
            cells_of.push(Span { start, end: cells.len() as u32 });
        }
        let (mut sharing, mut places) = (vec![None; d.resources.len()], vec![None; d.resources.len()]);
        let is_image = |resource: u32| matches!(d.resources[resource as usize].shape, Shape::Image { .. });
        for t in &plan.transients {
            if t.resource as usize >= d.resources.len() {
                return wrong(format!("transient {} is no resource", t.resource));
            }
            let here = || plan.transients.iter().filter(|o| o.heap == t.heap);
            let mixed = here().any(|o| is_image(o.resource)) && here().any(|o| !is_image(o.resource));
            let page = if mixed { request.granularity } else { 1 };
            let (start, end) = (t.offset / page * page, (t.offset + t.bytes).div_ceil(page) * page);
            sharing[t.resource as usize] = Some(t.sharing);
            places[t.resource as usize] = Some((t.heap, start, end));
        }
        // The previous frame is complete when other queues begin; the graphics queue only follows it in submission order.
        let mut seen = [[NOTHING; QUEUES]; QUEUES];
        seen.iter_mut().skip(1).for_each(|seen| seen[GRAPHICS] = BEFORE);
        Ok(Self {
            d,
            plan,
            versions: Versions::new(d, plan),
            cells_of,
            cells,
            sharing,
            places,
            clock: [BEFORE; QUEUES],
            seen,
            begun: Vec::new(),
            ended: vec![None; d.resources.len()],
        })
    }

    fn wait(&mut self, q: usize, signal: [i64; QUEUES]) {
        for (seen, time) in self.seen[q].iter_mut().zip(signal) {
            *seen = time.max(*seen);
        }
    }

    /// Whether a semaphore makes an event known to this queue.
    fn is_known(&self, q: usize, e: &Event) -> bool {
        e.time <= self.seen[q][e.queue]
    }

    /// Whether the first scope of a barrier covers an event.
    fn covers(&self, q: usize, scope: Scope, e: &Event) -> bool {
        let known_by_wait = self.is_known(q, e);
        let chained = e.before[q] & scope.pairs != 0 || (known_by_wait && scope.pairs != 0);
        let here = e.queue == q && e.pair & scope.pairs != 0;
        let any = scope.any && (e.queue == q || e.before[q] != 0 || known_by_wait);
        // Other queues wait for the graphics queue to open a frame, which it does when the one before is complete.
        let long_over = e.time == BEFORE && q != GRAPHICS;
        here || chained || any || (scope.waited && known_by_wait) || long_over
    }

    fn name(&self, resource: u32) -> String {
        self.d.resource_name(resource)
    }

    /// Describes an event.
    fn describe(&self, e: &Event) -> String {
        let what = match e.what {
            What::BeforeFrame => "what was before the frame".to_owned(),
            What::Pass(pass) => format!("pass {}", self.d.pass_name(pass)),
            What::Change(barrier) => format!("barrier {barrier}"),
        };
        format!("{what} at {} of queue {}, which comes before {:x?}", e.time, e.queue, e.before)
    }

    fn cells_in(&self, resource: u32, part: magpie::graph::Part) -> Vec<usize> {
        self.cells_of[resource as usize].range().filter(|&c| covers(part, self.cells[c].at)).collect()
    }

    /// The first use or barrier of a transient, which takes over memory.
    fn begin(&mut self, resource: u32) -> Checked {
        if let Some(by) = self.ended[resource as usize] {
            return wrong(format!("{} is used when {} has its memory", self.name(resource), self.name(by)));
        }
        if self.d.resources[resource as usize].origin != Origin::Transient || self.begun.contains(&resource) {
            return Ok(());
        }
        let Some((heap, start, end)) = self.places[resource as usize] else {
            return wrong(format!("{} has no memory", self.name(resource)));
        };
        let mut inherited: Vec<Event> = Vec::new();
        for (order, &other) in self.begun.iter().enumerate() {
            let Some((_, from, to)) = self.places[other as usize].filter(|p| p.0 == heap && p.1 < end && start < p.2)
            else {
                continue;
            };
            self.ended[other as usize] = Some(resource);
            // Its bytes that no other transient has reused since; later reuses are ordered after it.
            let mut left = vec![(from.max(start), to.min(end))];
            for later in self.begun[order + 1..].iter().filter_map(|&l| self.places[l as usize]).filter(|l| l.0 == heap)
            {
                let cut = |(from, to): (u64, u64)| [(from, to.min(later.1)), (from.max(later.2), to)];
                left = left.into_iter().flat_map(cut).filter(|(from, to)| from < to).collect();
            }
            if !left.is_empty() {
                let used = self.cells_of[other as usize].range().map(|c| &self.cells[c]).filter(|c| c.used);
                inherited.extend(used.flat_map(|c| &c.events));
            }
        }
        for c in self.cells_of[resource as usize].range() {
            self.cells[c].events.clone_from(&inherited);
        }
        self.begun.push(resource);
        Ok(())
    }

    /// Executes all barriers of one place, which are issued together.
    fn stop(&mut self, q: usize, stop: Span) -> Checked {
        let plan = self.plan;
        let mut ordered: Vec<(usize, usize, Set)> = Vec::new();
        let mut changed: Vec<usize> = Vec::new();
        let mut touched: Vec<usize> = Vec::new();
        for index in stop.range() {
            let b = &plan.barriers[index];
            if b.resource as usize >= self.d.resources.len() {
                return wrong(format!("barrier {index} is for no resource"));
            }
            self.begin(b.resource)?;
            let (from, to) = (Scope::of(b.from), Scope::of(b.to));
            let cells = self.cells_in(b.resource, b.part);
            let inside = usize::from(b.part.mips) * usize::from(b.part.layers) == cells.len() && !cells.is_empty();
            let known = access::stages_of(Queue::ALL[q]);
            if !inside || to.waited || (from.pairs | to.pairs) & !known != 0 {
                return wrong(format!("barrier {index} makes no sense on {:?}: {b:?}", Queue::ALL[q]));
            }
            let set = if to.any { access::ALL } else { to.pairs };
            for &c in &cells {
                let changes = self.changes(q, b, c)?;
                for (i, e) in self.cells[c].events.iter().enumerate() {
                    if self.covers(q, from, e) {
                        ordered.push((c, i, set));
                    } else if changes {
                        let what = self.name(b.resource);
                        return wrong(format!(
                            "barrier {index} changes {what} without waiting for {}",
                            self.describe(e)
                        ));
                    }
                }
                if changes {
                    changed.push(c);
                }
                touched.push(c);
            }
        }
        for (c, event, set) in ordered {
            self.cells[c].events[event].before[q] |= set;
        }
        for index in stop.range() {
            let b = &plan.barriers[index];
            for c in self.cells_in(b.resource, b.part) {
                if changed.contains(&c) {
                    if touched.iter().filter(|&&t| t == c).count() > 1 {
                        return wrong(format!("barrier {index} changes {} beside another", self.name(b.resource)));
                    }
                    self.change(q, index as u32, c);
                }
                self.cells[c].used = true;
                if b.discard {
                    self.cells[c].content = Content::Nothing;
                }
            }
        }
        Ok(())
    }

    /// Whether a barrier changes a cell's layout or owner, if it is allowed to.
    fn changes(&self, q: usize, b: &Barrier, c: usize) -> Result<bool, PlanFault> {
        let cell = &self.cells[c];
        let name = || self.name(b.resource);
        if !cell.is_image {
            if (b.layout_from, b.layout_to) != (Layout::Undefined, Layout::Undefined) {
                return wrong(format!("{} is no image: {b:?}", name()));
            }
        } else if b.discard != (b.layout_from == Layout::Undefined) {
            return wrong(format!("{} loses its contents, or does not: {b:?}", name()));
        } else if !b.discard && b.layout_from != cell.layout {
            return wrong(format!("{} is in {:?}: {b:?}", name(), cell.layout));
        } else if b.layout_to == Layout::Undefined {
            return wrong(format!("{} goes to no layout: {b:?}", name()));
        }
        let handed_over = self.sharing[b.resource as usize] == Some(Sharing::HandedOver);
        let Some(h) = b.handover else {
            if handed_over && !b.discard && !self.is_owner(q, c) {
                return wrong(format!("{} belongs to {:?}, not to queue {q}: {b:?}", name(), cell.owner));
            }
            return Ok(b.layout_from != b.layout_to);
        };
        let (from, to) = (h.from as usize, h.to as usize);
        let allowed = match h.role {
            Role::Release => q == from && cell.owner == Owner::Has(q),
            Role::Acquire => q == to && cell.owner == Owner::Between(from, to, b.layout_from, b.layout_to),
        };
        if !handed_over || !allowed || from == to {
            return wrong(format!("{} belongs to {:?}: {b:?} on queue {q}", name(), cell.owner));
        }
        Ok(true)
    }

    fn change(&mut self, q: usize, index: u32, c: usize) {
        let b = &self.plan.barriers[index as usize];
        let to = Scope::of(b.to);
        self.clock[q] += 1;
        let mut event = Event {
            what: What::Change(index),
            queue: q,
            time: self.clock[q],
            pair: 0,
            write: true,
            before: [0; QUEUES],
        };
        let cell = &mut self.cells[c];
        match b.handover {
            Some(h) if h.role == Role::Release => {
                // The new layout takes effect with the acquire.
                cell.owner = Owner::Between(h.from as usize, h.to as usize, b.layout_from, b.layout_to);
            }
            _ => {
                event.before[q] = if to.any { access::ALL } else { to.pairs };
                (cell.layout, cell.owner) = (b.layout_to, Owner::Has(q));
            }
        }
        cell.events = vec![event];
    }

    fn is_owner(&self, q: usize, c: usize) -> bool {
        match self.cells[c].owner {
            Owner::Nobody => true,
            Owner::Has(owner) => owner == q,
            Owner::Between(..) => false,
        }
    }

    fn pass(&mut self, q: usize, pass: u32) -> Checked {
        let (d, decl) = (self.d, &self.d.passes[pass as usize]);
        let uses: Vec<(usize, &Use)> = decl.uses.range().map(|i| (i, &d.uses[i])).collect();
        uses.iter().try_for_each(|(_, u)| self.begin(u.resource))?;
        for &(_, u) in &uses {
            // Another resource of the pass may have taken its memory.
            self.begin(u.resource)?;
            let pair = access::pair(u.access, decl.domain);
            for c in self.cells_in(u.resource, u.part) {
                self.check_use(q, pass, u, pair, c)?;
            }
        }
        self.clock[q] += 1;
        for &(index, u) in &uses {
            let (pair, write) = (access::pair(u.access, decl.domain), access::changes(u.access));
            let event =
                Event { what: What::Pass(pass), queue: q, time: self.clock[q], pair, write, before: [0; QUEUES] };
            for c in self.cells_in(u.resource, u.part) {
                let cell = &mut self.cells[c];
                (cell.used, cell.owner) = (true, Owner::Has(q));
                if write {
                    // Everything before is ordered before this as well.
                    cell.events.clear();
                } else {
                    cell.events.retain(|e| e.write || e.queue != q || e.pair != pair);
                }
                cell.events.push(event);
                if let Some(version) = u.writes {
                    let stored = self.plan.unstored.binary_search(&(index as u32)).is_err();
                    cell.content = if stored { Content::Version(version) } else { Content::Unstored(version) };
                }
            }
        }
        Ok(())
    }

    fn check_use(&self, q: usize, pass: u32, u: &Use, pair: Set, c: usize) -> Checked {
        let cell = &self.cells[c];
        let who = || format!("{} at {:?} of {}", self.d.pass_name(pass), cell.at, self.name(u.resource));
        if cell.is_image && cell.layout != access::layout(u.access) {
            return wrong(format!("{} finds {:?}, wants {:?}", who(), cell.layout, u.access));
        }
        match self.sharing[u.resource as usize] {
            Some(Sharing::Alone(queue)) if queue as usize != q => return wrong(format!("{} is not alone", who())),
            Some(Sharing::HandedOver) if !self.is_owner(q, c) => {
                return wrong(format!("{} belongs to {:?}, not to queue {q}", who(), cell.owner));
            }
            _ => {}
        }
        self.check_order(q, pair, access::changes(u.access), c).or_else(|e| wrong(format!("{}: {}", who(), e.0)))?;
        let Some(version) = u.reads else { return Ok(()) };
        let Some(held) = self.versions.held(u.resource, version, cell.at, true)? else { return Ok(()) };
        if cell.content != Content::Version(held) {
            return wrong(format!("{} finds {:?}, wants version {held}", who(), cell.content));
        }
        Ok(())
    }

    /// Checks that a use is ordered after everything it depends on.
    fn check_order(&self, q: usize, pair: Set, write: bool, c: usize) -> Checked {
        let late = |e: &&Event| (e.write || write) && e.before[q] & pair == 0 && !self.is_known(q, e);
        self.cells[c]
            .events
            .iter()
            .find(late)
            .map_or(Ok(()), |e| wrong(format!("does not wait for {}", self.describe(e))))
    }

    /// Checks that imports end in the requested state and hold their last version.
    fn leave(&self) -> Checked {
        for cell in &self.cells {
            let decl = &self.d.resources[cell.resource as usize];
            let Origin::Imported { key, leave, .. } = decl.origin else { continue };
            let name = self.name(cell.resource);
            if matches!(key, ImportKey::Next(_)) && leave.is_none() {
                return wrong(format!("{name} is left for nobody"));
            }
            if let Some((access, domain)) = leave {
                if cell.is_image && cell.layout != access::layout(access) {
                    return wrong(format!("{name} is left in {:?}, not for {access:?}", cell.layout));
                }
                let (pair, write) = (access::pair(access, domain), access::changes(access));
                let c = self.cells_of[cell.resource as usize].range().find(|&c| std::ptr::eq(&self.cells[c], cell));
                let ready = self.check_order(GRAPHICS, pair, write, c.unwrap_or_default());
                ready.or_else(|e| wrong(format!("the end of the frame, {name}: {}", e.0)))?;
            }
            let held = self.versions.held(cell.resource, decl.versions - 1, cell.at, false)?;
            if held.is_some_and(|held| cell.content != Content::Version(held)) {
                return wrong(format!("{name} is left with {:?}, not version {held:?}", cell.content));
            }
        }
        Ok(())
    }

    fn check_unstored(&self) -> Checked {
        if !self.plan.unstored.is_sorted() {
            return wrong("attachments that are not stored are in no order".to_owned());
        }
        for &index in &self.plan.unstored {
            let Some(u) = self.d.uses.get(index as usize).filter(|u| access::is_attachment(u.access)) else {
                return wrong(format!("use {index} is no attachment, and is not stored"));
            };
            if self.d.outputs.iter().any(|o| o.resource == u.resource && Some(o.version) == u.writes) {
                return wrong(format!("{} is an output, and is not stored", self.name(u.resource)));
            }
        }
        Ok(())
    }

    /// Without aliasing no two transients overlap.
    fn check_apart(&self) -> Checked {
        let places: Vec<&Place> = self.places.iter().flatten().collect();
        for (i, a) in places.iter().enumerate() {
            if let Some(b) = places[..i].iter().find(|b| b.0 == a.0 && b.1 < a.2 && a.1 < b.2) {
                return wrong(format!("nothing may be shared, but {a:?} and {b:?} meet"));
            }
        }
        let none = self.plan.successions.is_empty();
        if none { Ok(()) } else { wrong("nothing is shared, but some take over memory".to_owned()) }
    }

    /// Checks that the plan's pairs of aliased transients overlap and are used in that order.
    fn check_successions(&self) -> Checked {
        let at = |resource: u32| self.begun.iter().position(|&b| b == resource);
        for &(after, before) in &self.plan.successions {
            let meet = match (
                self.places.get(after as usize).copied().flatten(),
                self.places.get(before as usize).copied().flatten(),
            ) {
                (Some(a), Some(b)) => a.0 == b.0 && a.1 < b.2 && b.1 < a.2,
                _ => false,
            };
            if !meet || at(before) >= at(after) {
                return wrong(format!("{after} does not take over memory from {before}"));
            }
        }
        Ok(())
    }
}

impl Cell {
    fn before_frame(origin: Origin, resource: u32, at: (u32, u32), is_image: bool) -> Self {
        let mut cell = Self {
            resource,
            at,
            is_image,
            layout: Layout::Undefined,
            content: Content::Nothing,
            owner: Owner::Nobody,
            used: false,
            events: Vec::new(),
        };
        let Origin::Imported { key, last, layout, .. } = origin else { return cell };
        let event = |pair: Set, write: bool, before: Set| Event {
            what: What::BeforeFrame,
            queue: GRAPHICS,
            time: BEFORE,
            pair,
            write,
            before: [before, 0, 0],
        };
        let pairs: Vec<_> = last.iter().collect();
        if pairs.is_empty() {
            // The caller's last use is unknown; the frame's own histories are unused.
            if matches!(key, ImportKey::Caller(_)) {
                cell.events.push(event(0, true, 0));
            }
            return cell;
        }
        (cell.layout, cell.content) = (layout, Content::Version(0));
        let readers =
            pairs.iter().filter(|(a, _)| !access::changes(*a)).fold(0, |set, (a, d)| set | access::pair(*a, *d));
        if readers != 0 {
            // A read without a known write implies an earlier write.
            cell.events.push(event(0, true, readers));
        }
        cell.events.extend(pairs.iter().map(|(a, d)| event(access::pair(*a, *d), access::changes(*a), 0)));
        cell
    }
}
