//! Parameters of `shaders/bench`: the passes of `magpie bench graph`, and the rays of `magpie bench rays`.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Threads of a pass over buffers; each writes one [`Cell`].
pub const CELLS: u32 = 64;
/// Width and height of the images, pixels; one thread each.
pub const SIDE: u32 = 4;
/// Factor of what the pass before wrote. Odd, so that no bit is lost.
pub const FIRST_FACTOR: u32 = 1664525;
/// Factor of what the pass before that one wrote.
pub const SECOND_FACTOR: u32 = 22695477;
/// Factor of the number of the pass.
pub const NUMBER_FACTOR: u32 = 2654435761;

/// One word of a buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Cell {
    /// Anything.
    pub value: u32,
}

/// Push constants of `buffer.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BufferParams {
    /// What the pass before wrote, [`CELLS`] of [`Cell`]; pass 0 does not look.
    pub first: Address,
    /// What the pass before that one wrote; passes 0 and 1 do not look.
    pub second: Address,
    /// What this pass writes.
    pub result: Address,
    /// Number of the pass, from 0.
    pub number: u32,
}

/// Push constants of `image.comp` and `image_array.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ImageParams {
    /// What the pass before wrote; pass 0 does not look.
    pub first: StorageImage,
    /// What the pass before that one wrote; passes 0 and 1 do not look.
    pub second: StorageImage,
    /// What this pass writes.
    pub result: StorageImage,
    /// Number of the pass, from 0.
    pub number: u32,
}

/// What a [`RayTask`](super::rays::RayTask) met first.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RayAnswer {
    /// Distance in lengths of the direction; that of the end of the ray where it met nothing.
    pub t: f32,
    /// Index of the instance, or all ones.
    pub instance: u32,
    /// Index of the triangle or sphere in its mesh.
    pub primitive: u32,
    /// Weights of the second and third corner.
    pub barycentric: [f32; 2],
    /// 1 where it met the front.
    pub front: u32,
}

/// Push constants of `closest.ray` and `any.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TraceParams {
    /// Root of the scene's tables.
    pub scene: Address,
    /// [`RayTask`](super::rays::RayTask) table, row after row.
    pub rays: Address,
    /// [`RayAnswer`] table for `closest.ray`; for `any.ray` a [`Cell`] each, 1 where anything was met.
    pub answers: Address,
    /// Indices of rays in the order in which they are traced; zero for the order of the table.
    pub order: Address,
    /// Rays in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}
