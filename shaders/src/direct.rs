//! Parameters of `shaders/direct`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// A byte of [`ShadeParams::casters`]: a channel that holds no light.
pub const NO_CASTER: u32 = 255;
/// [`ShadeParams::emitters`] where no surface lights others.
pub const NO_EMITTERS: u32 = 4294967295;

/// Parameters of `emitters.ray` and `tinted_emitters.ray`: light of emissive surfaces.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct EmitterParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of rays.
    pub rays: Address,
    /// The [`LightTables`](super::reference::LightTables), of which `near` and `emitters` are there.
    pub lights: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Instance + 1 in red, triangle in green.
    pub ids: SampledImage,
    /// Linear base colour; occlusion in alpha.
    pub base_colour: SampledImage,
    /// Metalness in red, roughness in green.
    pub material: SampledImage,
    /// Outgoing radiance over the reflectance, RGBA32F.
    pub radiance: StorageImage,
    /// Rays of a pixel.
    pub samples: u32,
}

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
    /// Light of emissive surfaces, without the reflectance, or [`NO_EMITTERS`].
    pub emitters: u32,
    /// Points of each light that has a size; 0 for its centre.
    pub area: u32,
    /// How many images of visibility there are.
    pub group_count: u32,
    /// Their images.
    pub visibility: [u32; 8],
    /// The lights of each: a byte for each channel, the first lowest, which counts in [`View::casters`](super::view::View::casters), or is
    /// [`NO_CASTER`].
    pub casters: [u32; 8],
    /// A bit for each image whose first three channels belong to its first light, one for each of its colours.
    pub coloured: u32,
    /// Those that are single rays, unfiltered: a bit for each.
    pub raw: u32,
}
