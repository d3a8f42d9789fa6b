//! Device objects that outlive the frame: histories, kept buffers and kept images.

use std::{collections::HashMap, sync::Arc};

use super::super::{
    access::{Layout, Queue, Uses},
    declaration::{Declaration, ImportKey, Origin, Shape},
    desc::Part,
    history::{HistoryEntry, Persistence, SharedHistoryRegistry},
    plan::Plan,
    record::{BufferRange, Physical},
};
use crate::gpu::{
    self, BufferMemory, BufferUse, CommandEncoder, Gpu, GpuError, ImageBarrier, ImageInfo, ImageUse, Transition,
};
use crate::measure::PassTime;

/// By [`HistoryEntry::index`].
#[derive(Default)]
pub(super) struct PersistentResources(HashMap<u32, PersistentResource>);

struct PersistentResource {
    /// The entry that it belongs to; see [`HistoryEntry::generation`].
    generation: u64,
    shape: Shape,
    /// Both objects of a history; one for a kept buffer or image.
    objects: Vec<Physical>,
    /// Index in `objects` of the object that the frame reads; it writes the other one.
    previous: usize,
}

impl PersistentResources {
    /// The object behind an imported resource.
    pub fn object(&self, key: ImportKey) -> Option<Physical> {
        let (index, half) = match key {
            ImportKey::Caller(_) => return None,
            ImportKey::Previous(index) | ImportKey::Kept(index) => (index, 0),
            ImportKey::Next(index) => (index, 1),
        };
        let resource = self.0.get(&index)?;
        resource.objects.get((resource.previous + half) % resource.objects.len()).cloned()
    }

    /// Total size in bytes of device memory.
    pub fn bytes(&self) -> u64 {
        let bytes = |half: &Physical| match half {
            Physical::Image(image) => image.bytes(),
            Physical::Buffer(range) => range.buffer.bytes(),
            Physical::Accel(_) | Physical::Unused => 0,
        };
        self.0.values().flat_map(|resource| &resource.objects).map(bytes).sum()
    }

    /// Creates the objects that the frame declares, clears those that are not valid, and frees those that it does not declare.
    pub fn prepare(&mut self, gpu: &Gpu, histories: &SharedHistoryRegistry) -> Result<(), GpuError> {
        let registry = histories.lock();
        let mut declared: Vec<&HistoryEntry> = registry.declared().collect();
        if declared.is_empty() && self.0.is_empty() {
            return Ok(());
        }
        declared.sort_unstable_by_key(|e| e.index);
        self.forget(gpu, &declared)?;

        // Everything is created before anything is replaced: if memory runs out, kept buffers keep their contents.
        let mut made = Vec::new();
        for entry in &declared {
            if self.0.get(&entry.index).is_none_or(|held| held.shape != entry.shape) {
                made.push((*entry, PersistentResource::new(gpu, entry)?));
            }
        }
        let stale = |entry: &&&HistoryEntry| entry.persistence == Persistence::History && !entry.is_valid();
        let stale = declared.iter().filter(stale).filter_map(|entry| self.0.get(&entry.index));
        let stale: Vec<&PersistentResource> = stale.collect();
        if made.is_empty() && stale.is_empty() {
            return Ok(());
        }
        let mut work = CommandEncoder::new(gpu, Queue::Graphics)?;
        work.begin()?;
        for resource in stale {
            resource.clear(&mut work);
        }
        for (entry, resource) in &made {
            match self.0.get(&entry.index) {
                Some(smaller) => resource.copy_from(smaller, entry.valid_bytes, &mut work),
                None => resource.clear(&mut work),
            }
        }
        work.full_barrier();
        work.finish()?;
        let done = gpu.submit(Queue::Graphics, [&work], &[])?;
        gpu.wait(done)?;
        self.0.extend(made.into_iter().map(|(entry, resource)| (entry.index, resource)));
        Ok(())
    }

