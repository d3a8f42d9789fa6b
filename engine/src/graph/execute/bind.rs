//! Binds the resources of a plan to device objects, and translates its barriers to Vulkan.
//!
//! There is one heap for each kind of memory, of the size that the plan asks for. Transient buffers and acceleration structures
//! are ranges of one buffer over the whole heap, so that making one is free. Images are placed in the heap, and reused while
//! plans put an image of the same shape at the same offset.

use std::sync::Arc;

use magpie_shaders::Address;
use rustc_hash::FxHashMap;

use super::{
    super::{
        access::{Access, Uses},
        declaration::{Declaration, ImportKey, Origin, Shape},
        desc::Part,
        plan::{Barrier, Footprint, Footprints, Plan, Role, Sharing, Transient},
        record::{AccelObject, BufferRange, Physical},
    },
    ExecuteError, Imports,
    cache::Entry,
    persistent::PersistentResources,
};
use crate::gpu::{self, Gpu, GpuError, Heap, ImageBarrier, ImageInfo, ImageUse, MemoryBarrier, Transition};

/// Number of frames in a row that a heap may be larger than needed before it shrinks.
const PATIENCE: u32 = 16;

/// Alignment of buffers in a heap, bytes: one cache line. Acceleration structures need more.
const BUFFER_ALIGN: u64 = 64;
const ACCEL_ALIGN: u64 = 256;

/// Memory and images of transients, reused from frame to frame.
pub(super) struct Pool {
    heaps: Vec<Held>,
    images: FxHashMap<Place, Pooled>,
    footprints: FxHashMap<ImageInfo, Footprint>,
    /// Counts changes of heaps and images: objects that were bound under another generation may be gone.
    generation: u64,
    frame: u64,
    buffer_kind: u8,
}

/// A heap and the buffer that spans it.
struct Held {
    kind: u8,
    heap: Arc<Heap>,
    buffer: Option<Arc<gpu::Buffer>>,
    /// Number of frames in a row that asked for less.
    too_large: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Place {
    info: ImageInfo,
    heap: u32,
    offset: u64,
}

struct Pooled {
    image: Arc<gpu::Image>,
    /// Number of the last frame that used it.
    used: u64,
}

/// The device objects and translated barriers of a plan.
pub(super) struct Bound {
    generation: u64,
    pub physical: Vec<Physical>,
    imports: Vec<(u32, ImportKey)>,
    /// Parts of images that need views of their own: resource, part, kind of view.
    parts: Vec<(u32, Part, Binding)>,
    /// Keys of the pooled images in use, so that these can be marked as recently used.
    places: Vec<Place>,
    pub barriers: Compiled,
}

impl Bound {
    /// Drops the references to imported objects. They are looked up again each frame, so that a cached plan does not keep them alive.
    pub fn release_imports(&mut self) {
        for &(resource, _) in &self.imports {
            self.physical[resource as usize] = Physical::Unused;
        }
    }

    /// Whether the memory that it is bound to still exists.
    pub fn is_of(&self, pool: &Pool) -> bool {
        self.generation == pool.generation
    }
}

/// The kind of view that a part of an image needs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Binding {
    Sampled,
    Storage,
    Attachment,
}

/// The barriers of a plan, translated to Vulkan.
#[derive(Default)]
pub(super) struct Compiled {
    memory: Vec<MemoryBarrier>,
    images: Vec<ImageBarrier>,
    /// For before and after each position, and for the end: the index of the first memory barrier and the first image barrier.
    stops: Vec<(u32, u32)>,
    /// Image barriers on imports, as (barrier, resource): their image is filled in each frame.
    patches: Vec<(u32, u32)>,
}

impl Compiled {
    /// The barriers before a position.
    pub fn before(&self, position: usize) -> (&[MemoryBarrier], &[ImageBarrier]) {
        self.at(2 * position)
    }

    /// The barriers after a position.
    pub fn after(&self, position: usize) -> (&[MemoryBarrier], &[ImageBarrier]) {
        self.at(2 * position + 1)
    }

    /// The barriers at the end of the frame.
    pub fn end(&self) -> (&[MemoryBarrier], &[ImageBarrier]) {
        self.at(self.stops.len() - 2)
    }

    /// Total number of barriers.
    pub fn count(&self) -> u32 {
        (self.memory.len() + self.images.len()) as u32
    }

