//! Parameters of diffuse indirect light by rays and from the screen.
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
    /// Output, for the gradients of the next frame: surfaces as in `lib/gradient.glsl`, RG32 uint; or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub surfaces: u32,
    /// Output with `surfaces`: luminance that their first ray finds, -1 for none, R32F at a third of the size.
    pub luminance: u32,
}

/// Push constants of `gradient.ray` and `tinted_gradient.ray`: rays of one pixel out of nine of the previous frame, traced again.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct GradientParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Motion vectors of the G-buffer.
    pub motion: SampledImage,
    /// What shading at hits reads.
    pub hits: HitShadingParams,
    /// `surfaces` of the previous frame.
    pub previous: SampledImage,
    /// `luminance` of the previous frame.
    pub previous_luminance: SampledImage,
    /// Output, RGBA32F at a third of the size: change of the luminance, its square, the larger of the two luminances, and the change without its sign.
    pub change: StorageImage,
    /// 0 in the first frame.
    pub valid: u32,
    /// As in [`TraceParams`].
    pub samples: u32,
    /// As in [`TraceParams`].
    pub bounces: u32,
    /// As in [`TraceParams`].
    pub regularization: f32,
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

/// Push constants of `screen_light.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScreenLightParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Direct light and emission of this frame.
    pub direct: SampledImage,
    /// Which pixels of the previous frame showed the same surfaces.
    pub taps: SampledImage,
    /// Indirect light of the previous frame, or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub previous: u32,
    /// Output: radiance that each surface gives to others, RGBA16F or RGBA32F.
    pub light: StorageImage,
    /// 1 if the G-buffer has an image of emission.
    pub has_emission: u32,
    /// Greatest number in the format of `light`.
    pub greatest: f32,
}

/// Push constants of `screen_search.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScreenSearchParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of results that are not finite.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `light` of `screen_light.comp`.
    pub light: SampledImage,
    /// Output: irradiance over pi, RGBA16F or RGBA32F.
    pub found: StorageImage,
    /// Spacing of the pixels that are searched: 1, or 2 for half resolution.
    pub step: u32,
    /// Planes through the view direction, at least 1.
    pub slices: u32,
    /// Samples on each side of a slice, at least 1.
    pub steps: u32,
    /// Number of the frame in the sequence of the noise.
    pub frame: u32,
    /// Distance up to which surfaces count, metres.
    pub range: f32,
    /// Assumed thickness of surfaces, metres.
    pub thickness: f32,
    /// Greatest number in the format of `found`.
    pub greatest: f32,
}
