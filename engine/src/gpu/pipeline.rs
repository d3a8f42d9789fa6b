//! Compute and graphics pipelines, described first and made when first used. One layout for all: the bindless set and 128 bytes of push constants.
use super::device::lock;
use super::ray_pipeline::{HIT_SHADERS, RAY_PUSH_BYTES, RayPipeline, RayTable};
use super::reflect::{local_size, push_bytes};
use super::{Blend, Gpu, GpuError, format};
use crate::graph::Format;
use ash::vk::{self, Handle as _};
use magpie_shaders::Shader;
use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::ffi::CStr;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// Push constants that every Vulkan device has, bytes.
pub(crate) const PUSH_BYTES: u32 = 128;

pub(super) const ENTRY: &CStr = c"main";

/// The push constants that a pipeline reads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PushBlock {
    /// Index of the pipeline.
    pub pipeline: u32,
    /// Size of the block; `None` where no shader of the pipeline has one.
    pub bytes: Option<u32>,
}

/// A compute pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kernel {
    pub(super) index: u32,
    /// Threads of one workgroup.
    pub local_size: [u32; 3],
    pub(super) push: Option<u32>,
}

impl Kernel {
    pub(crate) fn push(self) -> PushBlock {
        PushBlock { pipeline: self.index, bytes: self.push }
    }
}

/// A graphics pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RasterKernel {
    pub(super) index: u32,
    push: Option<u32>,
}

impl RasterKernel {
    /// As [`Kernel::push`]: the longer block of its two shaders.
    pub(crate) fn push(self) -> PushBlock {
        PushBlock { pipeline: self.index, bytes: self.push }
    }
}

/// What a graphics pipeline draws with and into. Depth is reversed; culling and winding are set per draw, and the pass says whether depth
/// is written or [only tested against](crate::graph::PassBuilder::depth_test).
#[derive(Clone, Copy, Debug)]
pub struct RasterDesc<'a> {
    /// Name in errors and captures.
    pub name: &'a str,
    /// Vertex shader.
    pub vertex: &'a Shader,
    /// Fragment shader.
    pub fragment: &'a Shader,
    /// Values of the fragment shader's specialization constants, by their ids from 0.
    pub constants: &'a [u32],
    /// Colour attachments, in the order of their locations.
    pub colours: &'a [Format],
    /// How fragments go over what all the colour attachments hold.
    pub blend: Blend,
    /// Depth attachment.
    pub depth: Option<Format>,
}

/// Every pipeline that anybody described. The device makes one when a pass first records it: what never runs is never compiled.
///
/// Descriptions need no device, so that a frame can be planned without one. The same description gives the same id, and ids stay valid as
/// long as this does.
#[derive(Default)]
pub struct Pipelines {
    list: RwLock<Vec<Arc<Entry>>>,
    known: Mutex<HashMap<u64, u32>>,
    /// Shaders that were compiled anew, by the key of what they replace.
    pub(super) replaced: RwLock<Replaced>,
}

/// SPIR-V words by [`Code::key`].
pub(super) type Replaced = HashMap<u64, Arc<[u32]>>;

/// A pipeline: its description, and its handle once it is made.
pub(super) struct Entry {
    pub name: String,
    /// Threads of one workgroup of a compute pipeline.
    pub local_size: [u32; 3],
    /// Bytes of push constants that its shaders read.
    push: Option<u32>,
    /// The handle; null before it is made.
    made: AtomicU64,
    /// Held while it is made.
    making: Mutex<()>,
    request: Request,
}

/// What a pipeline is made from: shaders and state.
enum Request {
    Compute(Code),
    Raster(RasterRequest),
    Rays(Code),
}

/// A shader as it was described.
pub(super) struct Code {
    /// Hash of its name and words.
    pub key: u64,
    spirv: Spirv,
    /// Values of its specialization constants, by their ids from 0.
    pub constants: Vec<u32>,
}

