//! Parameters and tables of shadow maps, `shaders/shadows/map_*` and `contact.comp`.
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`MapParams::filter_kind`]: one texel.
pub const MAP_FILTER_NONE: u32 = 0;
/// [`MapParams::filter_kind`]: a box of texels (percentage-closer filtering).
pub const MAP_FILTER_PCF: u32 = 1;
/// [`MapParams::filter_kind`]: a disc as wide as the penumbra (percentage-closer soft shadows).
pub const MAP_FILTER_PCSS: u32 = 2;
/// [`MapLight::kind`]: a directional light; its layers are cascades, the finest first.
pub const MAP_CASCADES: u32 = 0;
/// [`MapLight::kind`]: a local light; its layers are faces that do not overlap, such as the six of a cube.
pub const MAP_FACES: u32 = 1;
/// Greatest number of lights per lookup pass.
pub const MAP_LIGHTS: u32 = 4;
/// Unsure, as the bit of the first light; the bits of light `i` are shifted by `i`. Some of the filter's area, or of a soft light, is
/// occluded and some is not.
pub const UNSURE_PENUMBRA: u32 = 1;
/// Unsure: an occluder is too close to the surface for the map's precision.
pub const UNSURE_CONTACT: u32 = 16;
/// Unsure: an occluder's edge is near, and a texel is wider than pixels are.
pub const UNSURE_RESOLUTION: u32 = 256;
/// Unsure: the surface is outside every layer of the light.
pub const UNSURE_OUTSIDE: u32 = 4096;
/// All reasons, as bits of the first light.
pub const UNSURE_ANY: u32 = 4369;

/// Push constants of `map.vert`, `map.frag`, `map_sphere.vert` and `map_sphere.frag`: one layer of a shadow map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapDrawParams {
    /// Clip from world. Depth is reversed: 1 nearest to the light, or at its near plane.
    pub clip_from_world: [[f32; 4]; 4],
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Position of a local light, metres; for directional lights the unit direction in which light travels.
    pub light: [f32; 3],
    /// 1 for a directional light.
    pub is_parallel: u32,
    /// Width of a texel, metres; for local lights at a distance of one metre.
    pub texel: f32,
}

/// A layer of a shadow map: an orthographic box, or a pyramid with its apex at the light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapLayer {
    /// Centre of the far side of the box, or the apex of the pyramid; world, metres.
    pub origin: [f32; 3],
    /// From the centre of the map to its right edge, metres; for a pyramid at a distance of one metre.
    pub right: [f32; 3],
    /// From the centre of the map to its lower edge, likewise.
    pub down: [f32; 3],
    /// Unit direction in which light travels through the centre.
    pub forward: [f32; 3],
    /// Depth of the box, or distance of the near plane from the apex; metres.
    pub depth: f32,
}

/// A light with a shadow map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapLight {
    /// Index of the light in the scene.
    pub light: u32,
    /// [`MAP_CASCADES`] or [`MAP_FACES`].
    pub kind: u32,
    /// Index of its first [`MapLayer`].
    pub first: u32,
    /// Number of layers.
    pub layers: u32,
    /// Tangent of half the angular diameter of a directional light; for local lights the radius of a disc of the same area, metres.
    pub size: f32,
    /// Unit direction of a one-sided light's front; zero for all others.
    pub facing: [f32; 3],
}

/// Push constants of `map_look.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Counter of texels that are not finite.
    pub not_finite: Address,
    /// [`MapLight`] table.
    pub lights: Address,
    /// [`MapLayer`] table.
    pub layers: Address,
    /// The map of each light: a depth image, with layers if there are several.
    pub maps: [SampledImage; 4],
    /// Number of lights.
    pub light_count: u32,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Output, one light in each channel: 1 visible, 0 occluded.
    pub visibility: StorageImage,
    /// Output: `UNSURE_*` bits; not written if it is the default image.
    pub unsure: StorageImage,
    /// `MAP_FILTER_*`.
    pub filter_kind: u32,
    /// Width of the PCF box, texels.
    pub kernel: f32,
    /// Samples of a soft shadow, and as many for its blocker search.
    pub taps: u32,
    /// 1 for PCF at sample positions rotated by per-pixel noise.
    pub rotate: u32,
    /// Width of the transition to the next cascade, as a share of the half side of a cascade.
    pub blend: f32,
    /// Width of a texel, pixels, from which on an edge nearby is unsure.
    pub coarse: f32,
}

/// Push constants of `contact.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ContactParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// [`MapLight`] table.
    pub lights: Address,
    /// Number of lights.
    pub light_count: u32,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// One light in each channel; set to 0 where occluded.
    pub visibility: StorageImage,
    /// Length of the march, metres.
    pub reach: f32,
    /// Steps of the march.
    pub steps: u32,
}
