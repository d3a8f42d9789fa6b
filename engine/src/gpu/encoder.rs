//! Recording commands. Safe to call; only the graph's execution does, in the order that its plan proved right.
use super::access::{self, Scope};
use super::bindless::PassSet;
use super::pipeline::PUSH_BYTES;
use super::query::Timestamps;
use super::{Buffer, Gpu, GpuError, Image, Kernel, RasterKernel, format};
use crate::graph::{Extent, Layout};
use ash::vk;
use std::ffi::CString;

/// One command pool with one command buffer, recorded anew each time it is free.
pub(crate) struct CommandEncoder {
    gpu: Gpu,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
}

/// Waits for `from`, then lets `to` see the whole image in its new layout.
pub(crate) struct ImageBarrier<'a> {
    pub image: &'a Image,
    pub from: Scope,
    pub to: Scope,
    pub layout_from: Layout,
    pub layout_to: Layout,
}

/// Waits for `from`, then lets `to` see the whole buffer.
pub(crate) struct BufferBarrier<'a> {
    pub buffer: &'a Buffer,
    pub from: Scope,
    pub to: Scope,
}

/// A target of a draw list.
pub(crate) struct Attachment<'a> {
    pub image: &'a Image,
    /// Cleared to this value; `None` keeps what is there. Depth reads the first number.
    pub clear: Option<[f32; 4]>,
}

/// Which faces are not drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cull {
    /// Both are drawn.
    None,
    /// Back faces; front faces wind counter-clockwise as seen from outside.
    Back,
    /// Back faces of an instance that its transform mirrors: fronts wind clockwise.
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

/// Part of an image in a buffer: rows without gaps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImageRegion {
    pub buffer_offset: u64,
    pub mip: u32,
    pub extent: Extent,
}

impl CommandEncoder {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(gpu.0.family)
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: the family exists on this device.
        let pool = unsafe { device.create_command_pool(&info, None) }.map_err(GpuError::call("vkCreateCommandPool"))?;
        let mut made = Self { gpu: gpu.clone(), pool, buffer: vk::CommandBuffer::null() };
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