enum Spirv {
    Embedded(&'static [u8]),
    Words(Vec<u32>),
}

/// A pipeline that was just made.
pub(super) struct Made {
    pub pipeline: vk::Pipeline,
    /// The shader binding table of a ray-tracing pipeline.
    pub table: Option<RayTable>,
}

/// [`RasterDesc`], owned.
struct RasterRequest {
    vertex: Code,
    fragment: Code,
    colours: Vec<Format>,
    blend: Blend,
    depth: Option<Format>,
}

impl Pipelines {
    /// The compute pipeline of an embedded shader.
    ///
    /// # Errors
    /// As [`Pipelines::kernel_from_words`].
    pub fn kernel(&self, shader: &Shader) -> Result<Kernel, GpuError> {
        self.compute(shader.name, &words(shader.name, shader.spirv)?, Some(shader), &[])
    }

    /// The compute pipeline of SPIR-V words, such as [`magpie_shaders::compile`] returns.
    ///
    /// # Errors
    /// [`GpuError::Shader`] when no workgroup size is declared, [`GpuError::Limit`] for more than 128 bytes of push constants.
    pub fn kernel_from_words(&self, name: &str, words: &[u32]) -> Result<Kernel, GpuError> {
        self.compute(name, words, None, &[])
    }

    /// A compute pipeline, whose words may be those of an embedded shader. `constants`: values of specialization constants, by their ids from 0.
    pub(super) fn compute(
        &self,
        name: &str,
        words: &[u32],
        of: Option<&Shader>,
        constants: &[u32],
    ) -> Result<Kernel, GpuError> {
        let key = key_of((name, words, constants));
        let entry = self.describe(key, || {
            let local_size = local_size(words).ok_or_else(|| GpuError::Shader {
                name: name.to_owned(),
                reason: "it is no compute shader with a workgroup size".to_owned(),
            })?;
            let push = checked_push(name, words, PUSH_BYTES)?;
            let code = Code::new(name, words, of).specialized(constants);
            Ok(Entry::new(name, local_size, push, Request::Compute(code)))
        });
        entry.map(|(index, entry)| Kernel { index, local_size: entry.local_size, push: entry.push })
    }

    /// A graphics pipeline.
    ///
    /// # Errors
    /// [`GpuError::Shader`] for what is no SPIR-V, [`GpuError::Limit`] for more than 128 bytes of push constants, [`GpuError::Blend`] for
    /// blending into integers. Where the device cannot blend a format, the frame that first records it fails with [`GpuError::Blend`]
    /// too; [`Gpu::blends`] asks.
    pub fn raster_kernel(&self, desc: &RasterDesc<'_>) -> Result<RasterKernel, GpuError> {
        let (shaders, targets) = ((desc.vertex.spirv, desc.fragment.spirv), (desc.colours, desc.blend, desc.depth));
        let entry = self.describe(key_of((desc.name, shaders, desc.constants, targets)), || {
            desc.blend.check_formats(desc.name, desc.colours)?;
            let stage = |shader: &Shader| {
                let words = words(shader.name, shader.spirv)?;
                let push = checked_push(shader.name, &words, PUSH_BYTES)?;
                Ok::<_, GpuError>((push, Code::new(shader.name, &words, Some(shader))))
            };
            let ((vertex_push, vertex), (fragment_push, fragment)) = (stage(desc.vertex)?, stage(desc.fragment)?);
            let fragment = fragment.specialized(desc.constants);
            let request = RasterRequest {
                vertex,
                fragment,
                colours: desc.colours.to_vec(),
                blend: desc.blend,
                depth: desc.depth,
            };
            Ok(Entry::new(desc.name, [0; 3], vertex_push.max(fragment_push), Request::Raster(request)))
        });
        entry.map(|(index, entry)| RasterKernel { index, push: entry.push })
    }

    /// A ray-tracing pipeline with this ray-generation shader, and the values of its specialization constants.
    pub(super) fn ray_pipeline(
        &self,
        name: &str,
        generation: &[u32],
        of: Option<&Shader>,
        constants: &[u32],
    ) -> Result<RayPipeline, GpuError> {
        let key = key_of(("ray pipeline", name, generation, constants));
        let entry = self.describe(key, || {
            let push = checked_push(name, generation, RAY_PUSH_BYTES)?;
            let code = Code::new(name, generation, of).specialized(constants);
            Ok(Entry::new(name, [0; 3], push, Request::Rays(code)))
        });
        entry.map(|(index, entry)| RayPipeline { index, push: entry.push })
    }

