//! Acceleration structures built by the driver: sizes, builds, refits, compaction.
use super::device::Garbage;
use super::{Buffer, BufferAt, CommandEncoder, Gpu, GpuError};
use ash::vk;
use bytemuck::{Pod, Zeroable};
use magpie_shaders::Address;
use std::sync::Arc;

/// Geometry or instances that an acceleration structure is built from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelGeometry {
    /// A bottom level of triangles. The flags of each instance decide whether any-hit shaders run.
    Triangles {
        /// Vertex positions, three `f32` each.
        positions: Address,
        /// Number of vertices.
        vertices: u32,
        /// Vertex indices, three `u32` per triangle.
        indices: Address,
        /// Number of triangles.
        triangles: u32,
    },
    /// A bottom level of bounding boxes of procedural primitives.
    Boxes {
        /// Minimum and maximum corner of each box, six `f32`.
        boxes: Address,
        /// Number of boxes.
        count: u32,
    },
    /// A top level.
    Instances {
        /// Table of [`AccelInstance`]s.
        instances: Address,
        /// Number of instances.
        count: u32,
    },
}

/// How an acceleration structure is built and used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelDesc {
    /// What it is built from.
    pub geometry: AccelGeometry,
    /// Prefer fast builds over fast traversal, for structures that are rebuilt often.
    pub fast_build: bool,
    /// Allow refits.
    pub update: bool,
    /// Allow compaction.
    pub compact: bool,
}

/// Memory that an acceleration structure needs, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccelSizes {
    /// The structure itself.
    pub bytes: u64,
    /// Scratch memory of a build, alignment included.
    pub build_scratch: u64,
    /// Scratch memory of a refit, alignment included.
    pub refit_scratch: u64,
}

/// An instance as the driver's top level reads it (`VkAccelerationStructureInstanceKHR`).
///
/// A face is front-facing if its corners run counter-clockwise in object space. This is Vulkan's default, which the specification
/// states as clockwise in a left-handed system; `VK_GEOMETRY_INSTANCE_TRIANGLE_FRONT_COUNTERCLOCKWISE_BIT_KHR` would reverse it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AccelInstance {
    /// Transform from object to world space, three rows.
    pub world_from_object: [[f32; 4]; 3],
    /// Index that shaders see in the low 24 bits, visibility mask in the high 8.
    pub index_and_mask: u32,
    /// Offset of the hit group in the low 24 bits, flags such as [`AccelInstance::DOUBLE_SIDED`] in the high 8.
    pub group_and_flags: u32,
    /// Device address of the bottom level.
    pub bottom: [u32; 2],
}

impl AccelInstance {
    /// Rays hit its faces from both sides: facing culling is off.
    pub const DOUBLE_SIDED: u32 = vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE.as_raw() << 24;
    /// Shaders decide about every hit, for alpha-tested and blended materials.
    pub const NOT_OPAQUE: u32 = vk::GeometryInstanceFlagsKHR::FORCE_NO_OPAQUE.as_raw() << 24;
    /// Largest number of instances in a top level, since their index has 24 bits.
    pub const LIMIT: u32 = 1 << 24;

    /// The index that shaders see, below [`AccelInstance::LIMIT`].
    pub fn index(&self) -> u32 {
        self.index_and_mask & (Self::LIMIT - 1)
    }
}

/// An acceleration structure in a range of a buffer. It is freed after it is dropped and the device has finished using it.
pub struct Accel {
    gpu: Gpu,
    pub(super) raw: vk::AccelerationStructureKHR,
    buffer: Arc<Buffer>,
    offset: u64,
    bytes: u64,
    address: Address,
}

impl Accel {
    /// Alignment of its offset in a buffer, bytes.
    pub const ALIGN: u64 = 256;

    /// An acceleration structure in `bytes` bytes of a buffer. It must be built before use.
    ///
    /// # Errors
    /// [`GpuError::MissingExtension`] if the driver has no acceleration structures, and failed Vulkan calls.
    pub fn new(gpu: &Gpu, buffer: &Arc<Buffer>, offset: u64, bytes: u64, top: bool) -> Result<Self, GpuError> {
        let calls = gpu.0.ray_calls()?;
        let kind = if top {
            vk::AccelerationStructureTypeKHR::TOP_LEVEL
        } else {
            vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL
        };
        let info =
            vk::AccelerationStructureCreateInfoKHR::default().buffer(buffer.raw).offset(offset).size(bytes).ty(kind);
        // SAFETY: the buffer was made for acceleration structures, and lives as long as this one.
        let raw = unsafe { calls.accel.create_acceleration_structure(&info, None) }
            .map_err(GpuError::call("vkCreateAccelerationStructureKHR"))?;
        let question = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(raw);
        // SAFETY: it was just made.
        let address = unsafe { calls.accel.get_acceleration_structure_device_address(&question) };
        Ok(Self { gpu: gpu.clone(), raw, buffer: buffer.clone(), offset, bytes, address: Address::new(address) })
    }

