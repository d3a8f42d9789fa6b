//! Images with their places in the bindless set.
use super::device::{Garbage, lock};
use super::{Gpu, GpuError, format};
use crate::graph::{Extent, Format};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use magpie_shaders::{SampledImage, StorageImage};

/// What an image is for; copies are always possible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ImageUse {
    /// Shaders sample or load it.
    pub sampled: bool,
    /// Shaders store to it.
    pub storage: bool,
    /// It is a colour or depth attachment.
    pub attachment: bool,
}

/// A two-dimensional image. Freed when dropped, after the device is done with it.
pub struct Image {
    gpu: Gpu,
    pub(super) raw: vk::Image,
    pub(super) view: vk::ImageView,
    views: Vec<vk::ImageView>,
    sampled: Option<u32>,
    storage: Option<u32>,
    memory: Option<Allocation>,
    format: Format,
    extent: Extent,
    mips: u32,
    bytes: u64,
}

impl Image {
    /// Makes an image with undefined contents.
    ///
    /// # Errors
    /// [`GpuError::Limit`] for an edge beyond the device's or a full bindless set, [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        name: &str,
        format: Format,
        extent: Extent,
        mips: u32,
        usage: ImageUse,
    ) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let limit = gpu.report().limits.get("max_image_edge").copied().unwrap_or(4096);
        let edge = u64::from(extent.width.max(extent.height));
        if edge > limit || extent.width == 0 || extent.height == 0 {
            return Err(GpuError::Limit { what: format!("edge of image {name}"), wanted: edge, limit });
        }
        let mut flags = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        if usage.sampled {
            flags |= vk::ImageUsageFlags::SAMPLED;
        }
        if usage.storage {
            flags |= vk::ImageUsageFlags::STORAGE;
        }
        if usage.attachment {
            flags |= if format.is_depth() {
                vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT
            } else {
                vk::ImageUsageFlags::COLOR_ATTACHMENT
            };
        }
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format::vulkan(format))
            .extent(vk::Extent3D { width: extent.width, height: extent.height, depth: 1 })
            .mip_levels(mips)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(flags);
        // SAFETY: `info` is complete and within the limits checked above.
        let raw = unsafe { device.create_image(&info, None) }.map_err(GpuError::call("vkCreateImage"))?;
        // SAFETY: the image was just made.
        let requirements = unsafe { device.get_image_memory_requirements(raw) };
        let allocation = lock(&gpu.0.allocator).allocate(&AllocationCreateDesc {
            name,
            requirements,
            location: MemoryLocation::GpuOnly,
            linear: false,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        });
        let memory = match allocation {
            Ok(a) => a,
            Err(e) => {
                log::error!("{name}: {e}");
                // SAFETY: nothing uses the image yet.
                unsafe { device.destroy_image(raw, None) };
                return Err(GpuError::OutOfMemory { what: name.to_owned(), bytes: requirements.size });
            }
        };
        // SAFETY: the memory was allocated for this image and is bound once.
        let bound = unsafe { device.bind_image_memory(raw, memory.memory(), memory.offset()) };
        let mut made = Self {
            gpu: gpu.clone(),
            raw,
            view: vk::ImageView::null(),
            views: Vec::new(),
            sampled: None,
            storage: None,
            memory: Some(memory),
            format,
            extent,
            mips,
            bytes: requirements.size,
        };
        bound.map_err(GpuError::call("vkBindImageMemory"))?;
        made.view = made.make_view(mips)?;
        if usage.sampled {
            made.sampled = Some(gpu.0.bindless.add_sampled(device, made.view, !usage.storage && !usage.attachment)?);
        }
        if usage.storage {
            let view = if mips == 1 { made.view } else { made.make_view(1)? };
            made.storage = Some(gpu.0.bindless.add_storage(device, view)?);
        }
        gpu.name_object(raw, name);
        Ok(made)
    }

    fn make_view(&mut self, mips: u32) -> Result<vk::ImageView, GpuError> {
        let info = vk::ImageViewCreateInfo::default()
            .image(self.raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format::vulkan(self.format))
            .subresource_range(vk::ImageSubresourceRange {
                aspect_mask: format::aspect(self.format),
                level_count: mips,
                layer_count: 1,
                ..Default::default()
            });
        // SAFETY: the image is alive and has these mips.
        let view =
            unsafe { self.gpu.raw().create_image_view(&info, None) }.map_err(GpuError::call("vkCreateImageView"))?;
        self.views.push(view);
        Ok(view)
    }

    /// Its index for sampling, when it was made for that.
    pub fn sampled(&self) -> Option<SampledImage> {
        self.sampled.map(SampledImage)
    }

    /// Its index for storing, when it was made for that.
    pub fn storage(&self) -> Option<StorageImage> {
        self.storage.map(StorageImage)
    }

    /// Its format.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Width and height of mip 0.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// How many mips.
    pub fn mips(&self) -> u32 {
        self.mips
    }

    /// Bytes of memory behind it.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        if let Some(memory) = self.memory.take() {
            let views = std::mem::take(&mut self.views);
            let (image, sampled, storage) = (self.raw, self.sampled, self.storage);
            self.gpu.0.discard(Garbage::Image { image, views, sampled, storage, memory });
        }
    }
}
