//! Places in one heap for items with lifetimes: interval packing, or dynamic storage allocation.
//!
//! Packing is NP-hard, so this is a ladder that stops at the first rung that is good enough. A sweep through time with a free
//! list costs a few tens of nanoseconds per item and is all that most frames need. Where it wastes memory, first fit in several
//! orders follows (after Sekiyama et al., "Profile-guided memory optimization for deep neural networks", 2018, who order by
//! lifetime; Pisarchyk and Lee, "Efficient memory management for deep neural net inference", 2020, who order by size), then a
//! search that moves the item that did not fit to the front (after Joslin and Clements, "Squeaky wheel optimization", 1999).
//! All of it is deterministic.

mod heap;

use heap::Heap;

/// Something that needs a place while it is alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Item {
    /// Bytes that it takes. They are rounded up to `align`.
    pub bytes: u64,
    /// Alignment of its offset, a power of two; zero counts as one.
    pub align: u64,
    /// Position of its first use.
    pub first: u32,
    /// Position of its last use, inclusive; not before `first`.
    pub last: u32,
    /// Queue whose positions these are. Positions of different lanes say nothing about time: items of different lanes never
    /// share a byte.
    pub lane: u8,
}

/// Where each item lies.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Packing {
    /// Offset of each item, in bytes.
    pub offsets: Vec<u64>,
    /// Bytes of the heap; `u64::MAX` when no packing that 64 bits can count was found, and then the offsets mean nothing.
    pub bytes: u64,
}

/// A packing within this part of the lower bound (1/50 is 2 %) is good enough.
const GOOD_ENOUGH: u64 = 50;
/// Most items of a lane for which first fit, whose cost grows with the square, is tried.
const FIRST_FIT_ITEMS: usize = 2000;
/// Most work of first fit and the search: items compared with one another, about 2.5 ns each, for each item of the lane, and at
/// least. Work is counted, not timed, so that the result is always the same.
const STEPS_PER_ITEM: usize = 2000;
const STEPS_AT_LEAST: usize = 400_000;
/// What it costs to note the place of an item, in such steps.
const STEPS_PER_PLACE: usize = 16;

/// Places the items. Two share bytes only if their lifetimes do not overlap and their lanes are the same.
pub(super) fn pack(items: &[Item]) -> Packing {
    let mut packing = Packing { offsets: vec![0; items.len()], bytes: 0 };
    let mut lanes = lanes(items);
    // The greatest alignment first: less is lost where one lane ends and the next begins.
    lanes.sort_by_key(|lane| std::cmp::Reverse(lane.align));
    for lane in &lanes {
        let placement = lane.pack();
        let base = align_up(packing.bytes, lane.align);
        packing.bytes = base.saturating_add(placement.bytes);
        for (&item, offset) in lane.items.iter().zip(placement.offsets) {
            packing.offsets[item as usize] = base.saturating_add(offset);
        }
    }
    packing
}

/// Most bytes alive at one position of a lane, rounded up to the alignment of each item, summed over the lanes, which share
/// nothing. No packing takes less. `u64::MAX` when 64 bits cannot count it.
pub(super) fn lower_bound(items: &[Item]) -> u64 {
    lanes(items).iter().map(|lane| lane.bound(&Events::new(&lane.spans))).fold(0, u64::saturating_add)
}

/// For each item, in order of first use, the items that held any of its bytes last before it: pairs of an item and a
/// predecessor. Only the most recent holder of each byte counts; padding is held by no one.
pub(super) fn predecessors(items: &[Item], packing: &Packing) -> Vec<(u32, u32)> {
    let mut order: Vec<u64> = items.iter().enumerate().map(|(i, item)| key(item.first, i)).collect();
    order.sort_unstable();
    let mut pairs = Vec::with_capacity(items.len());
    // The last item that each predecessor was listed for: its bytes may lie in several pieces.
    let mut listed = vec![u32::MAX; items.len()];
    // Pieces of the heap with their holders, by offset.
    let mut held: Vec<Held> = Vec::new();
    for i in order.into_iter().map(index) {
        let (start, end) = (packing.offsets[i], packing.offsets[i].saturating_add(items[i].bytes));
        if start == end {
            continue;
        }
        let from = held.partition_point(|h| h.end <= start);
        let count = held[from..].iter().take_while(|h| h.start < end).count();
        for h in &held[from..from + count] {
            if listed[h.item as usize] != i as u32 {
                listed[h.item as usize] = i as u32;
                pairs.push((i as u32, h.item));
            }
        }
        let new = Held { start, end, item: i as u32 };
        match held[from..from + count] {
            [old] if old.start == start && old.end == end => held[from] = new,
            [] => held.insert(from, new),
            [head, ..] => {
                let tail = held[from + count - 1];
                let before = (head.start < start).then_some(Held { end: start, ..head });
                let after = (tail.end > end).then_some(Held { start: end, ..tail });
                held.splice(from..from + count, before.into_iter().chain([new]).chain(after));
            }
        }
    }
    pairs
}

