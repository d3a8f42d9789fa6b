//! Deforming meshes, and the refit of their BVHs.
use super::types::Address;
use bytemuck::{Pod, Zeroable};

/// Vertices per workgroup, one thread each.
pub const DEFORM_GROUP: u32 = 64;
/// Threads per workgroup; a workgroup refits one BVH.
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
    /// Length of `jobs`.
    pub job_count: u32,
    /// 1 in the first frame: previous positions are set to the current ones.
    pub first: u32,
}

/// A mesh that deforms: its vertices in the bind pose, as loaded, and in the current pose.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Deformer {
    /// Positions as loaded, three `f32` each.
    pub source_positions: Address,
    /// Attributes as loaded, [`VertexAttributes`](super::scene::VertexAttributes).
    pub source_attributes: Address,
    /// [`Influence`] table, `influence_count` per vertex.
    pub influences: Address,
    /// [`MorphDelta`] table: all vertices of the first target, then of the next.
    pub targets: Address,
    /// Current positions, three `f32` each; written.
    pub positions: Address,
    /// Positions one frame ago, three `f32` each; written.
    pub previous_positions: Address,
    /// Current attributes; written.
    pub attributes: Address,
    /// Number of vertices.
    pub vertex_count: u32,
    /// Joints per vertex, at most; 0 where the mesh is not skinned.
    pub influence_count: u32,
    /// Number of morph targets.
    pub target_count: u32,
    /// Index of the mesh's first joint in the pose.
    pub first_joint: u32,
    /// Index of the mesh's first morph weight in the pose.
    pub first_weight: u32,
}

/// Up to [`DEFORM_GROUP`] vertices of one mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DeformJob {
    /// Index of the [`Deformer`].
    pub deformer: u32,
    /// Index of the first vertex.
    pub first: u32,
}

/// Weight of a joint for a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Influence {
    /// Index of the joint in its skin.
    pub joint: u32,
    /// 0 to 1; the weights of a vertex sum to 1.
    pub weight: f32,
}

/// Difference that a morph target of weight 1 adds to a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MorphDelta {
    /// Added to the position, object space.
    pub position: [f32; 3],
    /// Added to the normal, before it is normalised.
    pub normal: [f32; 3],
    /// Added to the tangent, before it is normalised.
    pub tangent: [f32; 3],
}

/// Transform of a joint from the bind pose to the current pose, in object space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct JointMatrix {
    /// The three upper rows of the affine matrix.
    pub rows: [[f32; 4]; 3],
}

/// Parameters of the pass that refits the BVHs of deforming meshes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct RefitParams {
    /// [`RefitJob`] table: one per workgroup.
    pub jobs: Address,
}

/// A BVH to refit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct RefitJob {
    /// [`BvhNode`](super::scene::BvhNode) table.
    pub nodes: Address,
    /// [`BvhPrimitive`](super::scene::BvhPrimitive) table.
    pub primitives: Address,
    /// Current positions, three `f32` each.
    pub positions: Address,
    /// [`NodeBox`] table, one per node: scratch memory.
    pub boxes: Address,
    /// Indices of all nodes, deepest level first.
    pub order: Address,
    /// Offset of each level in `order`, and the end of the last.
    pub levels: Address,
    /// Number of levels.
    pub level_count: u32,
}

/// Bounds of a node before quantisation.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct NodeBox {
    /// Lower corner, object space.
    pub lower: [f32; 3],
    /// Upper corner, object space.
    pub upper: [f32; 3],
}
