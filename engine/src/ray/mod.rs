//! Rays: the acceleration structures that the software backend walks on any device.
//!
//! Two levels of compressed wide BVHs: one [`MeshBvh`] per mesh in object space, and one [`SceneBvh`] over the placed meshes.
//! `shaders/lib/ray.glsl` walks them.

mod bounds;
mod cwbvh;
mod fit;
mod occluders;
mod sort;
mod split;
mod top;

pub use bounds::Bounds;
pub use cwbvh::MeshBvh;
pub use fit::{Child, Levels, children};
pub(crate) use occluders::{Occluder, Occluders};
pub use sort::RaySort;
pub use top::{Placement, SceneBvh, object_from_world, placements};

/// Largest coordinate that a tree takes, in either level: products of three of them still fit `f32` in the triangle test.
pub const COORDINATE_LIMIT: f32 = 1e12;

/// Largest number of primitives in one tree: `obvhs` numbers seven entries per binary node with 32 bits.
pub const PRIMITIVE_LIMIT: usize = 1 << 27;

/// Why a tree could not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RayError {
    /// The index table does not hold whole triangles.
    #[error("{count} indices are not a multiple of 3")]
    PartialTriangle {
        /// Length of the index table.
        count: usize,
    },
    /// A triangle names a vertex that is not there.
    #[error("index {at} names vertex {vertex}, but there are {vertices} vertices")]
    Index {
        /// Place in the index table.
        at: usize,
        /// The vertex it names.
        vertex: u32,
        /// Length of the vertex table.
        vertices: usize,
    },
    /// A position that is not finite, or too large.
    #[error(
        "vertex {vertex} lies at {position:?}; coordinates must be finite and at most {COORDINATE_LIMIT:e} in size"
    )]
    Position {
        /// Index of the vertex.
        vertex: usize,
        /// Its position, object space.
        position: [f32; 3],
    },
    /// A sphere that is not finite, has a negative radius, or reaches too far out.
    #[error(
        "sphere {sphere} has its centre at {centre:?} and radius {radius}; the radius must not be negative, and no coordinate of the sphere over {COORDINATE_LIMIT:e}"
    )]
    Sphere {
        /// Index of the sphere.
        sphere: usize,
        /// Its centre, object space.
        centre: [f32; 3],
        /// Its radius.
        radius: f32,
    },
    /// More primitives than a tree can number.
    #[error("{count} primitives; a tree takes at most {PRIMITIVE_LIMIT}")]
    TooMany {
        /// How many there are.
        count: usize,
    },
    /// An instance of a mesh that is not there.
    #[error("instance {instance} shows mesh {mesh}, but there are {meshes} meshes")]
    Mesh {
        /// Index of the instance.
        instance: usize,
        /// The mesh it names.
        mesh: u32,
        /// Length of the mesh table.
        meshes: usize,
    },
    /// An instance whose transform is not finite, or that lies too far out.
    #[error(
        "instance {instance} spans {min:?} to {max:?} in the world; coordinates must be finite and at most {COORDINATE_LIMIT:e} in size"
    )]
    Instance {
        /// Index of the instance.
        instance: usize,
        /// Lower corner of its bounds, world space, metres.
        min: [f32; 3],
        /// Upper corner.
        max: [f32; 3],
    },
    /// The tree is deeper than the traversal's stack.
    #[error("the tree needs {needed} stack entries; traversal has {limit}")]
    Stack {
        /// Entries that the deepest path needs.
        needed: u32,
        /// Entries there are.
        limit: u32,
    },
    /// A fault of one mesh, with the mesh's name.
    #[error("mesh `{mesh}`: {fault}")]
    InMesh {
        /// Name of the mesh.
        mesh: String,
        /// What is wrong with it.
        fault: Box<RayError>,
    },
}

impl RayError {
    /// The same fault, with the name of the mesh that has it.
    pub fn in_mesh(self, mesh: impl Into<String>) -> Self {
        Self::InMesh { mesh: mesh.into(), fault: Box::new(self) }
    }
}