    /// Begins anew. The device must be done with what was recorded before.
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
        self.bind(self.gpu.0.bindless.set);
        Ok(())
    }

    /// Everything that follows sees this set instead of the whole.
    pub fn bind_pass_set(&mut self, set: &PassSet) {
        self.bind(set.set);
    }

    fn bind(&mut self, set: vk::DescriptorSet) {
        let (device, layout) = (self.gpu.raw(), self.gpu.0.pipelines.layout);
        for point in [vk::PipelineBindPoint::COMPUTE, vk::PipelineBindPoint::GRAPHICS] {
            // SAFETY: the command buffer is recording; layout and set live until the device is done with it.
            unsafe { device.cmd_bind_descriptor_sets(self.buffer, point, layout, 0, &[set], &[]) };
        }
    }

    pub fn finish(&mut self) -> Result<(), GpuError> {
        // SAFETY: the command buffer is recording.
        unsafe { self.gpu.raw().end_command_buffer(self.buffer) }.map_err(GpuError::call("vkEndCommandBuffer"))
    }

    /// One batch of barriers. House rule: only `graph/execute.rs` calls this.
    pub fn barriers(&mut self, images: &[ImageBarrier<'_>], buffers: &[BufferBarrier<'_>]) {
        let images: Vec<_> = images
            .iter()
            .map(|b| {
                let from = b.from.available();
                vk::ImageMemoryBarrier2::default()
                    .src_stage_mask(from.stages)
                    .src_access_mask(from.access)
                    .dst_stage_mask(b.to.stages)
                    .dst_access_mask(b.to.access)
                    .old_layout(access::layout(b.layout_from))
                    .new_layout(access::layout(b.layout_to))
                    .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .image(b.image.raw)
                    .subresource_range(vk::ImageSubresourceRange {
                        aspect_mask: format::aspect(b.image.format()),
                        level_count: b.image.mips(),
                        layer_count: 1,
                        ..Default::default()
                    })
            })
            .collect();
        let buffers: Vec<_> = buffers
            .iter()
            .map(|b| {
                let from = b.from.available();
                vk::BufferMemoryBarrier2::default()
                    .src_stage_mask(from.stages)
                    .src_access_mask(from.access)
                    .dst_stage_mask(b.to.stages)
                    .dst_access_mask(b.to.access)
                    .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .buffer(b.buffer.raw)
                    .size(vk::WHOLE_SIZE)
            })
            .collect();
        let info = vk::DependencyInfo::default().image_memory_barriers(&images).buffer_memory_barriers(&buffers);
        // SAFETY: the command buffer is recording, outside of rendering.
        unsafe { self.gpu.raw().cmd_pipeline_barrier2(self.buffer, &info) };
    }

    /// Everything before it is done and seen by everything after it, the host included. Called as [`Self::barriers`] is.
    pub fn full_barrier(&mut self) {
        let (from, to) = (Scope::EVERYTHING.available(), Scope::EVERYTHING);
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(from.stages)
            .src_access_mask(from.access)
            .dst_stage_mask(to.stages | vk::PipelineStageFlags2::HOST)
            .dst_access_mask(to.access | vk::AccessFlags2::HOST_READ)];
        let info = vk::DependencyInfo::default().memory_barriers(&barrier);
        // SAFETY: the command buffer is recording, outside of rendering.
        unsafe { self.gpu.raw().cmd_pipeline_barrier2(self.buffer, &info) };
    }

    /// Begins drawing into these targets, over all of `extent`, which is the size of each.
    pub fn begin_rendering(&mut self, extent: Extent, colours: &[Attachment<'_>], depth: Option<&Attachment<'_>>) {
        let info = |a: &Attachment<'_>, layout| {
            let is_depth = a.image.format().is_depth();
            let clear = a.clear.unwrap_or_default();
            let clear_value = if is_depth {
                vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: clear[0], stencil: 0 } }
            } else if a.image.format().is_uint() {
                vk::ClearValue { color: vk::ClearColorValue { uint32: clear.map(|c| c as u32) } }
            } else {
                vk::ClearValue { color: vk::ClearColorValue { float32: clear } }
            };
            vk::RenderingAttachmentInfo::default()
                .image_view(a.image.view)
                .image_layout(layout)
                .load_op(if a.clear.is_some() { vk::AttachmentLoadOp::CLEAR } else { vk::AttachmentLoadOp::LOAD })
                .store_op(vk::AttachmentStoreOp::STORE)
                .clear_value(clear_value)
        };
        let colours: Vec<_> = colours.iter().map(|a| info(a, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)).collect();
        let depth = depth.map(|a| info(a, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL));
        let area =
            vk::Rect2D { extent: vk::Extent2D { width: extent.width, height: extent.height }, ..Default::default() };
        let mut rendering = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&colours);
        if let Some(depth) = &depth {
            rendering = rendering.depth_attachment(depth);
        }
        let viewport = vk::Viewport {
            width: extent.width as f32,
            height: extent.height as f32,
            max_depth: 1.0,
            ..Default::default()
        };
        // SAFETY: the command buffer is recording; the plan brought every target to its attachment layout.
        unsafe {
            self.gpu.raw().cmd_begin_rendering(self.buffer, &rendering);
            self.gpu.raw().cmd_set_viewport(self.buffer, 0, &[viewport]);
            self.gpu.raw().cmd_set_scissor(self.buffer, 0, &[area]);
        }
    }

    pub fn end_rendering(&mut self) {
        // SAFETY: `begin_rendering` came before.
        unsafe { self.gpu.raw().cmd_end_rendering(self.buffer) };
    }

    fn push(&mut self, params: &[u8]) {
        assert!(params.len() <= PUSH_BYTES as usize, "push constants: {} bytes, limit {PUSH_BYTES}", params.len());
        let layout = self.gpu.0.pipelines.layout;
        if !params.is_empty() {
            // SAFETY: the layout has 128 bytes for all stages, checked above.
            unsafe { self.gpu.raw().cmd_push_constants(self.buffer, layout, vk::ShaderStageFlags::ALL, 0, params) };
        }
    }

    pub fn dispatch(&mut self, kernel: Kernel, params: &[u8], groups: [u32; 3]) {
        let pipeline = self.gpu.0.pipelines.get(kernel.index);
        self.push(params);
        // SAFETY: the command buffer is recording outside of rendering, with the bindless set bound.
        unsafe {
            self.gpu.raw().cmd_bind_pipeline(self.buffer, vk::PipelineBindPoint::COMPUTE, pipeline);
            self.gpu.raw().cmd_dispatch(self.buffer, groups[0], groups[1], groups[2]);
        }
    }

    pub fn draw(&mut self, kernel: RasterKernel, params: &[u8], indices: &Buffer, draws: &[DrawRange]) {
        let pipeline = self.gpu.0.pipelines.get(kernel.index);
        self.push(params);
        let (device, commands) = (self.gpu.raw(), self.buffer);
        // SAFETY: the command buffer is recording inside of rendering, with the bindless set bound.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pipeline);
            device.cmd_bind_index_buffer(commands, indices.raw, 0, vk::IndexType::UINT32);
        }
        let mut current = None;
        for draw in draws {
            if current != Some(draw.cull) {
                current = Some(draw.cull);
                let (mode, front) = match draw.cull {
                    Cull::None => (vk::CullModeFlags::NONE, vk::FrontFace::COUNTER_CLOCKWISE),
                    Cull::Back => (vk::CullModeFlags::BACK, vk::FrontFace::COUNTER_CLOCKWISE),
                    Cull::BackMirrored => (vk::CullModeFlags::BACK, vk::FrontFace::CLOCKWISE),
                };
                // SAFETY: as above; both states are dynamic in every graphics pipeline.
                unsafe {
                    device.cmd_set_cull_mode(commands, mode);
                    device.cmd_set_front_face(commands, front);
                }
            }
            // SAFETY: as above; index ranges come from the scene's own tables.
            unsafe { device.cmd_draw_indexed(commands, draw.index_count, 1, draw.first_index, 0, draw.instance) };
        }
    }

    /// Fills a buffer with zeros.
    pub fn clear_buffer(&mut self, buffer: &Buffer) {
        // SAFETY: the command buffer is recording, outside of rendering; every buffer can be a copy's target.
        unsafe { self.gpu.raw().cmd_fill_buffer(self.buffer, buffer.raw, 0, vk::WHOLE_SIZE, 0) };
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

    pub fn copy_image_to_buffer(&mut self, from: &Image, to: &Buffer, region: ImageRegion) {
        let regions = [region.vulkan(from)];
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        // SAFETY: as above.
        unsafe { self.gpu.raw().cmd_copy_image_to_buffer(self.buffer, from.raw, layout, to.raw, &regions) };
    }

    /// Writes timestamp `index` once everything before it is done.
    ///
    /// llvmpipe puts a timestamp into the bins of its rasteriser, which it works off at the next flush, while dispatches run at
    /// once: without a flush, a dispatch that follows is over before the timestamp is taken. A barrier flushes.
    pub fn timestamp(&mut self, pool: &Timestamps, index: u32) {
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        // SAFETY: the pool was reset before this frame and `index` is below its capacity.
        unsafe { self.gpu.raw().cmd_write_timestamp2(self.buffer, stage, pool.pool, index) };
        if self.gpu.report().driver.starts_with("llvmpipe") {
            self.full_barrier();
        }
    }

    /// Opens a named section for debuggers and profilers.
    pub fn begin_label(&mut self, name: &str) {
        if let (Some(api), Ok(text)) = (&self.gpu.0.labels, CString::new(name)) {
            let label = vk::DebugUtilsLabelEXT::default().label_name(&text);
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
    /// Gives an object a name for debuggers and validation messages.
    pub(super) fn name_object(&self, object: impl vk::Handle, name: &str) {
        if let (Some(api), Ok(text)) = (&self.0.labels, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&text);
            // SAFETY: the object is alive; `text` outlives the call. A name that is not set is no loss.
            let _ = unsafe { api.set_debug_utils_object_name(&info) };
        }
    }
}
