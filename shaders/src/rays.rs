//! Looking at rays, and sorting them.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Parameters of the heat map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HeatMapParams {
    /// [`View`](super::view::View).
    pub view: Address,
    /// Counter of rays.
    pub rays: Address,
    /// Nodes visited and primitives tested, RG32F.
    pub steps: StorageImage,
    /// Their sum in false colours, RGBA8.
    pub colours: StorageImage,
    /// Steps that are shown as the hottest colour.
    pub hottest: f32,
}

/// A ray that was made beforehand, so that every way to trace gets the very same.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RayTask {
    /// Where it begins, world space, metres.
    pub origin: [f32; 3],
    /// Hits count from here on, in lengths of `direction`.
    pub t_min: f32,
    /// Where it goes; need not be a unit vector.
    pub direction: [f32; 3],
    /// Hits count up to here.
    pub t_max: f32,
    /// Instances that share a bit with it are seen.
    pub mask: u32,
    /// `RAY_CULL_*` bits of `lib/ray_types.glsl`: 1 back faces, 2 front faces.
    pub cull: u32,
}

/// Keys that rays are sorted by: three bits of direction, nine of origin.
pub const SORT_KEYS: u32 = 4096;
/// Threads of a workgroup that sorts.
pub const SORT_GROUP: u32 = 256;

/// Parameters of the passes that sort rays.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SortParams {
    /// [`RayTask`] table.
    pub rays: Address,
    /// Key of each ray, `u32`.
    pub keys: Address,
    /// Per key: how many rays, then where the next of them goes, `u32`.
    pub counts: Address,
    /// Indices of rays in their new order, `u32`.
    pub order: Address,
    /// How many rays.
    pub count: u32,
    /// Least corner of the box that origins lie in, metres.
    pub lower: [f32; 3],
    /// Eighths of that box per metre.
    pub scale: [f32; 3],
}
