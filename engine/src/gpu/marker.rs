//! Markers: words that the device writes to a buffer as it executes commands. They can be read after a device loss.
use super::{Buffer, CommandEncoder, Gpu};
use ash::vk;

/// When a marker is written, relative to the commands around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moment {
    /// When the device reaches this command.
    Reached,
    /// When everything before this command is done.
    Done,
}

impl Gpu {
    /// Whether the device can write markers without serialising passes (VK_AMD_buffer_marker).
    pub fn has_markers(&self) -> bool {
        self.0.markers.is_some()
    }
}

impl CommandEncoder {
    /// Writes a word at `offset`, a multiple of four, outside rendering. Without markers this is a buffer fill, which ignores
    /// `moment`: the caller must separate it by barriers from the work that it reports on.
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
