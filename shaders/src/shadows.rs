//! Parameters of `shaders/shadows`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`TraceParams::map_visibility`] without maps.
pub const NO_MAP: u32 = 4294967295;
/// [`TraceParams::penumbra`] where nobody asks.
pub const NO_PENUMBRA: u32 = 4294967295;
/// Width of a penumbra that 1 stands for in images, pixels; wider ones count as this wide.
pub const PENUMBRA_MOST: f32 = 64.0;

/// Push constants of `trace.ray`: shadow rays towards up to four lights.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TraceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Instance + 1 and primitive.
    pub ids: SampledImage,
    /// A light in each channel: 1 where all of it is visible, 0 where it is hidden.
    pub visibility: StorageImage,
    /// Width of the penumbra of what a ray has met, over [`PENUMBRA_MOST`], or [`NO_PENUMBRA`]; 0 where all of them arrived.
    pub penumbra: u32,
    /// What maps say of the same lights, or [`NO_MAP`].
    pub map_visibility: u32,
    /// Where they are not sure: `UNSURE_*` bits of [`super::shadow_map`]. Rays go from there alone.
    pub unsure: u32,
    /// Every so many pixels in each direction have rays: 1, or 2 for half resolution.
    pub step: u32,
    /// Rays of a pixel to each light; 0 for one to its centre.
    pub samples: u32,
    /// How many lights.
    pub count: u32,
    /// Their indices in the scene.
    pub lights: [u32; 4],
}

/// Push constants of `gradient.ray`: what has changed since the frame before.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct GradientParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Instance + 1 and primitive.
    pub ids: SampledImage,
    /// Texture coordinates now minus one frame ago.
    pub motion: SampledImage,
    /// The surfaces that the frame before remembered, one in nine pixels: RG32 uint, two texels beside each other for each.
    pub previous: SampledImage,
    /// What `trace.ray` found then, of every pixel.
    pub previous_visibility: SampledImage,
    /// The surfaces to remember: as `previous`.
    pub next: StorageImage,
    /// Difference of each channel, 0 to 1, a third as large.
    pub change: StorageImage,
    /// 0 where there is no frame before.
    pub valid: u32,
    /// As in [`TraceParams`].
    pub samples: u32,
    /// How many lights.
    pub count: u32,
    /// Their indices in the scene.
    pub lights: [u32; 4],
}

/// Push constants of `reach.comp`: the penumbrae in which each pixel may lie.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ReachParams {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// As `trace.ray` wrote it.
    pub penumbra: SampledImage,
    /// The widest of those around that reach as far as here, over [`PENUMBRA_MOST`].
    pub reach: StorageImage,
    /// Pixels for each of `penumbra`, each way: 1 or 2.
    pub step: u32,
}

/// Push constants of `upsample.comp`: visibility of half resolution brought to full.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct UpsampleParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Half as large: visibility of the upper left one of four pixels.
    pub half_visibility: SampledImage,
    /// Full size.
    pub visibility: StorageImage,
}
