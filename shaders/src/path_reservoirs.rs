//! Reservoirs of points that scatter light to the pixels, for diffuse indirect light by resampled paths.
use super::gbuffer::GBufferImages;
use super::hit_shading::HitShadingParams;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Flag of [`PathReservoir::colour`]: the sample is the sky in a direction.
pub const SKY_SAMPLE: u32 = 1073741824;
/// Flag of [`PathReservoir::colour`]: the surface there reflects too differently to different viewers for pixels around.
pub const GLOSSY_SAMPLE: u32 = 2147483648;
/// Greatest [`ValidateParams::cap`].
pub const GREATEST_CONFIDENCE: u32 = 65535;

/// Greatest number of neighbours of a round of spatial reuse.
pub const MAX_PATH_NEIGHBOURS: u32 = 8;

/// Side of a tile of [`PathChanges`], pixels that are worked on.
pub const CHANGES_TILE: u32 = 8;

/// The bits of `modes` that are one of [`WEIGHTS_BIASED`](super::resampling::WEIGHTS_BIASED) and so on.
pub const PATH_WEIGHTS: u32 = 3;
/// Bit of `modes`: weights are carried from surface to surface by the Jacobian.
pub const PATH_JACOBIAN: u32 = 4;
/// Bit of `modes`: shadow rays to samples of others.
pub const PATH_VISIBILITY: u32 = 8;
/// Bit of `modes`: one pixel of four.
pub const PATH_HALF: u32 = 16;
/// Bit of `modes`: directions are uniform over the hemisphere, not by the cosine.
pub const PATH_UNIFORM: u32 = 32;
/// From this bit of `modes` on: greatest number of surfaces that a path meets one after another, at least 1.
pub const PATH_BOUNCES: u32 = 8;

/// One sample of the light that reaches a pixel, chosen from many: what a path met first, and the radiance that comes from there.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PathReservoir {
    /// From the eye of the frame that wrote it to the point, metres; or with [`SKY_SAMPLE`] the direction, unit.
    pub place: [f32; 3],
    /// Octahedral geometric normal there, to the side that was seen: two snorm of 16 bits.
    pub normal: u32,
    /// The largest channel of the radiance.
    pub peak: f32,
    /// Roots of the channels' shares of that, three unorm of 10 bits, and flags.
    pub colour: u32,
    /// Unbiased contribution weight: light from the sample times this estimates the light from everywhere; per steradian, at the pixel's surface.
    pub weight: f32,
    /// Confidence in the lower 16 bits, in samples of one frame; age of the sample in frames above it.
    pub confidence: u32,
    /// Frames since the path was traced in the lower 8 bits; key of its random numbers above them.
    pub path: u32,
}

/// A pixel's surface, of this or of the previous frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathReceiver {
    /// From the eye of its frame to the origin of its rays, metres.
    pub from_eye: [f32; 3],
    /// Bound of the origin's distance from the surface, metres; 0 where nothing scatters light diffusely.
    pub rounding: f32,
    /// Octahedral geometric normal, two snorm of 16 bits.
    pub geometric_normal: u32,
    /// Octahedral shading normal, two snorm of 16 bits.
    pub normal: u32,
}

/// Samples of a tile of pixels that were traced again in a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathChanges {
    /// All of them.
    pub traced: u32,
    /// Those that have other light than before, or meet another surface.
    pub changed: u32,
}

/// Parameters of `restir_sample.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathSampleParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// What shading at hits reads.
    pub hits: HitShadingParams,
    /// [`PathReceiver`] of each pixel, to be written.
    pub receivers: Address,
    /// [`PathReservoir`] of each pixel, to be written.
    pub samples: Address,
    /// Frames after which a sample is traced again; 0 for never.
    pub validate: u32,
    /// `PATH_*`.
    pub modes: u32,
    /// As in the `TraceParams` of reflections.
    pub regularization: f32,
}

