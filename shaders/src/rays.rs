//! Parameters of the traversal heat map and of ray sorting.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Parameters of the heat map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HeatMapParams {
    /// [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Nodes visited and primitives tested, RG32F.
    pub steps: StorageImage,
    /// Their sum in false colour, RGBA8.
    pub colours: StorageImage,
    /// Number of steps that maps to the hottest colour.
    pub hottest: f32,
}

/// A precomputed ray, so that every backend traces the same ones.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RayTask {
    /// Origin, world space, metres.
    pub origin: [f32; 3],
    /// Least distance of a hit, in lengths of `direction`.
    pub t_min: f32,
    /// Direction; need not be a unit vector.
    pub direction: [f32; 3],
    /// Greatest distance of a hit, in lengths of `direction`.
    pub t_max: f32,
    /// Only instances whose mask shares a bit are hit.
    pub mask: u32,
    /// `RAY_CULL_*` bits of `lib/ray_types.glsl`: 1 back faces, 2 front faces.
    pub cull: u32,
}

/// Number of sort keys: three bits of direction, nine of origin.
pub const SORT_KEYS: u32 = 4096;
/// Threads per workgroup of the sorting passes.
pub const SORT_GROUP: u32 = 256;

/// Parameters of the passes that sort rays.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SortParams {
    /// [`RayTask`] table.
    pub rays: Address,
    /// Key of each ray, `u32`.
    pub keys: Address,
    /// Per key the number of rays, then the next free place in `order`, `u32`.
    pub counts: Address,
    /// Output: indices of rays in sorted order, `u32`.
    pub order: Address,
    /// Number of rays.
    pub count: u32,
    /// Lower corner of the bounding box of all origins, metres.
    pub lower: [f32; 3],
    /// Cells per metre; the box has eight along each axis.
    pub scale: [f32; 3],
}
