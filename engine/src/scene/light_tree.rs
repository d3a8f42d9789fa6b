//! The light tree: a hierarchy over local lights and emissive primitives, by which effects choose one of them for a point with a probability near
//! its share of the light there. It has two levels: a tree over local lights and emissive instances, and one over the primitives of each emissive
//! mesh, in its object space. Built here, refitted on the device.
//!
//! Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"; two levels and refits as in Moreau, Pharr and
//! Clarberg 2019, "Dynamic Many-Light Sampling for Real-Time Ray Tracing".
mod bounds;
mod build;
mod emitters;
#[cfg(test)]
mod tests;

use super::light_sampling::is_emitter;
use super::{Light, Scene};
use build::{Built, build};
use emitters::EmissiveMesh;
pub use emitters::Emitters;
use magpie_shaders::Address;
use magpie_shaders::light_tree::{
    LIGHT_NODE_HAS_SURFACES, LIGHT_NODE_INDEX, LIGHT_NODE_INSTANCE, LIGHT_NODE_KIND, LIGHT_NODE_LAMP,
    LIGHT_NODE_TWO_SIDED, LIGHT_REFIT_GROUP, LightNode, LightTree, LightTreeInstance, LightTreeJob, LightTreeLeaf,
    LightTreePart,
};
use magpie_shaders::scene as shared;
use rayon::prelude::*;

/// Greatest number of nodes.
pub const MOST_NODES: u32 = LIGHT_NODE_INDEX;
/// Alignment of the tables: a node is 64 bytes.
const ALIGNMENT: usize = 64;

/// A local light: its index in the scene's lights, and what shaders read of it.
pub type Lamp = (u32, shared::Light);

/// Whether a scene has any light that a tree could hold, shining or not.
pub fn has_lights(scene: &Scene) -> bool {
    let is_local = |light: &Light| !matches!(light, Light::Directional { .. });
    let has_primitives = |mesh: u32| {
        let mesh = &scene.meshes[mesh as usize];
        !mesh.indices.is_empty() || !mesh.spheres.is_empty()
    };
    scene.lights.iter().any(is_local) || scene.instances.iter().any(|i| has_primitives(i.mesh) && is_emitter(scene, i))
}

/// A tree for the device, in one block of bytes.
pub struct Tables {
    block: Vec<u8>,
    root: LightTree,
    instances: Vec<LightTreeInstance>,
    parts: Vec<LightTreePart>,
    /// Workgroups that refit the tree over lamps and instances, and those that refit meshes that deform.
    pub groups: [u32; 2],
}

impl Tables {
    /// Builds the tree over these lamps, in the order of their entries, and over emissive instances where `instance` puts them. `None` if there
    /// are neither.
    pub fn new(emitters: &Emitters, lamps: &[Lamp], instance: impl Fn(usize) -> shared::Instance) -> Option<Self> {
        if lamps.is_empty() && emitters.placed.is_empty() {
            return None;
        }
        let meshes: Vec<Built> = emitters.meshes.par_iter().map(|mesh| build(mesh.leaves())).collect();

        // The tree over lamps and instances.
        let lamp = |(entry, (_, light)): (u32, &Lamp)| bounds::lamp_leaf(light, LIGHT_NODE_LAMP | entry);
        let mut leaves: Vec<LightNode> = (0..).zip(lamps).map(lamp).collect();
        for placed in &emitters.placed {
            let root = &meshes[placed.mesh].nodes[0];
            let flags = LIGHT_NODE_HAS_SURFACES | root.child & LIGHT_NODE_TWO_SIDED;
            let child = LIGHT_NODE_INSTANCE | placed.instance | flags;
            leaves.push(bounds::instance_leaf(root, &instance(placed.instance as usize), child));
        }
        let top = build(leaves);

        let mut tables = Self {
            block: vec![0; size_of::<LightTree>()],
            root: LightTree::default(),
            instances: vec![LightTreeInstance::default(); emitters.count],
            parts: Vec::new(),
            groups: [(top.places.len() as u32).div_ceil(LIGHT_REFIT_GROUP), 0],
        };
        tables.root.nodes = tables.start();
        let mut first_nodes = Vec::with_capacity(meshes.len());
        tables.add_nodes(&top.nodes);
        for mesh in &meshes {
            first_nodes.push(tables.root.node_count);
            tables.add_nodes(&mesh.nodes);
        }
        let trails: Vec<u32> = top.places.iter().map(|place| place.trail).collect();
        tables.root.lamp_trails = tables.add(&trails[..lamps.len()]);
        tables.root.lamp_count = lamps.len() as u32;
        let mesh_trails: Vec<Address> = meshes
            .iter()
            .map(|mesh| tables.add(&mesh.places.iter().map(|place| place.trail).collect::<Vec<_>>()))
            .collect();
        for (placed, trail) in emitters.placed.iter().zip(&trails[lamps.len()..]) {
            tables.instances[placed.instance as usize] = LightTreeInstance {
                trail: *trail,
                root: first_nodes[placed.mesh],
                first_entry: placed.first_entry,
                trails: mesh_trails[placed.mesh],
            };
        }

        // What is refitted.
        let lights = lamps.iter().map(|(light, _)| *light).chain(emitters.placed.iter().map(|_| 0));
        let leaf = |(place, light): (&build::Place, u32)| LightTreeLeaf { node: place.node, light, emission: 0.0 };
        let top_leaves: Vec<LightTreeLeaf> = top.places.iter().zip(lights).map(leaf).collect();
        tables.add_part(0, 0, &top, &top_leaves);
        let mut jobs = Vec::new();
        for (mesh, (built, first_node)) in emitters.meshes.iter().zip(meshes.iter().zip(&first_nodes)) {
            let EmissiveMesh { deforms: Some(instance), emission, .. } = mesh else { continue };
            let leaf = |(place, emission): (&build::Place, &f32)| LightTreeLeaf {
                node: place.node,
                light: 0,
                emission: *emission,
            };
            let leaves: Vec<LightTreeLeaf> = built.places.iter().zip(emission).map(leaf).collect();
            let part = tables.parts.len() as u32;
            tables.add_part(*first_node, *instance, built, &leaves);
            let count = leaves.len() as u32;
            jobs.extend((0..count).step_by(LIGHT_REFIT_GROUP as usize).map(|first| LightTreeJob { part, first }));
        }
        tables.root.jobs = tables.add(&jobs);
        tables.groups[1] = jobs.len() as u32;
        tables.root.instances = tables.add(&tables.instances.clone());
        tables.root.parts = tables.add(&tables.parts.clone());
        Some(tables)
    }

