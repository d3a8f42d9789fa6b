//! Parameters of `shaders/denoise`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Side of a tile, pixels: the unit in which filtering is skipped, and a workgroup.
pub const TILE: u32 = 8;

/// Push constants of `reproject.comp`: writes this frame's guide, and finds the pixels of the previous frame that show the same surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ReprojectParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Instance + 1 and primitive.
    pub ids: SampledImage,
    /// Motion vectors: uv now minus uv one frame ago.
    pub motion: SampledImage,
    /// The previous frame's guide.
    pub previous_guide: SampledImage,
    /// This frame's guide: RG32 uint, see `lib/guide.glsl`.
    pub guide: StorageImage,
    /// Reprojected position and weights, as `lib/taps.glsl` packs them: R32 uint, 0 without history.
    pub taps: StorageImage,
    /// 0 in the first frame.
    pub valid: u32,
}

/// Push constants of `accumulate.comp`: temporal mean, its variance, and the history length.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct AccumulateParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples and histories that are not finite.
    pub not_finite: Address,
    /// Input: this frame's samples.
    pub noisy: SampledImage,
    /// Motion vectors: uv now minus uv one frame ago.
    pub motion: SampledImage,
    /// `taps` of `reproject.comp`.
    pub taps: SampledImage,
    /// Filtered result that the previous frame fed back.
    pub previous_filtered: SampledImage,
    /// `mean` of the previous frame.
    pub previous_mean: SampledImage,
    /// `variance` of the previous frame.
    pub previous_variance: SampledImage,
    /// `frames` of the previous frame.
    pub previous_frames: SampledImage,
    /// Share of the history to discard, 0 to 1, at a third of the size; or [`NO_IMAGE`].
    pub gradient: u32,
    /// As in [`LevelParams`].
    pub reach: u32,
    /// A bit for each channel whose subject moves by itself, such as a moving light: its history is limited even without motion vectors.
    pub moved: u32,
    /// Output: temporal mean that includes the fed-back result.
    pub accumulated: StorageImage,
    /// Variance of `accumulated`, for the filter.
    pub error: StorageImage,
    /// Temporal mean of the samples alone.
    pub mean: StorageImage,
    /// Variance of one sample.
    pub variance: StorageImage,
    /// History length, frames over [`LONGEST`].
    pub frames: StorageImage,
    /// Limit of the history length, frames, 1 to [`LONGEST`].
    pub longest: f32,
    /// 1: three channels of radiance with one variance. 0: up to four channels with a variance each.
    pub radiance: u32,
}

/// Side of the squares of which one pixel is retraced for temporal gradients.
pub const GRADIENT_STRATUM: u32 = 3;

/// Push constants of `blur_gradient.comp`: one step of the blur of temporal gradients.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlurGradientParams {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Change of each channel.
    pub change: SampledImage,
    /// Blurred change; of the last step the share of the history to discard.
    pub blurred: StorageImage,
    /// Distance between taps, texels.
    pub step: u32,
    /// 1 in the last step.
    pub is_last: u32,
}

/// Greatest history length, frames; 1 in the images of history length.
pub const LONGEST: f32 = 255.0;
/// Value of an optional image that is not there.
pub const NO_IMAGE: u32 = 4294967295;

/// Push constants of `spatial_variance.comp`: variance from neighbours where the history is short. As the first pass over tiles it also
/// resets their count.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SpatialVarianceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The [`Tiles`] to reset.
    pub tiles: Address,
    /// `guide` of `reproject.comp`.
    pub guide: SampledImage,
    /// Normals of the G-buffer for light that depends on the shading normal; or [`NO_IMAGE`].
    pub normals: u32,
    /// `accumulated` of `accumulate.comp`.
    pub accumulated: SampledImage,
    /// `error` of `accumulate.comp`.
    pub error: SampledImage,
    /// `frames` of `accumulate.comp`.
    pub frames: SampledImage,
    /// As in [`LevelParams`].
    pub reach: u32,
    /// Variance of `accumulated`, also where the history is short.
    pub variance: StorageImage,
    /// As in [`AccumulateParams`].
    pub radiance: u32,
    /// Channels of the variance.
    pub channels: u32,
}

/// Number of tiles to filter, in the form of an indirect dispatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Tiles {
    /// Number of tiles: workgroups in x.
    pub count: u32,
    /// Always 1: workgroups in y.
    pub groups_y: u32,
    /// Always 1: workgroups in z.
    pub groups_z: u32,
}

/// Push constants of `classify.comp`: lists the tiles that need filtering, and copies the others to the outputs of the filter.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ClassifyParams {
    /// The [`Tiles`] to count in.
    pub tiles: Address,
    /// Output: the listed tiles, column in the lower, row in the upper 16 bits of each word.
    pub list: Address,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Input of the filter.
    pub colour: SampledImage,
    /// Variance of `colour`.
    pub error: SampledImage,
    /// Output of the first level.
    pub first: StorageImage,
    /// Output of other levels, in alternation with `colour`.
    pub other: StorageImage,
    /// Variance of `other`.
    pub other_error: StorageImage,
    /// Output of `blur_variance.comp`.
    pub blurred: StorageImage,
    /// Channels that have a variance.
    pub channels: u32,
}

/// Push constants of `blur_variance.comp`: a 3x3 blur of the variance.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlurVarianceParams {
    /// List of tiles of `classify.comp`.
    pub list: Address,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Variance to blur.
    pub error: SampledImage,
    /// Blurred variance.
    pub blurred: StorageImage,
}

/// Push constants of `level.comp`: one level of the edge-avoiding à-trous filter.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LevelParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// List of tiles of `classify.comp`.
    pub list: Address,
    /// `guide` of `reproject.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// Input.
    pub colour: SampledImage,
    /// Variance of `colour`.
    pub error: SampledImage,
    /// Output of `blur_variance.comp`.
    pub blurred: SampledImage,
    /// Penumbra width around each pixel, over [`PENUMBRA_MOST`](super::shadows::PENUMBRA_MOST); or [`NO_IMAGE`].
    pub reach: u32,
    /// Output.
    pub filtered: StorageImage,
    /// Variance of `filtered`.
    pub filtered_error: StorageImage,
    /// Distance between taps, pixels: 2 to the power of the level.
    pub step: u32,
    /// As in [`AccumulateParams`].
    pub radiance: u32,
    /// Channels that have a variance.
    pub channels: u32,
    /// Difference between two values, in standard deviations, at which their weight is 1/e.
    pub sigma: f32,
}

/// Push constants of `bilateral.comp`: one edge-aware blur.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BilateralParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples that are not finite.
    pub not_finite: Address,
    /// `guide` of `reproject.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// Input.
    pub noisy: SampledImage,
    /// Output.
    pub filtered: StorageImage,
    /// As in [`LevelParams`].
    pub reach: u32,
    /// Radius, pixels.
    pub radius: u32,
}
