//! Kernels of ray passes: compute pipelines, or ray-tracing pipelines with their shader binding tables.
use super::device::lock;
use super::pipeline::{Code, ENTRY, Made, PUSH_BYTES, Pipelines, Replaced, words};
use super::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel, PushBlock};
use ash::vk;
use gpu_allocator::vulkan::Allocation;
use magpie_shaders::{RAY_ALPHA_RAHIT, RAY_HIT_RCHIT, RAY_MISS_RMISS, RAY_SPHERE_RINT, RayShader, Rays, Shader};
use std::collections::HashMap;
use std::sync::Mutex;

/// The pipeline of a ray pass, for one way to trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayKernel {
    /// A compute shader: it walks Magpie's own tree, or asks ray queries.
    Compute(Kernel),
    /// A ray-generation shader with the hit and miss shaders of the folder `ray`.
    Pipeline(RayPipeline),
}

impl RayKernel {
    /// Threads of one workgroup; a pipeline has none, and one thread at a time.
    pub fn local_size(self) -> [u32; 3] {
        match self {
            Self::Compute(kernel) => kernel.local_size,
            Self::Pipeline(_) => [1; 3],
        }
    }
}

/// A ray-tracing pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RayPipeline {
    pub(super) index: u32,
    pub(super) push: Option<u32>,
}

impl RayPipeline {
    /// As [`Kernel::push`]: the block of the ray-generation shader.
    pub(crate) fn push(self) -> PushBlock {
        PushBlock { pipeline: self.index, bytes: self.push }
    }
}

/// Push constants that a ray pass has for itself, bytes: behind them stands the root of the scene's tables.
pub(crate) const RAY_PUSH_BYTES: u32 = PUSH_BYTES - 8;

/// Hit group of triangles in every pipeline, as instances name it.
pub const TRIANGLE_GROUP: u32 = 0;
/// Hit group of spheres.
pub const SPHERE_GROUP: u32 = 1;

/// The shader binding tables of ray-tracing pipelines, by the index of the pipeline.
#[derive(Default)]
pub(super) struct RayTables(Mutex<HashMap<u32, RayTable>>);

/// One shader of each kind in the table: ray generation, miss; two hit groups.
pub(super) struct RayTable {
    /// As long as the device: a [`Buffer`] would keep the device alive that keeps it.
    memory: Option<(vk::Buffer, Allocation)>,
    regions: [vk::StridedDeviceAddressRegionKHR; 3],
}

impl RayTables {
    /// The memory of all, to be freed.
    pub fn take(&self) -> Vec<(vk::Buffer, Allocation)> {
        lock(&self.0).drain().filter_map(|(_, table)| table.memory).collect()
    }

    /// Sets the table of a pipeline, and returns the memory of the one before.
    pub fn replace(&self, index: u32, table: RayTable) -> Option<(vk::Buffer, Allocation)> {
        lock(&self.0).insert(index, table)?.memory
    }
}

impl RayTable {
    /// Its memory, to be freed.
    pub fn into_memory(self) -> Option<(vk::Buffer, Allocation)> {
        self.memory
    }
}

/// The shaders that every pipeline has behind its ray-generation shader, in the order of their indices.
pub(super) static HIT_SHADERS: [(&Shader, vk::ShaderStageFlags); 4] = [
    (&RAY_MISS_RMISS, vk::ShaderStageFlags::MISS_KHR),
    (&RAY_HIT_RCHIT, vk::ShaderStageFlags::CLOSEST_HIT_KHR),
    (&RAY_ALPHA_RAHIT, vk::ShaderStageFlags::ANY_HIT_KHR),
    (&RAY_SPHERE_RINT, vk::ShaderStageFlags::INTERSECTION_KHR),
];

// Stages of a pipeline, by index.
const GENERATION: u32 = 0;
const MISS: u32 = 1;
const CLOSEST_HIT: u32 = 2;
const ANY_HIT: u32 = 3;
const INTERSECTION: u32 = 4;

impl Pipelines {
    /// The pipeline of a ray pass, for one way to trace.
    ///
    /// # Errors
    /// As [`Pipelines::kernel_from_words`]; the limit of ray-tracing pipelines is 120 bytes of push constants.
    pub fn ray_kernel(&self, shader: &RayShader, rays: Rays) -> Result<RayKernel, GpuError> {
        self.ray_variant(shader, rays, &[])
    }

    /// The same with values of the shader's specialization constants, by their ids from 0.
    ///
    /// # Errors
    /// As [`Pipelines::ray_kernel`].
    pub fn ray_variant(&self, shader: &RayShader, rays: Rays, constants: &[u32]) -> Result<RayKernel, GpuError> {
        let shader = shader.way(rays);
        self.rays(shader.name, &words(shader.name, shader.spirv)?, rays, Some(shader), constants)
    }

    /// The pipeline of a ray pass from SPIR-V words, such as [`magpie_shaders::compile_rays`] returns for the same way.
    ///
    /// # Errors
    /// As [`Pipelines::ray_kernel`].
    pub fn ray_kernel_from_words(&self, name: &str, words: &[u32], rays: Rays) -> Result<RayKernel, GpuError> {
        self.rays(name, words, rays, None, &[])
    }