    fn at(&self, stop: usize) -> (&[MemoryBarrier], &[ImageBarrier]) {
        let ((memory, image), (memory_end, image_end)) = (self.stops[stop], self.stops[stop + 1]);
        (&self.memory[memory as usize..memory_end as usize], &self.images[image as usize..image_end as usize])
    }
}

/// Answers the plan's questions about the device.
pub(super) struct Device<'a> {
    pub gpu: &'a Gpu,
    pool: &'a mut Pool,
}

impl<'a> Device<'a> {
    pub fn new(gpu: &'a Gpu, pool: &'a mut Pool) -> Self {
        Self { gpu, pool }
    }
}

impl Footprints for Device<'_> {
    fn footprint(&mut self, shape: Shape, uses: Uses, sharing: Sharing) -> Footprint {
        let kind = self.pool.buffer_kind;
        let buffer = |bytes: u64, align: u64| Footprint { bytes: bytes.next_multiple_of(align), align, kind };
        match shape {
            Shape::Buffer { bytes } => buffer(bytes, BUFFER_ALIGN),
            Shape::Accel { bytes, .. } => buffer(bytes, ACCEL_ALIGN),
            Shape::Image { .. } => {
                let Some(info) = image_info(shape, uses, sharing) else { return buffer(0, 1) };
                *self.pool.footprints.entry(info).or_insert_with(|| {
                    let (bytes, align, kind) = info.footprint(self.gpu);
                    Footprint { bytes, align, kind }
                })
            }
        }
    }

    fn granularity(&self) -> u64 {
        self.gpu.granularity()
    }
}

