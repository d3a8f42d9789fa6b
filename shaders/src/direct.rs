//! Parameters of `shaders/direct`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// A byte of [`ShadeParams::casters`]: a channel that holds no light.
pub const NO_CASTER: u32 = 255;

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
    pub visibility: [u32; 8],
    /// The lights of each: a byte for each channel, the first lowest, which counts in [`View::casters`](super::view::View::casters), or is
    /// [`NO_CASTER`].
    pub casters: [u32; 8],
    /// A bit for each image whose first three channels belong to its first light, one for each of its colours.
    pub coloured: u32,
}
