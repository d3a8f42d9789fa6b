//! Parameters of reflections that choose between rays, the screen and a fallback.
use super::gbuffer::GBufferImages;
use super::hit_shading::HitShadingParams;
use super::screen_march::ScreenLight;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Values of the image of rates, over 255: the pixel reflects nothing.
pub const RATE_NONE: u32 = 0;
/// The fallback stands for the whole lobe.
pub const RATE_FALLBACK: u32 = 1;
/// One ray for each 4x4 pixels.
pub const RATE_SIXTEENTH: u32 = 2;
/// One ray for each 2x2 pixels.
pub const RATE_QUARTER: u32 = 3;
/// A ray for each pixel.
pub const RATE_FULL: u32 = 4;

/// Bit beside the rate: the pixel's ray is looked for on the screen before it is traced.
pub const MARCHED: u32 = 8;

/// Alpha of a ray that was found on the screen; 1 of one that was traced, 0 where there is none.
pub const FOUND_ON_SCREEN: f32 = 0.5;

/// Push constants of `choose.comp`: where rays start in this frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ChooseParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `taps` of `reproject/surfaces.comp`.
    pub taps: SampledImage,
    /// The previous frame's `steering` of `reconstruct.comp`.
    pub steering: SampledImage,
    /// Output, RGBA8 unorm: `RATE_*` and [`MARCHED`] over 255, and the share of rays that the screen knew, as in `steering`.
    pub rate: StorageImage,
    /// Output: keys for the list of rays, over [`GREATEST_KEY`](super::pixel_lists::GREATEST_KEY), R8 unorm; 0 where no ray starts.
    pub keys: StorageImage,
    /// Output: 0 everywhere, RGBA16F or RGBA32F.
    pub found: StorageImage,
    /// Output: 0 everywhere, RGBA16F.
    pub rays_found: StorageImage,
    /// Greatest distance of rays over the width of the lobe on the screen.
    pub spacing: f32,
    /// Least rate, `RATE_SIXTEENTH` or above.
    pub least_rate: u32,
    /// Standard error of the reconstruction over its mean from which on rays are denser by one step.
    pub noise: f32,
    /// Albedo of the lobe below which the fallback stands alone.
    pub faint: f32,
    /// Perceptual roughness from which the fallback stands alone.
    pub roughness_limit: f32,
    /// 1 if rays are looked for on the screen.
    pub screen: u32,
}

/// Push constants of `hybrid_march.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HybridMarchParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Counter of values of the previous frame that are not finite.
    pub not_finite: Address,
    /// Pixels whose rays are marched.
    pub list: Address,
    /// Output: pixels whose rays are to be traced.
    pub rest: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `rate` of `choose.comp`.
    pub rate: SampledImage,
    /// What rays find.
    pub light: ScreenLight,
    /// Output: radiance along the rays that were found, [`FOUND_ON_SCREEN`] in alpha.
    pub found: StorageImage,
    /// Output: these rays, as `lib/found_ray.glsl` packs them.
    pub rays_found: StorageImage,
    /// Greatest number in the format of `found`.
    pub greatest: f32,
}

/// Push constants of `hybrid_trace.ray` and `hybrid_tinted_trace.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HybridTraceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Pixels whose rays are traced.
    pub list: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// `rate` of `choose.comp`.
    pub rate: SampledImage,
    /// What shading at hits reads.
    pub hits: HitShadingParams,
    /// Output: radiance along the rays, 1 in alpha.
    pub found: StorageImage,
    /// Output: the rays, as `lib/found_ray.glsl` packs them.
    pub rays_found: StorageImage,
    /// As in [`TraceParams`](super::reflections::TraceParams).
    pub bounces: u32,
    /// As in [`TraceParams`](super::reflections::TraceParams).
    pub regularization: f32,
    /// Greatest number in the format of `found`.
    pub greatest: f32,
}

/// Push constants of `sources.comp`: where each pixel's reflection comes from, in false colours.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SourcesParams {
    /// `rate` of `choose.comp`.
    pub rate: SampledImage,
    /// Rays that were found.
    pub found: SampledImage,
    /// Output: colours, RGBA8.
    pub colours: StorageImage,
    /// Width and height, pixels.
    pub size: [u32; 2],
}