    /// Names of the pipelines that the device has made so far, in the order in which they were described.
    #[must_use]
    pub fn made(&self) -> Vec<String> {
        let list = self.list.read().unwrap_or_else(PoisonError::into_inner);
        list.iter().filter(|entry| entry.is_made()).map(|entry| entry.name.clone()).collect()
    }

    /// The entry of a description, and its index.
    fn describe(&self, key: u64, new: impl FnOnce() -> Result<Entry, GpuError>) -> Result<(u32, Arc<Entry>), GpuError> {
        let mut known = lock(&self.known);
        if let Some(index) = known.get(&key) {
            return Ok((*index, self.entry(*index)?));
        }
        let entry = Arc::new(new()?);
        let mut list = self.list.write().unwrap_or_else(PoisonError::into_inner);
        list.push(entry.clone());
        let index = list.len() as u32 - 1;
        known.insert(key, index);
        Ok((index, entry))
    }

    /// All entries, in the order of their indices.
    pub(super) fn entries(&self) -> Vec<Arc<Entry>> {
        self.list.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn entry(&self, index: u32) -> Result<Arc<Entry>, GpuError> {
        let list = self.list.read().unwrap_or_else(PoisonError::into_inner);
        let unknown = || GpuError::Shader { name: format!("pipeline {index}"), reason: "of another device".to_owned() };
        list.get(index as usize).cloned().ok_or_else(unknown)
    }

    /// The handle of a pipeline that was made; null before.
    pub(super) fn get(&self, index: u32) -> vk::Pipeline {
        self.entry(index).map(|entry| entry.get()).unwrap_or_default()
    }

    pub(super) fn name(&self, index: u32) -> String {
        self.entry(index).map(|entry| entry.name.clone()).unwrap_or_default()
    }

    /// # Safety
    /// The device is idle and no id is used again.
    pub(super) unsafe fn destroy(&self, device: &ash::Device) {
        for entry in self.list.write().unwrap_or_else(PoisonError::into_inner).drain(..) {
            // SAFETY: by this function's contract; null is ignored.
            unsafe { device.destroy_pipeline(entry.get(), None) };
        }
    }
}

impl fmt::Debug for Pipelines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pipelines").field("made", &self.made()).finish_non_exhaustive()
    }
}

impl Entry {
    fn new(name: &str, local_size: [u32; 3], push: Option<u32>, request: Request) -> Self {
        Self { name: name.to_owned(), local_size, push, made: AtomicU64::new(0), making: Mutex::default(), request }
    }

    fn get(&self) -> vk::Pipeline {
        vk::Pipeline::from_raw(self.made.load(Ordering::Acquire))
    }

    pub(super) fn is_made(&self) -> bool {
        self.get() != vk::Pipeline::null()
    }

    /// Sets the handle, and returns the one before.
    pub(super) fn set(&self, pipeline: vk::Pipeline) -> vk::Pipeline {
        vk::Pipeline::from_raw(self.made.swap(pipeline.as_raw(), Ordering::AcqRel))
    }

    /// Whether the pipeline has one of these shaders in it.
    pub(super) fn uses(&self, shaders: &Replaced) -> bool {
        match &self.request {
            Request::Compute(code) => shaders.contains_key(&code.key),
            Request::Raster(desc) => [&desc.vertex, &desc.fragment].iter().any(|code| shaders.contains_key(&code.key)),
            Request::Rays(code) => {
                let hits = || HIT_SHADERS.iter().filter_map(|(shader, _)| Code::embedded(shader).ok());
                shaders.contains_key(&code.key) || hits().any(|code| shaders.contains_key(&code.key))
            }
        }
    }
}

impl Code {
    /// The shader with these words, which are those of `of` where it is given.
    fn new(name: &str, words: &[u32], of: Option<&Shader>) -> Self {
        let spirv = of.map_or_else(|| Spirv::Words(words.to_vec()), |shader| Spirv::Embedded(shader.spirv));
        Self { key: key_of((name, words)), spirv, constants: Vec::new() }
    }

    fn specialized(self, constants: &[u32]) -> Self {
        Self { constants: constants.to_vec(), ..self }
    }

