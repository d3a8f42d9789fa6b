//! Command recording. Its methods are safe to call, but only the graph's execution does so, in an order that the plan has checked.
use super::access::{self, Scope};
use super::pass_set::PassSet;
use super::pipeline::PUSH_BYTES;
use super::query::{Counting, Work};
use super::ray_pipeline::RAY_PUSH_BYTES;
use super::{Buffer, Gpu, GpuError, Image, Kernel, RasterKernel, format};
use crate::graph::{Extent, Layout, Part, Queue, Uses};
use ash::vk;
use std::ffi::{CStr, CString};

/// A command pool with one command buffer, which can be recorded again once the device has finished it.
pub(crate) struct CommandEncoder {
    gpu: Gpu,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
    /// Whether its queue family supports compute.
    computes: bool,
    /// Whether its queue family supports graphics.
    draws: bool,
    /// Currently bound pipelines: compute, graphics, ray tracing.
    bound: [Option<u32>; 3],
    pub(super) counting: Option<Counting>,
}

/// Waits for some uses, and makes their writes visible to others, without naming a resource.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct MemoryBarrier(vk::MemoryBarrier2<'static>);

/// Waits for some uses of a part of an image, makes their writes visible to others, and may change its layout.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct ImageBarrier(vk::ImageMemoryBarrier2<'static>);

// SAFETY: neither points to anything: `p_next` is null.
unsafe impl Send for MemoryBarrier {}
// SAFETY: as above.
unsafe impl Sync for MemoryBarrier {}
// SAFETY: as above.
unsafe impl Send for ImageBarrier {}
// SAFETY: as above.
unsafe impl Sync for ImageBarrier {}

impl MemoryBarrier {
    pub fn new(gpu: &Gpu, from: Uses, to: Uses) -> Self {
        let (from, to) = (gpu.fit(Scope::before(from)), gpu.fit(Scope::after(to)));
        Self(
            vk::MemoryBarrier2::default()
                .src_stage_mask(from.stages)
                .src_access_mask(from.access)
                .dst_stage_mask(to.stages)
                .dst_access_mask(to.access),
        )
    }

    /// Merges `other` into this barrier if both have the same stages on both sides, or if they differ on only one side. Returns
    /// whether it did; the merged barrier does what both do.
    pub fn join(&mut self, other: &Self) -> bool {
        let (a, b) = (&mut self.0, &other.0);
        let same_from = (a.src_stage_mask, a.src_access_mask) == (b.src_stage_mask, b.src_access_mask);
        let same_to = (a.dst_stage_mask, a.dst_access_mask) == (b.dst_stage_mask, b.dst_access_mask);
        let same_stages = (a.src_stage_mask, a.dst_stage_mask) == (b.src_stage_mask, b.dst_stage_mask);
        let joins = same_from || same_to || same_stages;
        if joins {
            a.src_stage_mask |= b.src_stage_mask;
            a.src_access_mask |= b.src_access_mask;
            a.dst_stage_mask |= b.dst_stage_mask;
            a.dst_access_mask |= b.dst_access_mask;
        }
        joins
    }
}

/// What an image was used for and will be used for, and its layouts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Transition {
    pub from: Uses,
    pub to: Uses,
    pub layout_from: Layout,
    pub layout_to: Layout,
}

impl ImageBarrier {
    /// `families` are the releasing and the acquiring queue family of an ownership transfer.
    pub fn new(image: &Image, part: Part, transition: Transition, families: Option<(u32, u32)>) -> Self {
        let (gpu, Transition { from, to, layout_from, layout_to }) = (&image.gpu, transition);
        let (from, to) = (gpu.fit(Scope::before(from)), gpu.fit(Scope::after(to)));
        let (family_from, family_to) = families.unwrap_or((vk::QUEUE_FAMILY_IGNORED, vk::QUEUE_FAMILY_IGNORED));
        Self(
            vk::ImageMemoryBarrier2::default()
                .src_stage_mask(from.stages)
                .src_access_mask(from.access)
                .dst_stage_mask(to.stages)
                .dst_access_mask(to.access)
                .old_layout(access::layout(layout_from, image.format()))
                .new_layout(access::layout(layout_to, image.format()))
                .src_queue_family_index(family_from)
                .dst_queue_family_index(family_to)
                .image(image.raw)
                .subresource_range(image.range(part)),
        )
    }