impl Pool {
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            heaps: Vec::new(),
            images: FxHashMap::default(),
            footprints: FxHashMap::default(),
            generation: 0,
            frame: 0,
            buffer_kind: gpu.buffer_kind(),
        }
    }

    /// Total size of the heaps, bytes.
    pub fn bytes(&self) -> u64 {
        self.heaps.iter().map(|h| h.heap.bytes()).sum()
    }

    /// Drops images that no recent frame used.
    pub fn end_frame(&mut self) {
        self.frame += 1;
        if self.frame.is_multiple_of(u64::from(PATIENCE)) {
            let oldest = self.frame.saturating_sub(u64::from(PATIENCE));
            let before = self.images.len();
            self.images.retain(|_, pooled| pooled.used >= oldest);
            if self.images.len() != before {
                self.generation += 1;
            }
        }
    }

    /// Binds every resource of a plan to an object. What an earlier frame bound is reused, except for imports.
    pub fn bind(
        &mut self,
        gpu: &Gpu,
        entry: &mut Entry,
        imports: &Imports,
        persistent: &PersistentResources,
    ) -> Result<(), ExecuteError> {
        self.fit_heaps(gpu, &entry.plan)?;
        if entry.bound.as_ref().is_none_or(|b| b.generation != self.generation) {
            entry.bound = Some(self.bind_transients(gpu, &entry.declaration, &entry.plan)?);
        }
        let Some(bound) = &mut entry.bound else { return Ok(()) };
        for place in &bound.places {
            if let Some(pooled) = self.images.get_mut(place) {
                pooled.used = self.frame;
            }
        }
        for &(resource, key) in &bound.imports {
            let object = match key {
                ImportKey::Caller(at) => imports.objects.get(at as usize).cloned(),
                ImportKey::Previous(_) | ImportKey::Next(_) | ImportKey::Kept(_) => persistent.object(key),
            };
            bound.physical[resource as usize] = object.unwrap_or(Physical::Unused);
        }
        for &(resource, part, binding) in &bound.parts {
            if let Physical::Image(image) = &bound.physical[resource as usize] {
                let failed = |source| ExecuteError::Pass { pass: entry.declaration.resource_name(resource), source };
                let prepared = match binding {
                    Binding::Sampled => image.prepare(part, false),
                    Binding::Storage => image.prepare(part, true),
                    Binding::Attachment => image.prepare_target(Part { mips: 1, layers: 1, ..part }),
                };
                prepared.map_err(failed)?;
            }
        }
        let Bound { physical, barriers, .. } = bound;
        for &(barrier, resource) in &barriers.patches {
            if let Physical::Image(image) = &physical[resource as usize] {
                barriers.images[barrier as usize].set_image(image);
            }
        }
        if barriers.stops.is_empty() {
            *barriers = compile(gpu, &entry.declaration, &entry.plan, physical);
        }
        Ok(())
    }

    /// Creates one heap for each kind of memory in the plan. Too small ones are replaced at once, too large ones after
    /// [`PATIENCE`] frames.
    fn fit_heaps(&mut self, gpu: &Gpu, plan: &Plan) -> Result<(), GpuError> {
        let wanted = |kind: u8| plan.heaps.iter().find(|h| h.kind == kind).map_or(0, |h| h.bytes);
        for held in &mut self.heaps {
            let less = wanted(held.kind) < held.heap.bytes();
            held.too_large = if less { held.too_large + 1 } else { 0 };
        }
        let before = self.heaps.len();
        self.heaps.retain(|held| {
            let bytes = wanted(held.kind);
            bytes <= held.heap.bytes() && held.too_large < PATIENCE
        });
        if self.heaps.len() != before {
            self.generation += 1;
            self.images.clear();
        }
        for heap in &plan.heaps {
            if heap.bytes > 0 && !self.heaps.iter().any(|h| h.kind == heap.kind) {
                let memory = Arc::new(Heap::new(gpu, "transients", heap.bytes, heap.kind)?);
                let buffer = (heap.kind == self.buffer_kind)
                    .then(|| gpu::Buffer::over(gpu, "transient buffers", &memory).map(Arc::new))
                    .transpose()?;
                self.heaps.push(Held { kind: heap.kind, heap: memory, buffer, too_large: 0 });
                self.generation += 1;
            }
        }
        Ok(())
    }

    fn bind_transients(&mut self, gpu: &Gpu, declaration: &Declaration, plan: &Plan) -> Result<Bound, ExecuteError> {
        let mut bound = Bound {
            generation: self.generation,
            physical: vec![Physical::Unused; declaration.resources.len()],
            imports: Vec::new(),
            parts: parts(declaration, plan),
            places: Vec::new(),
            barriers: Compiled::default(),
        };
        for (resource, decl) in (0..).zip(&declaration.resources) {
            if let Origin::Imported { key, .. } = decl.origin {
                bound.imports.push((resource, key));
            }
        }
        for transient in &plan.transients {
            let failed = |source| ExecuteError::Pass { pass: declaration.resource_name(transient.resource), source };
            let object = self.object(gpu, declaration, plan, transient, &mut bound.places).map_err(failed)?;
            bound.physical[transient.resource as usize] = object;
        }
        Ok(bound)
    }

    fn object(
        &mut self,
        gpu: &Gpu,
        declaration: &Declaration,
        plan: &Plan,
        transient: &Transient,
        places: &mut Vec<Place>,
    ) -> Result<Physical, GpuError> {
        let kind = plan.heaps[transient.heap as usize].kind;
        let Some(held) = self.heaps.iter().find(|h| h.kind == kind) else { return Ok(Physical::Unused) };
        let shape = declaration.resources[transient.resource as usize].shape;
        let offset = transient.offset;
        let Some(info) = image_info(shape, transient.uses, transient.sharing) else {
            let Some(buffer) = held.buffer.clone() else { return Ok(Physical::Unused) };
            let memory = BufferRange { buffer, offset, bytes: shape.bytes() };
            let Shape::Accel { bytes, top } = shape else { return Ok(Physical::Buffer(memory)) };
            // An acceleration structure that a shader writes is plain memory.
            let by_driver = transient.uses.iter().any(|(access, _)| matches!(access, Access::Build | Access::Refit));
            let made = || gpu::Accel::new(gpu, &memory.buffer, offset, bytes, top).map(Arc::new);
            let driver = by_driver.then(made).transpose()?;
            return Ok(Physical::Accel(AccelObject { memory, driver, root: Address::default() }));
        };
        let place = Place { info, heap: transient.heap, offset };
        if let Some(pooled) = self.images.get(&place) {
            places.push(place);
            return Ok(Physical::Image(pooled.image.clone()));
        }
        // Several resources may alias one image, so it is not named after any of them.
        let name = format!("transient {:?} {} at {offset}", info.format, info.extent);
        let image = Arc::new(gpu::Image::placed(gpu, &name, info, &held.heap, offset)?);
        self.images.insert(place, Pooled { image: image.clone(), used: self.frame });
        places.push(place);
        Ok(Physical::Image(image))
    }
}

