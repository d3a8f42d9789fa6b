//! The light tree on the device: built when an effect first asks for it, and what of it is out of date.
use super::block::upload_at;
use super::state::State;
use super::{ResidentError, ResidentScene};
use crate::gpu::{Buffer, Gpu};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, Buffer as GraphBuffer, BufferDesc, FrameGraph, WriteHandle};
use crate::scene::Light;
use crate::scene::light_tree::{Emitters, Lamp, MOST_NODES, Tables};
use glam::DVec3;
use magpie_shaders::Address;
use std::sync::Arc;

/// The light tree of a frame, with what has to be refitted in it.
pub struct LightTreeUpdate {
    /// The tree, as it was in the frame before.
    pub tree: WriteHandle<GraphBuffer>,
    /// Workgroups for the tree over lamps and instances; 0 where none of them has changed.
    pub lamp_groups: u32,
    /// Workgroups for meshes that deform; 0 where none has changed.
    pub mesh_groups: u32,
}

/// The tree of a scene, while it is wanted.
pub(super) struct ResidentTree {
    memory: Arc<Buffer>,
    groups: [u32; 2],
    /// Instances that emit, and of these the ones that deform.
    instances: Vec<usize>,
    deforming: Vec<usize>,
    /// What the nodes on the device stand for; `None` where they have to be refitted in any case.
    fitted: Option<Fitted>,
}

/// A state of the scene's lights.
#[derive(PartialEq)]
struct Fitted {
    lights: u64,
    origin: DVec3,
    instances: Vec<u64>,
    deforming: Vec<u64>,
}

impl ResidentTree {
    fn new(gpu: &Gpu, emitters: &Emitters, state: &State) -> Result<Option<Self>, ResidentError> {
        let is_local = |index: &usize| !matches!(state.pose.lights[*index], Light::Directional { .. });
        // The topology is that of the lamps at full strength, since it stays when they are dimmed.
        let lamps: Vec<Lamp> = (0..state.pose.lights.len())
            .filter(is_local)
            .map(|index| (index as u32, state.undimmed_light(index)))
            .collect();
        let Some(tables) = Tables::new(emitters, &lamps, |instance| state.instance(instance)) else { return Ok(None) };
        if tables.nodes() > MOST_NODES {
            let count = tables.nodes() as usize;
            return Err(ResidentError::Limit { what: "nodes of the light tree", count, limit: MOST_NODES });
        }
        let (groups, bytes) = (tables.groups, tables.bytes());
        let memory =
            upload_at(gpu, &mut Executor::new(gpu)?, "scene light tree", bytes, |address| tables.placed(address))?;
        let (instances, deforming) = emitters.instances();
        Ok(Some(Self { memory, groups, instances, deforming, fitted: None }))
    }

    pub fn buffer(&self) -> &Arc<Buffer> {
        &self.memory
    }

    /// Discards the state of the device: the next frame refits everything.
    pub fn forget(&mut self) {
        self.fitted = None;
    }

    /// Brings the tree into a frame, and takes it for fitted to the state of that frame.
    fn declare(&mut self, g: &mut FrameGraph, imports: &mut Imports, state: &State) -> LightTreeUpdate {
        let desc = BufferDesc::new(self.memory.bytes());
        let tree = g.import_buffer("scene.light_tree", desc, Access::BufferReadWrite, imports.buffer(&self.memory));
        let changed = |instances: &[usize]| instances.iter().map(|instance| state.changed[*instance]).collect();
        let now = Fitted {
            lights: state.lights_changed,
            origin: state.origin,
            instances: changed(&self.instances),
            deforming: changed(&self.deforming),
        };
        let before = self.fitted.as_ref();
        let lamps = before != Some(&now);
        let meshes = before.is_none_or(|before| before.deforming != now.deforming);
        self.fitted = Some(now);
        let [lamp_groups, mesh_groups] = self.groups;
        LightTreeUpdate {
            tree,
            lamp_groups: if lamps { lamp_groups } else { 0 },
            mesh_groups: if meshes { mesh_groups } else { 0 },
        }
    }
}

impl ResidentScene {
    /// Builds the light tree and brings it to the device where it is wanted and not there yet, or frees it.
    pub(super) fn want_light_tree(&mut self, gpu: &Gpu, wanted: bool) -> Result<(), ResidentError> {
        if !wanted {
            self.lights.tree = None;
        } else if self.lights.tree.is_none() {
            self.lights.tree = ResidentTree::new(gpu, &self.lights.surfaces, &self.state)?;
        }
        Ok(())
    }

    /// Brings the light tree into a frame, if it is wanted and the scene has lights for it. Whoever calls it refits what is said to be out of date,
    /// after [`ResidentScene::declare`].
    pub fn declare_light_tree(&mut self, g: &mut FrameGraph, imports: &mut Imports) -> Option<LightTreeUpdate> {
        Some(self.lights.tree.as_mut()?.declare(g, imports, &self.state))
    }

    /// Where the light tree is on the device: [`LightTree`](magpie_shaders::light_tree::LightTree). 0 while there is none.
    pub fn light_tree_address(&self) -> Address {
        self.lights.tree.as_ref().map_or(Address::default(), |tree| tree.memory.address())
    }

    /// Bytes of the light tree; 0 while it is not wanted.
    pub fn light_tree_bytes(&self) -> u64 {
        self.lights.tree.as_ref().map_or(0, |tree| tree.memory.bytes())
    }
}
