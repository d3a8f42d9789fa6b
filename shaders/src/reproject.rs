//! Parameters of `shaders/reproject`.
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `surfaces.comp`: writes this frame's guide, and finds the pixels of the previous frame that show the same surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ReprojectParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// The previous frame's guide.
    pub previous_guide: SampledImage,
    /// This frame's guide: RG32 uint, see `lib/guide.glsl`.
    pub guide: StorageImage,
    /// Reprojected position and weights, as `lib/taps.glsl` packs them: R32 uint, 0 without history.
    pub taps: StorageImage,
    /// 0 in the first frame.
    pub valid: u32,
}
