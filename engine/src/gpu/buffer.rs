//! Buffers, which shaders access by device address.
use super::device::Garbage;
use super::heap::Heap;
use super::rays::RaySupport;
use super::{Gpu, GpuError};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use magpie_shaders::Address;
use std::sync::Arc;

/// Where a buffer's memory is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BufferMemory {
    /// Device memory that the host cannot access.
    Device,
    /// Host-visible memory, written by the host and read by the device.
    Upload,
    /// Host-visible memory, written by the device and read by the host.
    ReadBack,
}

/// Usage of a buffer. Every buffer can be copied, and accessed by its device address.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BufferUse {
    /// Read and written by shaders.
    #[default]
    Storage,
    /// Also an index buffer.
    Index,
    /// Also arguments of indirect draws and dispatches.
    Indirect,
    /// All of these.
    Any,
}

/// A buffer. It is freed after it is dropped and the device has finished using it.
pub struct Buffer {
    gpu: Gpu,
    pub(super) raw: vk::Buffer,
    memory: Memory,
    address: Address,
    bytes: u64,
    name: String,
}

impl Buffer {
    /// A buffer of `bytes` bytes, at least 4.
    ///
    /// # Errors
    /// [`GpuError::Limit`] above the device's largest buffer size, [`GpuError::OutOfMemory`] with the name and size.
    pub fn new(gpu: &Gpu, name: &str, bytes: u64, memory: BufferMemory, usage: BufferUse) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let size = bytes.max(4);
        let limit = gpu.report().limits.get("max_buffer_bytes").copied().unwrap_or(u64::MAX);
        if size > limit {
            return Err(GpuError::Limit { what: format!("bytes of buffer {name}"), wanted: size, limit });
        }
        let rays = gpu.0.ray_support.buffer_usage();
        let extra = match usage {
            BufferUse::Storage => vk::BufferUsageFlags::empty(),
            BufferUse::Index => vk::BufferUsageFlags::INDEX_BUFFER,
            BufferUse::Indirect => vk::BufferUsageFlags::INDIRECT_BUFFER,
            BufferUse::Any => EVERYTHING,
        };
        let families = &gpu.0.families;
        let info = shared(vk::BufferCreateInfo::default().size(size).usage(BASIC | extra | rays), families);
        // SAFETY: `info` is complete; the device is alive as long as `gpu`.
        let raw = unsafe { device.create_buffer(&info, None) }.map_err(GpuError::call("vkCreateBuffer"))?;
        // SAFETY: the buffer was just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(raw) };
        let location = match memory {
            BufferMemory::Device => MemoryLocation::GpuOnly,
            BufferMemory::Upload => MemoryLocation::CpuToGpu,
            BufferMemory::ReadBack => MemoryLocation::GpuToCpu,
        };
        let allocation = gpu.allocate(name, requirements, location, true).inspect_err(|_| {
            // SAFETY: nothing uses the buffer yet.
            unsafe { device.destroy_buffer(raw, None) };
        })?;
        // SAFETY: the memory was allocated for this buffer and is bound once.
        let bound = unsafe { device.bind_buffer_memory(raw, allocation.memory(), allocation.offset()) };
        let mut made = Self {
            gpu: gpu.clone(),
            raw,
            memory: Memory::Own(allocation),
            address: Address::default(),
            bytes: size,
            name: name.to_owned(),
        };
        bound.map_err(GpuError::call("vkBindBufferMemory"))?;
        made.find_address();
        Ok(made)
    }

    /// A buffer that spans a whole heap, with every usage.
    ///
    /// # Errors
    /// Vulkan calls that failed.
    pub(crate) fn over(gpu: &Gpu, name: &str, heap: &Arc<Heap>) -> Result<Self, GpuError> {
        let device = gpu.raw();
        let info = vk::BufferCreateInfo::default()
            .size(heap.bytes().max(4))
            .usage(EVERYTHING | gpu.0.ray_support.buffer_usage());
        let info = shared(info, &gpu.0.families);
        // SAFETY: `info` is complete; the device is alive as long as `gpu`.
        let raw = unsafe { device.create_buffer(&info, None) }.map_err(GpuError::call("vkCreateBuffer"))?;
        let (memory, offset) = heap.place(0);
        let mut made = Self {
            gpu: gpu.clone(),
            raw,
            memory: Memory::Placed { _heap: heap.clone() },
            address: Address::default(),
            bytes: heap.bytes(),
            name: name.to_owned(),
        };
        // SAFETY: the heap is of a type that such buffers can lie in, and as large as the buffer.
        unsafe { device.bind_buffer_memory(raw, memory, offset) }.map_err(GpuError::call("vkBindBufferMemory"))?;
        made.find_address();
        Ok(made)
    }

    fn find_address(&mut self) {
        // The buffer has memory and was made with SHADER_DEVICE_ADDRESS.
        let info = vk::BufferDeviceAddressInfo::default().buffer(self.raw);
        // SAFETY: as said.
        self.address = Address::new(unsafe { self.gpu.raw().get_buffer_device_address(&info) });
        self.gpu.name_object(self.raw, &self.name);
    }

    /// Device address, for shaders.
    pub fn address(&self) -> Address {
        self.address
    }

    /// Size in bytes, at least 4.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Name in errors and captures.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Copies `data` to `offset`. The device must not be reading that range.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if the range ends past the buffer, or if the host cannot access the memory.
    pub fn write(&mut self, offset: u64, data: &[u8]) -> Result<(), GpuError> {
        let (bytes, name) = (self.bytes, &self.name);
        let end = offset.saturating_add(data.len() as u64);
        let past = || GpuError::Limit { what: format!("write to {name}"), wanted: end, limit: bytes };
        let mapped = self.memory.own_mut().and_then(Allocation::mapped_slice_mut).ok_or_else(past)?;
        // The mapped memory may be longer than the buffer.
        let range = if end <= bytes { mapped.get_mut(offset as usize..end as usize) } else { None };
        range.ok_or_else(past)?.copy_from_slice(data);
        Ok(())
    }

    /// Takes its handle and memory, which the caller must free. `None` if it is in a heap.
    pub(super) fn into_parts(mut self) -> Option<(vk::Buffer, Allocation)> {
        match std::mem::replace(&mut self.memory, Memory::Gone) {
            Memory::Own(memory) => Some((self.raw, memory)),
            placed => {
                self.memory = placed;
                None
            }
        }
    }

    /// The contents as the host sees them; empty for device memory.
    pub fn contents(&self) -> &[u8] {
        let mapped = self.memory.own().and_then(Allocation::mapped_slice).unwrap_or(&[]);
        &mapped[..mapped.len().min(self.bytes as usize)]
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let garbage = match std::mem::replace(&mut self.memory, Memory::Gone) {
            Memory::Own(memory) => Garbage::Buffer(self.raw, memory),
            Memory::Placed { .. } => Garbage::PlacedBuffer(self.raw),
            Memory::Gone => return,
        };
        self.gpu.0.discard(garbage);
    }
}

