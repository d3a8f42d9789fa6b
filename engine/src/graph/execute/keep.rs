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
use crate::measure::PassTime;

/// By slot.
#[derive(Default)]
pub(super) struct Kept(HashMap<u32, Slot>);

struct Slot {
    /// Whose it is.
    birth: u64,
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
            Physical::Accel(_) | Physical::Unused => 0,
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
        self.forget(gpu, &declared)?;

        // All is made before anything is replaced: where memory runs out, kept buffers still hold what they held.
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

    /// Lets go of what is not declared any more, and of pairs of another size, before anything new takes memory.
    fn forget(&mut self, gpu: &Gpu, declared: &[&Entry]) -> Result<(), GpuError> {
        let before = self.0.len();
        self.0.retain(|slot, held| {
            let Ok(at) = declared.binary_search_by_key(slot, |e| e.slot) else { return false };
            let entry = declared[at];
            held.birth == entry.birth && (held.shape == entry.shape || entry.keeping == Keeping::Single)
        });
        if self.0.len() == before { Ok(()) } else { gpu.wait_idle() }
    }

    /// The frame ran: what it wrote is what the next one reads.
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

    /// Kept images that were read by passes which met values that are not finite are made anew in the next frame: else one bad value
    /// stays for as long as nothing that they show changes. `passes` are by position; none where nothing was measured.
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

    /// Fills what the frame reads with zeros, and leaves it as the plan expects it.
    fn clear(&self, work: &mut CommandEncoder) {
        match &self.halves[self.previous] {
            Physical::Image(image) => {
                let all = Part::ALL.of(image.mips(), image.layers());
                // No access of the graph stands for a clear, which is no copy to a device.
                let into = |from, to| ImageBarrier::new(image, all, (Uses::ANY, Uses::ANY), (from, to), None);
                work.barriers(&[], &[into(Layout::Undefined, Layout::TransferTarget)]);
                work.clear_image(image);
                work.barriers(&[], &[into(Layout::TransferTarget, Layout::ShaderRead)]);
            }
            Physical::Buffer(range) => work.clear_buffer(&range.buffer),
            Physical::Accel(_) | Physical::Unused => {}
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