    /// Frees objects that are no longer declared, and histories of another size, before new memory is allocated.
    fn forget(&mut self, gpu: &Gpu, declared: &[&HistoryEntry]) -> Result<(), GpuError> {
        let before = self.0.len();
        self.0.retain(|index, held| {
            let Ok(at) = declared.binary_search_by_key(index, |e| e.index) else { return false };
            let entry = declared[at];
            held.generation == entry.generation
                && (held.shape == entry.shape || entry.persistence == Persistence::Buffer)
        });
        if self.0.len() == before { Ok(()) } else { gpu.wait_idle() }
    }

    /// Called after the frame was submitted: swaps the halves of the histories that it wrote.
    pub fn end_frame(&mut self, histories: &SharedHistoryRegistry, declaration: &Declaration, plan: &Plan) {
        let mut written = Vec::new();
        if !self.0.is_empty() {
            let uses = plan.order.iter().flat_map(|&pass| declaration.uses_of(pass));
            for u in uses.filter(|u| u.writes.is_some()) {
                let Origin::Imported { key, .. } = declaration.resources[u.resource as usize].origin else { continue };
                if let ImportKey::Next(index) | ImportKey::Kept(index) = key
                    && !written.contains(&index)
                {
                    written.push(index);
                }
            }
        }
        for index in &written {
            if let Some(resource) = self.0.get_mut(index) {
                resource.previous = (resource.previous + 1) % resource.objects.len();
            }
        }
        histories.lock().end_frame(|index| written.contains(&index));
    }

    /// Marks all kept images as stale if any pass met non-finite values: where one value was bad, others that no pass has read yet may
    /// have reached what is kept, and would stay there until what the image shows changes. `passes` is empty if nothing was measured.
    pub fn invalidate_non_finite(histories: &SharedHistoryRegistry, declaration: &Declaration, passes: &[PassTime]) {
        if passes.iter().all(|counted| counted.not_finite == 0) {
            return;
        }
        for resource in &declaration.resources {
            if let Origin::Imported { key: ImportKey::Kept(index), .. } = resource.origin {
                histories.lock().invalidate_layers(index);
            }
        }
    }
}

impl PersistentResource {
    fn new(gpu: &Gpu, entry: &HistoryEntry) -> Result<Self, GpuError> {
        let make = |half: &str| match entry.shape {
            Shape::Image { format, extent, mips, layers } => {
                let usage = ImageUse { sampled: true, storage: format.is_storable(), attachment: true };
                let info = ImageInfo { format, extent, mips, layers, usage, exclusive: false };
                let image = gpu::Image::with(gpu, &format!("history {} {half}", entry.index), info)?;
                Ok(Physical::Image(Arc::new(image)))
            }
            Shape::Buffer { bytes } | Shape::Accel { bytes, .. } => {
                let name = format!("kept {} {half}", entry.index);
                let bytes = bytes.next_multiple_of(4);
                let buffer = gpu::Buffer::new(gpu, &name, bytes, BufferMemory::Device, BufferUse::Any)?;
                Ok::<_, GpuError>(Physical::Buffer(BufferRange::whole(Arc::new(buffer))))
            }
        };
        let objects = match entry.persistence {
            Persistence::History => vec![make("a")?, make("b")?],
            Persistence::Buffer | Persistence::Layers => vec![make("")?],
        };
        Ok(Self { generation: entry.generation, shape: entry.shape, objects, previous: 0 })
    }

    /// Clears the half that the frame reads to zero, and puts it into the layout that the plan expects.
    fn clear(&self, work: &mut CommandEncoder) {
        match &self.objects[self.previous] {
            Physical::Image(image) => {
                let all = Part::ALL.of(image.mips(), image.layers());
                // The graph has no access for a clear, which Vulkan does not treat as a copy.
                let into = |layout_from, layout_to| {
                    let transition = Transition { from: Uses::ANY, to: Uses::ANY, layout_from, layout_to };
                    ImageBarrier::new(image, all, transition, None)
                };
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
        if let (Physical::Buffer(new), Physical::Buffer(old)) = (&self.objects[0], &old.objects[0]) {
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
