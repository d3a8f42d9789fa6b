//! What outlives the frame: the objects behind histories and kept buffers.

use std::{collections::HashMap, sync::Arc};

use super::super::{
    access::{Layout, Queue, Uses},
    declaration::{Declaration, ImportKey, Origin, Shape},
    desc::Part,
    history::{Book, Entry, Keeping},
    plan::Plan,
    record::{BufferRange, Physical},
};
use crate::gpu::{self, BufferMemory, BufferUse, CommandEncoder, Gpu, GpuError, ImageBarrier, ImageInfo, ImageUse};

/// By slot.
#[derive(Default)]
pub(super) struct Kept(HashMap<u32, Slot>);

struct Slot {
    shape: Shape,
    /// Both halves of a pair; a kept buffer has one.
    halves: Vec<Physical>,
    /// The half that the frame reads; it writes the other.
    previous: usize,
}

impl Kept {
    /// The object behind a resource.
    pub fn object(&self, key: ImportKey) -> Option<Physical> {
        let (slot, half) = match key {
            ImportKey::Caller(_) => return None,
            ImportKey::Previous(slot) | ImportKey::Kept(slot) => (slot, 0),
            ImportKey::Next(slot) => (slot, 1),
        };
        let slot = self.0.get(&slot)?;
        slot.halves.get((slot.previous + half) % slot.halves.len()).cloned()
    }

    /// Bytes of device memory behind it all.
    pub fn bytes(&self) -> u64 {
        let bytes = |half: &Physical| match half {
            Physical::Image(image) => image.bytes(),
            Physical::Buffer(range) => range.buffer.bytes(),
            Physical::Unused => 0,
        };
        self.0.values().flat_map(|slot| &slot.halves).map(bytes).sum()
    }

    /// Makes what the frame has declared and is not there yet, clears what is not valid, and lets go of the rest.
    pub fn prepare(&mut self, gpu: &Gpu, book: &Book) -> Result<(), GpuError> {
        let pages = book.open();
        let mut declared: Vec<&Entry> = pages.declared().collect();
        if declared.is_empty() && self.0.is_empty() {
            return Ok(());
        }
        declared.sort_unstable_by_key(|e| e.slot);
        self.0.retain(|slot, _| declared.binary_search_by_key(slot, |e| e.slot).is_ok());
        let mut encoder = None;
        // Replaced buffers live until the copies from them are done.
        let mut replaced = Vec::new();
        for entry in declared {
            let same = self.0.get(&entry.slot).is_some_and(|held| held.shape == entry.shape);
            let (valid, bytes) = (entry.valid || entry.keeping == Keeping::Single, entry.valid_bytes);
            if same && valid {
                continue;
            }
            let work = match &mut encoder {
                Some(work) => work,
                none => {
                    let new = none.insert(CommandEncoder::new(gpu, Queue::Graphics)?);
                    new.begin()?;
                    new
                }
            };
            if !same {
                let old = self.0.insert(entry.slot, Slot::new(gpu, entry)?);
                if let (Keeping::Single, Some(old), Some(new)) = (entry.keeping, old, self.0.get(&entry.slot)) {
                    new.copy_from(&old, bytes, work);
                    replaced.push(old);
                    continue;
                }
            }
            if let Some(slot) = self.0.get(&entry.slot) {
                slot.clear(work);
            }
        }
        if let Some(mut work) = encoder {
            work.full_barrier();
            work.finish()?;
            let done = gpu.submit(Queue::Graphics, [&work], &[])?;
            gpu.wait(done)?;
        }
        drop(replaced);
        Ok(())
    }

    /// The frame ran: what it wrote is what the next one reads.
    pub fn end(&mut self, book: &Book, declaration: &Declaration, plan: &Plan) {
        let written: Vec<u32> = declaration
            .resources
            .iter()
            .zip(&plan.lifetimes)
            .filter_map(|(decl, life)| match decl.origin {
                Origin::Imported { key: ImportKey::Next(slot), .. } => life.map(|_| slot),
                Origin::Imported { .. } | Origin::Transient => None,
            })
            .collect();
        for slot in &written {
            if let Some(slot) = self.0.get_mut(slot) {
                slot.previous = 1 - slot.previous;
            }
        }
        book.open().end(|slot| written.contains(&slot));
    }
}

impl Slot {
    fn new(gpu: &Gpu, entry: &Entry) -> Result<Self, GpuError> {
        let make = |half: &str| match entry.shape {
            Shape::Image { format, extent, mips, layers } => {
                let usage = ImageUse { sampled: true, storage: format.is_storable(), attachment: true };
                let info = ImageInfo { format, extent, mips, layers, usage, exclusive: false };
                let image = gpu::Image::with(gpu, &format!("history {} {half}", entry.slot), info)?;
                Ok(Physical::Image(Arc::new(image)))
            }
            Shape::Buffer { bytes } | Shape::Accel { bytes } => {
                let name = format!("kept {} {half}", entry.slot);
                let bytes = bytes.next_multiple_of(4);
                let buffer = gpu::Buffer::new(gpu, &name, bytes, BufferMemory::Device, BufferUse::Indirect)?;
                Ok::<_, GpuError>(Physical::Buffer(BufferRange::whole(Arc::new(buffer))))
            }
        };
        let halves = match entry.keeping {
            Keeping::Pair => vec![make("a")?, make("b")?],
            Keeping::Single => vec![make("")?],
        };
        Ok(Self { shape: entry.shape, halves, previous: 0 })
    }

    /// Fills what the frame reads with zeros, and leaves it as the plan expects it.
    fn clear(&self, work: &mut CommandEncoder) {
        match &self.halves[self.previous] {
            Physical::Image(image) => {
                let all = Part::ALL.of(image.mips(), image.layers());
                // A clear is no copy: no access of the graph stands for it.
                let layouts = (Layout::Undefined, Layout::TransferTarget);
                work.barriers(&[], &[ImageBarrier::new(image, all, (Uses::ANY, Uses::ANY), layouts, None)]);
                work.clear_image(image);
                let layouts = (Layout::TransferTarget, Layout::ShaderRead);
                work.barriers(&[], &[ImageBarrier::new(image, all, (Uses::ANY, Uses::ANY), layouts, None)]);
            }
            Physical::Buffer(range) => work.clear_buffer(&range.buffer),
            Physical::Unused => {}
        }
    }

    /// Takes over what a smaller buffer held; the rest is zeros.
    fn copy_from(&self, old: &Self, bytes: u64, work: &mut CommandEncoder) {
        if let (Physical::Buffer(new), Physical::Buffer(old)) = (&self.halves[0], &old.halves[0]) {
            let held = bytes.min(old.buffer.bytes()).next_multiple_of(4);
            if held > 0 {
                work.copy_buffer(&old.buffer, 0, &new.buffer, 0, held);
            }
            if new.buffer.bytes() > held {
                work.clear_range(&new.buffer, held, new.buffer.bytes() - held);
            }
        }
    }
}
