//! Parameters of `shaders/direct`.
use super::gbuffer::GBufferImages;
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Four bits of [`ShadeParams::shadow_lights`] for a channel without a light.
pub const NO_SHADOW_LIGHT: u32 = 15;
/// [`ShadeParams::emitters`] if emissive surfaces do not light others.
pub const NO_EMITTERS: u32 = 4294967295;

/// Parameters of `emitters.ray` and `tinted_emitters.ray`: light of emissive surfaces.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct EmitterParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// The [`LightTables`](super::light_sampling::LightTables), of which only `near` and `emitters` are set.
    pub lights: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Outgoing radiance over the albedo (`reflectance` of `lib/bsdf.glsl`).
    pub radiance: StorageImage,
    /// Rays per pixel.
    pub samples: u32,
    /// Largest finite number of the format of `radiance`.
    pub greatest: f32,
}

/// Push constants of `shade.comp`: radiance from every light, and emission.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ShadeParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Outgoing radiance, RGBA32F or RGBA16F.
    pub radiance: StorageImage,
    /// Greatest number in the format of `radiance`; infinite for 32-bit floats.
    pub greatest: f32,
    /// Light of emissive surfaces over the albedo, or [`NO_EMITTERS`].
    pub emitters: u32,
    /// Samples per light that has a size; 0 to treat it as a point at its centre.
    pub area: u32,
    /// Number of visibility images.
    pub group_count: u32,
    /// Visibility images, up to four lights each.
    pub visibility: [u32; 8],
    /// Lights of two images each, the first image in the lower half: four bits per channel, the first channel lowest, with an index in
    /// [`View::shadow_lights`](super::view::View::shadow_lights) or [`NO_SHADOW_LIGHT`].
    pub shadow_lights: [u32; 4],
    /// Bit k: the first three channels of image k hold the coloured visibility of its first light. Bit 8 + k: it holds unfiltered rays.
    pub group_flags: u32,
}
