//! Parameters of `shaders/gi/sky.comp` and `shaders/reflections/sky.comp`: light of the sky on what the camera sees.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of both: the sky's diffuse and specular light, unoccluded.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SkyLightParams {
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
    /// Outgoing radiance, RGBA32F or RGBA16F.
    pub radiance: StorageImage,
    /// Greatest number that its format holds; infinite for 32-bit floats.
    pub greatest: f32,
}