    /// Replaces the image by one with the same format, mips and layers.
    pub fn set_image(&mut self, image: &Image) {
        self.0.image = image.raw;
    }
}

/// Which faces are culled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cull {
    /// No faces.
    None,
    /// Back faces. Front faces wind counter-clockwise as seen from outside.
    Back,
    /// Back faces of an instance whose transform mirrors: front faces wind clockwise.
    BackMirrored,
}

/// One indexed draw of one instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrawRange {
    pub first_index: u32,
    pub index_count: u32,
    pub instance: u32,
    pub cull: Cull,
}

/// Several indirect draws that cull the same faces, with five words each in a buffer.
#[derive(Clone, Copy)]
pub(crate) struct DrawsAt<'a> {
    pub words: BufferAt<'a>,
    pub count: u32,
    pub cull: Cull,
}

/// A place in a buffer, `offset` bytes from its start.
#[derive(Clone, Copy)]
pub(crate) struct BufferAt<'a> {
    pub buffer: &'a Buffer,
    pub offset: u64,
}

/// A part of an image in a buffer, with tightly packed rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImageRegion {
    pub buffer_offset: u64,
    pub mip: u32,
    pub extent: Extent,
}

impl CommandEncoder {
    /// An encoder for a queue.
    pub fn new(gpu: &Gpu, queue: Queue) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(gpu.family(queue))
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: the family exists on this device.
        let pool = unsafe { device.create_command_pool(&info, None) }.map_err(GpuError::call("vkCreateCommandPool"))?;
        let computes = queue != Queue::Transfer || gpu.family(queue) == gpu.family(Queue::Graphics);
        let draws = queue == Queue::Graphics;
        let mut made = Self {
            gpu: gpu.clone(),
            pool,
            buffer: vk::CommandBuffer::null(),
            computes,
            draws,
            bound: [None; 3],
            counting: None,
        };
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        // SAFETY: the pool was just made.
        let buffers = unsafe { made.gpu.raw().allocate_command_buffers(&info) }
            .map_err(GpuError::call("vkAllocateCommandBuffers"))?;
        made.buffer = buffers[0];
        Ok(made)
    }

    pub(super) fn raw(&self) -> vk::CommandBuffer {
        self.buffer
    }

    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Name of a pipeline, by its index.
    pub fn pipeline_name(&self, index: u32) -> String {
        self.gpu.0.pipelines.name(index)
    }

    /// Starts recording again. The device must have finished the previous submission.
    pub fn begin(&mut self) -> Result<(), GpuError> {
        let device = self.gpu.raw();
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the caller waited for the last submission of this encoder.
        unsafe {
            device
                .reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(GpuError::call("vkResetCommandPool"))?;
            device.begin_command_buffer(self.buffer, &info).map_err(GpuError::call("vkBeginCommandBuffer"))?;
        }
        self.bound = [None; 3];
        self.counting = None;
        self.bind(self.gpu.0.bindless.set);
        Ok(())
    }

    /// Binds this set in place of the whole bindless set for all following commands.
    pub fn bind_pass_set(&mut self, set: &PassSet) {
        self.bind(set.raw());
    }

    fn bind(&mut self, set: vk::DescriptorSet) {
        let (device, layout) = (self.gpu.raw(), self.gpu.0.pipeline_layout);
        let points = [
            (vk::PipelineBindPoint::COMPUTE, self.computes),
            (vk::PipelineBindPoint::GRAPHICS, self.draws),
            (vk::PipelineBindPoint::RAY_TRACING_KHR, self.computes && self.gpu.0.ray_support.pipeline),
        ];
        for (point, _) in points.into_iter().filter(|(_, can)| *can) {
            // SAFETY: the command buffer is recording; layout and set live until the device is done with it.
            unsafe { device.cmd_bind_descriptor_sets(self.buffer, point, layout, 0, &[set], &[]) };
        }
    }

    pub fn finish(&mut self) -> Result<(), GpuError> {
        // SAFETY: the command buffer is recording.
        unsafe { self.gpu.raw().end_command_buffer(self.buffer) }.map_err(GpuError::call("vkEndCommandBuffer"))
    }

    /// Records barriers in one call. A house rule allows only `graph/execute/` to call this.
    pub fn barriers(&mut self, memory: &[MemoryBarrier], images: &[ImageBarrier]) {
        // SAFETY: both are transparent wrappers of the structs that Vulkan takes.
        let (memory, images) = unsafe {
            (
                std::slice::from_raw_parts(memory.as_ptr().cast::<vk::MemoryBarrier2<'_>>(), memory.len()),
                std::slice::from_raw_parts(images.as_ptr().cast::<vk::ImageMemoryBarrier2<'_>>(), images.len()),
            )
        };
        let info = vk::DependencyInfo::default().memory_barriers(memory).image_memory_barriers(images);
        self.depend(&info);
    }

    /// Records barriers of Vulkan's own kind, for what lies outside of the graph: the display, and the layer's own images.
    pub(super) fn depend(&self, barriers: &vk::DependencyInfo<'_>) {
        // SAFETY: the command buffer is recording, outside of rendering; what the barriers name is alive.
        unsafe { self.gpu.raw().cmd_pipeline_barrier2(self.buffer, barriers) };
    }

    /// An empty barrier, which makes drivers that defer work start it.
    pub(super) fn flush(&mut self) {
        self.depend(&vk::DependencyInfo::default());
    }

    /// Changes the layout of an image of the device's own with one mip, after everything before it is done.
    pub(super) fn settle(&mut self, image: &Image, from: vk::ImageLayout, to: vk::ImageLayout) {
        let everything = Scope::EVERYTHING;
        let barrier = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(everything.stages)
            .src_access_mask(everything.available().access)
            .dst_stage_mask(everything.stages)
            .dst_access_mask(everything.access)
            .old_layout(from)
            .new_layout(to)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image.raw)
            .subresource_range(image.range(Part::ALL.of(1, 1)))];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barrier);
        self.depend(&info);
    }

    /// Makes everything before it visible to everything after it, the host included. The same house rule as for
    /// [`Self::barriers`] applies.
    pub fn full_barrier(&mut self) {
        let (from, to) = (Scope::EVERYTHING.available(), Scope::EVERYTHING);
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(from.stages)
            .src_access_mask(from.access)
            .dst_stage_mask(to.stages | vk::PipelineStageFlags2::HOST)
            .dst_access_mask(to.access | vk::AccessFlags2::HOST_READ)];
        let info = vk::DependencyInfo::default().memory_barriers(&barrier);
        self.depend(&info);
    }

    /// Sets push constants. The caller has checked their size against the pipeline and the limit.
    fn push(&mut self, params: &[u8]) {
        debug_assert!(params.len() <= PUSH_BYTES as usize);
        let layout = self.gpu.0.pipeline_layout;
        if !params.is_empty() {
            // SAFETY: the layout has 128 bytes for all stages, to which `Record::fits` holds every pass.
            unsafe { self.gpu.raw().cmd_push_constants(self.buffer, layout, vk::ShaderStageFlags::ALL, 0, params) };
        }
    }

    /// Sets the parameters of a ray pass, and the address of the scene's tables in the last eight bytes, for hit shaders.
    pub(super) fn push_rays(&mut self, params: &[u8], scene: magpie_shaders::Address) {
        const ROOT: u32 = RAY_PUSH_BYTES;
        self.push(params);
        let (layout, root) = (self.gpu.0.pipeline_layout, bytemuck::bytes_of(&scene));
        // SAFETY: the layout has 128 bytes for all stages.
        unsafe { self.gpu.raw().cmd_push_constants(self.buffer, layout, vk::ShaderStageFlags::ALL, ROOT, root) };
    }

    /// Binds a pipeline, which [`Gpu::make_pipeline`] has made, unless it is bound already.
    pub(super) fn bind_pipeline(&mut self, index: u32, point: vk::PipelineBindPoint) {
        let bound = &mut self.bound[match point {
            vk::PipelineBindPoint::GRAPHICS => 1,
            vk::PipelineBindPoint::RAY_TRACING_KHR => 2,
            _ => 0,
        }];
        if bound.replace(index) != Some(index) {
            let pipeline = self.gpu.0.pipelines.get(index);
            // SAFETY: the command buffer is recording; pipelines live as long as the device.
            unsafe { self.gpu.raw().cmd_bind_pipeline(self.buffer, point, pipeline) };
        }
    }

    fn begin_dispatch(&mut self, kernel: Kernel, params: &[u8]) {
        self.bind_pipeline(kernel.index, vk::PipelineBindPoint::COMPUTE);
        self.push(params);
        self.count(Work::Dispatch);
    }

    pub fn dispatch(&mut self, kernel: Kernel, params: &[u8], groups: [u32; 3]) {
        self.begin_dispatch(kernel, params);
        // SAFETY: the command buffer is recording outside of rendering, with pipeline and bindless set bound.
        unsafe { self.gpu.raw().cmd_dispatch(self.buffer, groups[0], groups[1], groups[2]) };
    }

    /// Dispatches the number of workgroups that three words of a buffer at `offset` say; any of them may be zero.
    pub fn dispatch_indirect(&mut self, kernel: Kernel, params: &[u8], groups: &Buffer, offset: u64) {
        self.begin_dispatch(kernel, params);
        // SAFETY: the command buffer is recording outside of rendering, with pipeline and bindless set bound; the caller keeps the
        // words inside of the buffer.
        unsafe { self.gpu.raw().cmd_dispatch_indirect(self.buffer, groups.raw, offset) };
    }

    /// Issues indirect draws.
    pub fn draw_indirect(&mut self, kernel: RasterKernel, params: &[u8], indices: BufferAt<'_>, draws: DrawsAt<'_>) {
        let DrawsAt { words: BufferAt { buffer, offset }, count, cull } = draws;
        self.begin_draws(kernel, params, indices);
        self.set_cull(cull);
        let (device, stride) = (self.gpu.raw(), size_of::<vk::DrawIndexedIndirectCommand>() as u32);
        let several = self.gpu.0.multi_draw_indirect;
        // SAFETY: the command buffer is recording inside of rendering; the caller keeps the words inside of the buffer, and more
        // than one draw at a time is asked for only where the device has it.
        unsafe {
            if several {
                device.cmd_draw_indexed_indirect(self.buffer, buffer.raw, offset, count, stride);
            } else {
                for i in 0..count {
                    let at = offset + u64::from(i * stride);
                    device.cmd_draw_indexed_indirect(self.buffer, buffer.raw, at, 1, stride);
                }
            }
        }
    }

    fn begin_draws(&mut self, kernel: RasterKernel, params: &[u8], indices: BufferAt<'_>) {
        self.bind_pipeline(kernel.index, vk::PipelineBindPoint::GRAPHICS);
        self.push(params);
        let (device, raw, kind) = (self.gpu.raw(), indices.buffer.raw, vk::IndexType::UINT32);
        // SAFETY: the command buffer is recording inside of rendering, with the bindless set bound.
        unsafe { device.cmd_bind_index_buffer(self.buffer, raw, indices.offset, kind) };
        self.count(Work::Draw);
    }

    fn set_cull(&mut self, cull: Cull) {
        let (mode, front) = match cull {
            Cull::None => (vk::CullModeFlags::NONE, vk::FrontFace::COUNTER_CLOCKWISE),
            Cull::Back => (vk::CullModeFlags::BACK, vk::FrontFace::COUNTER_CLOCKWISE),
            Cull::BackMirrored => (vk::CullModeFlags::BACK, vk::FrontFace::CLOCKWISE),
        };
        // SAFETY: the command buffer is recording; both states are dynamic in every graphics pipeline.
        unsafe {
            self.gpu.raw().cmd_set_cull_mode(self.buffer, mode);
            self.gpu.raw().cmd_set_front_face(self.buffer, front);
        }
    }

    /// Draws ranges of the index buffer.
    pub fn draw(&mut self, kernel: RasterKernel, params: &[u8], indices: BufferAt<'_>, draws: &[DrawRange]) {
        self.begin_draws(kernel, params, indices);
        let mut current = None;
        for draw in draws {
            if current != Some(draw.cull) {
                current = Some(draw.cull);
                self.set_cull(draw.cull);
            }
            // SAFETY: the command buffer is recording inside of rendering; index ranges come from the scene's own tables.
            unsafe {
                let device = self.gpu.raw();
                device.cmd_draw_indexed(self.buffer, draw.index_count, 1, draw.first_index, 0, draw.instance);
            }
        }
    }

    /// Fills a buffer with zeros.
    pub fn clear_buffer(&mut self, buffer: &Buffer) {
        // SAFETY: the command buffer is recording, outside of rendering; every buffer can be a copy's target.
        unsafe { self.gpu.raw().cmd_fill_buffer(self.buffer, buffer.raw, 0, vk::WHOLE_SIZE, 0) };
    }

    /// Fills a range of a buffer with zeros. Offset and size must be multiples of four.
    pub fn clear_range(&mut self, buffer: &Buffer, offset: u64, bytes: u64) {
        // SAFETY: as above; the caller keeps the range inside of the buffer.
        unsafe { self.gpu.raw().cmd_fill_buffer(self.buffer, buffer.raw, offset, bytes, 0) };
    }

    /// Fills an image with zeros. It must be in the layout for copy targets.
    pub fn clear_image(&mut self, image: &Image) {
        let (device, layout) = (self.gpu.raw(), vk::ImageLayout::TRANSFER_DST_OPTIMAL);
        let range = [image.range(Part::ALL.of(image.mips(), image.layers()))];
        // SAFETY: the command buffer is recording, outside of rendering; every image can be a copy's target.
        unsafe {
            if image.format().is_depth() {
                let zero = vk::ClearDepthStencilValue::default();
                device.cmd_clear_depth_stencil_image(self.buffer, image.raw, layout, &zero, &range);
            } else {
                device.cmd_clear_color_image(self.buffer, image.raw, layout, &vk::ClearColorValue::default(), &range);
            }
        }
    }

    /// Writes at most 65536 bytes to a buffer. Offset and size must be multiples of four.
    pub fn fill_buffer(&mut self, to: &Buffer, offset: u64, bytes: &[u8]) {
        if !bytes.is_empty() {
            // SAFETY: the command buffer is recording, outside of rendering; the caller keeps the range inside of the buffer.
            unsafe { self.gpu.raw().cmd_update_buffer(self.buffer, to.raw, offset, bytes) };
        }
    }

    pub fn copy_buffer(&mut self, from: &Buffer, from_offset: u64, to: &Buffer, to_offset: u64, bytes: u64) {
        let region = [vk::BufferCopy { src_offset: from_offset, dst_offset: to_offset, size: bytes }];
        // SAFETY: the caller keeps both ranges inside their buffers.
        unsafe { self.gpu.raw().cmd_copy_buffer(self.buffer, from.raw, to.raw, &region) };
    }

    pub fn copy_buffer_to_image(&mut self, from: &Buffer, to: &Image, regions: &[ImageRegion]) {
        let regions: Vec<_> = regions.iter().map(|r| r.vulkan(to)).collect();
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        // SAFETY: the plan brought the image to this layout; regions come from the image's own mips.
        unsafe { self.gpu.raw().cmd_copy_buffer_to_image(self.buffer, from.raw, to.raw, layout, &regions) };
    }

    /// Copies one pixel from the start of a buffer to one mip of one layer.
    pub fn copy_pixel(&mut self, from: &Buffer, to: &Image, part: Part, [x, y]: [u32; 2]) {
        let layers = vk::ImageSubresourceLayers {
            aspect_mask: format::aspect(to.format()),
            mip_level: part.mip.into(),
            base_array_layer: part.layer.into(),
            layer_count: 1,
        };
        let region = [vk::BufferImageCopy::default()
            .image_subresource(layers)
            .image_offset(vk::Offset3D { x: x as i32, y: y as i32, z: 0 })
            .image_extent(vk::Extent3D { width: 1, height: 1, depth: 1 })];
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        // SAFETY: the caller brought the image to this layout, and the pixel lies inside of it.
        unsafe { self.gpu.raw().cmd_copy_buffer_to_image(self.buffer, from.raw, to.raw, layout, &region) };
    }

    pub fn copy_image_to_buffer(&mut self, from: &Image, to: &Buffer, region: ImageRegion) {
        let regions = [region.vulkan(from)];
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        // SAFETY: as above.
        unsafe { self.gpu.raw().cmd_copy_image_to_buffer(self.buffer, from.raw, layout, to.raw, &regions) };
    }

    /// Copies all layers of a mip to a mip of the same size and format.
    pub fn copy_image(&mut self, from: &Image, from_mip: u32, to: &Image, to_mip: u32) {
        let layers = |image: &Image, mip: u32| vk::ImageSubresourceLayers {
            aspect_mask: format::aspect(image.format()),
            mip_level: mip,
            layer_count: image.layers(),
            ..Default::default()
        };
        let extent = from.extent().mip(from_mip);
        let region = [vk::ImageCopy {
            src_subresource: layers(from, from_mip),
            dst_subresource: layers(to, to_mip),
            extent: vk::Extent3D { width: extent.width, height: extent.height, depth: 1 },
            ..Default::default()
        }];
        let (source, target) = (vk::ImageLayout::TRANSFER_SRC_OPTIMAL, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
        // SAFETY: the plan brought both images to these layouts; the caller compared sizes and formats.
        unsafe { self.gpu.raw().cmd_copy_image(self.buffer, from.raw, source, to.raw, target, &region) };
    }

    /// Opens a labelled region for debuggers and profilers.
    pub fn begin_label(&mut self, name: &str) {
        let Some(api) = &self.gpu.0.labels else { return };
        // Zero-terminated, on the stack: labels are short, and there is one for every pass.
        let mut text = [0_u8; 128];
        let length = name.len().min(text.len() - 1);
        text[..length].copy_from_slice(&name.as_bytes()[..length]);
        if let Ok(text) = CStr::from_bytes_until_nul(&text) {
            let label = vk::DebugUtilsLabelEXT::default().label_name(text);
            // SAFETY: the command buffer is recording; `text` outlives the call.
            unsafe { api.cmd_begin_debug_utils_label(self.buffer, &label) };
        }
    }

    pub fn end_label(&mut self) {
        if let Some(api) = &self.gpu.0.labels {
            // SAFETY: `begin_label` came before.
            unsafe { api.cmd_end_debug_utils_label(self.buffer) };
        }
    }
}

impl ImageRegion {
    fn vulkan(&self, image: &Image) -> vk::BufferImageCopy {
        vk::BufferImageCopy {
            buffer_offset: self.buffer_offset,
            image_subresource: vk::ImageSubresourceLayers {
                aspect_mask: format::aspect(image.format()),
                mip_level: self.mip,
                layer_count: 1,
                ..Default::default()
            },
            image_extent: vk::Extent3D { width: self.extent.width, height: self.extent.height, depth: 1 },
            ..Default::default()
        }
    }
}

impl Drop for CommandEncoder {
    fn drop(&mut self) {
        // SAFETY: its owner waits for the device before it drops a frame.
        unsafe { self.gpu.raw().destroy_command_pool(self.pool, None) };
    }
}

impl Gpu {
    /// Sets the name of an object in debuggers and validation messages.
    pub(super) fn name_object(&self, object: impl vk::Handle, name: &str) {
        if let (Some(api), Ok(text)) = (&self.0.labels, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&text);
            // SAFETY: the object is alive; `text` outlives the call. A name that is not set is no loss.
            let _ = unsafe { api.set_debug_utils_object_name(&info) };
        }
    }
}
