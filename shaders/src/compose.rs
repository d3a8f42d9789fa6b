//! Parameters of `shaders/compose`.
use super::types::{SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Value of an input whose slot has no output.
pub const NO_INPUT: u32 = 4294967295;

/// Push constants of `sum.comp`: the sum of the lighting slots.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SumParams {
    /// Radiance of the slot `direct`.
    pub direct: SampledImage,
    /// Radiance of the slot `gi`, or [`NO_INPUT`].
    pub gi: u32,
    /// Radiance of the slot `reflections`, or [`NO_INPUT`].
    pub reflections: u32,
    /// Output, RGBA32F or RGBA16F.
    pub lit: StorageImage,
    /// Greatest number in the format of `lit`; infinite for 32-bit floats.
    pub greatest: f32,
    /// Width and height, pixels.
    pub size: [u32; 2],
}
