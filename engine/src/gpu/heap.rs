//! Device memory that several objects share, side by side or aliased.
use super::device::Garbage;
use super::{Gpu, GpuError};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

/// A block of device memory. It is freed after it is dropped and the device has finished using it.
pub(crate) struct Heap {
    gpu: Gpu,
    memory: Option<Allocation>,
    bytes: u64,
}

/// Alignment of a heap, bytes: current devices need no more for any object.
const ALIGN: u64 = 1 << 16;

impl Heap {
    /// A heap of `bytes` bytes in memory type `kind`.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, name: &str, bytes: u64, kind: u8) -> Result<Self, GpuError> {
        let requirements =
            vk::MemoryRequirements { size: bytes.max(1), alignment: ALIGN, memory_type_bits: 1 << u32::from(kind) };
        let memory = gpu.allocate(name, requirements, MemoryLocation::GpuOnly, false)?;
        Ok(Self { gpu: gpu.clone(), memory: Some(memory), bytes })
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Memory and offset to bind an object at `offset` of the heap to.
    pub(super) fn place(&self, offset: u64) -> (vk::DeviceMemory, u64) {
        self.memory.as_ref().map_or((vk::DeviceMemory::null(), 0), |m| {
            // SAFETY: the memory lives as long as the heap, which whoever is bound to it holds.
            (unsafe { m.memory() }, m.offset() + offset)
        })
    }
}

impl Drop for Heap {
    fn drop(&mut self) {
        if let Some(memory) = self.memory.take() {
            self.gpu.0.discard(Garbage::Memory(memory));
        }
    }
}

impl Gpu {
    /// The memory type for objects that allow `types`: device-local, and the same as for buffers if possible.
    pub(super) fn memory_kind(&self, types: u32) -> u8 {
        let buffers = self.0.buffer_types.trailing_zeros() as u8;
        let fast = |t: &u8| {
            types >> *t & 1 == 1 && self.0.memory_types[usize::from(*t)].contains(vk::MemoryPropertyFlags::DEVICE_LOCAL)
        };
        let all = || 0..self.0.memory_types.len() as u8;
        let shared = all().find(|t| fast(t) && self.0.buffer_types >> *t & 1 == 1);
        shared.or_else(|| all().find(fast)).unwrap_or(buffers)
    }

    /// The memory type for buffers.
    pub(crate) fn buffer_kind(&self) -> u8 {
        self.memory_kind(self.0.buffer_types)
    }

    /// Least distance between images and buffers in one heap, bytes.
    pub(crate) fn granularity(&self) -> u64 {
        self.0.granularity
    }
}
