//! Parameters of `shaders/shadows`.
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Value of [`TraceParams::map_visibility`] without shadow maps.
pub const NO_MAP: u32 = 4294967295;
/// Value of [`TraceParams::penumbra`] if no pass reads it.
pub const NO_PENUMBRA: u32 = 4294967295;
/// Value of [`TraceParams::surfaces`] if no pass compares the visibility of two frames.
pub const NO_SURFACES: u32 = 4294967295;

/// Push constants of `trace.ray`: shadow rays towards up to four lights.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TraceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Output, a light in each channel: 1 fully visible, 0 occluded.
    pub visibility: StorageImage,
    /// Output: penumbra width at the hits, over [`WIDEST_NOISE`](super::denoise::WIDEST_NOISE), 0 where all rays arrived; or [`NO_PENUMBRA`].
    pub penumbra: u32,
    /// Output: the surface of one pixel in nine, for `gradient.ray` of the next frame, two texels each; or [`NO_SURFACES`].
    pub surfaces: u32,
    /// Visibility by shadow maps of the same lights, or [`NO_MAP`].
    pub map_visibility: u32,
    /// `UNSURE_*` bits of [`super::shadow_map`] for `map_visibility`. Only pixels with any are traced.
    pub unsure: u32,
    /// Spacing of the pixels that are traced: 1, or 2 for half resolution.
    pub step: u32,
    /// Rays per pixel to each light; 0 for one to its centre.
    pub samples: u32,
    /// Number of lights.
    pub count: u32,
    /// Indices of the lights in the scene.
    pub lights: [u32; 4],
}

/// Push constants of `gradient.ray`: temporal gradients of visibility.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct GradientParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `surfaces` of `trace.ray` one frame ago: RG32 uint, two adjacent texels for one of nine pixels.
    pub previous: SampledImage,
    /// `visibility` of `trace.ray` one frame ago.
    pub previous_visibility: SampledImage,
    /// Output: change of each channel, 0 to 1, at a third of the size.
    pub change: StorageImage,
    /// 0 in the first frame.
    pub valid: u32,
    /// As in [`TraceParams`].
    pub samples: u32,
    /// Number of lights.
    pub count: u32,
    /// Indices of the lights in the scene.
    pub lights: [u32; 4],
}

/// Push constants of `penumbra_width.comp`: the penumbra width that may apply to each pixel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PenumbraWidthParams {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// `penumbra` of `trace.ray`.
    pub penumbra: SampledImage,
    /// Output: the widest penumbra around that reaches the pixel, over [`WIDEST_NOISE`](super::denoise::WIDEST_NOISE).
    pub width: StorageImage,
    /// Pixels per texel of `penumbra`, in each direction: 1 or 2.
    pub step: u32,
}