/// Parts of images that kept passes use on their own.
fn parts(declaration: &Declaration, plan: &Plan) -> Vec<(u32, Part, Binding)> {
    let mut parts = Vec::new();
    for u in plan.order.iter().flat_map(|&pass| declaration.uses_of(pass)) {
        let (mips, layers) = declaration.resources[u.resource as usize].shape.parts();
        let binding = match u.access {
            Access::Sample => Binding::Sampled,
            access if is_storage(access) => Binding::Storage,
            access if access.is_attachment() => Binding::Attachment,
            _ => continue,
        };
        let one = (u.resource, u.part, binding);
        if u.part != Part::ALL.of(mips, layers) && !parts.contains(&one) {
            parts.push(one);
        }
    }
    parts
}

/// Whether a storage image is read or written.
pub(super) fn is_storage(access: Access) -> bool {
    matches!(access, Access::StorageRead | Access::StorageWrite | Access::StorageReadWrite)
}

/// Format, size and usage of the image behind a resource; `None` for anything but an image.
fn image_info(shape: Shape, uses: Uses, sharing: Sharing) -> Option<ImageInfo> {
    let Shape::Image { format, extent, mips, layers } = shape else { return None };
    let mut usage = ImageUse::default();
    for (access, _) in uses.iter() {
        usage.sampled |= access == Access::Sample;
        usage.attachment |= access.is_attachment();
        usage.storage |= is_storage(access);
    }
    let exclusive = sharing != Sharing::Concurrent;
    Some(ImageInfo { format, extent, mips, layers, usage, exclusive })
}

fn compile(gpu: &Gpu, declaration: &Declaration, plan: &Plan, physical: &[Physical]) -> Compiled {
    let mut compiled = Compiled { stops: Vec::with_capacity(2 * plan.order.len() + 2), ..Default::default() };
    compiled.memory.reserve(plan.barriers.len());
    for (before, after) in plan.before.iter().zip(&plan.after) {
        compiled.stop(gpu, declaration, &plan.barriers[before.range()], physical);
        compiled.stop(gpu, declaration, &plan.barriers[after.range()], physical);
    }
    compiled.stop(gpu, declaration, &plan.barriers[plan.end.range()], physical);
    compiled.stops.push((compiled.memory.len() as u32, compiled.images.len() as u32));
    compiled
}

impl Compiled {
    /// Adds a barrier, merged into one from index `first` on where possible.
    fn add_memory(&mut self, first: usize, new: MemoryBarrier) {
        if !self.memory[first..].iter_mut().any(|known| known.join(&new)) {
            self.memory.push(new);
        }
    }

    /// Translates the barriers of one place. Those that change neither layout nor ownership become global memory barriers.
    fn stop(&mut self, gpu: &Gpu, declaration: &Declaration, batch: &[Barrier], physical: &[Physical]) {
        let first = self.memory.len();
        self.stops.push((first as u32, self.images.len() as u32));
        for b in batch {
            let families = b.handover.map(|h| (gpu.family(h.from), gpu.family(h.to))).filter(|(from, to)| from != to);
            // Two queues of the plan may be one of the device. The release then changes the layout, and the acquire does nothing.
            let done = families.is_none() && b.handover.is_some_and(|h| h.role == Role::Acquire);
            let image = match &physical[b.resource as usize] {
                Physical::Image(image) if b.layout_from != b.layout_to || families.is_some() => image,
                Physical::Image(_) | Physical::Buffer(_) | Physical::Accel(_) => {
                    self.add_memory(first, MemoryBarrier::new(gpu, b.from, b.to));
                    continue;
                }
                Physical::Unused => continue,
            };
            if done {
                continue;
            }
            if !declaration.resources[b.resource as usize].is_transient() {
                self.patches.push((self.images.len() as u32, b.resource));
            }
            if b.discard && !b.from.is_empty() {
                // The memory belonged to another object, and an image barrier on the new image does not cover writes to that one.
                self.add_memory(first, MemoryBarrier::new(gpu, b.from, b.to));
            }
            let Barrier { from, to, layout_from, layout_to, .. } = *b;
            let transition = Transition { from, to, layout_from, layout_to };
            self.images.push(ImageBarrier::new(image, b.part, transition, families));
        }
    }
}
