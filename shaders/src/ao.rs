//! Parameters of `shaders/ao`.
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Value of `bent_normal` where there is no such image.
pub const NO_BENT_NORMAL: u32 = 4294967295;

/// Push constants of `trace.ray`: rays over the hemisphere above every pixel.
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
    /// R16F: share of the rays that met nothing.
    pub openness: StorageImage,
    /// Spacing of the pixels that are traced: 1, or 2 for half resolution.
    pub step: u32,
    /// Rays per pixel.
    pub samples: u32,
    /// Distance up to which geometry occludes, metres.
    pub range: f32,
}

/// Push constants of `search.comp`: horizons in the depth image.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SearchParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of results that are not finite.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Unit bent normal in the world, -1 to 1 as 0 to 1, and openness in alpha: RGBA8.
    pub found: StorageImage,
    /// Spacing of the pixels that are searched: 1, or 2 for half resolution.
    pub step: u32,
    /// Planes through the view direction.
    pub slices: u32,
    /// Depth samples on each side of a slice.
    pub steps: u32,
    /// Distance up to which geometry occludes, metres.
    pub range: f32,
    /// Share of the way by which a sample below the horizon lowers it, 0 to 1.
    pub decay: f32,
    /// Noise of this frame, added to that of the pixel, 0 to 1: rotation of the slices, and offset of the steps.
    pub noise: [f32; 2],
}

/// Push constants of `filter.comp`: edge-aware denoising of `search.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FilterParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `found` of `search.comp`.
    pub found: SampledImage,
    /// At full size R16F, openness; at half size as `found`.
    pub filtered: StorageImage,
    /// At full size RG16F, the octahedral bent normal; at half size [`NO_BENT_NORMAL`].
    pub bent_normal: u32,
    /// As in [`SearchParams`].
    pub step: u32,
}
