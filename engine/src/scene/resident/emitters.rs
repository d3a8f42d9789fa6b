//! The alias table of emissive triangles and spheres, on the device only while an effect asks for it.
use super::block::Block;
use super::{ResidentError, ResidentScene};
use crate::gpu::{Buffer, BufferUse, Gpu};
use crate::graph::execute::Executor;
use crate::scene::Scene;
use crate::scene::light_sampling::Emitters;
use magpie_shaders::reference::LightTables;
use std::sync::Arc;

/// The emitters of a scene.
pub(super) struct Emission {
    emitters: Option<Emitters>,
    /// [`LightTables`] with only `near` and `emitters` set, followed by these two tables.
    pub buffer: Option<Arc<Buffer>>,
}

impl Emission {
    /// Computes the table, without uploading it.
    pub fn new(scene: &Scene) -> Self {
        Self { emitters: Emitters::new(scene), buffer: None }
    }

    pub fn bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, |b| b.bytes())
    }
}

impl ResidentScene {
    /// Says whether the next frames need [`SceneHandles::emitters`](super::SceneHandles::emitters): uploads the table or frees
    /// it. Without emissive meshes there is never a table.
    ///
    /// # Errors
    /// Out of memory, or device loss.
    pub fn want_emitters(&mut self, gpu: &Gpu, wanted: bool) -> Result<(), ResidentError> {
        let emission = &mut self.emission;
        let Some(emitters) = emission.emitters.as_ref().filter(|_| wanted) else {
            emission.buffer = None;
            return Ok(());
        };
        if emission.buffer.is_some() {
            return Ok(());
        }
        let mut block = Block::default();
        block.add(&[LightTables::default()]);
        let (near, first) = (block.add(&emitters.choices), block.add(&emitters.first));
        let buffer = block.buffer(gpu, "scene emitters", BufferUse::Storage)?;
        let root = LightTables {
            near: buffer.address().offset(near),
            near_count: emitters.choices.len() as u32,
            emitters: buffer.address().offset(first),
            ..LightTables::default()
        };
        block.put(0, &[root]);
        block.copy_to(gpu, &mut Executor::new(gpu)?, &buffer)?;
        emission.buffer = Some(buffer);
        Ok(())
    }
}
