//! Deforming meshes, and the refit of their trees.
use super::types::Address;
use bytemuck::{Pod, Zeroable};

/// Vertices that one workgroup deforms.
pub const DEFORM_GROUP: u32 = 64;
/// Threads that refit one tree.
pub const REFIT_GROUP: u32 = 128;

/// Parameters of the pass that deforms every skinned and morphing mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DeformParams {
    /// [`Deformer`] table.
    pub deformers: Address,
    /// [`DeformJob`] table: one per workgroup.
    pub jobs: Address,
    /// [`JointMatrix`] table of this frame's pose.
    pub joints: Address,
    /// Morph weights of this frame's pose, one `f32` each.
    pub weights: Address,
    /// How many jobs.
    pub job_count: u32,
    /// There is no frame before: nothing moves.
    pub first: u32,
}

/// A mesh that deforms, with its vertices as they are in the file and as they are now.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Deformer {
    /// Positions in the file, three `f32` each.
    pub source_positions: Address,
    /// Attributes in the file.
    pub source_attributes: Address,
    /// [`Influence`] table, `influence_count` per vertex.
    pub influences: Address,
    /// [`MorphDelta`] table: every vertex of the first target, then of the next.
    pub targets: Address,
    /// Positions now.
    pub positions: Address,
    /// Positions one frame ago.
    pub previous_positions: Address,
    /// Attributes now.
    pub attributes: Address,
    /// How many vertices.
    pub vertex_count: u32,
    /// Joints that move one vertex, at most; 0 where the mesh is not skinned.
    pub influence_count: u32,
    /// How many morph targets.
    pub target_count: u32,
    /// Index of its first joint in the pose.
    pub first_joint: u32,
    /// Index of its first weight in the pose.
    pub first_weight: u32,
}

/// Up to [`DEFORM_GROUP`] vertices of one mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DeformJob {
    /// Index of the [`Deformer`].
    pub deformer: u32,
    /// First vertex.
    pub first: u32,
}

/// How much a joint moves a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Influence {
    /// Index of the joint in its skin.
    pub joint: u32,
    /// Share, the sum over a vertex being 1.
    pub weight: f32,
}

/// What a morph target of weight 1 adds to a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MorphDelta {
    /// To its position.
    pub position: [f32; 3],
    /// To its normal.
    pub normal: [f32; 3],
    /// To its tangent.
    pub tangent: [f32; 3],
}

/// Object space from the bind pose, three rows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct JointMatrix {
    /// The rows.
    pub rows: [[f32; 4]; 3],
}

/// Parameters of the pass that refits the trees of deforming meshes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct RefitParams {
    /// [`RefitJob`] table: one per workgroup.
    pub jobs: Address,
}

/// A tree to be refitted.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct RefitJob {
    /// [`BvhNode`](super::scene::BvhNode) table.
    pub nodes: Address,
    /// [`BvhPrimitive`](super::scene::BvhPrimitive) table.
    pub primitives: Address,
    /// Positions now.
    pub positions: Address,
    /// [`NodeBox`] table, one per node: working memory.
    pub boxes: Address,
    /// Indices of nodes, the deepest level first.
    pub order: Address,
    /// Where each level begins in `order`, and where the last ends.
    pub levels: Address,
    /// How many levels.
    pub level_count: u32,
}

/// The box of a node, exactly.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct NodeBox {
    /// Least corner.
    pub lower: [f32; 3],
    /// Greatest corner.
    pub upper: [f32; 3],
}
