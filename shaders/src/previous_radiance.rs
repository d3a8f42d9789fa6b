//! Parameters of `shaders/previous_radiance`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `keep.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct KeepParams {
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The lit picture.
    pub radiance: SampledImage,
    /// Output: radiance with 1 in alpha; 0 in all channels where it is not known.
    pub kept: StorageImage,
    /// Largest finite number of the format of `kept`.
    pub greatest: f32,
}
