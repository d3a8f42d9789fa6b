//! Parameters of `shaders/post`.
use super::types::{Address, SampledImage, SamplerId, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`ToneMapParams::curve`]: clip to 0..1.
pub const CURVE_NONE: u32 = 0;
/// [`ToneMapParams::curve`]: AgX.
pub const CURVE_AGX: u32 = 1;
/// [`ToneMapParams::curve`]: ACES, RRT and ODT fit.
pub const CURVE_ACES: u32 = 2;

/// Push constants of `tone_map.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ToneMapParams {
    /// Counter of pixels that are not finite.
    pub not_finite: Address,
    /// Linear radiance.
    pub colour: SampledImage,
    /// Display-referred image, RGBA8, sRGB-encoded by the shader.
    pub display: StorageImage,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Scale before the curve: `2^stops`.
    pub exposure: f32,
    /// `CURVE_*`.
    pub curve: u32,
}

/// Push constants of `taa.comp`. Images of the frame have its size, all others that of the output.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TaaParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples and histories that are not finite.
    pub not_finite: Address,
    /// Linear radiance of this frame.
    pub colour: SampledImage,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Texture coordinates now minus one frame ago.
    pub motion: SampledImage,
    /// Instance + 1.
    pub ids: SampledImage,
    /// The picture one frame ago, linear radiance.
    pub picture: SampledImage,
    /// Its moments: slow mean, variance and fast mean over time of the tone-weighted luma of the 3x3, and the weight of the
    /// samples in the picture.
    pub moments: SampledImage,
    /// Its surfaces: least and greatest depth and the instances around each pixel, and how still it was.
    pub surfaces: SampledImage,
    /// The picture now.
    pub next_picture: StorageImage,
    /// Its moments.
    pub next_moments: StorageImage,
    /// Its surfaces.
    pub next_surfaces: StorageImage,
    /// Bilinear, clamped.
    pub sampler_id: SamplerId,
    /// 1 where there was a frame before.
    pub valid: u32,
    /// Scale before the tone curve.
    pub exposure: f32,
}

/// Push constants of `upscale.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct UpscaleParams {
    /// Linear radiance in the frame's size.
    pub colour: SampledImage,
    /// Bilinear, clamped.
    pub sampler_id: SamplerId,
    /// The same in the size of the output.
    pub radiance: StorageImage,
    /// Width and height of the output, pixels.
    pub size: [u32; 2],
}

/// Push constants of `sharpen.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SharpenParams {
    /// Linear radiance.
    pub colour: SampledImage,
    /// The same, sharper.
    pub radiance: StorageImage,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Scale before the tone curve.
    pub exposure: f32,
    /// Part of the sharpening that makes no overshoot, 0 to 1.
    pub amount: f32,
}