/// The memory behind a buffer.
enum Memory {
    Own(Allocation),
    /// A range of a heap, which it keeps alive.
    Placed {
        _heap: Arc<Heap>,
    },
    /// Moved to the garbage list.
    Gone,
}

impl Memory {
    fn own(&self) -> Option<&Allocation> {
        if let Self::Own(memory) = self { Some(memory) } else { None }
    }

    fn own_mut(&mut self) -> Option<&mut Allocation> {
        if let Self::Own(memory) = self { Some(memory) } else { None }
    }
}

/// Usage of every buffer.
const BASIC: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);
/// Usage of the buffer behind the transients of a frame.
const EVERYTHING: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    BASIC.as_raw() | vk::BufferUsageFlags::INDEX_BUFFER.as_raw() | vk::BufferUsageFlags::INDIRECT_BUFFER.as_raw(),
);

/// Concurrent sharing between all queue families. For buffers this costs nothing.
fn shared<'a>(info: vk::BufferCreateInfo<'a>, families: &'a [u32]) -> vk::BufferCreateInfo<'a> {
    if families.len() > 1 {
        info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(families)
    } else {
        info
    }
}

/// Bit mask of the memory types that the buffer behind the transients can be in.
pub(super) fn memory_types(device: &ash::Device, rays: RaySupport) -> u32 {
    let info = vk::BufferCreateInfo::default().size(1 << 16).usage(EVERYTHING | rays.buffer_usage());
    let question = vk::DeviceBufferMemoryRequirements::default().create_info(&info);
    let mut answer = vk::MemoryRequirements2::default();
    // SAFETY: core in Vulkan 1.3 with maintenance4, which the floor asks for.
    unsafe { device.get_device_buffer_memory_requirements(&question, &mut answer) };
    answer.memory_requirements.memory_type_bits
}
