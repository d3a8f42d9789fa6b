//! A free-list allocator, for the sweep through time.

use super::align_up;

/// No block.
const NONE: u32 = u32::MAX;
/// Number of free blocks of a bin that are compared before one is taken.
const LOOKED_AT: usize = 16;

/// A part of the heap, free or taken.
#[derive(Clone, Copy)]
struct Block {
    offset: u64,
    size: u64,
    /// Indices of the neighbours in memory. In an unused entry, `above` is the next unused one.
    below: u32,
    above: u32,
    /// Indices of the neighbours in the free list of its bin.
    previous: u32,
    next: u32,
    free: bool,
}

/// Blocks from the bottom to the top of the heap. Free ones are in bins by size, eight per power of two, as in TLSF (Masmano et
/// al., "TLSF: a new dynamic memory allocator for real-time systems", 2004), so every call takes constant time.
pub(super) struct Heap {
    blocks: Vec<Block>,
    /// First unused entry of `blocks`.
    spare: u32,
    /// Index of the last block in memory.
    top: u32,
    /// Size of the heap, bytes.
    pub(super) bytes: u64,
    /// First block of each bin.
    bins: [u32; 512],
    /// One bit for each bin that is not empty.
    filled: [u64; 8],
}

impl Heap {
    pub(super) fn new() -> Self {
        Self { blocks: Vec::with_capacity(64), spare: NONE, top: NONE, bytes: 0, bins: [NONE; 512], filled: [0; 8] }
    }

    /// Bin of a size above zero, from its leading one and the three bits after it.
    fn bin(size: u64) -> usize {
        let leading = size.leading_zeros();
        let fraction = (size << leading) >> 60 & 7;
        (63 - leading as usize) * 8 + fraction as usize
    }

    /// Where a block begins.
    pub(super) fn offset(&self, id: u32) -> u64 {
        self.blocks[id as usize].offset
    }

    /// The first bin from `bin` on that is not empty.
    fn next_bin(&self, bin: usize) -> Option<usize> {
        let mut word = bin / 64;
        let mut bits = self.filled.get(word)? & (u64::MAX << (bin % 64));
        while bits == 0 {
            word += 1;
            bits = *self.filled.get(word)?;
        }
        Some(word * 64 + bits.trailing_zeros() as usize)
    }

    /// Stores a block, in an unused entry if there is one.
    fn block(&mut self, block: Block) -> u32 {
        if self.spare == NONE {
            self.blocks.push(block);
            return self.blocks.len() as u32 - 1;
        }
        let id = self.spare;
        self.spare = self.blocks[id as usize].above;
        self.blocks[id as usize] = block;
        id
    }

    /// Adds a block to the free list.
    fn put(&mut self, id: u32) {
        let bin = Self::bin(self.blocks[id as usize].size);
        let next = std::mem::replace(&mut self.bins[bin], id);
        let block = &mut self.blocks[id as usize];
        (block.free, block.previous, block.next) = (true, NONE, next);
        if next != NONE {
            self.blocks[next as usize].previous = id;
        }
        self.filled[bin / 64] |= 1 << (bin % 64);
    }

    /// Removes a block from the free list.
    fn pick(&mut self, id: u32) {
        let Block { size, previous, next, .. } = self.blocks[id as usize];
        self.blocks[id as usize].free = false;
        if next != NONE {
            self.blocks[next as usize].previous = previous;
        }
        if previous != NONE {
            self.blocks[previous as usize].next = next;
            return;
        }
        let bin = Self::bin(size);
        self.bins[bin] = next;
        if next == NONE {
            self.filled[bin / 64] &= !(1 << (bin % 64));
        }
    }

    /// The free block that wastes least, of those compared, and the aligned offset in it.
    fn best(&self, size: u64, align: u64) -> Option<(u32, u64)> {
        let mut bin = Self::bin(size);
        loop {
            bin = self.next_bin(bin)?;
            let mut best = (u64::MAX, 0, NONE);
            let mut id = self.bins[bin];
            for _ in 0..LOOKED_AT {
                if id == NONE {
                    break;
                }
                let block = &self.blocks[id as usize];
                let offset = align_up(block.offset, align);
                let lost = offset - block.offset;
                if block.size >= size && block.size - size >= lost {
                    best = best.min((block.size - size, offset, id));
                }
                id = block.next;
            }
            if best.2 != NONE {
                return Some((best.2, best.1));
            }
            bin += 1;
        }
    }

    /// Allocates a block of this size; `None` if the heap would exceed 64 bits.
    pub(super) fn take(&mut self, size: u64, align: u64) -> Option<u32> {
        let (id, offset) = match self.best(size, align) {
            Some((id, offset)) => {
                self.pick(id);
                (id, offset)
            }
            None => self.grow(size, align)?,
        };
        let Block { offset: start, size: whole, below, above, .. } = self.blocks[id as usize];
        let (head, tail) = (offset - start, start + whole - offset - size);
        let empty = Block { offset: start, size: head, below, above, previous: NONE, next: NONE, free: false };
        if head > 0 {
            let new = self.block(Block { above: id, ..empty });
            if below != NONE {
                self.blocks[below as usize].above = new;
            }
            self.blocks[id as usize].below = new;
            self.put(new);
        }
        if tail > 0 {
            let new = self.block(Block { offset: offset + size, size: tail, below: id, ..empty });
            match above {
                NONE => self.top = new,
                above => self.blocks[above as usize].below = new,
            }
            self.blocks[id as usize].above = new;
            self.put(new);
        }
        let block = &mut self.blocks[id as usize];
        (block.offset, block.size) = (offset, size);
        Some(id)
    }

    /// Grows the heap by a block at the top, including what was free there. Returns the block and the aligned offset in it.
    fn grow(&mut self, size: u64, align: u64) -> Option<(u32, u64)> {
        let free = self.top != NONE && self.blocks[self.top as usize].free;
        let start = if free { self.blocks[self.top as usize].offset } else { self.bytes };
        let offset = align_up(start, align);
        let end = offset.checked_add(size).filter(|&end| end < u64::MAX)?;
        if free {
            self.pick(self.top);
        } else {
            let below = self.top;
            let block = Block { offset: start, size: 0, below, above: NONE, previous: NONE, next: NONE, free: false };
            self.top = self.block(block);
            if below != NONE {
                self.blocks[below as usize].above = self.top;
            }
        }
        self.blocks[self.top as usize].size = end - start;
        self.bytes = end;
        Some((self.top, offset))
    }

    /// Frees a block and merges it with free neighbours.
    pub(super) fn release(&mut self, id: u32) {
        let Block { mut offset, mut size, mut below, mut above, .. } = self.blocks[id as usize];
        if below != NONE && self.blocks[below as usize].free {
            self.pick(below);
            let merged = self.blocks[below as usize];
            (offset, size) = (merged.offset, size + merged.size);
            self.drop_block(below);
            below = merged.below;
        }
        if above != NONE && self.blocks[above as usize].free {
            self.pick(above);
            let merged = self.blocks[above as usize];
            size += merged.size;
            self.drop_block(above);
            above = merged.above;
        }
        let block = &mut self.blocks[id as usize];
        (block.offset, block.size, block.below, block.above) = (offset, size, below, above);
        if below != NONE {
            self.blocks[below as usize].above = id;
        }
        match above {
            NONE => self.top = id,
            above => self.blocks[above as usize].below = id,
        }
        self.put(id);
    }

    /// Makes the entry of a block available again.
    fn drop_block(&mut self, id: u32) {
        self.blocks[id as usize].above = self.spare;
        self.spare = id;
    }
}
