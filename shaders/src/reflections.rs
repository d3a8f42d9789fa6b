//! Parameters of reflections by rays.
use super::gbuffer::GBufferImages;
use super::hit_shading::HitShadingParams;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Greatest number of rays in a row of one path: bounces, and surfaces that it goes straight through.
pub const MOST_TURNS: u32 = 24;

/// Push constants of `trace.ray` and `tinted_trace.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TraceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// What shading at hits reads.
    pub hits: HitShadingParams,
    /// Output: reflected radiance over the albedo of the specular lobe, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Output: distance of the nearest hit, metres, R16F; 65504 for the sky.
    pub hit_distance: StorageImage,
    /// Output: width of the lobe on the screen, pixels over [`WIDEST_NOISE`](super::denoise::WIDEST_NOISE), R8 unorm.
    pub width: StorageImage,
    /// Rays of each pixel, at least 1.
    pub samples: u32,
    /// Greatest number of bounces, at least 1: surfaces that a ray meets one after another and that are shaded.
    pub bounces: u32,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}

/// Push constants of `resolve.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ResolveParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Radiance over albedo.
    pub denoised: SampledImage,
    /// Output: radiance, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}
