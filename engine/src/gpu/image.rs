//! Images, with their indices in the bindless set.
use super::bindless::place;
use super::device::Garbage;
use super::heap::Heap;
use super::{Gpu, GpuError, Owner, access, format};
use crate::graph::{Access, Extent, Format, Layout, Part};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use magpie_shaders::{SampledImage, StorageImage};
use std::sync::{Arc, RwLock};

/// Usage of an image. Copies are always possible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ImageUse {
    /// Sampled or fetched by shaders.
    pub sampled: bool,
    /// Storage image.
    pub storage: bool,
    /// Colour or depth attachment.
    pub attachment: bool,
}

/// Everything needed to create an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct ImageInfo {
    pub format: Format,
    pub extent: Extent,
    pub mips: u32,
    pub layers: u32,
    pub usage: ImageUse,
    /// Exclusive sharing mode: one queue family owns it at a time. Otherwise all queues may use it concurrently.
    pub exclusive: bool,
}

/// A two-dimensional image or image array. It is freed after it is dropped and the device has finished using it.
pub struct Image {
    pub(super) gpu: Gpu,
    pub(super) raw: vk::Image,
    view: vk::ImageView,
    /// View of mip 0 of layer 0, for rendering.
    target: vk::ImageView,
    /// Views of other parts, for rendering.
    targets: RwLock<Vec<(Part, vk::ImageView)>>,
    sampled: Option<u32>,
    storage: Option<u32>,
    /// Bindless indices of its parts.
    parts: RwLock<Vec<PartPlace>>,
    views: RwLock<Vec<vk::ImageView>>,
    memory: Option<Allocation>,
    _heap: Option<Arc<Heap>>,
    /// Whether it is destroyed with its memory.
    is_own: bool,
    /// Kept until it is freed.
    owner: Option<Owner>,
    info: ImageInfo,
    bytes: u64,
}

/// Memory to bind to an image: an allocation of its own, or a place in a heap.
struct ImageMemory {
    raw: vk::DeviceMemory,
    /// Offset in `raw`, bytes.
    offset: u64,
    allocation: Option<Allocation>,
    heap: Option<Arc<Heap>>,
    /// Size, bytes.
    bytes: u64,
}

/// Mip 0 of layer 0.
const FIRST: Part = Part { mip: 0, mips: 1, layer: 0, layers: 1 };

/// Bindless index of a part of an image.
#[derive(Clone, Copy)]
struct PartPlace {
    part: Part,
    storage: bool,
    index: u32,
}

