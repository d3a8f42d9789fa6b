//! What the constructor of an effect gets: the pipelines of a device, or, where a frame is only planned, descriptions of them.

use magpie_shaders::{RayShader, Rays, SamplerId, Shader};

use super::SlotError;
use crate::{
    gpu::{Gpu, GpuError, Indexed, Kernel, PipelineSet, Pipelines, RasterDesc, RasterKernel, RayKernel},
    graph::Format,
    scene::{Sampler, Wrap},
};

/// What the constructor of an effect gets. Pipelines are described here, and made when a pass first records one: describe all that the
/// settings allow, and let [`Effect::add`](super::Effect::add) choose.
#[derive(Clone, Copy, Debug)]
pub struct Build<'a> {
    pipelines: &'a Pipelines,
    gpu: Option<&'a Gpu>,
    described: Option<&'a PipelineSet>,
    /// How rays are traced.
    pub rays: Rays,
}

impl<'a> Build<'a> {
    /// For frames that run on a device.
    #[must_use]
    pub fn new(gpu: &'a Gpu, rays: Rays) -> Self {
        Self { pipelines: gpu.pipelines(), gpu: Some(gpu), described: None, rays }
    }

    /// For frames that are declared and planned, but do not run. There is no device.
    #[must_use]
    pub fn without_device(pipelines: &'a Pipelines, rays: Rays) -> Self {
        Self { pipelines, gpu: None, described: None, rays }
    }

    /// The same, and every pipeline that is described with it is added to `set`.
    #[must_use]
    pub fn noting(self, set: &'a PipelineSet) -> Self {
        Self { described: Some(set), ..self }
    }

    fn note<K: Indexed>(&self, kernel: Result<K, GpuError>) -> Result<K, SlotError> {
        let kernel = kernel.map_err(SlotError::other)?;
        self.described.into_iter().for_each(|set| set.add(kernel));
        Ok(kernel)
    }

    /// The device, for effects that cannot be made without one.
    ///
    /// # Errors
    /// [`SlotError::NoDevice`] where a frame is only planned.
    pub fn gpu(&self) -> Result<&'a Gpu, SlotError> {
        self.gpu.ok_or(SlotError::NoDevice)
    }

    /// The compute pipeline of an embedded shader.
    ///
    /// # Errors
    /// [`SlotError::Other`] where the shader is faulty: [`Pipelines::kernel`].
    pub fn kernel(&self, shader: &Shader) -> Result<Kernel, SlotError> {
        self.note(self.pipelines.kernel(shader))
    }

    /// The compute pipeline of SPIR-V words, such as [`magpie_shaders::compile`] returns.
    ///
    /// # Errors
    /// As [`Build::kernel`].
    pub fn kernel_from_words(&self, name: &str, words: &[u32]) -> Result<Kernel, SlotError> {
        self.note(self.pipelines.kernel_from_words(name, words))
    }

    /// The pipeline of a ray pass, for the way in which rays are traced.
    ///
    /// # Errors
    /// As [`Build::kernel`], and where the device cannot trace so.
    pub fn ray_kernel(&self, shader: &RayShader) -> Result<RayKernel, SlotError> {
        self.can_trace()?;
        self.note(self.pipelines.ray_kernel(shader, self.rays))
    }

    /// The same with values of the shader's specialization constants, by their ids from 0.
    ///
    /// # Errors
    /// As [`Build::ray_kernel`].
    pub fn ray_variant(&self, shader: &RayShader, constants: &[u32]) -> Result<RayKernel, SlotError> {
        self.can_trace()?;
        self.note(self.pipelines.ray_variant(shader, self.rays, constants))
    }

    /// The pipeline of a ray pass from SPIR-V words, such as [`magpie_shaders::compile_rays`] returns for [`Build::rays`].
    ///
    /// # Errors
    /// As [`Build::ray_kernel`].
    pub fn ray_kernel_from_words(&self, name: &str, words: &[u32]) -> Result<RayKernel, SlotError> {
        self.can_trace()?;
        self.note(self.pipelines.ray_kernel_from_words(name, words, self.rays))
    }

    /// A graphics pipeline.
    ///
    /// # Errors
    /// As [`Build::kernel`].
    pub fn raster_kernel(&self, desc: &RasterDesc<'_>) -> Result<RasterKernel, SlotError> {
        self.note(self.pipelines.raster_kernel(desc))
    }

    /// As [`Gpu::bilinear`].
    ///
    /// # Errors
    /// As there.
    pub fn bilinear(&self, format: Format, wrap: [Wrap; 2]) -> Result<SamplerId, SlotError> {
        // A frame that does not run samples nothing.
        self.gpu.map_or(Ok(SamplerId::default()), |gpu| gpu.bilinear(format, wrap)).map_err(SlotError::other)
    }

    /// A sampler that blends texels and mips, for 16-bit floats and formats of fewer bits, which every device can blend.
    ///
    /// # Errors
    /// [`SlotError::Other`] where there are too many samplers.
    pub fn trilinear(&self, wrap: [Wrap; 2]) -> Result<SamplerId, SlotError> {
        let sampler = Sampler { wrap, ..Sampler::default() };
        self.gpu.map_or(Ok(SamplerId::default()), |gpu| gpu.sampler(sampler)).map_err(SlotError::other)
    }

    fn can_trace(&self) -> Result<(), SlotError> {
        self.gpu
            .map_or(Ok(()), |gpu: &Gpu| -> Result<(), GpuError> { gpu.check_rays(self.rays) })
            .map_err(SlotError::other)
    }
}
