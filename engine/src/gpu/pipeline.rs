//! Compute and graphics pipelines. One layout for all: the bindless set and 128 bytes of push constants.
use super::device::lock;
use super::reflect::{local_size, push_bytes};
use super::{Gpu, GpuError, format};
use crate::graph::Format;
use ash::vk;
use magpie_shaders::Shader;
use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::ffi::CStr;
use std::hash::{Hash, Hasher};
use std::sync::Mutex;

/// Push constants that every Vulkan device has, bytes.
pub(crate) const PUSH_BYTES: u32 = 128;

pub(super) const ENTRY: &CStr = c"main";

/// A compute pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kernel {
    pub(super) index: u32,
    /// Threads of one workgroup.
    pub local_size: [u32; 3],
    pub(super) push: Option<u32>,
}

impl Kernel {
    /// Which pipeline it is, and the bytes of push constants that its shader reads; `None` where it reads none.
    pub(crate) fn push(self) -> (u32, Option<u32>) {
        (self.index, self.push)
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
    pub(crate) fn push(self) -> (u32, Option<u32>) {
        (self.index, self.push)
    }
}

/// What a graphics pipeline draws with and into. Depth is reversed; culling and winding are set per draw.
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
    /// Depth attachment.
    pub depth: Option<Format>,
}

/// Pipelines live as long as the device: ids stay valid, and the same request gives the same id.
pub(super) struct Pipelines {
    pub layout: vk::PipelineLayout,
    list: Mutex<Vec<(vk::Pipeline, String)>>,
    known: Mutex<HashMap<u64, Made>>,
}

/// A pipeline that was made.
#[derive(Clone, Copy)]
pub(super) struct Made {
    pub index: u32,
    /// Threads of one workgroup of a compute pipeline; of one for rays, the place of its table first.
    pub numbers: [u32; 3],
    /// Bytes of push constants that its shaders read.
    pub push: Option<u32>,
}

