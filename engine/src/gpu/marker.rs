//! Words in a buffer that say how far the device came; they outlive a lost device.
use super::{Buffer, CommandEncoder, Gpu};
use ash::vk;

/// When a marker is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moment {
    /// The device has come to this place in the commands.
    Reached,
    /// Everything before this place is done.
    Done,
}

impl Gpu {
    /// The device can write markers while passes overlap as ever (VK_AMD_buffer_marker).
    pub fn has_markers(&self) -> bool {
        self.0.markers.is_some()
    }
}

impl CommandEncoder {
    /// Writes a word at a multiple of four bytes, outside of rendering. Where the device has no markers it is a fill, which keeps to
    /// no moment: the caller puts a barrier between it and what it tells of.
    pub fn mark(&mut self, buffer: &Buffer, offset: u64, word: u32, moment: Moment) {
        let stage = match moment {
            Moment::Reached => vk::PipelineStageFlags::TOP_OF_PIPE,
            Moment::Done => vk::PipelineStageFlags::BOTTOM_OF_PIPE,
        };
        // SAFETY: the command buffer is recording; the caller keeps the word inside of the buffer, which can be a copy's target.
        unsafe {
            match &self.gpu().0.markers {
                Some(api) => api.cmd_write_buffer_marker(self.raw(), stage, buffer.raw, offset, word),
                None => self.gpu().raw().cmd_fill_buffer(self.raw(), buffer.raw, offset, 4, word),
            }
        }
    }
}
