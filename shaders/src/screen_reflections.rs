//! Parameters of reflections found on the screen.
use super::gbuffer::GBufferImages;
use super::screen_march::ScreenLight;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Confidence that 1 stands for in images of confidence: weighted with the sample's share of the lobe, it exceeds 1.
pub const MOST_CONFIDENCE: f32 = 4.0;
/// [`MarchParams::flags`]: marches from one pixel of four, the upper left.
pub const MARCH_HALF: u32 = 1;
/// [`MarchParams::flags`]: along the mirror direction instead of one sampled from the lobe.
pub const MARCH_MIRROR: u32 = 2;

/// Push constants of `march.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MarchParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Counter of values of the previous frame that are not finite.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// What rays find.
    pub light: ScreenLight,
    /// Output: radiance over the albedo of the lobe, times confidence; steps in alpha, 0 where there was no ray. RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Output: confidence over [`MOST_CONFIDENCE`], R16 unorm or R32F.
    pub confidence: StorageImage,
    /// Output: distance of the hit, metres, R16F; 65504 where nothing was hit.
    pub hit_distance: StorageImage,
    /// Output: width of the lobe on the screen, pixels over [`WIDEST_NOISE`](super::denoise::WIDEST_NOISE), R8 unorm.
    pub width: StorageImage,
    /// Distance of steps at roughness 0 and at the limit, pixels, 16 bits each, the first in the lower ones. For steps of equal length.
    pub strides: u32,
    /// Perceptual roughness from which no ray is marched.
    pub roughness_limit: f32,
    /// `MARCH_*`.
    pub flags: u32,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}

/// Push constants of `spread.comp`: from half to full resolution.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SpreadParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Outputs of `march.comp`, of half the size: radiance, confidence, distance, width.
    pub half_size: [SampledImage; 4],
    /// The same at full size.
    pub full_size: [StorageImage; 4],
    /// As in [`MarchParams`].
    pub roughness_limit: f32,
    /// Greatest number in the format of radiance.
    pub greatest: f32,
}

/// Push constants of `blur.comp`: one axis of a Gaussian that halves the size along it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlurParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// Guide of the surfaces, for a blur that stays on them; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub guide: u32,
    /// Radiance times confidence in red to blue; in alpha confidence, below 0 where no ray was marched.
    pub source: SampledImage,
    /// Mip of `source`.
    pub source_mip: u32,
    /// Confidence over [`MOST_CONFIDENCE`], where `source` has steps in alpha; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub confidence: u32,
    /// Width and height of `source`, pixels.
    pub source_size: [u32; 2],
    /// How often `source` was halved along x and y.
    pub halved: [u32; 2],
    /// Axis: 0 across, 1 down.
    pub axis: u32,
    /// Output, half as large along the axis.
    pub blurred: StorageImage,
    /// Its width and height, pixels.
    pub size: [u32; 2],
    /// Greatest number in the format of `blurred`.
    pub greatest: f32,
}

/// Push constants of `cone.comp`: the blurred reflection that each pixel's lobe asks for.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ConeParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Outputs of `march.comp`.
    pub sharp: SampledImage,
    /// Confidence over [`MOST_CONFIDENCE`].
    pub confidence: SampledImage,
    /// Distance of hits, metres.
    pub hit_distance: SampledImage,
    /// The blurred pyramid; mip 0 has half the size.
    pub blurred: SampledImage,
    /// Guide of the surfaces, for a blur that stays on them; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub guide: u32,
    /// Mips of `blurred`.
    pub levels: u32,
    /// The free parameter of the cone's angle, 0 to 1.
    pub xi: f32,
    /// Output: as `sharp`, with the level in alpha.
    pub radiance: StorageImage,
    /// Output: as `confidence`.
    pub blurred_confidence: StorageImage,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}

/// Push constants of `blend.comp`: what was found on the screen over what stands in for the rest, times the albedo of the lobe.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlendParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Radiance over albedo, times confidence; or [`NO_IMAGE`](super::denoise::NO_IMAGE) where nothing was marched.
    pub found: u32,
    /// Confidence over [`MOST_CONFIDENCE`].
    pub found_confidence: SampledImage,
    /// Openness, 0 to 1; [`NO_IMAGE`](super::denoise::NO_IMAGE) for no ambient occlusion.
    pub openness: u32,
    /// Output: radiance, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Output: confidence, 0 to 1, R8 unorm; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub confidence: u32,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}
