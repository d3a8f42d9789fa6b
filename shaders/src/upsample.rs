//! Parameters of upsampling from half to full resolution.
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`UpsampleParams::direction`]: no direction.
pub const NO_DIRECTION: u32 = 4294967295;

/// Parameters of `joint_bilateral.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct UpsampleParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Half resolution: a texel for the upper left one of four pixels. With a direction, that in red to blue and the value in alpha.
    pub half_size: SampledImage,
    /// The value, full size.
    pub value: StorageImage,
    /// Index of the storage image for the octahedral direction, full size, or [`NO_DIRECTION`].
    pub direction: u32,
    /// The value where no surface is seen.
    pub background: f32,
}
