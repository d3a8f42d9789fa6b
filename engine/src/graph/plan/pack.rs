//! Placement of items with lifetimes in one heap: interval packing, also called dynamic storage allocation.
//!
//! Packing is NP-hard, so methods of rising cost are tried until one is good enough. A sweep through time with a free list costs
//! tens of nanoseconds per item and is enough for most frames. Where it wastes memory, first fit in several orders follows (after
//! Sekiyama et al., "Profile-guided memory optimization for deep neural networks", 2018, who order by lifetime; Pisarchyk and
//! Lee, "Efficient memory management for deep neural net inference", 2020, who order by size), then a search that moves the item
//! that did not fit to the front (after Joslin and Clements, "Squeaky wheel optimization", 1999). All of it is deterministic.

mod heap;

use heap::Heap;

/// An item to place, with its lifetime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Item {
    /// Size in bytes, rounded up to `align`.
    pub bytes: u64,
    /// Alignment of its offset, a power of two; zero counts as one.
    pub align: u64,
    /// Position of its first use.
    pub first: u32,
    /// Position of its last use, inclusive; not before `first`.
    pub last: u32,
    /// Queue of the positions. Positions on different queues are not ordered in time, so items of different lanes never share memory.
    pub lane: u8,
}

/// The placement of all items.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Packing {
    /// Offset of each item, in bytes.
    pub offsets: Vec<u64>,
    /// Size of the heap, bytes. `u64::MAX` if it does not fit in 64 bits; the offsets are then meaningless.
    pub bytes: u64,
}

/// A packing within this fraction of the lower bound (1/50 is 2 %) is good enough.
const GOOD_ENOUGH: u64 = 50;
/// Largest number of items in a lane for which first fit is tried; its cost is quadratic.
const FIRST_FIT_ITEMS: usize = 2000;
/// Limit on the work of first fit and the search, in comparisons of items (about 2.5 ns each): this many per item of the lane,
/// but at least [`STEPS_AT_LEAST`]. Work is counted rather than timed, so that the result is deterministic.
const STEPS_PER_ITEM: usize = 2000;
const STEPS_AT_LEAST: usize = 400_000;
/// Cost of recording the place of an item, in the same unit.
const STEPS_PER_PLACE: usize = 16;