    /// Where each constant is among the values.
    pub(super) fn constant_map(&self) -> Vec<vk::SpecializationMapEntry> {
        let entry = |id| vk::SpecializationMapEntry { constant_id: id, offset: 4 * id, size: 4 };
        (0..self.constants.len() as u32).map(entry).collect()
    }

    pub(super) fn embedded(shader: &Shader) -> Result<Self, GpuError> {
        Ok(Self::new(shader.name, &words(shader.name, shader.spirv)?, Some(shader)))
    }

    /// The words, or those that replace them.
    pub(super) fn words(&self, replaced: &Replaced) -> Result<Arc<[u32]>, GpuError> {
        match (replaced.get(&self.key), &self.spirv) {
            (Some(words), _) => Ok(words.clone()),
            (None, Spirv::Words(words)) => Ok(words.as_slice().into()),
            (None, Spirv::Embedded(bytes)) => Ok(words("embedded shader", bytes)?.into()),
        }
    }
}

/// One layout for all: the bindless set, and 128 bytes of push constants for every stage.
pub(super) fn pipeline_layout(
    device: &ash::Device,
    set: vk::DescriptorSetLayout,
) -> Result<vk::PipelineLayout, GpuError> {
    let sets = [set];
    let push = [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::ALL, offset: 0, size: PUSH_BYTES }];
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
    // SAFETY: all pointers outlive the call.
    unsafe { device.create_pipeline_layout(&info, None) }.map_err(GpuError::call("vkCreatePipelineLayout"))
}

pub(super) fn key_of(parts: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    parts.hash(&mut hasher);
    hasher.finish()
}

/// SPIR-V bytes as words.
pub(super) fn words(name: &str, bytes: &[u8]) -> Result<Vec<u32>, GpuError> {
    ash::util::read_spv(&mut std::io::Cursor::new(bytes))
        .map_err(|e| GpuError::Shader { name: name.to_owned(), reason: e.to_string() })
}

/// Bytes of push constants that a shader reads, at most `most`.
pub(super) fn checked_push(name: &str, words: &[u32], most: u32) -> Result<Option<u32>, GpuError> {
    let bytes = push_bytes(words);
    match bytes.filter(|b| *b > most) {
        None => Ok(bytes),
        Some(wanted) => {
            let what = format!("bytes of push constants of {name}");
            Err(GpuError::Limit { what, wanted: wanted.into(), limit: most.into() })
        }
    }
}

impl Gpu {
    /// The pipelines that were described for this device.
    #[must_use]
    pub fn pipelines(&self) -> &Arc<Pipelines> {
        &self.0.pipelines
    }

    /// As [`Pipelines::kernel`].
    ///
    /// # Errors
    /// As there.
    pub fn kernel(&self, shader: &Shader) -> Result<Kernel, GpuError> {
        self.0.pipelines.kernel(shader)
    }

    /// As [`Pipelines::kernel_from_words`].
    ///
    /// # Errors
    /// As there.
    pub fn kernel_from_words(&self, name: &str, words: &[u32]) -> Result<Kernel, GpuError> {
        self.0.pipelines.kernel_from_words(name, words)
    }

    /// As [`Pipelines::raster_kernel`].
    ///
    /// # Errors
    /// As there.
    pub fn raster_kernel(&self, desc: &RasterDesc<'_>) -> Result<RasterKernel, GpuError> {
        self.0.pipelines.raster_kernel(desc)
    }

    /// Makes a pipeline, unless it is made already. A second thread that wants the same one waits.
    pub(crate) fn make_pipeline(&self, index: u32) -> Result<(), GpuError> {
        let pipelines = &self.0.pipelines;
        let entry = pipelines.entry(index)?;
        if entry.is_made() {
            return Ok(());
        }
        let _making = lock(&entry.making);
        if !entry.is_made() {
            // Held until the pipeline is set: a reload that comes between finds it and makes it anew.
            let replaced = pipelines.replaced.read().unwrap_or_else(PoisonError::into_inner);
            let Made { pipeline, table } = self.build_pipeline(&entry, &replaced)?;
            table.into_iter().for_each(|table| drop(self.0.ray_tables.replace(index, table)));
            entry.set(pipeline);
        }
        Ok(())
    }

