//! Parameters of `shaders/new_pass`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `apply.comp`: exposure and natural vignetting.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ApplyParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Linear radiance.
    pub source: SampledImage,
    /// Linear radiance behind the lens, RGBA32F.
    pub target: StorageImage,
    /// Scale: `2^stops`.
    pub exposure: f32,
    /// Share of the fall with the angle, 0 to 1.
    pub falloff: f32,
}