    /// Where the next table begins.
    fn start(&mut self) -> Address {
        self.block.resize(self.block.len().next_multiple_of(ALIGNMENT), 0);
        Address::new(self.block.len() as u64)
    }

    fn add<T: bytemuck::Pod>(&mut self, items: &[T]) -> Address {
        let at = self.start();
        self.block.extend_from_slice(bytemuck::cast_slice(items));
        at
    }

    /// Adds the nodes of a tree, which count from its root.
    fn add_nodes(&mut self, nodes: &[LightNode]) {
        let base = self.root.node_count;
        let at = |node: &LightNode| {
            let offset = if node.child & LIGHT_NODE_KIND == 0 { base } else { 0 };
            LightNode { child: node.child + offset, ..*node }
        };
        self.block.extend(nodes.iter().map(at).flat_map(bytemuck::cast::<LightNode, [u8; 64]>));
        self.root.node_count += nodes.len() as u32;
    }

    fn add_part(&mut self, first_node: u32, instance: u32, built: &Built, leaves: &[LightTreeLeaf]) {
        let parents = self.add(&built.parents);
        let counters = self.add(&vec![0_u32; built.parents.len()]);
        let leaf_count = leaves.len() as u32;
        let leaves = self.add(leaves);
        self.parts.push(LightTreePart { first_node, leaf_count, instance, parents, counters, leaves });
    }

    /// Number of nodes.
    pub fn nodes(&self) -> u32 {
        self.root.node_count
    }

    /// Size of the block.
    pub fn bytes(&self) -> u64 {
        self.block.len() as u64
    }

    /// The block for a buffer at this address.
    pub fn placed(mut self, at: Address) -> Vec<u8> {
        let on = |offset: Address| at.offset(offset.get());
        for instance in &mut self.instances {
            instance.trails = on(instance.trails);
        }
        for part in &mut self.parts {
            *part = LightTreePart {
                parents: on(part.parents),
                counters: on(part.counters),
                leaves: on(part.leaves),
                ..*part
            };
        }
        let LightTree { nodes, instances, lamp_trails, parts, jobs, .. } = self.root;
        let mut put = |offset: Address, bytes: &[u8]| {
            let from = offset.get() as usize;
            self.block[from..from + bytes.len()].copy_from_slice(bytes);
        };
        put(instances, bytemuck::cast_slice(&self.instances));
        put(parts, bytemuck::cast_slice(&self.parts));
        let root = LightTree {
            nodes: on(nodes),
            instances: on(instances),
            lamp_trails: on(lamp_trails),
            parts: on(parts),
            jobs: on(jobs),
            ..self.root
        };
        put(Address::default(), bytemuck::bytes_of(&root));
        self.block
    }
}
