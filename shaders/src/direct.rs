//! Parameters of `shaders/direct`.
use super::gbuffer::GBufferImages;
use super::light_tree::LightSplit;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`LobeImages::specular`] and [`ShadeParams::specular`] if specular light is not apart from diffuse light.
pub const NO_LOBE: u32 = 4294967295;

/// Where light goes that surfaces reflect once, for denoisers.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LobeImages {
    /// Outgoing radiance over the albedo, `reflectance` of `lib/bsdf.glsl`; with `specular` without the share that is apart, light and albedo.
    pub radiance: StorageImage,
    /// Outgoing radiance of the specular lobes over their albedo, or [`NO_LOBE`]. 0 where none of it is apart.
    pub specular: u32,
    /// With `specular`, distance to what these reflect, metres.
    pub hit_distance: StorageImage,
    /// With `specular`, their width on the screen, pixels over `WIDEST_NOISE`.
    pub width: StorageImage,
    /// Largest finite number of the format of `radiance` and `specular`.
    pub greatest: f32,
    /// With `specular`, perceptual roughness from which on nothing is apart. The share that is falls to 0 from three quarters of it on.
    pub limit: f32,
}

/// Four bits of [`ShadeParams::shadow_lights`] for a channel without a light.
pub const NO_SHADOW_LIGHT: u32 = 15;
/// [`ShadeParams::sampled`] if there is no such light.
pub const NO_SAMPLED_LIGHT: u32 = 4294967295;

/// Bits of [`ShadeParams::flags`] with the lights that are evaluated.
pub const LIGHTS_MASK: u32 = 0x30000;
/// All.
pub const LIGHTS_ALL: u32 = 0;
/// Directional ones.
pub const LIGHTS_DIRECTIONAL: u32 = 0x10000;
/// None.
pub const LIGHTS_NONE: u32 = 0x20000;
/// Bit of [`ShadeParams::flags`]: `radiance` holds 16-bit floats.
pub const RADIANCE_HALF: u32 = 0x40000;
/// From this bit of [`ShadeParams::flags`] on: samples of each light that has a size; 0 to treat it as a point at its centre.
pub const AREA_SHIFT: u32 = 24;

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
    /// What is written.
    pub lobes: LobeImages,
    /// Rays per pixel.
    pub samples: u32,
}

/// Parameters of `tree.ray` and `tinted_tree.ray`: light of local lights and emissive surfaces, chosen by the light tree.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TreeLightParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// The [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// The [`LightTree`](super::light_tree::LightTree).
    pub tree: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// What is written.
    pub lobes: LobeImages,
    /// How the tree is split.
    pub split: LightSplit,
    /// Alpha below which a ray is traced along lobes; 0 for none.
    pub widest_alpha: f32,
}

/// Push constants of `light_change.comp`: how much the light of lamps has changed, in one pixel of nine.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightChangeParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// The [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// The [`LightTree`](super::light_tree::LightTree).
    pub tree: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `drawn` one frame ago.
    pub previous: SampledImage,
    /// Output, RG32 uint: the lamp that was chosen, + 1, and a point of it, two numbers of 16 bits.
    pub drawn: StorageImage,
    /// Output: change, 0 to 1.
    pub change: StorageImage,
    /// 0 in the first frame.
    pub valid: u32,
}

/// Push constants of `shade.comp` and `clustered.comp`: radiance from every light, and emission.
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
    /// Light of emissive surfaces, or of sampled lights, over the albedo as in [`LobeImages`], or [`NO_SAMPLED_LIGHT`].
    pub sampled: u32,
    /// The part of it that specular lobes reflect, as in [`LobeImages`], or [`NO_LOBE`].
    pub specular: u32,
    /// [`LobeImages::limit`].
    pub limit: f32,
    /// The [`LampGrid`](super::clusters::LampGrid), for `clustered.comp` alone.
    pub clusters: Address,
    /// Visibility images, up to four lights each. The first that is left at its default ends them.
    pub visibility: [SampledImage; 8],
    /// Lights of two images each, the first image in the lower half: four bits per channel, the first channel lowest, with an index in
    /// [`View::shadow_lights`](super::view::View::shadow_lights) or [`NO_SHADOW_LIGHT`].
    pub shadow_lights: [u32; 4],
    /// Bit k: the first three channels of visibility image k hold the coloured visibility of its first light. Bit 8 + k: it holds unfiltered rays.
    /// Bits of [`LIGHTS_MASK`]: `LIGHTS_*`. [`RADIANCE_HALF`]. From bit [`AREA_SHIFT`] on: points of lights.
    pub flags: u32,
}
