//! Parameters of `shaders/sky`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `fill.comp`: draws the sky into background pixels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FillParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Radiance, RGBA32F or RGBA16F; only background pixels are written.
    pub lit: StorageImage,
    /// Greatest number in the format of `lit`; infinite for 32-bit floats.
    pub greatest: f32,
}
