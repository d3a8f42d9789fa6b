//! Parameters of `shaders/direct`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

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
    /// Outgoing radiance, RGBA32F or RGBA16F.
    pub radiance: StorageImage,
    /// Greatest number that its format holds; infinite for 32-bit floats.
    pub greatest: f32,
    /// How many images of visibility there are.
    pub group_count: u32,
    /// Their images.
    pub visibility: [u32; 4],
    /// The light of each channel of each, or [`NO_LIGHT`](super::view::NO_LIGHT).
    pub lights: [u32; 16],
    /// A bit for each image whose first three channels belong to its first light, one for each of its colours.
    pub coloured: u32,
}
