//! Parameters of `shaders/bench`: the passes of `magpie bench graph`, and the rays of `magpie bench rays`.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Threads of a pass over buffers; each writes one [`Cell`].
pub const CELLS: u32 = 64;
/// Width and height of the images, pixels; one thread each.
pub const SIDE: u32 = 4;
/// Factor of the previous pass's value. Odd, so that no bit is lost.
pub const FIRST_FACTOR: u32 = 1664525;
/// Factor of the value of the pass before that.
pub const SECOND_FACTOR: u32 = 22695477;
/// Factor of the index of the pass.
pub const NUMBER_FACTOR: u32 = 2654435761;

/// One word of a buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Cell {
    /// Result of the pass for one thread.
    pub value: u32,
}

/// Push constants of `buffer.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BufferParams {
    /// Output of the previous pass, [`CELLS`] of [`Cell`]; pass 0 does not read it.
    pub first: Address,
    /// Output of the pass before that; passes 0 and 1 do not read it.
    pub second: Address,
    /// Output of this pass.
    pub result: Address,
    /// Index of the pass, from 0.
    pub number: u32,
}

/// Push constants of `image.comp` and `image_array.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ImageParams {
    /// Output of the previous pass; pass 0 does not read it.
    pub first: StorageImage,
    /// Output of the pass before that; passes 0 and 1 do not read it.
    pub second: StorageImage,
    /// Output of this pass.
    pub result: StorageImage,
    /// Index of the pass, from 0.
    pub number: u32,
}

/// The closest hit of a [`RayTask`](super::rays::RayTask).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RayAnswer {
    /// Distance of the hit in lengths of the direction; the ray's `t_max` on a miss.
    pub t: f32,
    /// Index of the instance; all ones on a miss.
    pub instance: u32,
    /// Index of the triangle or sphere in its mesh.
    pub primitive: u32,
    /// Barycentric weights of the second and third corner.
    pub barycentric: [f32; 2],
    /// 1 for a hit on the front.
    pub front: u32,
}

/// Push constants of `closest.ray` and `any.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TraceParams {
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// [`RayTask`](super::rays::RayTask) table, row after row.
    pub rays: Address,
    /// Results: a [`RayAnswer`] per ray for `closest.ray`; a [`Cell`] per ray for `any.ray`, 1 for a hit.
    pub answers: Address,
    /// Indices of rays in the order in which to trace them; zero for the order of the table.
    pub order: Address,
    /// Rays per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}
