//! Host-written buffers that get new contents every frame.
use super::{Buffer, BufferMemory, BufferUse, Gpu, GpuError};
use std::sync::Arc;

/// A buffer for data of the current frame. Frames do not overlap, so one buffer suffices. If an earlier frame's buffer is still
/// referenced elsewhere, it stays as it is and a new one is made.
pub struct Staging {
    gpu: Gpu,
    name: &'static str,
    buffer: Option<Arc<Buffer>>,
}

impl Staging {
    /// No buffer yet; it is made by the first [`Self::write`].
    pub fn new(gpu: &Gpu, name: &'static str) -> Self {
        Self { gpu: gpu.clone(), name, buffer: None }
    }

    /// Writes `bytes` to the start of the buffer and returns it. The buffer may be longer.
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
