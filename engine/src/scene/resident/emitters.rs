//! The table by which effects choose emissive triangles and spheres, on the device only while one of them asks for it.
use super::block::Block;
use super::{ResidentError, ResidentScene};
use crate::gpu::{Buffer, BufferUse, Gpu};
use crate::graph::execute::Executor;
use crate::scene::Scene;
use crate::scene::odds::Emitters;
use magpie_shaders::reference::LightTables;
use std::sync::Arc;

/// What emits.
pub(super) struct Emission {
    odds: Option<Emitters>,
    /// [`LightTables`], of which only `near` and `emitters` are there, and these two.
    pub buffer: Option<Arc<Buffer>>,
}

impl Emission {
    /// Nothing on the device yet.
    pub fn new(scene: &Scene) -> Self {
        Self { odds: Emitters::new(scene), buffer: None }
    }

    pub fn bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, |b| b.bytes())
    }
}

impl ResidentScene {
    /// Says whether the frames to come want [`SceneHandles::emitters`](super::SceneHandles::emitters): the table goes to the device, or is
    /// dropped. Where nothing emits there is none in any case.
    ///
    /// # Errors
    /// Exhausted memory, or a lost device.
    pub fn want_emitters(&mut self, gpu: &Gpu, wanted: bool) -> Result<(), ResidentError> {
        let emission = &mut self.emission;
        let Some(odds) = emission.odds.as_ref().filter(|_| wanted) else {
            emission.buffer = None;
            return Ok(());
        };
        if emission.buffer.is_some() {
            return Ok(());
        }
        let mut block = Block::default();
        block.add(&[LightTables::default()]);
        let (near, first) = (block.add(&odds.choices), block.add(&odds.first));
        let buffer = block.buffer(gpu, "scene emitters", BufferUse::Storage)?;
        let root = LightTables {
            near: buffer.address().offset(near),
            near_count: odds.choices.len() as u32,
            emitters: buffer.address().offset(first),
            ..LightTables::default()
        };
        block.put(0, &[root]);
        block.copy_to(gpu, &mut Executor::new(gpu)?, &buffer)?;
        emission.buffer = Some(buffer);
        Ok(())
    }
}