impl Image {
    /// An image with one layer and undefined contents, which every queue may use.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if a side is too long or the bindless set is full, [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        name: &str,
        format: Format,
        extent: Extent,
        mips: u32,
        usage: ImageUse,
    ) -> Result<Self, GpuError> {
        Self::with(gpu, name, ImageInfo { format, extent, mips, layers: 1, usage, exclusive: false })
    }

    /// An image with any properties.
    pub(crate) fn with(gpu: &Gpu, name: &str, info: ImageInfo) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let raw = info.create(gpu, name)?;
        // SAFETY: the image was just made.
        let requirements = unsafe { device.get_image_memory_requirements(raw) };
        let memory = gpu.allocate(name, requirements, MemoryLocation::GpuOnly, false).inspect_err(|_| {
            // SAFETY: nothing uses the image yet.
            unsafe { device.destroy_image(raw, None) };
        })?;
        // SAFETY: the memory lives as long as the image.
        let raw_memory = unsafe { memory.memory() };
        let (offset, bytes) = (memory.offset(), requirements.size);
        let memory = ImageMemory { raw: raw_memory, offset, allocation: Some(memory), heap: None, bytes };
        Self::bind(gpu, name, info, raw, memory)
    }

    /// An image in a heap. Objects that it aliases must no longer be in use.
    pub(crate) fn placed(
        gpu: &Gpu,
        name: &str,
        info: ImageInfo,
        heap: &Arc<Heap>,
        offset: u64,
    ) -> Result<Self, GpuError> {
        let raw = info.create(gpu, name)?;
        let bytes = info.footprint(gpu).0;
        let (raw_memory, offset) = heap.place(offset);
        let memory = ImageMemory { raw: raw_memory, offset, allocation: None, heap: Some(heap.clone()), bytes };
        Self::bind(gpu, name, info, raw, memory)
    }

    /// An image of the application, which made it with `info`. It is not destroyed here. What a frame leaves in it has the layout
    /// [`Image::layout_after`].
    ///
    /// It has two dimensions, one sample, optimal tiling, one of the graph's formats, and a usage with `TRANSFER_SRC` and `TRANSFER_DST`; the
    /// rest of its usage says what else frames can do with it.
    ///
    /// # Safety
    /// - `raw` was made from `info` on the device of `gpu`, and has memory.
    /// - It lives until Magpie is done with it: `owner` is dropped then. Without an owner, that is when the image was dropped, all frames that use
    ///   it were finished, and [`Gpu::wait_idle`] was called.
    /// - Nobody else uses it while a frame that imports it runs. A frame begins after the semaphores of
    ///   [`Imports::wait_for`](crate::graph::execute::Imports::wait_for), and is done when the ticket's semaphore value is reached.
    /// - If it is exclusive to a queue family, that is the family of Magpie's graphics queue ([`Gpu::family`]), and only passes on that queue use it.
    ///
    /// # Errors
    /// [`GpuError::Unsuited`] with a sentence for each thing that is not so, [`GpuError::Limit`] if the bindless set is full.
    pub unsafe fn adopt(
        gpu: &Gpu,
        name: &str,
        raw: vk::Image,
        info: &vk::ImageCreateInfo<'_>,
        owner: Option<Owner>,
    ) -> Result<Self, GpuError> {
        let unsuited = |lacks| GpuError::Unsuited { what: format!("the image {name}"), lacks };
        let info = ImageInfo::of(info).map_err(unsuited)?;
        // SAFETY: by this function's contract.
        let bytes = unsafe { gpu.raw().get_image_memory_requirements(raw) }.size;
        let memory = ImageMemory { raw: vk::DeviceMemory::null(), offset: 0, allocation: None, heap: None, bytes };
        let mut made = Self::without_views(gpu, info, raw, memory);
        (made.is_own, made.owner) = (false, owner);
        made.with_views(name)
    }

    fn bind(gpu: &Gpu, name: &str, info: ImageInfo, raw: vk::Image, memory: ImageMemory) -> Result<Self, GpuError> {
        // SAFETY: the memory was made for such images and is bound once.
        let bound = unsafe { gpu.raw().bind_image_memory(raw, memory.raw, memory.offset) };
        let made = Self::without_views(gpu, info, raw, memory);
        bound.map_err(GpuError::call("vkBindImageMemory"))?;
        made.with_views(name)
    }

    fn without_views(gpu: &Gpu, info: ImageInfo, raw: vk::Image, memory: ImageMemory) -> Self {
        Self {
            gpu: gpu.clone(),
            raw,
            view: vk::ImageView::null(),
            target: vk::ImageView::null(),
            targets: RwLock::default(),
            sampled: None,
            storage: None,
            parts: RwLock::default(),
            views: RwLock::default(),
            memory: memory.allocation,
            _heap: memory.heap,
            is_own: true,
            owner: None,
            info,
            bytes: memory.bytes,
        }
    }

    /// Adds the views and bindless indices that its usage asks for.
    fn with_views(mut self, name: &str) -> Result<Self, GpuError> {
        let info = self.info;
        let gpu = self.gpu.clone();
        let (device, bindless) = (gpu.raw(), &gpu.0.bindless);
        let whole = Part::ALL.of(info.mips, info.layers);
        let ImageUse { sampled, storage, attachment } = info.usage;
        // An image that is only copied cannot have views.
        if sampled || storage || attachment {
            self.view = self.make_view(whole)?;
            self.target = if whole == FIRST || !attachment { self.view } else { self.make_view(FIRST)? };
        }
        if sampled {
            let (layout, texture) = (self.read_layout(), !storage && !attachment);
            self.sampled = Some(bindless.add_sampled(device, self.view, layout, texture)?);
        }
        if storage {
            let view = if info.mips == 1 { self.view } else { self.make_view(Part { mips: 1, ..whole })? };
            self.storage = Some(bindless.add_storage(device, view)?);
        }
        gpu.name_object(self.raw, name);
        Ok(self)
    }

    fn make_view(&self, part: Part) -> Result<vk::ImageView, GpuError> {
        let kind = if part.layers > 1 { vk::ImageViewType::TYPE_2D_ARRAY } else { vk::ImageViewType::TYPE_2D };
        let info = vk::ImageViewCreateInfo::default()
            .image(self.raw)
            .view_type(kind)
            .format(format::vulkan(self.info.format))
            .subresource_range(self.range(part));
        // SAFETY: the image is alive and has these mips and layers.
        let view =
            unsafe { self.gpu.raw().create_image_view(&info, None) }.map_err(GpuError::call("vkCreateImageView"))?;
        self.views.write().unwrap_or_else(std::sync::PoisonError::into_inner).push(view);
        Ok(view)
    }

    /// The layout in which it is sampled.
    fn read_layout(&self) -> vk::ImageLayout {
        access::layout(Layout::ReadOnly, self.info.format)
    }

    /// The Vulkan layout of the image after a frame that left it for this access ([`FrameGraph::leave`](crate::graph::FrameGraph::leave)).
    pub fn layout_after(&self, access: Access) -> vk::ImageLayout {
        access::layout(access.layout(), self.info.format)
    }

    /// The subresource range of a part.
    pub(super) fn range(&self, part: Part) -> vk::ImageSubresourceRange {
        vk::ImageSubresourceRange {
            aspect_mask: format::aspect(self.info.format),
            base_mip_level: part.mip.into(),
            level_count: part.mips.into(),
            base_array_layer: part.layer.into(),
            layer_count: part.layers.into(),
        }
    }

    /// Creates a view and a bindless index for a part, unless it has them or the whole image's will do.
    pub(crate) fn prepare(&self, part: Part, storage: bool) -> Result<(), GpuError> {
        if self.is_whole(part, storage) || self.part_place(part, storage).is_some() {
            return Ok(());
        }
        let view = self.make_view(if storage { Part { mips: 1, ..part } } else { part })?;
        let (bindless, device) = (&self.gpu.0.bindless, self.gpu.raw());
        let index = if storage {
            bindless.add_storage(device, view)?
        } else {
            bindless.add_sampled(device, view, self.read_layout(), false)?
        };
        let place = PartPlace { part, storage, index };
        self.parts.write().unwrap_or_else(std::sync::PoisonError::into_inner).push(place);
        Ok(())
    }

    /// Creates a view to render to a part, which must be one mip of one layer.
    pub(crate) fn prepare_target(&self, part: Part) -> Result<(), GpuError> {
        if part == FIRST || self.other_target(part).is_some() {
            return Ok(());
        }
        let view = self.make_view(part)?;
        self.targets.write().unwrap_or_else(std::sync::PoisonError::into_inner).push((part, view));
        Ok(())
    }

    fn other_target(&self, part: Part) -> Option<vk::ImageView> {
        let targets = self.targets.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        targets.iter().find(|(known, _)| *known == part).map(|(_, view)| *view)
    }

    /// The view to render to a part. It must be prepared, except for mip 0 of layer 0.
    pub(super) fn target_part(&self, part: Part) -> vk::ImageView {
        self.other_target(part).unwrap_or(self.target)
    }

    fn is_whole(&self, part: Part, storage: bool) -> bool {
        let all = Part::ALL.of(self.info.mips, self.info.layers);
        part == all || (storage && Part { mips: all.mips, ..part } == all)
    }

    fn part_place(&self, part: Part, storage: bool) -> Option<u32> {
        let parts = self.parts.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        parts.iter().find(|p| p.part == part && p.storage == storage).map(|p| p.index)
    }

    /// Bindless index of a part for sampling; `None` before it is prepared.
    pub(crate) fn sampled_part(&self, part: Part) -> Option<SampledImage> {
        let own = if self.is_whole(part, false) { self.sampled } else { self.part_place(part, false) };
        own.map(place)
    }

    /// Bindless index of a part's first mip as a storage image; `None` before it is prepared.
    pub(crate) fn storage_part(&self, part: Part) -> Option<StorageImage> {
        let own = if self.is_whole(part, true) { self.storage } else { self.part_place(part, true) };
        own.map(place)
    }

    /// Bindless index for sampling; `None` without sampled usage.
    pub fn sampled(&self) -> Option<SampledImage> {
        self.sampled.map(place)
    }

    /// Bindless index as a storage image; `None` without storage usage.
    pub fn storage(&self) -> Option<StorageImage> {
        self.storage.map(place)
    }

    /// Its format.
    pub fn format(&self) -> Format {
        self.info.format
    }

    /// Size of mip 0, pixels.
    pub fn extent(&self) -> Extent {
        self.info.extent
    }

    /// Number of mips.
    pub fn mips(&self) -> u32 {
        self.info.mips
    }

    /// Number of layers.
    pub fn layers(&self) -> u32 {
        self.info.layers
    }

    /// Size of its memory, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl ImageInfo {
    /// The image that an application makes with this info, or why Magpie cannot use it, one sentence each.
    fn of(info: &vk::ImageCreateInfo<'_>) -> Result<Self, Vec<String>> {
        let mut lacks = Vec::new();
        let mut want = |holds: bool, sentence: String| {
            if !holds {
                lacks.push(sentence);
            }
        };
        let usage = info.usage;
        let copies = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        let format = Format::ALL.into_iter().find(|format| format::vulkan(*format) == info.format);
        want(format.is_some(), format!("{:?} is not a format of the graph", info.format));
        want(usage.contains(copies), format!("its usage lacks {:?}", copies & !usage));
        want(
            info.image_type == vk::ImageType::TYPE_2D && info.extent.depth == 1,
            format!("it is of {:?} with a depth of {}, not of two dimensions", info.image_type, info.extent.depth),
        );
        want(info.samples == vk::SampleCountFlags::TYPE_1, format!("it has {:?} samples, not one", info.samples));
        want(info.tiling == vk::ImageTiling::OPTIMAL, format!("its tiling is {:?}, not OPTIMAL", info.tiling));
        let (Some(format), true) = (format, lacks.is_empty()) else { return Err(lacks) };
        let attachment = if format.is_depth() {
            vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT
        } else {
            vk::ImageUsageFlags::COLOR_ATTACHMENT
        };
        Ok(Self {
            format,
            extent: Extent::new(info.extent.width, info.extent.height),
            mips: info.mip_levels,
            layers: info.array_layers,
            usage: ImageUse {
                sampled: usage.contains(vk::ImageUsageFlags::SAMPLED),
                storage: usage.contains(vk::ImageUsageFlags::STORAGE),
                attachment: usage.contains(attachment),
            },
            exclusive: info.sharing_mode == vk::SharingMode::EXCLUSIVE,
        })
    }

    fn vulkan(&self) -> vk::ImageCreateInfo<'static> {
        let ImageUse { sampled, storage, attachment } = self.usage;
        let mut flags = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        if sampled {
            flags |= vk::ImageUsageFlags::SAMPLED;
        }
        if storage {
            flags |= vk::ImageUsageFlags::STORAGE;
        }
        if attachment {
            flags |= if self.format.is_depth() {
                vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT
            } else {
                vk::ImageUsageFlags::COLOR_ATTACHMENT
            };
        }
        vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format::vulkan(self.format))
            .extent(vk::Extent3D { width: self.extent.width, height: self.extent.height, depth: 1 })
            .mip_levels(self.mips)
            .array_layers(self.layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(flags)
    }

    fn shared<'a>(&self, info: vk::ImageCreateInfo<'a>, gpu: &'a Gpu) -> vk::ImageCreateInfo<'a> {
        if self.exclusive || gpu.0.families.len() == 1 {
            info
        } else {
            info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(&gpu.0.families)
        }
    }

    fn create(&self, gpu: &Gpu, name: &str) -> Result<vk::Image, GpuError> {
        let limit = gpu.report().limits.get("max_image_edge").copied().unwrap_or(4096);
        let edge = u64::from(self.extent.width.max(self.extent.height));
        if edge > limit || self.extent.width == 0 || self.extent.height == 0 {
            return Err(GpuError::Limit { what: format!("edge of image {name}"), wanted: edge, limit });
        }
        let info = self.shared(self.vulkan(), gpu);
        // SAFETY: `info` is complete and within the limits checked above.
        unsafe { gpu.raw().create_image(&info, None) }.map_err(GpuError::call("vkCreateImage"))
    }

    /// Size and alignment of its memory in bytes, and its memory type.
    pub fn footprint(&self, gpu: &Gpu) -> (u64, u64, u8) {
        let info = self.shared(self.vulkan(), gpu);
        let question = vk::DeviceImageMemoryRequirements::default().create_info(&info);
        let mut answer = vk::MemoryRequirements2::default();
        // SAFETY: core in Vulkan 1.3 with maintenance4, which the floor asks for.
        unsafe { gpu.raw().get_device_image_memory_requirements(&question, &mut answer) };
        let found = answer.memory_requirements;
        (found.size, found.alignment, gpu.memory_kind(found.memory_type_bits))
    }
}

