//! Memory that the host fills anew every frame.
use super::{Buffer, BufferMemory, BufferUse, Gpu, GpuError};
use std::sync::Arc;

/// Contents for one frame at a time. Frames do not overlap, so one buffer is enough: where something still holds what an earlier
/// frame was declared with, that keeps it, and this one takes another.
pub struct Staging {
    gpu: Gpu,
    name: &'static str,
    buffer: Option<Arc<Buffer>>,
}

impl Staging {
    /// Nothing yet.
    pub fn new(gpu: &Gpu, name: &'static str) -> Self {
        Self { gpu: gpu.clone(), name, buffer: None }
    }

    /// The buffer, holding `bytes` from its begin on. It is at least as long.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<&Arc<Buffer>, GpuError> {
        let wanted = bytes.len() as u64;
        let free = self.buffer.take().and_then(|b| Arc::try_unwrap(b).ok()).filter(|b| b.bytes() >= wanted);
        let mut buffer = match free {
            Some(buffer) => buffer,
            None => Buffer::new(&self.gpu, self.name, wanted, BufferMemory::Upload, BufferUse::Storage)?,
        };
        buffer.write(0, bytes)?;
        Ok(self.buffer.insert(Arc::new(buffer)))
    }
}
