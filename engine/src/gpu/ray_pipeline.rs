//! Kernels of ray passes: compute pipelines, or ray-tracing pipelines with their shader binding tables.
use super::{Gpu, GpuError, Kernel};
use magpie_shaders::{RayShader, Rays};

/// The pipeline of a ray pass, for one way to trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayKernel {
    /// A compute shader: it walks Magpie's own tree, or asks ray queries.
    Compute(Kernel),
}

impl Gpu {
    /// The pipeline of a ray pass.
    ///
    /// # Errors
    /// [`GpuError::Shader`] and failing calls.
    pub fn ray_kernel(&self, shader: &RayShader, rays: Rays) -> Result<RayKernel, GpuError> {
        Ok(RayKernel::Compute(self.kernel(shader.way(rays))?))
    }

    /// The pipeline of a ray pass from SPIR-V words, such as [`magpie_shaders::compile_rays`] returns for the same way.
    ///
    /// # Errors
    /// As [`Gpu::ray_kernel`].
    pub fn ray_kernel_from_words(&self, name: &str, words: &[u32], _rays: Rays) -> Result<RayKernel, GpuError> {
        Ok(RayKernel::Compute(self.kernel_from_words(name, words)?))
    }
}
