//! Parameters of reflections by rays.
use super::gbuffer::GBufferImages;
use super::hit_shading::HitShadingParams;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Greatest number of rays that one pixel is reconstructed from.
pub const MOST_TAPS: u32 = 16;

/// Below this share of a limit of roughness rays give the whole reflection; from there to the limit their share falls to 0.
pub const ROUGHNESS_FADE: f32 = 0.75;

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
    /// Output. Without `rays_found`: mean reflected radiance over the albedo of the specular lobe. With it: radiance along the ray of each cell,
    /// 1 in alpha where there is a ray. RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Output without `rays_found`: distance of the nearest hit, metres, R16F; 65504 for the sky.
    pub hit_distance: StorageImage,
    /// Output without `rays_found`: width of the lobe on the screen, pixels over [`WIDEST_NOISE`](super::denoise::WIDEST_NOISE), R8 unorm.
    pub width: StorageImage,
    /// Output: the ray of each cell, RGBA16F as `lib/found_ray.glsl` packs it; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub rays_found: u32,
    /// Without `rays_found`: rays of each pixel, at least 1. With it: pixels of a cell, which has one ray: 1, 2 side by side, or 4 in a square.
    pub density: u32,
    /// Greatest number of bounces, at least 1: surfaces that a ray meets one after another and that are shaded.
    pub bounces: u32,
    /// As the setting of that name, 0 to 1.
    pub regularization: f32,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
    /// Perceptual roughness from which a surface has no ray, 0 to 1; 1: every surface has.
    pub roughness_limit: f32,
}

/// Push constants of `reconstruct.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ReconstructParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of rays whose radiance is not finite.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// `radiance` of `trace.ray`, a pixel for each cell.
    pub found: SampledImage,
    /// `rays_found` of `trace.ray`.
    pub rays_found: SampledImage,
    /// Output: reflected radiance over the albedo of the specular lobe, RGBA16F or RGBA32F; in alpha how much it counts in a mean over
    /// frames, 0 to 1.
    pub radiance: StorageImage,
    /// Output: distance of what is reflected, metres, R16F; 65504 for the sky.
    pub hit_distance: StorageImage,
    /// Output: as in [`TraceParams`].
    pub width: StorageImage,
    /// `rate` of `choose.comp`, where the distance of rays differs from pixel to pixel and the images of rays have the size of the frame; or
    /// [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub rate: u32,
    /// Output, RGBA8 unorm: standard error of the reconstruction over its mean; width of the lobe as in [`TraceParams`] but above 0, 0 where
    /// there is nothing to trace; share of the rays that were looked for on the screen and found there, a mean over frames; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub steering: u32,
    /// As in [`TraceParams`]; not used with `rate`.
    pub pixels_per_ray: u32,
    /// Rays that are looked at, 1 to [`MOST_TAPS`].
    pub taps: u32,
    /// Greatest distance of these rays, pixels.
    pub radius: f32,
    /// Limit for the brightest ray, over the mean of the others.
    pub firefly_limit: f32,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
    /// As in [`TraceParams`].
    pub roughness_limit: f32,
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
    /// Radiance of the fallback; or [`NO_IMAGE`](super::denoise::NO_IMAGE) for the sky.
    pub fallback: u32,
    /// Openness, 0 to 1; [`NO_IMAGE`](super::denoise::NO_IMAGE) for no ambient occlusion.
    pub openness: u32,
    /// Perceptual roughness from which the fallback stands alone; 1 for none.
    pub roughness_limit: f32,
    /// Albedo of the lobe below which the fallback stands alone.
    pub faint: f32,
    /// Output: radiance, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}
