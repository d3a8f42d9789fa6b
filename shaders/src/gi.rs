//! Parameters of diffuse indirect light by rays.
use super::gbuffer::GBufferImages;
use super::hit_shading::HitShadingParams;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

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
    /// Output: mean scattered radiance over the albedo of the diffuse lobe, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Rays of each pixel, at least 1.
    pub samples: u32,
    /// Greatest number of surfaces that a ray meets one after another and that are shaded, at least 1.
    pub bounces: u32,
    /// As in the `TraceParams` of reflections.
    pub regularization: f32,
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
