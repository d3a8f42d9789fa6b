//! The tables by which lights are sampled, each on the device only while an effect asks for it.
use super::block::upload_at;
use super::light_tree::ResidentTree;
use super::{ResidentError, ResidentScene};
use crate::gpu::{Buffer, Gpu};
use crate::graph::execute::Executor;
use crate::scene::light_tables::{LightWeights, Tables};
use crate::scene::light_tree::Emitters;
use crate::scene::{Pose, Scene};
use crate::slot::Needs;
use std::sync::Arc;

/// What is known of a scene's lights, and the buffers of the tables that are wanted.
pub(super) struct SampledLights {
    weights: LightWeights,
    /// The table of emissive surfaces alone.
    pub emitters: Option<Arc<Buffer>>,
    /// The tables of every light.
    pub all: Option<Arc<Buffer>>,
    /// What a light tree is made of beside lamps.
    pub surfaces: Emitters,
    /// The light tree.
    pub tree: Option<ResidentTree>,
}

impl SampledLights {
    /// Of a scene that is in this pose.
    pub fn new(scene: &Scene, pose: &Pose) -> Self {
        let weights = LightWeights::of_animation(scene);
        let surfaces = Emitters::new(scene, pose, weights.first_emitters());
        Self { weights, emitters: None, all: None, surfaces, tree: None }
    }

    /// Discards the state of the device: the next frame refits the tree.
    pub fn forget(&mut self) {
        if let Some(tree) = &mut self.tree {
            tree.forget();
        }
    }

    pub fn bytes(&self) -> u64 {
        let tree = self.tree.as_ref().map(ResidentTree::buffer);
        self.emitters.iter().chain(&self.all).chain(tree).map(|buffer| buffer.bytes()).sum()
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
    /// Says what the next frames need of lights: [`SceneHandles::emitters`](super::SceneHandles::emitters),
    /// [`SceneHandles::lights`](super::SceneHandles::lights) and the light tree. Others are freed. Where nothing emits, there is never a table of
    /// emitters. With a tree, the tables of every light lead to it.
    ///
    /// # Errors
    /// Out of memory, device loss, or more lights than a tree can hold.
    pub fn want_lights(&mut self, gpu: &Gpu, needs: &Needs) -> Result<(), ResidentError> {
        let before = self.light_tree_address();
        self.want_light_tree(gpu, needs.light_tree)?;
        let tree = self.light_tree_address();
        let SampledLights { weights, emitters: emitter_table, all, .. } = &mut self.lights;
        if tree != before {
            *all = None;
        }
        let emitters = needs.emitters && self.facts.emits();
        keep(emitter_table, gpu, "scene emitters", emitters, || weights.emitters())?;
        let lights = needs.light_tables || needs.light_tree;
        keep(all, gpu, "scene lights", lights, || Some(weights.tables().with_tree(tree)))
    }
}