/// A piece of the heap and who used it last.
#[derive(Clone, Copy)]
struct Held {
    start: u64,
    end: u64,
    item: u32,
}

/// Sorts by position, then by index.
fn key(position: u32, index: usize) -> u64 {
    u64::from(position) << 32 | index as u64
}

/// Position of a key.
fn position(key: u64) -> u32 {
    (key >> 32) as u32
}

/// Index of a key.
fn index(key: u64) -> usize {
    key as u32 as usize
}

/// The next multiple of `align`, a power of two; `u64::MAX` beyond 64 bits.
fn align_up(offset: u64, align: u64) -> u64 {
    offset.checked_add(align - 1).map_or(u64::MAX, |end| end & !(align - 1))
}

/// An item with its bytes rounded up, more than zero.
#[derive(Clone, Copy, Debug)]
struct Span {
    size: u64,
    align: u64,
    first: u32,
    last: u32,
}

impl Span {
    /// Positions that it is alive.
    fn length(&self) -> u64 {
        u64::from(self.last - self.first) + 1
    }

    /// With time reversed.
    fn mirrored(self) -> Self {
        Self { first: u32::MAX - self.last, last: u32::MAX - self.first, ..self }
    }
}

/// Items that may share bytes with one another.
#[derive(Default)]
struct Lane {
    /// By index in the input.
    items: Vec<u32>,
    spans: Vec<Span>,
    /// Greatest alignment.
    align: u64,
}

/// Offsets of the spans of a lane and where the last ends.
struct Placement {
    offsets: Vec<u64>,
    bytes: u64,
}

/// Items by lane, without those that take no bytes.
fn lanes(items: &[Item]) -> Vec<Lane> {
    let mut lanes: Vec<Lane> = Vec::new();
    let mut of = [None; 256];
    for (i, item) in items.iter().enumerate().filter(|(_, item)| item.bytes > 0) {
        let slot = *of[item.lane as usize].get_or_insert_with(|| {
            // Mostly there is one lane.
            let room = if lanes.is_empty() { items.len() } else { 0 };
            lanes.push(Lane { items: Vec::with_capacity(room), spans: Vec::with_capacity(room), align: 1 });
            lanes.len() - 1
        });
        let lane = &mut lanes[slot];
        debug_assert!(item.align == 0 || item.align.is_power_of_two(), "alignment {} of item {i}", item.align);
        let align = item.align.max(1).checked_next_power_of_two().unwrap_or(1 << 63);
        lane.align = lane.align.max(align);
        lane.items.push(i as u32);
        let size = align_up(item.bytes, align);
        lane.spans.push(Span { size, align, first: item.first, last: item.last.max(item.first) });
    }
    lanes
}

/// Spans by begin and by end.
struct Events {
    starts: Vec<u64>,
    ends: Vec<u64>,
}

impl Events {
    fn new(spans: &[Span]) -> Self {
        let mut starts: Vec<u64> = spans.iter().enumerate().map(|(i, s)| key(s.first, i)).collect();
        let mut ends: Vec<u64> = spans.iter().enumerate().map(|(i, s)| key(s.last, i)).collect();
        starts.sort_unstable();
        ends.sort_unstable();
        Self { starts, ends }
    }

    /// Calls `begin` for each span in order of time, after `end` for those that are over by then.
    fn walk<T>(&self, state: &mut T, mut begin: impl FnMut(&mut T, usize) -> bool, mut end: impl FnMut(&mut T, usize)) {
        let mut ended = 0;
        for &start in &self.starts {
            while position(self.ends[ended]) < position(start) {
                end(state, index(self.ends[ended]));
                ended += 1;
            }
            if !begin(state, index(start)) {
                return;
            }
        }
    }
}

