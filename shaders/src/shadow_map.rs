//! Parameters and tables of shadow maps, `shaders/shadows/map_*` and `contact.comp`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`MapParams::filter_kind`]: one texel.
pub const MAP_FILTER_NONE: u32 = 0;
/// [`MapParams::filter_kind`]: a box of texels (percentage-closer filtering).
pub const MAP_FILTER_PCF: u32 = 1;
/// [`MapParams::filter_kind`]: a disc as wide as the penumbra (percentage-closer soft shadows).
pub const MAP_FILTER_PCSS: u32 = 2;
/// [`MapLight::kind`]: parallel light; its layers are cascades, the finest first.
pub const MAP_CASCADES: u32 = 0;
/// [`MapLight::kind`]: light from a point; its layers are faces that do not overlap.
pub const MAP_FACES: u32 = 1;
/// Most lights that one look at maps answers for.
pub const MAP_LIGHTS: u32 = 4;
/// Unsure, in the bits of the first light; those of light `i` lie `i` bits higher. Some of what a soft light or the filter sees is
/// hidden, and some is not.
pub const UNSURE_PENUMBRA: u32 = 1;
/// Unsure: something in the map is nearer to the surface than the map can tell apart.
pub const UNSURE_CONTACT: u32 = 16;
/// Unsure: the edge of something in the map is near, and a texel is wider than pixels are.
pub const UNSURE_RESOLUTION: u32 = 256;
/// Unsure: the surface lies outside of every map of the light.
pub const UNSURE_OUTSIDE: u32 = 4096;
/// Every reason, in the bits of the first light.
pub const UNSURE_ANY: u32 = 4369;

/// Push constants of `map.vert`, `map.frag`, `map_sphere.vert` and `map_sphere.frag`: one layer of a shadow map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapDrawParams {
    /// Clip from world. Depth is reversed: 1 nearest to the light, or at its near plane.
    pub clip_from_world: [[f32; 4]; 4],
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The light, where it has a place; else its unit direction of travel.
    pub light: [f32; 3],
    /// 1 where the light is parallel.
    pub is_parallel: u32,
    /// Width of a texel, metres; of a light that has a place, at one metre from it.
    pub texel: f32,
}

/// A layer of a shadow map: a box, or a pyramid with its top at the light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapLayer {
    /// Centre of the far side of the box, or the top of the pyramid; world, metres.
    pub origin: [f32; 3],
    /// From the centre of the map to its right edge: metres; of a pyramid, metres at one metre from its top.
    pub right: [f32; 3],
    /// From the centre of the map to its lower edge.
    pub down: [f32; 3],
    /// Unit direction of travel of the light through the centre.
    pub forward: [f32; 3],
    /// Depth of the box, or distance of the near plane from the top of the pyramid; metres.
    pub depth: f32,
}

/// A light with a shadow map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapLight {
    /// Index of the light in the scene.
    pub light: u32,
    /// `MAP_*`.
    pub kind: u32,
    /// Index of its first [`MapLayer`].
    pub first: u32,
    /// How many layers it has.
    pub layers: u32,
    /// The tangent of half the angle of parallel light; of a lamp, the radius of a disc of its area, metres.
    pub size: f32,
    /// The side that a lamp shines to, unit; zero where it shines all around.
    pub facing: [f32; 3],
}

/// Push constants of `map_look.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MapParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of texels that are not finite.
    pub not_finite: Address,
    /// [`MapLight`] table.
    pub lights: Address,
    /// [`MapLayer`] table.
    pub layers: Address,
    /// The map of each light: a depth image, an array where it has several layers.
    pub maps: [SampledImage; 4],
    /// How many lights.
    pub light_count: u32,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// One light in each channel: 1 where it is seen, 0 where it is hidden.
    pub visibility: StorageImage,
    /// `UNSURE_*` bits, where somebody wants to know.
    pub unsure: StorageImage,
    /// 1 where somebody wants to know.
    pub classify: u32,
    /// `MAP_FILTER_*`.
    pub filter_kind: u32,
    /// Side of the box of the filter, texels.
    pub kernel: f32,
    /// Samples of a soft shadow; as many look for what casts it.
    pub taps: u32,
    /// 1 where the box is sampled at points that are turned by noise of each pixel.
    pub rotate: u32,
    /// Share of the half side of a cascade over which it goes over into the next.
    pub blend: f32,
    /// How many pixels a texel may be wide before an edge near it is unsure.
    pub coarse: f32,
}

/// Push constants of `contact.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ContactParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`MapLight`] table.
    pub lights: Address,
    /// How many lights.
    pub light_count: u32,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// One light in each channel, to be darkened.
    pub visibility: StorageImage,
    /// How far to march, metres.
    pub reach: f32,
    /// In how many steps.
    pub steps: u32,
}
