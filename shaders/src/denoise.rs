//! Parameters of `shaders/denoise`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Side of a tile, pixels: the unit in which filtering is skipped, and a workgroup.
pub const TILE: u32 = 8;

/// Layout of a signal and its standard deviation: one channel in red, its deviation in green.
pub const SIGNAL_ONE: u32 = 1;
/// Two channels in red and green, their deviations in blue and alpha.
pub const SIGNAL_TWO: u32 = 2;
/// Three or four channels, their deviations in a second image.
pub const SIGNAL_FOUR: u32 = 4;
/// Radiance in red, green and blue, the deviation of its luminance in alpha.
pub const SIGNAL_RADIANCE: u32 = 0;

/// Width of noise that the value 1 stands for, pixels: the widest that is told apart.
pub const WIDEST_NOISE: f32 = 64.0;

/// [`NoisyImage::samples`]: alpha of radiance is the weight of a sample.
pub const SAMPLES_WEIGHTED: u32 = 1;
/// [`NoisyImage::samples`]: where the width of the noise is below a pixel, a sample is as good as a mean.
pub const SAMPLES_SHARP: u32 = 2;

/// A noisy image of which a mean over frames is made.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct NoisyImage {
    /// This frame's samples.
    pub image: SampledImage,
    /// As in [`LevelParams`].
    pub width: u32,
    /// `SAMPLES_*`.
    pub samples: u32,
    /// How the signal is laid out: `SIGNAL_ONE` and so on.
    pub packing: u32,
}

/// Where `lib/two_histories.glsl` finds the mean over the frames before.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HistoryImages {
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// The same of the previous frame.
    pub previous_guide: SampledImage,
    /// Shading normals of the G-buffer.
    pub normal: SampledImage,
    /// Distance of what is reflected, metres; or [`NO_IMAGE`].
    pub hit_distance: u32,
    /// Mean over frames, and the deviation of the samples, of the previous frame.
    pub values: SampledImage,
    /// Its deviations for [`SIGNAL_FOUR`]; else [`NO_IMAGE`].
    pub deviations: u32,
    /// Number of samples in the mean.
    pub frames: SampledImage,
    /// Mean over the last few frames; or [`NO_IMAGE`]. With it, `frames` has as many channels as the signal has variances.
    pub fast: u32,
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
    pub noisy: NoisyImage,
    /// Motion vectors of the G-buffer.
    pub motion: SampledImage,
    /// `taps` of `reproject/surfaces.comp`.
    pub taps: SampledImage,
    /// Filtered result that the previous frame fed back; its deviation is not read.
    pub previous_filtered: SampledImage,
    /// `moments` of the previous frame.
    pub previous_moments: SampledImage,
    /// Deviations of `previous_moments` for [`SIGNAL_FOUR`]; else [`NO_IMAGE`].
    pub previous_moments_deviation: u32,
    /// `frames` of the previous frame.
    pub previous_frames: SampledImage,
    /// Share of the history to discard, 0 to 1, at a third of the size; or [`NO_IMAGE`].
    pub gradient: u32,
    /// A bit for each channel whose subject moves by itself, such as a moving light: its history is limited even without motion vectors.
    pub moved: u32,
    /// Output: temporal mean that includes the fed-back result, and its deviation.
    pub accumulated: StorageImage,
    /// Deviations of `accumulated` for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// Output: temporal mean of the samples alone, of radiance their luminance, and the deviation of one sample.
    pub moments: StorageImage,
    /// Deviations of `moments` for [`SIGNAL_FOUR`].
    pub moments_deviation: u32,
    /// History length, frames over [`LONGEST`].
    pub frames: StorageImage,
    /// Limit of the history length, frames, 1 to [`LONGEST`].
    pub longest: f32,
    /// Over how many frames samples of a pixel are alike: 1 for independent ones, 0 for the points of a stratified sequence.
    pub alike: f32,
    /// Largest finite number of the format of radiance.
    pub greatest: f32,
}

/// Side of the squares of which one pixel is retraced for temporal gradients.
pub const GRADIENT_STRATUM: u32 = 3;

