//! Parameters of `shaders/direct`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Value of [`ShadeParams::visibility`] without a shadow stage.
pub const NO_VISIBILITY: u32 = 4294967295;

/// Push constants of `shade.comp`: radiance from every light, and emission.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ShadeParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Linear base colour; occlusion in alpha.
    pub base_colour: SampledImage,
    /// Metalness in red, roughness in green.
    pub material: SampledImage,
    /// Emitted radiance.
    pub emission: SampledImage,
    /// Visibility of the key light, or [`NO_VISIBILITY`].
    pub visibility: u32,
    /// Outgoing radiance, RGBA32F or RGBA16F.
    pub radiance: StorageImage,
    /// Greatest number that its format holds; infinite for 32-bit floats.
    pub greatest: f32,
}
