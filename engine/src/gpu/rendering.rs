//! Dynamic rendering: the attachments of a pass and what is set with them.
use super::{CommandEncoder, Image, access};
use crate::graph::{Extent, Layout, Part};
use ash::vk;

/// A render target of a pass.
pub(crate) struct Attachment<'a> {
    pub image: &'a Image,
    /// The mip and layer that is rendered to. Unless it is mip 0 of layer 0, it must have been prepared.
    pub part: Part,
    /// Clear value; `None` loads the contents. For depth only the first number counts.
    pub clear: Option<[f32; 4]>,
    /// Whether the result is read later, so that it must be stored.
    pub store: bool,
    /// Whether it is a depth image that is only tested against.
    pub read_only: bool,
}

impl CommandEncoder {
    /// Begins rendering to these attachments. `extent` is the size of each of them.
    pub fn begin_rendering(&mut self, extent: Extent, colours: &[Attachment<'_>], depth: Option<&Attachment<'_>>) {
        let info = |a: &Attachment<'_>, layout: Layout| {
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
                .image_view(a.image.target_part(a.part))
                .image_layout(access::layout(layout, a.image.format()))
                .load_op(if a.clear.is_some() { vk::AttachmentLoadOp::CLEAR } else { vk::AttachmentLoadOp::LOAD })
                .store_op(match (a.read_only, a.store) {
                    // Storing counts as writing.
                    (true, _) => vk::AttachmentStoreOp::NONE,
                    (false, true) => vk::AttachmentStoreOp::STORE,
                    (false, false) => vk::AttachmentStoreOp::DONT_CARE,
                })
                .clear_value(clear_value)
        };
        let colours: Vec<_> = colours.iter().map(|a| info(a, Layout::ColorAttachment)).collect();
        let writes_depth = depth.is_some_and(|a| !a.read_only);
        let depth = depth.map(|a| info(a, if a.read_only { Layout::ReadOnly } else { Layout::DepthAttachment }));
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
        // SAFETY: the command buffer is recording; the plan brought every target to its attachment layout; whether depth is written is
        // dynamic in every graphics pipeline.
        unsafe {
            self.gpu().raw().cmd_begin_rendering(self.raw(), &rendering);
            self.gpu().raw().cmd_set_viewport(self.raw(), 0, &[viewport]);
            self.gpu().raw().cmd_set_scissor(self.raw(), 0, &[area]);
            self.gpu().raw().cmd_set_depth_write_enable(self.raw(), writes_depth);
        }
    }

    pub fn end_rendering(&mut self) {
        // SAFETY: `begin_rendering` came before.
        unsafe { self.gpu().raw().cmd_end_rendering(self.raw()) };
    }
}