/// Push constants of `blur_gradient.comp` and `sum_gradient.comp`: one step of the blur of temporal gradients.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlurGradientParams {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Change of each channel; of `sum_gradient.comp` the change, its square, what it is a change of, and the change without its sign.
    pub change: SampledImage,
    /// Blurred changes; of the last step the share of the history to discard.
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

/// Push constants of `spatial_variance.comp`: variance from neighbours where the history is short, and which tiles have any.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SpatialVarianceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// Normals of the G-buffer for light that depends on the shading normal; or [`NO_IMAGE`].
    pub normals: u32,
    /// `accumulated` of `accumulate.comp`.
    pub accumulated: SampledImage,
    /// Its deviations for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// `frames` of `accumulate.comp`.
    pub frames: SampledImage,
    /// As in [`LevelParams`].
    pub noise_width: u32,
    /// Output: `accumulated` with its deviation, also where the history is short.
    pub signal: StorageImage,
    /// Deviations of `signal` for [`SIGNAL_FOUR`].
    pub signal_deviation: u32,
    /// Output, one pixel per tile: 1 where any pixel of the tile has a variance.
    pub varied_tiles: StorageImage,
    /// As in [`NoisyImage`].
    pub packing: u32,
    /// Number of channels that have a variance.
    pub channels: u32,
    /// As in [`AccumulateParams`].
    pub alike: f32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `level.comp`: one level of the edge-avoiding à-trous filter.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LevelParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// Input.
    pub signal: SampledImage,
    /// Deviations of `signal` for [`SIGNAL_FOUR`].
    pub signal_deviation: u32,
    /// `varied_tiles` of `spatial_variance.comp`.
    pub varied_tiles: SampledImage,
    /// Width of the noise around each pixel, over [`WIDEST_NOISE`]; or [`NO_IMAGE`].
    pub noise_width: u32,
    /// Output with its deviation, for the next level or the next frame; or [`NO_IMAGE`].
    pub filtered: u32,
    /// Deviations of `filtered` for [`SIGNAL_FOUR`].
    pub filtered_deviation: u32,
    /// Output of the last level, without deviation; else [`NO_IMAGE`].
    pub result: u32,
    /// Distance between taps, pixels: 2 to the power of the level.
    pub step: u32,
    /// As in [`NoisyImage`].
    pub packing: u32,
    /// Difference between two values, in standard deviations, at which their weight is 1/e.
    pub sigma: f32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `bilateral.comp`: one edge-aware blur.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BilateralParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples that are not finite.
    pub not_finite: Address,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// Input.
    pub noisy: SampledImage,
    /// Output.
    pub filtered: StorageImage,
    /// As in [`LevelParams`].
    pub noise_width: u32,
    /// Radius, pixels.
    pub radius: u32,
    /// As in [`NoisyImage`].
    pub packing: u32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `dual_source.comp`: temporal mean along the motion of surfaces and of what they reflect.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DualSourceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples and histories that are not finite.
    pub not_finite: Address,
    /// Input: this frame's samples.
    pub noisy: NoisyImage,
    /// Motion vectors of the G-buffer.
    pub motion: SampledImage,
    /// `taps` of `reproject/surfaces.comp`.
    pub taps: SampledImage,
    /// What the previous frame left.
    pub history: HistoryImages,
    /// Output: temporal mean, and the deviation of the samples.
    pub accumulated: StorageImage,
    /// Deviations of `accumulated` for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// Output: number of samples in the mean, R16F.
    pub frames: StorageImage,
    /// As in [`AccumulateParams`], of radiance.
    pub gradient: u32,
    /// Output: shares of the surface's history and of the reflected image's, 0 where there is none; or [`NO_IMAGE`].
    pub source: u32,
    /// Limit of that number.
    pub longest: f32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `accumulate_blurred.comp`: temporal mean of what was blurred in the previous frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct AccumulateBlurredParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples and histories that are not finite.
    pub not_finite: Address,
    /// Input: this frame's samples.
    pub noisy: NoisyImage,
    /// Motion vectors of the G-buffer.
    pub motion: SampledImage,
    /// `taps` of `reproject/surfaces.comp`.
    pub taps: SampledImage,
    /// What the previous frame left.
    pub history: HistoryImages,
    /// As in [`AccumulateParams`].
    pub gradient: u32,
    /// As in [`AccumulateParams`].
    pub moved: u32,
    /// Output: temporal mean, and the deviation of the samples.
    pub accumulated: StorageImage,
    /// Deviations of `accumulated` for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// Output: number of samples in the mean.
    pub frames: StorageImage,
    /// Output: mean over the last few frames.
    pub fast: StorageImage,
    /// Output: width of the noise, of radiance without that of single rays; or [`NO_IMAGE`].
    pub width: u32,
    /// Limit of the number of samples.
    pub longest: f32,
    /// The same for `fast`.
    pub fast_longest: f32,
    /// Radius of the blur of a full history, pixels.
    pub radius: f32,
    /// Of radiance: deviations above the mean at which a sample is limited.
    pub outliers: f32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `mend_history.comp`: what is out of date is clamped, and what is new is filled from around.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MendHistoryParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// This frame's samples. Its width is that of `accumulate_blurred.comp`.
    pub noisy: NoisyImage,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// `accumulated` of `accumulate_blurred.comp`.
    pub accumulated: SampledImage,
    /// Its deviations for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// `frames` of `accumulate_blurred.comp`.
    pub frames: SampledImage,
    /// Its `fast`.
    pub fast: SampledImage,
    /// Output: the mean, and its own deviation.
    pub mended: StorageImage,
    /// Deviations of `mended` for [`SIGNAL_FOUR`].
    pub mended_deviation: u32,
    /// Output: history length, less where the mean was out of date.
    pub mended_frames: StorageImage,
    /// As in [`AccumulateBlurredParams`].
    pub longest: f32,
    /// As in [`AccumulateBlurredParams`].
    pub fast_longest: f32,
    /// As in [`AccumulateBlurredParams`].
    pub radius: f32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `blur.comp`: a blur as wide as the history is short.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct RecurrentBlurParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// Input, with the deviation of the mean.
    pub signal: SampledImage,
    /// Deviations of `signal` for [`SIGNAL_FOUR`].
    pub signal_deviation: u32,
    /// `mended_frames` of `mend_history.comp`.
    pub frames: SampledImage,
    /// `width` of `accumulate_blurred.comp`; or [`NO_IMAGE`].
    pub noise_width: u32,
    /// Of the last blur: `mended` of `mend_history.comp`.
    pub mended: u32,
    /// Deviations of `mended` for [`SIGNAL_FOUR`].
    pub mended_deviation: u32,
    /// Of the last blur: `accumulated` of `accumulate_blurred.comp`.
    pub accumulated: u32,
    /// Deviations of `accumulated` for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// Output, of the last blur for the next frame.
    pub blurred: StorageImage,
    /// Deviations of `blurred` for [`SIGNAL_FOUR`].
    pub blurred_deviation: u32,
    /// Of the last blur: output without deviation; else [`NO_IMAGE`].
    pub result: u32,
    /// As in [`AccumulateBlurredParams`].
    pub longest: f32,
    /// As in [`AccumulateBlurredParams`].
    pub fast_longest: f32,
    /// As in [`AccumulateBlurredParams`].
    pub radius: f32,
    /// Difference between two values, in standard deviations, at which their weight is 1/2.
    pub sigma: f32,
    /// As in [`NoisyImage`].
    pub packing: u32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}

/// Push constants of `clean_up.comp`: a blur where the mean is noisy.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CleanUpParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// `guide` of `reproject/surfaces.comp`.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// `accumulated` of `dual_source.comp`.
    pub accumulated: SampledImage,
    /// Its deviations for [`SIGNAL_FOUR`].
    pub accumulated_deviation: u32,
    /// `frames` of `dual_source.comp`.
    pub frames: SampledImage,
    /// As in [`LevelParams`].
    pub noise_width: u32,
    /// Output.
    pub result: StorageImage,
    /// Deviation of the mean over the mean from which on a pixel is blurred.
    pub threshold: f32,
    /// Radius of the blur, pixels.
    pub radius: f32,
    /// As in [`NoisyImage`].
    pub packing: u32,
    /// As in [`AccumulateParams`].
    pub greatest: f32,
}