    /// An acceleration structure in a buffer of its own.
    ///
    /// # Errors
    /// As [`Accel::new`], and [`GpuError::OutOfMemory`].
    pub fn alone(gpu: &Gpu, name: &str, bytes: u64, top: bool) -> Result<Self, GpuError> {
        let buffer = Buffer::new(gpu, name, bytes, super::BufferMemory::Device, super::BufferUse::Storage)?;
        Self::new(gpu, &Arc::new(buffer), 0, bytes, top)
    }

    /// Device address, as instances and shaders use it.
    pub fn address(&self) -> Address {
        self.address
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The buffer that it is in, and its offset there.
    pub fn place(&self) -> (&Arc<Buffer>, u64) {
        (&self.buffer, self.offset)
    }
}

impl Drop for Accel {
    fn drop(&mut self) {
        // The buffer is dropped after this, so it is freed later than the structure.
        self.gpu.0.discard(Garbage::Accel(self.raw));
    }
}

/// The single geometry of a build as a Vulkan struct, its number of primitives, and whether it is a top level.
fn geometry(geometry: AccelGeometry) -> (vk::AccelerationStructureGeometryKHR<'static>, u32, bool) {
    let at = |address: Address| vk::DeviceOrHostAddressConstKHR { device_address: address.get() };
    let (kind, data, count) = match geometry {
        AccelGeometry::Triangles { positions, vertices, indices, triangles } => {
            let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
                .vertex_format(vk::Format::R32G32B32_SFLOAT)
                .vertex_data(at(positions))
                .vertex_stride(12)
                .max_vertex(vertices.saturating_sub(1))
                .index_type(vk::IndexType::UINT32)
                .index_data(at(indices));
            let data = vk::AccelerationStructureGeometryDataKHR { triangles: data };
            (vk::GeometryTypeKHR::TRIANGLES, data, triangles)
        }
        AccelGeometry::Boxes { boxes, count } => {
            let data = vk::AccelerationStructureGeometryAabbsDataKHR::default().data(at(boxes)).stride(24);
            let data = vk::AccelerationStructureGeometryDataKHR { aabbs: data };
            (vk::GeometryTypeKHR::AABBS, data, count)
        }
        AccelGeometry::Instances { instances, count } => {
            let data = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(at(instances));
            let data = vk::AccelerationStructureGeometryDataKHR { instances: data };
            (vk::GeometryTypeKHR::INSTANCES, data, count)
        }
    };
    let top = kind == vk::GeometryTypeKHR::INSTANCES;
    let made = vk::AccelerationStructureGeometryKHR::default().geometry_type(kind).geometry(data);
    (made.flags(vk::GeometryFlagsKHR::OPAQUE), count, top)
}

fn build_info(desc: &AccelDesc, top: bool) -> vk::AccelerationStructureBuildGeometryInfoKHR<'static> {
    use vk::BuildAccelerationStructureFlagsKHR as Flags;
    let mut flags = if desc.fast_build { Flags::PREFER_FAST_BUILD } else { Flags::PREFER_FAST_TRACE };
    if desc.update {
        flags |= Flags::ALLOW_UPDATE;
    }
    if desc.compact {
        flags |= Flags::ALLOW_COMPACTION;
    }
    let kind =
        if top { vk::AccelerationStructureTypeKHR::TOP_LEVEL } else { vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL };
    vk::AccelerationStructureBuildGeometryInfoKHR::default().ty(kind).flags(flags)
}

