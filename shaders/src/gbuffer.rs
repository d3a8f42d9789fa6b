//! Parameters of `shaders/gbuffer`.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Images of the G-buffer, as passes get them in their parameters. What each holds is in `lib/README.md`; those that a pass did not declare
/// read as black.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct GBufferImages {
    /// Reversed depth.
    pub depth: SampledImage,
    /// Linear base colour; occlusion in alpha.
    pub base_colour: SampledImage,
    /// Octahedral shading normal.
    pub normal: SampledImage,
    /// Octahedral geometric normal.
    pub geometric_normal: SampledImage,
    /// Metalness, roughness, and the specular reflectance of the dielectric part.
    pub material: SampledImage,
    /// Strength and roughness of the clear coat.
    pub coat: SampledImage,
    /// Emitted radiance.
    pub emission: SampledImage,
    /// Motion vectors.
    pub motion: SampledImage,
    /// Instance + 1 and primitive.
    pub ids: SampledImage,
}

/// Push constants of one draw list.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DrawParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
}