impl Lane {
    /// Most bytes alive at one position.
    fn bound(&self, events: &Events) -> u64 {
        let mut state = (0u128, 0u128);
        let begin = |(alive, most): &mut (u128, u128), i: usize| {
            *alive += u128::from(self.spans[i].size);
            *most = (*most).max(*alive);
            true
        };
        events.walk(&mut state, begin, |(alive, _), i| *alive -= u128::from(self.spans[i].size));
        u64::try_from(state.1).unwrap_or(u64::MAX)
    }

    /// Bytes alive when each span of `events.starts` has begun. Of those that begin at one position the last has the sum.
    fn alive(&self, events: &Events) -> Vec<u128> {
        let mut state = (0u128, Vec::with_capacity(self.spans.len()));
        let begin = |(alive, all): &mut (u128, Vec<u128>), i: usize| {
            *alive += u128::from(self.spans[i].size);
            all.push(*alive);
            true
        };
        events.walk(&mut state, begin, |(alive, _), i| *alive -= u128::from(self.spans[i].size));
        state.1
    }

    fn pack(&self) -> Placement {
        let events = Events::new(&self.spans);
        let bound = self.bound(&events);
        let goal = bound.saturating_add(bound / GOOD_ENOUGH);
        let mut best =
            sweep(&self.spans, &events).unwrap_or(Placement { offsets: vec![0; self.spans.len()], bytes: u64::MAX });
        if best.bytes > goal {
            self.sweep_more(goal, &mut best);
        }
        if best.bytes > goal && self.spans.len() <= FIRST_FIT_ITEMS {
            self.fit(&events, goal, &mut best);
        }
        best
    }

    /// Sweeps backwards in time, and with the larger ones first where several begin at once.
    fn sweep_more(&self, goal: u64, best: &mut Placement) {
        let mut by_size: Vec<u32> = (0..self.spans.len() as u32).collect();
        by_size.sort_by_key(|&i| std::cmp::Reverse(self.spans[i as usize].size));
        for mirror in [false, true] {
            let turn = |&i: &u32| if mirror { self.spans[i as usize].mirrored() } else { self.spans[i as usize] };
            let spans: Vec<Span> = by_size.iter().map(turn).collect();
            let Some(placement) = sweep(&spans, &Events::new(&spans)) else { continue };
            if placement.bytes < best.bytes {
                best.bytes = placement.bytes;
                for (&i, offset) in by_size.iter().zip(placement.offsets) {
                    best.offsets[i as usize] = offset;
                }
            }
            if best.bytes <= goal {
                return;
            }
        }
    }

    /// First fit in several orders, the one that most often serves first, then the search from the best of them.
    fn fit(&self, events: &Events, goal: u64, best: &mut Placement) {
        let spans = &self.spans;
        // The busiest moment of each span: what lives then has the least choice.
        let alive = self.alive(events);
        let peak = |s: &Span| {
            let from = events.starts.partition_point(|&start| position(start) < s.first);
            let to = events.starts.partition_point(|&start| position(start) <= s.last);
            alive[from..to].iter().copied().max().unwrap_or(0)
        };
        let peaks: Vec<u128> = spans.iter().map(peak).collect();
        type Rank<'a> = &'a dyn Fn(usize) -> (u128, u128);
        let (size, length) = (|i: usize| u128::from(spans[i].size), |i: usize| u128::from(spans[i].length()));
        let ranks: [Rank; 7] = [
            &|i| (peaks[i], size(i) * length(i)),
            &|i| (peaks[i], size(i)),
            &|i| (peaks[i], length(i)),
            &|i| (size(i), length(i)),
            &|i| (size(i) * length(i), 0),
            &|i| (length(i), size(i)),
            &|i| (u128::from(spans[i].align), size(i)),
        ];
        let mut fit = Fit { spans, placed: Vec::with_capacity(spans.len()), offsets: vec![0; spans.len()], steps: 0 };
        let budget = STEPS_AT_LEAST.max(STEPS_PER_ITEM * spans.len());
        let mut order: Vec<u32> = Vec::with_capacity(spans.len());
        let mut start = (u64::MAX, (0..spans.len() as u32).collect());
        for rank in ranks {
            order.clear();
            order.extend(0..spans.len() as u32);
            order.sort_by_cached_key(|&i| std::cmp::Reverse(rank(i as usize)));
            // The search begins with the best order of these, also where a sweep was better.
            if let Ok(bytes) = fit.place(&order, start.0) {
                start = (bytes, order.clone());
                if bytes < best.bytes {
                    best.bytes = bytes;
                    best.offsets.copy_from_slice(&fit.offsets);
                }
                if best.bytes <= goal {
                    return;
                }
            }
            if fit.steps >= budget / 4 {
                break;
            }
        }
        fit.search(start.1, budget, goal, best);
    }
}