/// Parameters of `restir_temporal.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathTemporalParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// [`PathReceiver`] of each pixel.
    pub receivers: Address,
    /// The same one frame ago.
    pub previous_receivers: Address,
    /// [`PathReservoir`] of each pixel: the samples of this frame.
    pub samples: Address,
    /// [`PathReservoir`] of each pixel one frame ago.
    pub previous: Address,
    /// [`PathReservoir`] of each pixel, to be written; of listed pixels the old one, moved to their surface.
    pub resampled: Address,
    /// List of pixels whose old sample is to be traced again.
    pub list: Address,
    /// [`PathChanges`] of each tile one frame ago.
    pub previous_changes: Address,
    /// [`PathChanges`] of each tile, to be set to 0.
    pub changes: Address,
    /// Motion vectors.
    pub motion: SampledImage,
    /// Which pixels of the previous frame showed the surface.
    pub taps: SampledImage,
    /// Greatest confidence of a reservoir.
    pub cap: u32,
    /// Frames after which a sample is traced again; 0 for never.
    pub validate: u32,
    /// Greatest age of a sample, frames; 0 for any.
    pub life: u32,
    /// `PATH_*`.
    pub modes: u32,
    /// Greatest Jacobian, and one over the least.
    pub stretch: f32,
}

/// Parameters of `restir_validate.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ValidateParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// What shading at hits reads.
    pub hits: HitShadingParams,
    /// [`PathReceiver`] of each pixel.
    pub receivers: Address,
    /// [`PathReservoir`] of each pixel: the samples of this frame.
    pub samples: Address,
    /// [`PathReservoir`] of each pixel, to be written; of listed pixels as `restir_temporal.comp` left them.
    pub resampled: Address,
    /// List of pixels whose old sample is traced again.
    pub list: Address,
    /// [`PathChanges`] of each tile, to be added to.
    pub changes: Address,
    /// Greatest confidence of a reservoir.
    pub cap: u32,
    /// `PATH_*`.
    pub modes: u32,
    /// Greatest Jacobian, and one over the least.
    pub stretch: f32,
    /// As in the `TraceParams` of reflections.
    pub regularization: f32,
}

/// Parameters of `restir_spatial.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathSpatialParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// Two counters: neighbours in the picture, and those of them on another surface (`uint`).
    pub around: Address,
    /// Two counters: Jacobians between pixels, and those of them that were refused (`uint`).
    pub jacobians: Address,
    /// [`PathReceiver`] of each pixel.
    pub receivers: Address,
    /// [`PathReservoir`] of each pixel.
    pub reservoirs: Address,
    /// [`PathReservoir`] of each pixel, to be written.
    pub resampled: Address,
    /// Those four of each pixel, or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub asked: u32,
    /// Greatest confidence of a reservoir.
    pub cap: u32,
    /// Neighbours that are asked, up to [`MAX_PATH_NEIGHBOURS`].
    pub neighbours: u32,
    /// Their greatest distance, pixels.
    pub reach: f32,
    /// Number of the round, from 0.
    pub round: u32,
    /// `PATH_*`.
    pub modes: u32,
    /// Greatest Jacobian, and one over the least.
    pub stretch: f32,
}

/// Parameters of `restir_shade.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathShadeParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// [`PathReceiver`] of each pixel.
    pub receivers: Address,
    /// [`PathReservoir`] of each pixel.
    pub reservoirs: Address,
    /// Output: scattered radiance over the albedo of the diffuse lobe, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// `PATH_*`.
    pub modes: u32,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}

/// Parameters of `restir_show.comp`: what reservoirs hold, as images.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathShowParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`PathReservoir`] of each pixel.
    pub reservoirs: Address,
    /// [`PathChanges`] of each tile; 0 if there are none.
    pub changes: Address,
    /// Radiance of the sample.
    pub radiance: StorageImage,
    /// The weight.
    pub weight: StorageImage,
    /// Confidence.
    pub confidence: StorageImage,
    /// Age of the sample, frames.
    pub age: StorageImage,
    /// Frames since it was traced.
    pub traced: StorageImage,
    /// Samples of the pixel's tile that were traced again, and those of them that had changed.
    pub changed: StorageImage,
    /// `PATH_*`.
    pub modes: u32,
}