impl Image {
    /// Takes its handles and memory, so that the device itself can hold and free them.
    pub(super) fn into_parts(mut self) -> Garbage {
        self.parts()
    }

    fn parts(&mut self) -> Garbage {
        let poisoned = std::sync::PoisonError::into_inner;
        let views = std::mem::take(self.views.get_mut().unwrap_or_else(poisoned));
        let parts = std::mem::take(self.parts.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner));
        let places = |storage: bool, whole: Option<u32>| {
            let own = parts.iter().filter(|p| p.storage == storage).map(|p| p.index);
            own.chain(whole).collect::<Vec<u32>>()
        };
        let (sampled, storage) = (places(false, self.sampled), places(true, self.storage));
        let (raw, memory, owner) = (std::mem::take(&mut self.raw), self.memory.take(), self.owner.take());
        let image = if self.is_own { raw } else { vk::Image::null() };
        Garbage::Image { image, views, sampled, storage, memory, owner }
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        // Nothing is left after `into_parts`.
        if self.raw != vk::Image::null() {
            let parts = self.parts();
            self.gpu.0.discard(parts);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_of_the_application_is_described_by_what_it_was_made_with() {
        let usage = ImageUse { storage: true, attachment: true, ..ImageUse::default() };
        let (extent, exclusive) = (Extent::new(64, 36), true);
        for format in Format::ALL {
            let info = ImageInfo { format, extent, mips: 3, layers: 2, usage, exclusive };
            assert_eq!(ImageInfo::of(&info.vulkan()), Ok(info));
        }
    }

    #[test]
    fn each_thing_that_an_image_of_the_application_lacks_is_a_sentence() {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_3D)
            .format(vk::Format::B8G8R8A8_UNORM)
            .extent(vk::Extent3D { width: 8, height: 8, depth: 4 })
            .samples(vk::SampleCountFlags::TYPE_4)
            .tiling(vk::ImageTiling::LINEAR)
            .usage(vk::ImageUsageFlags::TRANSFER_SRC);
        let lacks = ImageInfo::of(&info).err().unwrap_or_default();
        let wanted = ["B8G8R8A8_UNORM", "TRANSFER_DST", "TYPE_3D", "TYPE_4", "LINEAR"];
        assert_eq!(lacks.len(), wanted.len(), "{lacks:?}");
        for (sentence, word) in lacks.iter().zip(wanted) {
            assert!(sentence.contains(word), "{sentence:?} does not name {word}");
        }
    }
}