    fn rays(
        &self,
        name: &str,
        words: &[u32],
        rays: Rays,
        of: Option<&Shader>,
        constants: &[u32],
    ) -> Result<RayKernel, GpuError> {
        match rays {
            Rays::Software | Rays::Query => Ok(RayKernel::Compute(self.compute(name, words, of, constants)?)),
            Rays::Pipeline => Ok(RayKernel::Pipeline(self.ray_pipeline(name, words, of, constants)?)),
        }
    }
}

impl Gpu {
    /// As [`Pipelines::ray_kernel`].
    ///
    /// # Errors
    /// As there, and [`GpuError::Rays`] where the device cannot trace in this way.
    pub fn ray_kernel(&self, shader: &RayShader, rays: Rays) -> Result<RayKernel, GpuError> {
        self.ray_variant(shader, rays, &[])
    }

    /// As [`Pipelines::ray_variant`].
    ///
    /// # Errors
    /// As [`Gpu::ray_kernel`].
    pub fn ray_variant(&self, shader: &RayShader, rays: Rays, constants: &[u32]) -> Result<RayKernel, GpuError> {
        self.check_rays(rays)?;
        self.0.pipelines.ray_variant(shader, rays, constants)
    }

    /// As [`Pipelines::ray_kernel_from_words`].
    ///
    /// # Errors
    /// As [`Gpu::ray_kernel`].
    pub fn ray_kernel_from_words(&self, name: &str, words: &[u32], rays: Rays) -> Result<RayKernel, GpuError> {
        self.check_rays(rays)?;
        self.0.pipelines.ray_kernel_from_words(name, words, rays)
    }

    /// Whether the device can trace in this way.
    ///
    /// # Errors
    /// [`GpuError::Rays`] where it cannot.
    pub fn check_rays(&self, rays: Rays) -> Result<(), GpuError> {
        let ways = self.rays();
        if ways.contains(&rays) {
            return Ok(());
        }
        let known = ways.iter().map(|w| w.name()).collect();
        Err(GpuError::Rays { device: self.report().name.clone(), wanted: rays.name(), known })
    }

    /// Makes a ray-tracing pipeline and its shader binding table.
    pub(super) fn make_ray_pipeline(
        &self,
        name: &str,
        generation: &Code,
        replaced: &Replaced,
    ) -> Result<Made, GpuError> {
        let calls = self.0.ray_calls()?;
        let missing =
            || GpuError::MissingExtension { name: "VK_KHR_ray_tracing_pipeline", needed_for: "ray pipelines" };
        let calls = calls.pipeline.as_ref().ok_or_else(missing)?;

        // Stages, in the order of their indices.
        let mut modules = Modules { gpu: self, list: Vec::new() };
        let map = generation.constant_map();
        let constants =
            vk::SpecializationInfo::default().map_entries(&map).data(bytemuck::cast_slice(&generation.constants));
        let first = modules.stage(&generation.words(replaced)?, vk::ShaderStageFlags::RAYGEN_KHR)?;
        let mut stages = vec![first.specialization_info(&constants)];
        for (shader, stage) in HIT_SHADERS {
            stages.push(modules.stage(&Code::embedded(shader)?.words(replaced)?, stage)?);
        }

        // Groups.
        let group = |kind| {
            vk::RayTracingShaderGroupCreateInfoKHR::default()
                .ty(kind)
                .general_shader(vk::SHADER_UNUSED_KHR)
                .closest_hit_shader(vk::SHADER_UNUSED_KHR)
                .any_hit_shader(vk::SHADER_UNUSED_KHR)
                .intersection_shader(vk::SHADER_UNUSED_KHR)
        };
        let general = |stage| group(vk::RayTracingShaderGroupTypeKHR::GENERAL).general_shader(stage);
        let hits = |kind| group(kind).closest_hit_shader(CLOSEST_HIT);
        let groups = [
            general(GENERATION),
            general(MISS),
            hits(vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP).any_hit_shader(ANY_HIT),
            hits(vk::RayTracingShaderGroupTypeKHR::PROCEDURAL_HIT_GROUP).intersection_shader(INTERSECTION),
        ];
        let info = vk::RayTracingPipelineCreateInfoKHR::default()
            .stages(&stages)
            .groups(&groups)
            .max_pipeline_ray_recursion_depth(1)
            .layout(self.0.pipeline_layout);
        // SAFETY: every pointer in `info` outlives the call; the modules go after it, as the specification allows.
        let made = unsafe {
            calls.create_ray_tracing_pipelines(vk::DeferredOperationKHR::null(), self.cache(), &[info], None)
        };
        drop(modules);
        let pipeline = made.map_err(|(_, e)| GpuError::call("vkCreateRayTracingPipelinesKHR")(e))?[0];
        match self.ray_table(calls, pipeline, name) {
            Ok(table) => Ok(Made { pipeline, table: Some(table) }),
            Err(error) => {
                // SAFETY: the pipeline was just made and nothing uses it.
                unsafe { self.raw().destroy_pipeline(pipeline, None) };
                Err(error)
            }
        }
    }

