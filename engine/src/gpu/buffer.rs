//! Buffers, reached from shaders by device address.
use super::device::{Garbage, lock};
use super::{Gpu, GpuError};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use magpie_shaders::Address;

/// Where a buffer's memory lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BufferMemory {
    /// Fast for the device, out of the host's reach.
    Device,
    /// Written by the host, read by the device.
    Upload,
    /// Written by the device, read by the host.
    ReadBack,
}

/// What a buffer is for, beyond being addressed and copied, which every buffer can be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BufferUse {
    /// Shaders read and write it by address.
    #[default]
    Storage,
    /// Indices of draws as well.
    Index,
    /// Arguments of indirect draws and dispatches as well.
    Indirect,
}

/// A buffer. Freed when dropped, after the device is done with it.
pub struct Buffer {
    gpu: Gpu,
    pub(super) raw: vk::Buffer,
    memory: Option<Allocation>,
    address: Address,
    bytes: u64,
    name: String,
}

impl Buffer {
    /// Makes a buffer of `bytes` bytes (at least 4 are taken).
    ///
    /// # Errors
    /// [`GpuError::Limit`] beyond the largest buffer of the device, [`GpuError::OutOfMemory`] with the name and size.
    pub fn new(gpu: &Gpu, name: &str, bytes: u64, memory: BufferMemory, usage: BufferUse) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let size = bytes.max(4);
        let limit = gpu.report().limits.get("max_buffer_bytes").copied().unwrap_or(u64::MAX);
        if size > limit {
            return Err(GpuError::Limit { what: format!("bytes of buffer {name}"), wanted: size, limit });
        }
        let extra = match usage {
            BufferUse::Storage => vk::BufferUsageFlags::empty(),
            BufferUse::Index => vk::BufferUsageFlags::INDEX_BUFFER,
            BufferUse::Indirect => vk::BufferUsageFlags::INDIRECT_BUFFER,
        };
        let info = vk::BufferCreateInfo::default().size(size).usage(
            vk::BufferUsageFlags::STORAGE_BUFFER
                | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
                | vk::BufferUsageFlags::TRANSFER_SRC
                | vk::BufferUsageFlags::TRANSFER_DST
                | extra,
        );
        // SAFETY: `info` is complete; the device is alive as long as `gpu`.
        let raw = unsafe { device.create_buffer(&info, None) }.map_err(GpuError::call("vkCreateBuffer"))?;
        // SAFETY: the buffer was just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(raw) };
        let location = match memory {
            BufferMemory::Device => MemoryLocation::GpuOnly,
            BufferMemory::Upload => MemoryLocation::CpuToGpu,
            BufferMemory::ReadBack => MemoryLocation::GpuToCpu,
        };
        let allocation = lock(&gpu.0.allocator).allocate(&AllocationCreateDesc {
            name,
            requirements,
            location,
            linear: true,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        });
        let allocation = match allocation {
            Ok(a) => a,
            Err(e) => {
                log::error!("{name}: {e}");
                // SAFETY: nothing uses the buffer yet.
                unsafe { device.destroy_buffer(raw, None) };
                return Err(GpuError::OutOfMemory { what: name.to_owned(), bytes: size });
            }
        };
        // SAFETY: the memory was allocated for this buffer and is bound once.
        let bound = unsafe { device.bind_buffer_memory(raw, allocation.memory(), allocation.offset()) };
        let mut made = Self {
            gpu: gpu.clone(),
            raw,
            memory: Some(allocation),
            address: Address::default(),
            bytes: size,
            name: name.to_owned(),
        };
        bound.map_err(GpuError::call("vkBindBufferMemory"))?;
        // SAFETY: the buffer has memory and was made with SHADER_DEVICE_ADDRESS.
        let address = unsafe { device.get_buffer_device_address(&vk::BufferDeviceAddressInfo::default().buffer(raw)) };
        made.address = Address::new(address);
        gpu.name_object(raw, name);
        Ok(made)
    }

    /// Its device address.
    pub fn address(&self) -> Address {
        self.address
    }

    /// Its size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Copies `data` to `offset`. The device must not be reading that range.
    ///
    /// # Errors
    /// [`GpuError::Limit`] past the end, or when the host cannot reach the memory.
    pub fn write(&mut self, offset: u64, data: &[u8]) -> Result<(), GpuError> {
        let (bytes, name) = (self.bytes, &self.name);
        let end = offset.saturating_add(data.len() as u64);
        let past = || GpuError::Limit { what: format!("write to {name}"), wanted: end, limit: bytes };
        let mapped = self.memory.as_mut().and_then(Allocation::mapped_slice_mut).ok_or_else(past)?;
        // The memory may be longer than the buffer.
        let range = if end <= bytes { mapped.get_mut(offset as usize..end as usize) } else { None };
        range.ok_or_else(past)?.copy_from_slice(data);
        Ok(())
    }

    /// The contents, as far as the host can reach them: empty for device memory.
    pub fn contents(&self) -> &[u8] {
        let mapped = self.memory.as_ref().and_then(Allocation::mapped_slice).unwrap_or(&[]);
        &mapped[..mapped.len().min(self.bytes as usize)]
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if let Some(memory) = self.memory.take() {
            self.gpu.0.discard(Garbage::Buffer(self.raw, memory));
        }
    }
}