/// Places the items. Two share memory only if they are in the same lane and their lifetimes are disjoint.
pub(super) fn pack(items: &[Item]) -> Packing {
    let mut packing = Packing { offsets: vec![0; items.len()], bytes: 0 };
    let mut lanes = lanes(items);
    // By falling alignment, so that less is lost between lanes.
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

/// Lower bound of every packing: per lane, the largest number of bytes alive at one position, sizes rounded up to alignments;
/// summed over lanes, since these share nothing. `u64::MAX` if it does not fit in 64 bits.
pub(super) fn lower_bound(items: &[Item]) -> u64 {
    lanes(items).iter().map(|lane| lane.bound(&Events::new(&lane.spans))).fold(0, u64::saturating_add)
}

/// Pairs of an item and a predecessor, by first use of the item: the items that last used any of its bytes before it. Only the
/// most recent user of each byte counts; padding has no user.
pub(super) fn predecessors(items: &[Item], packing: &Packing) -> Vec<(u32, u32)> {
    let mut order: Vec<u64> = items.iter().enumerate().map(|(i, item)| key(item.first, i)).collect();
    order.sort_unstable();
    let mut pairs = Vec::with_capacity(items.len());
    // The last item for which each predecessor was listed, since its bytes may be in several pieces.
    let mut listed = vec![u32::MAX; items.len()];
    // Pieces of the heap with their last users, by offset.
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

/// A piece of the heap and its last user.
#[derive(Clone, Copy)]
struct Held {
    start: u64,
    end: u64,
    item: u32,
}

/// A key that sorts by position, then by index.
fn key(position: u32, index: usize) -> u64 {
    u64::from(position) << 32 | index as u64
}

/// The position in a key.
fn position(key: u64) -> u32 {
    (key >> 32) as u32
}

/// The index in a key.
fn index(key: u64) -> usize {
    key as u32 as usize
}

/// `offset` rounded up to a multiple of `align`, a power of two; `u64::MAX` on overflow.
fn align_up(offset: u64, align: u64) -> u64 {
    offset.checked_add(align - 1).map_or(u64::MAX, |end| end & !(align - 1))
}

/// An item with its size rounded up, above zero.
#[derive(Clone, Copy, Debug)]
struct Span {
    size: u64,
    align: u64,
    first: u32,
    last: u32,
}

impl Span {
    /// Length of its lifetime, in positions.
    fn length(&self) -> u64 {
        u64::from(self.last - self.first) + 1
    }

    /// The span with time reversed.
    fn mirrored(self) -> Self {
        Self { first: u32::MAX - self.last, last: u32::MAX - self.first, ..self }
    }
}

/// All items of one lane, which may share memory.
#[derive(Default)]
struct Lane {
    /// Indices of the items in the input.
    items: Vec<u32>,
    spans: Vec<Span>,
    /// Largest alignment of its items.
    align: u64,
}

/// Offset of each span of a lane, and the end of the last one.
struct Placement {
    offsets: Vec<u64>,
    bytes: u64,
}

/// Groups the items by lane; items of zero bytes are skipped.
fn lanes(items: &[Item]) -> Vec<Lane> {
    let mut lanes: Vec<Lane> = Vec::new();
    let mut of = [None; 256];
    for (i, item) in items.iter().enumerate().filter(|(_, item)| item.bytes > 0) {
        let slot = *of[item.lane as usize].get_or_insert_with(|| {
            // Usually there is only one lane, so the first reserves space for all items.
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

/// Spans sorted by their first positions and by their last ones.
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

    /// Calls `begin` for each span in order of time, after `end` for all spans that are over before it. Stops if `begin` returns false.
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
    /// Largest number of bytes alive at one position.
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

    /// Bytes alive after each span of `events.starts` has begun. Of spans that begin at the same position, the last has the total.
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

    /// Two more sweeps with ties in time ordered by size, forwards and backwards in time.
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

    /// First fit in several orders, the most successful one first, then the search from the best of them.
    fn fit(&self, events: &Events, goal: u64, best: &mut Placement) {
        let spans = &self.spans;
        // Spans that are alive when most memory is in use have the least freedom, so they are placed first.
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
            // The search starts from the best of these orders, even if a sweep did better.
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

/// First fit: places each span at the lowest offset that those before it leave free.
struct Fit<'a> {
    spans: &'a [Span],
    /// Sorted by offset.
    placed: Vec<Placed>,
    offsets: Vec<u64>,
    /// Comparisons so far; see [`STEPS_PER_ITEM`].
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
    /// Size of the heap, or the index in `order` of the first span whose end reached `limit`.
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

    /// The lowest free offset for a span.
    fn gap(&self, s: &Span) -> u64 {
        // End of the placed spans below that are alive at the same time.
        let mut free = 0;
        for p in &self.placed {
            let together = (p.first <= s.last) & (p.last >= s.first);
            // Rarely true, and cheap to test without the alignment.
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

    /// Repeatedly moves the span that exceeded the limit nearer to the front.
    fn search(&mut self, mut order: Vec<u32>, budget: usize, goal: u64, best: &mut Placement) {
        let mut random = 0x9e37_79b9_7f4a_7c15u64;
        while self.steps < budget {
            // The limit asks for a quarter of the remaining gap, not for one byte: that soon shows which spans are in the way.
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
                    // Xorshift (Marsaglia, "Xorshift RNGs", 2003) with a fixed seed. The distance is random, or the search would cycle.
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

/// Best fit in order of time, from a free list; `None` if it does not fit in 64 bits.
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
