//! The light tree: a hierarchy over local lights and emissive primitives, by which one is chosen for a point.
use super::types::Address;
use bytemuck::{Pod, Zeroable};

/// [`LightNode::child`]: the bits that say what is below the node; 0 for two further nodes.
pub const LIGHT_NODE_KIND: u32 = 0xc000_0000;
/// [`LightNode::child`]: a local light. The index is its entry in [`LightTables::near`](super::light_sampling::LightTables::near).
pub const LIGHT_NODE_LAMP: u32 = 0x4000_0000;
/// [`LightNode::child`]: an emissive instance, of which a tree of its own goes on. The index is that of the instance.
pub const LIGHT_NODE_INSTANCE: u32 = 0x8000_0000;
/// [`LightNode::child`]: a triangle or sphere. The index is its place in the mesh.
pub const LIGHT_NODE_PRIMITIVE: u32 = 0xc000_0000;
/// [`LightNode::child`]: some light below the node shines from both sides.
pub const LIGHT_NODE_TWO_SIDED: u32 = 0x2000_0000;
/// [`LightNode::child`]: not all lights below the node are lamps.
pub const LIGHT_NODE_HAS_SURFACES: u32 = 0x1000_0000;
/// [`LightNode::child`]: the bits of the index; of two nodes that of the first, the second follows.
pub const LIGHT_NODE_INDEX: u32 = 0x0fff_ffff;
/// [`LightNode::reach`] of lights without a range, metres.
pub const UNLIMITED_REACH: f32 = 1e30;
/// Least [`LightNode::intensity`] of what shines at all.
pub const LEAST_INTENSITY: f32 = 1e-20;
/// Greatest [`LightNode::intensity`] of one light.
pub const GREATEST_INTENSITY: f32 = 1e20;
/// Threads per workgroup of the passes that refit.
pub const LIGHT_REFIT_GROUP: u32 = 64;
/// Greatest number of lights that splitting gives.
pub const MOST_SPLIT_LIGHTS: u32 = 16;

/// A node: bounds of some lights in space, direction and strength. Those of a mesh are in its object space, all others in the world,
/// counted from the origin of the frame. Lights that do not shine are in no bounds.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LightNode {
    /// Lower corner of a box around the lights, metres.
    pub min: [f32; 3],
    /// Sum of their greatest radiant intensities, luminance: radiance times area of what has an area. 0 where nothing shines.
    pub intensity: f32,
    /// Upper corner.
    pub max: [f32; 3],
    /// Greatest distance from which any of them is seen, metres: the range of lamps that have one, or [`UNLIMITED_REACH`].
    pub reach: f32,
    /// Axis of a cone around all their normals, unit.
    pub axis: [f32; 3],
    /// Cosine of the cone's half angle; -1 for all directions.
    pub cos_normals: f32,
    /// Cosine of the greatest angle to its normal at which a light still shines: 0 for surfaces.
    pub cos_emission: f32,
    /// Variance of their intensities over the square of their mean.
    pub spread: f32,
    /// How many of them shine.
    pub count: u32,
    /// What is below: `LIGHT_NODE_*`.
    pub child: u32,
}

/// Root of the tree's tables.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTree {
    /// [`LightNode`] table: first those of the tree over lamps and instances, its root first, then those of each mesh.
    pub nodes: Address,
    /// [`LightTreeInstance`] table, one for each instance of the scene.
    pub instances: Address,
    /// The path from the root to each local light, in the order of its entry: bit `i` says which of two nodes follows at depth `i`.
    pub lamp_trails: Address,
    /// [`LightTreePart`] table: the trees that are refitted, the one over lamps and instances first.
    pub parts: Address,
    /// [`LightTreeJob`] table: one for each workgroup that refits meshes that deform.
    pub jobs: Address,
    /// Number of nodes.
    pub node_count: u32,
    /// Number of local lights.
    pub lamp_count: u32,
}

/// Where an emissive instance is in the tree; zero for others.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTreeInstance {
    /// The path from the root to the instance.
    pub trail: u32,
    /// Index of the root of its mesh.
    pub root: u32,
    /// Entry of its first primitive in [`LightTables::near`](super::light_sampling::LightTables::near).
    pub first_entry: u32,
    /// The path from that root to each of its primitives.
    pub trails: Address,
}

/// A tree that is refitted. Nodes are counted from its root. Siblings follow each other: nodes `1 + 2 i` and `2 + 2 i` are pair `i`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTreePart {
    /// Index of its root.
    pub first_node: u32,
    /// Number of leaves.
    pub leaf_count: u32,
    /// The instance that deforms; unused for the tree over lamps and instances.
    pub instance: u32,
    /// The node above each pair.
    pub parents: Address,
    /// How many nodes of each pair are done; zero between passes.
    pub counters: Address,
    /// [`LightTreeLeaf`] table.
    pub leaves: Address,
}

/// A leaf of a tree that is refitted.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTreeLeaf {
    /// Its node.
    pub node: u32,
    /// Of a local light, its index among the scene's lights.
    pub light: u32,
    /// Of a triangle, the luminance of its radiance, averaged over its texture.
    pub emission: f32,
}

/// Up to [`LIGHT_REFIT_GROUP`] leaves of one tree.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTreeJob {
    /// Index of the [`LightTreePart`].
    pub part: u32,
    /// Index of the first leaf.
    pub first: u32,
}

/// Parameters of the passes that refit the tree.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightRefitParams {
    /// The scene.
    pub scene: Address,
    /// The [`LightTree`].
    pub tree: Address,
    /// Number of jobs, or of workgroups.
    pub groups: u32,
}

/// How a tree is split for several lights at once.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LightSplit {
    /// Clusters of lights are split while the relative variance of what they send is above this. 0: whenever there are several lights.
    pub threshold: f32,
    /// Greatest number of lights, 1 to [`MOST_SPLIT_LIGHTS`].
    pub most: u32,
}
