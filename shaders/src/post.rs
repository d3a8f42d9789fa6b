//! Parameters of `shaders/post`.
use super::types::{SampledImage, StorageImage};
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
