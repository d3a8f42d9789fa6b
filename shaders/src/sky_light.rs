//! Parameters of `shaders/gi/sky.comp` and `shaders/reflections/sky.comp`: sky light on visible surfaces.
use super::gbuffer::GBufferImages;
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Value of an optional image that is not there.
pub const NO_IMAGE: u32 = 4294967295;

/// Push constants of both passes, the diffuse and the specular one.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SkyLightParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Openness, 0 to 1; [`NO_IMAGE`] for no ambient occlusion.
    pub openness: u32,
    /// Octahedral bent normal, the mean unoccluded direction; [`NO_IMAGE`] where there is none.
    pub bent_normal: u32,
    /// Outgoing radiance, RGBA32F or RGBA16F.
    pub radiance: StorageImage,
    /// Greatest number in the format of `radiance`; infinite for 32-bit floats.
    pub greatest: f32,
}
