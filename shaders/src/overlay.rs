//! Structs of `shaders/overlay`.
use super::types::{Address, SampledImage, SamplerId};
use bytemuck::{Pod, Zeroable};

/// A corner of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct OverlayVertex {
    /// From the upper left of the target, in units of the mesh.
    pub position: [f32; 2],
    /// In the image of its mesh, 0 to 1.
    pub uv: [f32; 2],
    /// Display values times alpha, then alpha, 8 bits each: red in the lowest.
    pub colour: u32,
}

/// Push constants of `draw.vert` and `draw.frag`: one mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct OverlayParams {
    /// [`OverlayVertex`] table of all meshes.
    pub vertices: Address,
    /// Width and height of the target, pixels.
    pub size: [f32; 2],
    /// Left, top, right and bottom of what is drawn of the mesh, pixels.
    pub clip: [f32; 4],
    /// Image that colours are multiplied with: display values times alpha, and alpha.
    pub image: SampledImage,
    /// How that is filtered.
    pub sampler_id: SamplerId,
    /// 1 if the alpha of that does not count, else 0.
    pub is_opaque: u32,
    /// Where the corners of the mesh begin in the table.
    pub first_vertex: u32,
    /// Pixels per unit of the positions.
    pub scale: f32,
}