impl Pipelines {
    pub fn new(device: &ash::Device, set: vk::DescriptorSetLayout) -> Result<Self, GpuError> {
        let sets = [set];
        let push = [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::ALL, offset: 0, size: PUSH_BYTES }];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
        // SAFETY: all pointers outlive the call.
        let layout =
            unsafe { device.create_pipeline_layout(&info, None) }.map_err(GpuError::call("vkCreatePipelineLayout"))?;
        Ok(Self { layout, list: Mutex::default(), known: Mutex::default() })
    }

    pub fn get(&self, index: u32) -> vk::Pipeline {
        lock(&self.list).get(index as usize).map(|(pipeline, _)| *pipeline).unwrap_or_default()
    }

    pub fn name(&self, index: u32) -> String {
        lock(&self.list).get(index as usize).map(|(_, name)| name.clone()).unwrap_or_default()
    }

    /// The pipeline of a request that was made before.
    pub fn known(&self, key: u64) -> Option<Made> {
        lock(&self.known).get(&key).copied()
    }

    pub fn add(&self, key: u64, (pipeline, name): (vk::Pipeline, &str), numbers: [u32; 3], push: Option<u32>) -> Made {
        let mut list = lock(&self.list);
        list.push((pipeline, name.to_owned()));
        let made = Made { index: list.len() as u32 - 1, numbers, push };
        lock(&self.known).insert(key, made);
        made
    }

    /// # Safety
    /// The device is idle and no id is used again.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: by this function's contract.
        unsafe {
            for (pipeline, _) in lock(&self.list).drain(..) {
                device.destroy_pipeline(pipeline, None);
            }
            device.destroy_pipeline_layout(self.layout, None);
        }
    }
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
    /// The compute pipeline of an embedded shader.
    ///
    /// # Errors
    /// [`GpuError::Shader`] and failing calls.
    pub fn kernel(&self, shader: &Shader) -> Result<Kernel, GpuError> {
        self.kernel_from_words(shader.name, &words(shader.name, shader.spirv)?)
    }

    /// The compute pipeline of SPIR-V words, such as [`magpie_shaders::compile`] returns.
    ///
    /// # Errors
    /// [`GpuError::Shader`] when no workgroup size is declared, [`GpuError::Limit`] for more than 128 bytes of push constants, and failing
    /// calls.
    pub fn kernel_from_words(&self, name: &str, words: &[u32]) -> Result<Kernel, GpuError> {
        let key = key_of((name, words));
        let of = |made: Made| Kernel { index: made.index, local_size: made.numbers, push: made.push };
        if let Some(made) = self.0.pipelines.known(key) {
            return Ok(of(made));
        }
        let local_size = local_size(words).ok_or_else(|| GpuError::Shader {
            name: name.to_owned(),
            reason: "it is no compute shader with a workgroup size".to_owned(),
        })?;
        let push = checked_push(name, words, PUSH_BYTES)?;
        let module = self.module(words)?;
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(ENTRY);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.0.pipelines.layout);
        // SAFETY: module and layout are alive; the module goes after the call, as the specification allows.
        let made = unsafe {
            let made = self.raw().create_compute_pipelines(self.cache(), &[info], None);
            self.raw().destroy_shader_module(module, None);
            made
        };
        let pipeline = made.map_err(|(_, e)| GpuError::call("vkCreateComputePipelines")(e))?[0];
        self.name_object(pipeline, name);
        Ok(of(self.0.pipelines.add(key, (pipeline, name), local_size, push)))
    }

    /// A graphics pipeline.
    ///
    /// # Errors
    /// [`GpuError::Shader`] and failing calls.
    pub fn raster_kernel(&self, desc: &RasterDesc<'_>) -> Result<RasterKernel, GpuError> {
        let key = key_of((desc.name, desc.vertex.spirv, desc.fragment.spirv, desc.constants, desc.colours, desc.depth));
        if let Some(Made { index, push, .. }) = self.0.pipelines.known(key) {
            return Ok(RasterKernel { index, push });
        }
        let (vertex, fragment) =
            (words(desc.vertex.name, desc.vertex.spirv)?, words(desc.fragment.name, desc.fragment.spirv)?);
        let push = checked_push(desc.vertex.name, &vertex, PUSH_BYTES)?.max(checked_push(
            desc.fragment.name,
            &fragment,
            PUSH_BYTES,
        )?);
        let vertex = self.module(&vertex)?;
        let fragment = match self.module(&fragment) {
            Ok(m) => m,
            Err(e) => {
                // SAFETY: the module was just made and nothing uses it.
                unsafe { self.raw().destroy_shader_module(vertex, None) };
                return Err(e);
            }
        };
        let entries: Vec<_> = (0..desc.constants.len() as u32)
            .map(|id| vk::SpecializationMapEntry { constant_id: id, offset: 4 * id, size: 4 })
            .collect();
        let constants =
            vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(desc.constants));
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
            .depth_write_enable(desc.depth.is_some())
            .depth_compare_op(vk::CompareOp::GREATER);
        let blends: Vec<_> = desc
            .colours
            .iter()
            .map(|_| vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA))
            .collect();
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
        let states = [
            vk::DynamicState::VIEWPORT,
            vk::DynamicState::SCISSOR,
            vk::DynamicState::CULL_MODE,
            vk::DynamicState::FRONT_FACE,
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
            .layout(self.0.pipelines.layout)
            .push_next(&mut rendering);
        // SAFETY: every pointer in `info` outlives the call; the modules go after it, as the specification allows.
        let made = unsafe {
            let made = self.raw().create_graphics_pipelines(self.cache(), &[info], None);
            self.raw().destroy_shader_module(vertex, None);
            self.raw().destroy_shader_module(fragment, None);
            made
        };
        let pipeline = made.map_err(|(_, e)| GpuError::call("vkCreateGraphicsPipelines")(e))?[0];
        self.name_object(pipeline, desc.name);
        let Made { index, push, .. } = self.0.pipelines.add(key, (pipeline, desc.name), [0; 3], push);
        Ok(RasterKernel { index, push })
    }

    pub(super) fn module(&self, words: &[u32]) -> Result<vk::ShaderModule, GpuError> {
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: glslang wrote these words, or `read_spv` checked their magic number.
        unsafe { self.raw().create_shader_module(&info, None) }.map_err(GpuError::call("vkCreateShaderModule"))
    }
}
