//! The tables by which lights are sampled, each on the device only while an effect asks for it.
use super::block::upload_at;
use super::{ResidentError, ResidentScene};
use crate::gpu::{Buffer, Gpu};
use crate::graph::execute::Executor;
use crate::scene::Scene;
use crate::scene::light_tables::{LightWeights, Tables};
use std::sync::Arc;

/// What is known of a scene's lights, and the buffers of the tables that are wanted.
pub(super) struct SampledLights {
    weights: LightWeights,
    /// The table of emissive surfaces alone.
    pub emitters: Option<Arc<Buffer>>,
    /// The tables of every light.
    pub all: Option<Arc<Buffer>>,
}

impl SampledLights {
    pub fn new(scene: &Scene) -> Self {
        Self { weights: LightWeights::of_animation(scene), emitters: None, all: None }
    }

    pub fn bytes(&self) -> u64 {
        self.emitters.iter().chain(&self.all).map(|buffer| buffer.bytes()).sum()
    }
}

/// Makes and uploads tables that are wanted and not there yet, or frees what is not wanted.
fn keep(
    buffer: &mut Option<Arc<Buffer>>,
    gpu: &Gpu,
    name: &str,
    wanted: bool,
    tables: impl FnOnce() -> Option<Tables>,
) -> Result<(), ResidentError> {
    if !wanted {
        *buffer = None;
    } else if buffer.is_none()
        && let Some(tables) = tables()
    {
        *buffer = Some(tables.upload(gpu, &mut Executor::new(gpu)?, name)?);
    }
    Ok(())
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
        let SampledLights { weights, emitters: emitter_table, all } = &mut self.lights;
        let emitters = emitters && self.facts.emits();
        keep(emitter_table, gpu, "scene emitters", emitters, || weights.emitters())?;
        keep(all, gpu, "scene lights", lights, || Some(weights.tables()))
    }
}
