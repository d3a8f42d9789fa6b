//! Parameters of `shaders/post`.
use super::gbuffer::GBufferImages;
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
    /// Factor before the curve: `2^stops`.
    pub exposure: f32,
    /// `CURVE_*`.
    pub curve: u32,
}

/// Push constants of `taa.comp`. `colour`, `depth`, `motion` and `ids` have the size of the frame, all others that of the output.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TaaParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Counter of samples and histories that are not finite.
    pub not_finite: Address,
    /// Linear radiance of this frame.
    pub colour: SampledImage,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// History: the previous output, linear radiance.
    pub picture: SampledImage,
    /// History: mean over time of the tone-compressed YCoCg of the 3x3, and its variance, of all channels together.
    pub moments: SampledImage,
    /// History: a faster mean of the same, and the weight of the history in samples.
    pub fast_moments: SampledImage,
    /// History: range of depth and set of instances around each pixel, and how static it was.
    pub surfaces: SampledImage,
    /// History: a thing that can move and has been seen around each pixel, instance + 1, else 0; or [`NO_IMAGE`](super::denoise::NO_IMAGE) where nothing can move.
    pub movers: u32,
    /// Output, linear radiance.
    pub next_picture: StorageImage,
    /// `moments` for the next frame.
    pub next_moments: StorageImage,
    /// `fast_moments` for the next frame.
    pub next_fast_moments: StorageImage,
    /// `surfaces` for the next frame.
    pub next_surfaces: StorageImage,
    /// `movers` for the next frame; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub next_movers: u32,
    /// Bilinear, clamped.
    pub sampler_id: SamplerId,
    /// 0 in the first frame.
    pub valid: u32,
    /// Factor before the tone curve.
    pub exposure: f32,
}

/// Push constants of `upscale.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct UpscaleParams {
    /// Linear radiance in the size of the frame.
    pub colour: SampledImage,
    /// Bilinear, clamped.
    pub sampler_id: SamplerId,
    /// Output in `size`.
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
    /// Output.
    pub radiance: StorageImage,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Factor before the tone curve.
    pub exposure: f32,
    /// Share of the greatest sharpening without overshoot, 0 to 1.
    pub amount: f32,
}
