//! Host-written buffers that get new contents every frame.
use super::{Buffer, BufferMemory, BufferUse, Gpu, GpuError};
use std::sync::Arc;

/// Buffers for data of the current frame. One that something else still refers to, such as a frame in flight, stays as it is; the others are written
/// anew, so there are as many as there are frames in flight.
pub struct Staging {
    gpu: Gpu,
    name: &'static str,
    usage: BufferUse,
    /// The newest last.
    buffers: Vec<Arc<Buffer>>,
}

impl Staging {
    /// No buffer yet; the first is made by the first [`Self::write`].
    pub fn new(gpu: &Gpu, name: &'static str) -> Self {
        Self::with_use(gpu, name, BufferUse::Storage)
    }

    /// The same with buffers for a certain use.
    pub fn with_use(gpu: &Gpu, name: &'static str, usage: BufferUse) -> Self {
        Self { gpu: gpu.clone(), name, usage, buffers: Vec::new() }
    }

    /// Writes `bytes` to the start of a buffer and returns it. The buffer may be longer.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<&Arc<Buffer>, GpuError> {
        self.write_parts(&[bytes])
    }

    /// The same with several parts, one after the other.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_parts(&mut self, parts: &[&[u8]]) -> Result<&Arc<Buffer>, GpuError> {
        let wanted = parts.iter().map(|part| part.len() as u64).sum();
        self.buffers.retain_mut(|buffer| buffer.bytes() >= wanted || Arc::get_mut(buffer).is_none());
        let free = self.buffers.iter_mut().position(|buffer| Arc::get_mut(buffer).is_some());
        let mut buffer = match free {
            Some(at) => self.buffers.remove(at),
            None => {
                let memory = BufferMemory::Upload;
                Arc::new(Buffer::new(&self.gpu, self.name, wanted, memory, self.usage)?)
            }
        };
        if let Some(buffer) = Arc::get_mut(&mut buffer) {
            let mut offset = 0;
            for part in parts {
                buffer.write(offset, part)?;
                offset += part.len() as u64;
            }
        }
        self.buffers.push(buffer);
        Ok(&self.buffers[self.buffers.len() - 1])
    }
}
