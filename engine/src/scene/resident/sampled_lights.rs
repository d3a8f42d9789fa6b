//! The tables by which lights are sampled, each on the device only while an effect asks for it.
use super::block::upload_at;
use super::{ResidentError, ResidentScene};
use crate::gpu::{Buffer, Gpu};
use crate::graph::execute::Executor;
use crate::scene::Scene;
use crate::scene::light_tables::Tables;
use std::sync::Arc;

/// Tables of a scene, and their buffer while it is wanted.
pub(super) struct SampledLights {
    tables: Option<Tables>,
    pub buffer: Option<Arc<Buffer>>,
}

impl SampledLights {
    /// The emissive surfaces alone.
    pub fn emitters(scene: &Scene) -> Self {
        Self { tables: Tables::emitters(scene), buffer: None }
    }

    /// Every light.
    pub fn all(scene: &Scene) -> Self {
        Self { tables: Some(Tables::of_animation(scene)), buffer: None }
    }

    pub fn bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, |b| b.bytes())
    }

    /// Uploads the tables or frees their buffer.
    fn want(&mut self, gpu: &Gpu, name: &str, wanted: bool) -> Result<(), ResidentError> {
        match (&self.tables, wanted) {
            (Some(tables), true) if self.buffer.is_none() => {
                self.buffer = Some(tables.upload(gpu, &mut Executor::new(gpu)?, name)?);
            }
            (Some(_), true) => {}
            _ => self.buffer = None,
        }
        Ok(())
    }
}

impl Tables {
    /// Brings the tables to the device.
    ///
    /// # Errors
    /// Out of memory, or device loss.
    pub fn upload(&self, gpu: &Gpu, executor: &mut Executor, name: &str) -> Result<Arc<Buffer>, ResidentError> {
        upload_at(gpu, executor, name, self.bytes(), |address| self.placed(address))
    }
}

impl ResidentScene {
    /// Says which tables the next frames need: [`SceneHandles::emitters`](super::SceneHandles::emitters) and
    /// [`SceneHandles::lights`](super::SceneHandles::lights). Others are freed. Where nothing emits, there is never a table of emitters.
    ///
    /// # Errors
    /// Out of memory, or device loss.
    pub fn want_light_tables(&mut self, gpu: &Gpu, emitters: bool, lights: bool) -> Result<(), ResidentError> {
        self.emitters.want(gpu, "scene emitters", emitters)?;
        self.lights.want(gpu, "scene lights", lights)
    }
}