    /// Handles of the groups in memory: ray generation, miss, and the hit groups, each region at an aligned address.
    fn ray_table(
        &self,
        calls: &ash::khr::ray_tracing_pipeline::Device,
        pipeline: vk::Pipeline,
        name: &str,
    ) -> Result<RayTable, GpuError> {
        const GROUPS: [u64; 3] = [1, 1, 2];
        let support = &self.0.ray_support;
        let handle = u64::from(support.handle_bytes);
        let (stride, base) = (handle.next_multiple_of(u64::from(support.handle_align)), u64::from(support.base_align));
        let count = GROUPS.iter().sum::<u64>();
        // SAFETY: the pipeline has this many groups, and the answer this many handles.
        let handles =
            unsafe { calls.get_ray_tracing_shader_group_handles(pipeline, 0, count as u32, (count * handle) as usize) }
                .map_err(GpuError::call("vkGetRayTracingShaderGroupHandlesKHR"))?;
        let sizes = GROUPS.map(|groups| (groups * stride).next_multiple_of(base));
        let bytes = sizes.iter().sum::<u64>() + base;
        let mut memory = Buffer::new(self, name, bytes, BufferMemory::Upload, BufferUse::Storage)?;
        let start = memory.address().get();
        let mut offset = start.next_multiple_of(base) - start;
        let mut regions = [vk::StridedDeviceAddressRegionKHR::default(); 3];
        let mut first = 0;
        for ((groups, size), region) in GROUPS.into_iter().zip(sizes).zip(&mut regions) {
            for group in 0..groups {
                let from = ((first + group) * handle) as usize;
                memory.write(offset + group * stride, &handles[from..from + handle as usize])?;
            }
            // The region of the ray-generation shader has one entry, whose stride is its size.
            let stride = if first == 0 { size } else { stride };
            *region = vk::StridedDeviceAddressRegionKHR { device_address: start + offset, stride, size };
            offset += size;
            first += groups;
        }
        Ok(RayTable { memory: memory.into_parts(), regions })
    }
}

/// Shader modules that go when the pipeline is made, or could not be made.
struct Modules<'a> {
    gpu: &'a Gpu,
    list: Vec<vk::ShaderModule>,
}

impl Modules<'_> {
    fn stage(
        &mut self,
        words: &[u32],
        stage: vk::ShaderStageFlags,
    ) -> Result<vk::PipelineShaderStageCreateInfo<'static>, GpuError> {
        let module = self.gpu.module(words)?;
        self.list.push(module);
        Ok(vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module).name(ENTRY))
    }
}

impl Drop for Modules<'_> {
    fn drop(&mut self) {
        for module in self.list.drain(..) {
            // SAFETY: pipelines keep what they need of their modules.
            unsafe { self.gpu.raw().destroy_shader_module(module, None) };
        }
    }
}

impl super::CommandEncoder {
    /// Traces with one ray-generation shader per element of `size`. `scene` is the root of the scene's tables, for the hit shaders.
    pub fn trace_rays(&mut self, pipeline: RayPipeline, params: &[u8], scene: magpie_shaders::Address, size: [u32; 3]) {
        let gpu = self.gpu().clone();
        let (calls, regions) = self.begin_trace(&gpu, pipeline, params, scene);
        let Some(calls) = calls else { return };
        let [generation, miss, hit] = &regions;
        let none = vk::StridedDeviceAddressRegionKHR::default();
        // SAFETY: the command buffer is recording outside of rendering, with pipeline and bindless set bound; the regions are those
        // of the pipeline's own table.
        unsafe { calls.cmd_trace_rays(self.raw(), generation, miss, hit, &none, size[0], size[1], size[2]) };
    }

    /// The same with a size of three words at an address.
    pub fn trace_rays_indirect(
        &mut self,
        pipeline: RayPipeline,
        params: &[u8],
        scene: magpie_shaders::Address,
        size: magpie_shaders::Address,
    ) {
        let gpu = self.gpu().clone();
        let (calls, regions) = self.begin_trace(&gpu, pipeline, params, scene);
        let Some(calls) = calls else { return };
        let none = vk::StridedDeviceAddressRegionKHR::default();
        let [generation, miss, hit] = &regions;
        // SAFETY: as above; the caller keeps the words inside of their buffer.
        unsafe { calls.cmd_trace_rays_indirect(self.raw(), generation, miss, hit, &none, size.get()) };
    }

    fn begin_trace<'a>(
        &mut self,
        gpu: &'a Gpu,
        pipeline: RayPipeline,
        params: &[u8],
        scene: magpie_shaders::Address,
    ) -> (Option<&'a ash::khr::ray_tracing_pipeline::Device>, [vk::StridedDeviceAddressRegionKHR; 3]) {
        self.bind_pipeline(pipeline.index, vk::PipelineBindPoint::RAY_TRACING_KHR);
        self.push_rays(params, scene);
        let regions = lock(&gpu.0.ray_tables.0).get(&pipeline.index).map(|t| t.regions).unwrap_or_default();
        (gpu.0.ray_calls.as_ref().and_then(|c| c.pipeline.as_ref()), regions)
    }
}