    /// Makes the pipeline of an entry, with these shaders in the place of those that it was described with.
    pub(super) fn build_pipeline(&self, entry: &Entry, replaced: &Replaced) -> Result<Made, GpuError> {
        let made = match &entry.request {
            Request::Compute(code) => Made { pipeline: self.compute_pipeline(code, replaced)?, table: None },
            Request::Raster(desc) => {
                self.check_blend(&entry.name, desc.blend, &desc.colours)?;
                Made { pipeline: self.raster_pipeline(desc, replaced)?, table: None }
            }
            Request::Rays(generation) => self.make_ray_pipeline(&entry.name, generation, replaced)?,
        };
        self.name_object(made.pipeline, &entry.name);
        Ok(made)
    }

    fn compute_pipeline(&self, code: &Code, replaced: &Replaced) -> Result<vk::Pipeline, GpuError> {
        let module = self.module(&code.words(replaced)?)?;
        let map = code.constant_map();
        let constants = vk::SpecializationInfo::default().map_entries(&map).data(bytemuck::cast_slice(&code.constants));
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(ENTRY)
            .specialization_info(&constants);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.0.pipeline_layout);
        // SAFETY: module and layout are alive; the module goes after the call, as the specification allows.
        let made = unsafe {
            let made = self.raw().create_compute_pipelines(self.cache(), &[info], None);
            self.raw().destroy_shader_module(module, None);
            made
        };
        Ok(made.map_err(|(_, e)| GpuError::call("vkCreateComputePipelines")(e))?[0])
    }

    fn raster_pipeline(&self, desc: &RasterRequest, replaced: &Replaced) -> Result<vk::Pipeline, GpuError> {
        let (vertex, fragment) = (desc.vertex.words(replaced)?, desc.fragment.words(replaced)?);
        let vertex = self.module(&vertex)?;
        let fragment = match self.module(&fragment) {
            Ok(m) => m,
            Err(e) => {
                // SAFETY: the module was just made and nothing uses it.
                unsafe { self.raw().destroy_shader_module(vertex, None) };
                return Err(e);
            }
        };
        let map = desc.fragment.constant_map();
        let constants =
            vk::SpecializationInfo::default().map_entries(&map).data(bytemuck::cast_slice(&desc.fragment.constants));
        let stage = |flag, module| vk::PipelineShaderStageCreateInfo::default().stage(flag).module(module).name(ENTRY);
        let stages = [
            stage(vk::ShaderStageFlags::VERTEX, vertex),
            stage(vk::ShaderStageFlags::FRAGMENT, fragment).specialization_info(&constants),
        ];
        let vertex_input = vk::PipelineVertexInputStateCreateInfo::default();
        let assembly =
            vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let multisample =
            vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(desc.depth.is_some())
            .depth_compare_op(vk::CompareOp::GREATER);
        let blends = vec![desc.blend.vulkan(); desc.colours.len()];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
        let states = [
            vk::DynamicState::VIEWPORT,
            vk::DynamicState::SCISSOR,
            vk::DynamicState::CULL_MODE,
            vk::DynamicState::FRONT_FACE,
            vk::DynamicState::DEPTH_WRITE_ENABLE,
        ];
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&states);
        let colours: Vec<_> = desc.colours.iter().map(|f| format::vulkan(*f)).collect();
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .color_attachment_formats(&colours)
            .depth_attachment_format(desc.depth.map_or(vk::Format::UNDEFINED, format::vulkan));
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&vertex_input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&rasterization)
            .multisample_state(&multisample)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(self.0.pipeline_layout)
            .push_next(&mut rendering);
        // SAFETY: every pointer in `info` outlives the call; the modules go after it, as the specification allows.
        let made = unsafe {
            let made = self.raw().create_graphics_pipelines(self.cache(), &[info], None);
            self.raw().destroy_shader_module(vertex, None);
            self.raw().destroy_shader_module(fragment, None);
            made
        };
        Ok(made.map_err(|(_, e)| GpuError::call("vkCreateGraphicsPipelines")(e))?[0])
    }

    pub(super) fn module(&self, words: &[u32]) -> Result<vk::ShaderModule, GpuError> {
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: glslang wrote these words, or `read_spv` checked their magic number.
        unsafe { self.raw().create_shader_module(&info, None) }.map_err(GpuError::call("vkCreateShaderModule"))
    }
}
