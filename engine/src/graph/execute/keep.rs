//! Device objects that outlive the frame: histories, kept buffers and kept images.

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
use crate::measure::PassTime;

/// By slot number.
#[derive(Default)]
pub(super) struct Kept(HashMap<u32, Slot>);

struct Slot {
    /// The entry that it belongs to; see [`Entry::birth`].
    birth: u64,
    shape: Shape,
    /// Both objects of a history; one for a kept buffer or image.
    halves: Vec<Physical>,
    /// Index in `halves` of the object that the frame reads; it writes the other one.
    previous: usize,
}

impl Kept {
    /// The object behind an imported resource.
    pub fn object(&self, key: ImportKey) -> Option<Physical> {
        let (slot, half) = match key {
            ImportKey::Caller(_) => return None,
            ImportKey::Previous(slot) | ImportKey::Kept(slot) => (slot, 0),
            ImportKey::Next(slot) => (slot, 1),
        };
        let slot = self.0.get(&slot)?;
        slot.halves.get((slot.previous + half) % slot.halves.len()).cloned()
    }

    /// Total size in bytes of device memory.
    pub fn bytes(&self) -> u64 {
        let bytes = |half: &Physical| match half {
            Physical::Image(image) => image.bytes(),
            Physical::Buffer(range) => range.buffer.bytes(),
            Physical::Accel(_) | Physical::Unused => 0,
        };
        self.0.values().flat_map(|slot| &slot.halves).map(bytes).sum()
    }

    /// Creates the objects that the frame declares, clears those that are not valid, and frees those that it does not declare.
    pub fn prepare(&mut self, gpu: &Gpu, book: &Book) -> Result<(), GpuError> {
        let pages = book.open();
        let mut declared: Vec<&Entry> = pages.declared().collect();
        if declared.is_empty() && self.0.is_empty() {
            return Ok(());
        }
        declared.sort_unstable_by_key(|e| e.slot);
        self.forget(gpu, &declared)?;

        // Everything is created before anything is replaced: if memory runs out, kept buffers keep their contents.
        let mut made = Vec::new();
        for entry in &declared {
            if self.0.get(&entry.slot).is_none_or(|held| held.shape != entry.shape) {
                made.push((*entry, Slot::new(gpu, entry)?));
            }
        }
        let stale = |entry: &&&Entry| entry.keeping == Keeping::Pair && !entry.is_valid();
        let stale = declared.iter().filter(stale).filter_map(|entry| self.0.get(&entry.slot));
        let stale: Vec<&Slot> = stale.collect();
        if made.is_empty() && stale.is_empty() {
            return Ok(());
        }
        let mut work = CommandEncoder::new(gpu, Queue::Graphics)?;
        work.begin()?;
        for slot in stale {
            slot.clear(&mut work);
        }
        for (entry, slot) in &made {
            match self.0.get(&entry.slot) {
                Some(smaller) => slot.copy_from(smaller, entry.valid_bytes, &mut work),
                None => slot.clear(&mut work),
            }
        }
        work.full_barrier();
        work.finish()?;
        let done = gpu.submit(Queue::Graphics, [&work], &[])?;
        gpu.wait(done)?;
        self.0.extend(made.into_iter().map(|(entry, slot)| (entry.slot, slot)));
        Ok(())
    }

    /// Frees objects that are no longer declared, and histories of another size, before new memory is allocated.
    fn forget(&mut self, gpu: &Gpu, declared: &[&Entry]) -> Result<(), GpuError> {
        let before = self.0.len();
        self.0.retain(|slot, held| {
            let Ok(at) = declared.binary_search_by_key(slot, |e| e.slot) else { return false };
            let entry = declared[at];
            held.birth == entry.birth && (held.shape == entry.shape || entry.keeping == Keeping::Single)
        });
        if self.0.len() == before { Ok(()) } else { gpu.wait_idle() }
    }

    /// Called after the frame has run: swaps the halves of the histories that it wrote.
    pub fn end(&mut self, book: &Book, declaration: &Declaration, plan: &Plan) {
        let mut written = Vec::new();
        if !self.0.is_empty() {
            let uses = plan.order.iter().flat_map(|&pass| declaration.uses_of(pass));
            for u in uses.filter(|u| u.writes.is_some()) {
                let Origin::Imported { key, .. } = declaration.resources[u.resource as usize].origin else { continue };
                if let ImportKey::Next(slot) | ImportKey::Kept(slot) = key
                    && !written.contains(&slot)
                {
                    written.push(slot);
                }
            }
        }
        for slot in &written {
            if let Some(slot) = self.0.get_mut(slot) {
                slot.previous = (slot.previous + 1) % slot.halves.len();
            }
        }
        book.open().end(|slot| written.contains(&slot));
    }

    /// Marks kept images as stale if a pass that read them met non-finite values: otherwise one bad value would stay until what
    /// the image shows changes. `passes` are by position, and empty if nothing was measured.
    pub fn distrust(&self, book: &Book, declaration: &Declaration, plan: &Plan, passes: &[PassTime]) {
        for (&pass, _) in plan.order.iter().zip(passes).filter(|(_, counted)| counted.not_finite > 0) {
            for u in declaration.uses_of(pass).iter().filter(|u| u.reads.is_some()) {
                if let Origin::Imported { key: ImportKey::Kept(slot), .. } =
                    declaration.resources[u.resource as usize].origin
                {
                    book.open().distrust(slot);
                }
            }
        }
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
            Shape::Buffer { bytes } | Shape::Accel { bytes, .. } => {
                let name = format!("kept {} {half}", entry.slot);
                let bytes = bytes.next_multiple_of(4);
                let buffer = gpu::Buffer::new(gpu, &name, bytes, BufferMemory::Device, BufferUse::Any)?;
                Ok::<_, GpuError>(Physical::Buffer(BufferRange::whole(Arc::new(buffer))))
            }
        };
        let halves = match entry.keeping {
            Keeping::Pair => vec![make("a")?, make("b")?],
            Keeping::Single | Keeping::Layers => vec![make("")?],
        };
        Ok(Self { birth: entry.birth, shape: entry.shape, halves, previous: 0 })
    }

    /// Clears the half that the frame reads to zero, and puts it into the layout that the plan expects.
    fn clear(&self, work: &mut CommandEncoder) {
        match &self.halves[self.previous] {
            Physical::Image(image) => {
                let all = Part::ALL.of(image.mips(), image.layers());
                // The graph has no access for a clear, which Vulkan does not treat as a copy.
                let into = |from, to| ImageBarrier::new(image, all, (Uses::ANY, Uses::ANY), (from, to), None);
                work.barriers(&[], &[into(Layout::Undefined, Layout::TransferTarget)]);
                work.clear_image(image);
                work.barriers(&[], &[into(Layout::TransferTarget, Layout::ReadOnly)]);
            }
            Physical::Buffer(range) => work.clear_buffer(&range.buffer),
            Physical::Accel(_) | Physical::Unused => {}
        }
    }

    /// Copies the contents of a smaller buffer and clears the rest.
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