/// First fit: each span in turn at the lowest place that those before it leave free.
struct Fit<'a> {
    spans: &'a [Span],
    /// By offset.
    placed: Vec<Placed>,
    offsets: Vec<u64>,
    /// Items compared so far.
    steps: usize,
}

#[derive(Clone, Copy)]
struct Placed {
    offset: u64,
    end: u64,
    first: u32,
    last: u32,
}

impl Fit<'_> {
    /// Bytes of the heap, or the index in `order` of the span that made it reach `limit`.
    fn place(&mut self, order: &[u32], limit: u64) -> Result<u64, usize> {
        self.placed.clear();
        let mut bytes = 0;
        for (turn, &i) in order.iter().enumerate() {
            let s = self.spans[i as usize];
            self.steps += self.placed.len() + STEPS_PER_PLACE;
            let offset = self.gap(&s);
            let end = offset.saturating_add(s.size);
            if end >= limit {
                return Err(turn);
            }
            bytes = bytes.max(end);
            self.offsets[i as usize] = offset;
            let at = self.placed.partition_point(|p| p.offset < offset);
            self.placed.insert(at, Placed { offset, end, first: s.first, last: s.last });
        }
        Ok(bytes)
    }

    /// The lowest place for a span among those placed.
    fn gap(&self, s: &Span) -> u64 {
        // The end of what lies below and is alive at the same time.
        let mut free = 0;
        for p in &self.placed {
            let together = (p.first <= s.last) & (p.last >= s.first);
            // Rarely true, and cheap to rule out without the alignment.
            if together & (p.offset.saturating_sub(free) >= s.size) {
                let offset = align_up(free, s.align);
                if p.offset.saturating_sub(offset) >= s.size {
                    return offset;
                }
            }
            free = if together { free.max(p.end) } else { free };
        }
        align_up(free, s.align)
    }

    /// Moves the span that made the heap too large nearer to the front, again and again.
    fn search(&mut self, mut order: Vec<u32>, budget: usize, goal: u64, best: &mut Placement) {
        let mut random = 0x9e37_79b9_7f4a_7c15u64;
        while self.steps < budget {
            // Asking for a quarter of what is missing at once, not for a byte, shows early what is in the way.
            let limit = goal + 1 + (best.bytes - goal - 1) / 4 * 3;
            match self.place(&order, limit) {
                Ok(bytes) => {
                    best.bytes = bytes;
                    best.offsets.copy_from_slice(&self.offsets);
                    if bytes <= goal {
                        return;
                    }
                }
                Err(turn) => {
                    // Xorshift (Marsaglia, "Xorshift RNGs", 2003) with a fixed seed. Nearer the front by a distance of its own
                    // each time, or the search goes in circles.
                    random ^= random << 13;
                    random ^= random >> 7;
                    random ^= random << 17;
                    let to = (random >> 32) as usize % (turn / 4 + 1);
                    order[to..=turn].rotate_right(1);
                }
            }
        }
    }
}

/// Best fit in order of time from a free list; none where 64 bits cannot count it.
fn sweep(spans: &[Span], events: &Events) -> Option<Placement> {
    let mut state = (Heap::new(), vec![0u32; spans.len()], vec![0; spans.len()], true);
    let begin = |(heap, blocks, offsets, fits): &mut (Heap, Vec<u32>, Vec<u64>, bool), i: usize| {
        let Some(block) = heap.take(spans[i].size, spans[i].align) else {
            *fits = false;
            return false;
        };
        blocks[i] = block;
        offsets[i] = heap.offset(block);
        true
    };
    events.walk(&mut state, begin, |(heap, blocks, ..), i| heap.release(blocks[i]));
    let (heap, _, offsets, fits) = state;
    fits.then_some(Placement { offsets, bytes: heap.bytes })
}

#[cfg(test)]
#[path = "pack_tests.rs"]
mod tests;
