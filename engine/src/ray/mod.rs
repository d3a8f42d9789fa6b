//! Ray tracing in software: BVHs that compute shaders traverse on any device.
//!
//! There are two levels of compressed wide BVHs: one [`MeshBvh`] per mesh in object space, and one [`SceneBvh`] over the
//! instances in world space. `shaders/lib/ray_software.glsl` traverses them.

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

/// Largest coordinate in a BVH of either level. Products of three such numbers still fit into `f32`, as the triangle test needs.
pub const COORDINATE_LIMIT: f32 = 1e12;

/// Largest number of primitives in one BVH: `obvhs` counts seven entries per binary node in 32 bits.
pub const PRIMITIVE_LIMIT: usize = 1 << 27;

/// Why a BVH could not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RayError {
    /// The length of the index table is not a multiple of three.
    #[error("{count} indices are not a multiple of 3")]
    PartialTriangle {
        /// Length of the index table.
        count: usize,
    },
    /// An index refers to a vertex that does not exist.
    #[error("index {at} names vertex {vertex}, but there are {vertices} vertices")]
    Index {
        /// Position in the index table.
        at: usize,
        /// The vertex that it refers to.
        vertex: u32,
        /// Length of the vertex table.
        vertices: usize,
    },
    /// A position is not finite, or beyond [`COORDINATE_LIMIT`].
    #[error(
        "vertex {vertex} lies at {position:?}; coordinates must be finite and at most {COORDINATE_LIMIT:e} in size"
    )]
    Position {
        /// Index of the vertex.
        vertex: usize,
        /// Its position, object space.
        position: [f32; 3],
    },
    /// A sphere is not finite, has a negative radius, or reaches beyond [`COORDINATE_LIMIT`].
    #[error(
        "sphere {sphere} has its centre at {centre:?} and radius {radius}; the radius must not be negative, and no coordinate of the sphere over {COORDINATE_LIMIT:e}"
    )]
    Sphere {
        /// Index of the sphere.
        sphere: usize,
        /// Its centre, object space.
        centre: [f32; 3],
        /// Its radius, object space.
        radius: f32,
    },
    /// There are more than [`PRIMITIVE_LIMIT`] primitives.
    #[error("{count} primitives; a tree takes at most {PRIMITIVE_LIMIT}")]
    TooMany {
        /// Number of primitives.
        count: usize,
    },
    /// An instance refers to a mesh that does not exist.
    #[error("instance {instance} shows mesh {mesh}, but there are {meshes} meshes")]
    Mesh {
        /// Index of the instance.
        instance: usize,
        /// The mesh that it refers to.
        mesh: u32,
        /// Length of the mesh table.
        meshes: usize,
    },
    /// The transform of an instance is not finite, or the instance reaches beyond [`COORDINATE_LIMIT`].
    #[error(
        "instance {instance} spans {min:?} to {max:?} in the world; coordinates must be finite and at most {COORDINATE_LIMIT:e} in size"
    )]
    Instance {
        /// Index of the instance.
        instance: usize,
        /// Lower corner of its bounds, world space, metres.
        min: [f32; 3],
        /// Upper corner of its bounds, world space, metres.
        max: [f32; 3],
    },
    /// The BVH is too deep for the traversal stack of the shader.
    #[error("the tree needs {needed} stack entries; traversal has {limit}")]
    Stack {
        /// Stack entries that a traversal needs.
        needed: u32,
        /// Stack entries that the shader has.
        limit: u32,
    },
    /// An error in one mesh, with its name.
    #[error("mesh `{mesh}`: {fault}")]
    InMesh {
        /// Name of the mesh.
        mesh: String,
        /// The error.
        fault: Box<RayError>,
    },
}

impl RayError {
    /// The same error, with the name of the mesh.
    pub fn in_mesh(self, mesh: impl Into<String>) -> Self {
        Self::InMesh { mesh: mesh.into(), fault: Box::new(self) }
    }
}
