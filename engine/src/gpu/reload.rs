//! Pipelines whose shaders were compiled anew take the place of those in use, and pipelines that will be needed are made ahead.
use super::device::{Garbage, lock};
use super::pipeline::{Code, Made, Replaced};
use super::reflect::{local_size, push_members};
use super::{Gpu, GpuError, Kernel, RasterKernel, RayKernel};
use magpie_shaders::Shader;
use std::mem;
use std::sync::{Mutex, PoisonError};

/// Pipelines with new shaders, ready to take the place of those in use. Dropped without [`Reload::apply`], it leaves everything as it was.
pub struct Reload {
    gpu: Gpu,
    shaders: Replaced,
    /// By the index of the pipeline.
    made: Vec<(u32, Made)>,
}

/// Indices of pipelines.
#[derive(Debug, Default)]
pub struct PipelineSet(Mutex<Vec<u32>>);

impl PipelineSet {
    pub(crate) fn add(&self, kernel: impl Indexed) {
        let index = kernel.index();
        let mut list = lock(&self.0);
        if !list.contains(&index) {
            list.push(index);
        }
    }

    /// Number of those that the device has not made yet.
    #[must_use]
    pub fn missing(&self, gpu: &Gpu) -> usize {
        let is_missing = |index: &&u32| gpu.0.pipelines.entry(**index).is_ok_and(|entry| !entry.is_made());
        lock(&self.0).iter().filter(is_missing).count()
    }

    /// Makes all of them. Frames may run meanwhile, on another thread.
    ///
    /// # Errors
    /// Of the first one that cannot be made.
    pub fn make(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let list = lock(&self.0).clone();
        list.into_iter().try_for_each(|index| gpu.make_pipeline(index))
    }
}

/// A kernel of any kind.
pub(crate) trait Indexed: Copy {
    /// Index of its pipeline.
    fn index(self) -> u32;
}

impl Indexed for Kernel {
    fn index(self) -> u32 {
        self.index
    }
}

impl Indexed for RasterKernel {
    fn index(self) -> u32 {
        self.index
    }
}

impl Indexed for RayKernel {
    fn index(self) -> u32 {
        match self {
            Self::Compute(kernel) => kernel.index,
            Self::Pipeline(pipeline) => pipeline.index,
        }
    }
}

impl Gpu {
    /// Whether a pipeline with this shader was made.
    #[must_use]
    pub fn runs(&self, shader: &Shader) -> bool {
        let Ok(code) = Code::embedded(shader) else { return false };
        let shaders = Replaced::from([(code.key, [].into())]);
        self.0.pipelines.entries().iter().any(|entry| entry.is_made() && entry.uses(&shaders))
    }

    /// Makes every pipeline in use that has one of these embedded shaders, with the words that were compiled in its place. Frames may run
    /// meanwhile, on another thread, with the old ones.
    ///
    /// # Errors
    /// [`GpuError::Shader`] if a shader has another workgroup size or other push constants than the one that it replaces, on which passes rely;
    /// failed Vulkan calls. Nothing has changed then.
    pub fn reload(&self, shaders: &[(&Shader, Vec<u32>)]) -> Result<Reload, GpuError> {
        let mut replaced = Replaced::new();
        for (shader, new) in shaders {
            let code = Code::embedded(shader)?;
            let old = code.words(&Replaced::new())?;
            let changed = |what: &str| {
                let reason = format!("{what}, which the program relies on; it has to be built again");
                Err(GpuError::Shader { name: shader.name.to_owned(), reason })
            };
            if local_size(&old) != local_size(new) {
                let of = |words| local_size(words).map_or("none".to_owned(), |[x, y, z]| format!("{x} x {y} x {z}"));
                return changed(&format!("the size of its workgroups was {} and is {}", of(&old), of(new)));
            }
            if push_members(&old) != push_members(new) {
                return changed("it has other push constants");
            }
            replaced.insert(code.key, new.as_slice().into());
        }
        let mut all = self.0.pipelines.replaced.read().unwrap_or_else(PoisonError::into_inner).clone();
        all.extend(replaced.iter().map(|(key, words)| (*key, words.clone())));
        let mut reload = Reload { gpu: self.clone(), shaders: replaced, made: Vec::new() };
        reload.make(&all)?;
        Ok(reload)
    }
}

impl Reload {
    /// Number of the pipelines that will be replaced.
    #[must_use]
    pub fn pipelines(&self) -> usize {
        self.made.len()
    }

    /// Makes all that is in use and not yet made with the new shaders; `all` has those of earlier reloads as well.
    fn make(&mut self, all: &Replaced) -> Result<(), GpuError> {
        for (index, entry) in (0..).zip(self.gpu.0.pipelines.entries()) {
            let is_new = self.made.iter().any(|(made, _)| *made == index);
            if entry.is_made() && entry.uses(&self.shaders) && !is_new {
                self.made.push((index, self.gpu.build_pipeline(&entry, all)?));
            }
        }
        Ok(())
    }

    /// Puts them in place: frames that are recorded from now on run with them. Must not be called while a frame is being recorded.
    ///
    /// # Errors
    /// Failed Vulkan calls, for pipelines that came into use since [`Gpu::reload`]; nothing has changed then.
    pub fn apply(mut self) -> Result<(), GpuError> {
        let inner = self.gpu.0.clone();
        // No other thread makes a pipeline from the old shaders any more.
        let mut replaced = inner.pipelines.replaced.write().unwrap_or_else(PoisonError::into_inner);
        let mut all = replaced.clone();
        all.extend(self.shaders.iter().map(|(key, words)| (*key, words.clone())));
        self.make(&all)?;
        *replaced = all;
        for (index, Made { pipeline, table }) in mem::take(&mut self.made) {
            let old = inner.pipelines.entry(index)?.set(pipeline);
            inner.discard(Garbage::Pipeline(old));
            let memory = table.and_then(|table| inner.ray_tables.replace(index, table));
            memory.into_iter().for_each(|(buffer, memory)| inner.discard(Garbage::Buffer(buffer, memory)));
        }
        Ok(())
    }
}

impl Drop for Reload {
    fn drop(&mut self) {
        for (_, Made { pipeline, table }) in mem::take(&mut self.made) {
            self.gpu.0.discard(Garbage::Pipeline(pipeline));
            let memory = table.and_then(super::ray_pipeline::RayTable::into_memory);
            memory.into_iter().for_each(|(buffer, memory)| self.gpu.0.discard(Garbage::Buffer(buffer, memory)));
        }
    }
}