impl Gpu {
    /// Memory requirements of an acceleration structure.
    ///
    /// # Errors
    /// [`GpuError::MissingExtension`] if the driver has no acceleration structures.
    pub fn accel_sizes(&self, desc: &AccelDesc) -> Result<AccelSizes, GpuError> {
        let calls = self.0.ray_calls()?;
        let (geometry, count, top) = geometry(desc.geometry);
        let geometries = [geometry];
        let info = build_info(desc, top).geometries(&geometries);
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let host = vk::AccelerationStructureBuildTypeKHR::DEVICE;
        // SAFETY: `info` describes one geometry, and there is one count.
        unsafe { calls.accel.get_acceleration_structure_build_sizes(host, &info, &[count], &mut sizes) };
        // Scratch memory may be at any offset of a shared buffer, so room for its alignment is added.
        let align = u64::from(self.0.ray_support.scratch_align);
        Ok(AccelSizes {
            bytes: sizes.acceleration_structure_size,
            build_scratch: sizes.build_scratch_size + align,
            refit_scratch: sizes.update_scratch_size + align,
        })
    }
}

/// A query pool in which the device stores the compacted sizes of structures.
pub struct CompactedSizes {
    gpu: Gpu,
    pool: vk::QueryPool,
}

impl CompactedSizes {
    /// A pool for `count` sizes.
    ///
    /// # Errors
    /// The pool could not be created.
    pub fn new(gpu: &Gpu, count: u32) -> Result<Self, GpuError> {
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR)
            .query_count(count.max(1));
        // SAFETY: the extension is on, else there would be nothing to compact.
        let pool = unsafe { gpu.raw().create_query_pool(&info, None) }.map_err(GpuError::call("vkCreateQueryPool"))?;
        // SAFETY: the pool was just made; hostQueryReset is on.
        unsafe { gpu.raw().reset_query_pool(pool, 0, count.max(1)) };
        Ok(Self { gpu: gpu.clone(), pool })
    }
}

impl Drop for CompactedSizes {
    fn drop(&mut self) {
        // SAFETY: its owner waited for the frame that wrote the sizes.
        unsafe { self.gpu.raw().destroy_query_pool(self.pool, None) };
    }
}

impl CommandEncoder {
    /// Builds `target`, or refits it to its current geometry. `scratch` must have the size that [`Gpu::accel_sizes`] returns.
    pub fn build_accel(&mut self, desc: &AccelDesc, refit: bool, target: &Accel, scratch: Address) {
        let gpu = self.gpu().clone();
        let Some(calls) = &gpu.0.ray_calls else { return };
        let (geometry, count, top) = geometry(desc.geometry);
        let geometries = [geometry];
        let scratch = scratch.get().next_multiple_of(u64::from(gpu.0.ray_support.scratch_align));
        let mut info = build_info(desc, top)
            .geometries(&geometries)
            .dst_acceleration_structure(target.raw)
            .scratch_data(vk::DeviceOrHostAddressKHR { device_address: scratch })
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD);
        if refit {
            info = info.mode(vk::BuildAccelerationStructureModeKHR::UPDATE).src_acceleration_structure(target.raw);
        }
        let ranges = [vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count)];
        // SAFETY: the command buffer is recording outside of rendering; the pass declared what the build reads, writes and works in.
        unsafe { calls.accel.cmd_build_acceleration_structures(self.raw(), &[info], &[&ranges[..]]) };
    }

    /// Writes the compacted sizes to a buffer, as one 64-bit word each.
    pub fn compacted_sizes(&mut self, accels: &[&Accel], sizes: &CompactedSizes, to: BufferAt<'_>) {
        let gpu = self.gpu().clone();
        let Some(calls) = &gpu.0.ray_calls else { return };
        let raw: Vec<_> = accels.iter().map(|a| a.raw).collect();
        let kind = vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR;
        // SAFETY: the structures were built with compaction allowed; the pool was reset and has a place for each.
        unsafe {
            calls.accel.cmd_write_acceleration_structures_properties(self.raw(), &raw, kind, sizes.pool, 0);
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            let count = raw.len() as u32;
            gpu.raw().cmd_copy_query_pool_results(self.raw(), sizes.pool, 0, count, to.buffer.raw, to.offset, 8, flags);
        }
    }

    /// Compacts a structure into one that has the compacted size.
    pub fn compact_accel(&mut self, source: &Accel, target: &Accel) {
        let gpu = self.gpu().clone();
        let Some(calls) = &gpu.0.ray_calls else { return };
        let info = vk::CopyAccelerationStructureInfoKHR::default()
            .src(source.raw)
            .dst(target.raw)
            .mode(vk::CopyAccelerationStructureModeKHR::COMPACT);
        // SAFETY: the command buffer is recording outside of rendering; the target has the size that was asked for.
        unsafe { calls.accel.cmd_copy_acceleration_structure(self.raw(), &info) };
    }
}
