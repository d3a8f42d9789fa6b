//! Parameters of `shaders/denoise`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Pixels on a side of a tile, which is what is filtered or left alone: a workgroup.
pub const TILE: u32 = 8;

/// Push constants of `reproject.comp`: the guide of this frame, and which pixels of the frame before show the same surface.
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
    /// Texture coordinates now minus one frame ago.
    pub motion: SampledImage,
    /// The guide of the frame before.
    pub previous_guide: SampledImage,
    /// The guide: RG32 uint.
    pub guide: StorageImage,
    /// Where the surface was seen, as `lib/taps.glsl` packs it: R32 uint, 0 where it was not.
    pub taps: StorageImage,
    /// 0 where there is no frame before.
    pub valid: u32,
}

/// Push constants of `accumulate.comp`: the mean over frames, its variance, and over how many frames it goes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct AccumulateParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples and histories that are not finite.
    pub not_finite: Address,
    /// What is to be denoised.
    pub noisy: SampledImage,
    /// Texture coordinates now minus one frame ago.
    pub motion: SampledImage,
    /// As `reproject.comp` wrote it.
    pub taps: SampledImage,
    /// What the frame before fed back.
    pub previous_filtered: SampledImage,
    /// Mean of the frame before.
    pub previous_mean: SampledImage,
    /// Variance of the frame before.
    pub previous_variance: SampledImage,
    /// Frames of the frame before, over [`LONGEST`].
    pub previous_frames: SampledImage,
    /// How much has changed since the frame before, 0 to 1, at a third of the size; or [`NO_IMAGE`].
    pub gradient: u32,
    /// As in [`LevelParams`].
    pub reach: u32,
    /// Channels of which what they are about moves by itself: a bit for each.
    pub moved: u32,
    /// The mean, with what was fed back.
    pub accumulated: StorageImage,
    /// Its variance, for the filter.
    pub error: StorageImage,
    /// The mean, without.
    pub mean: StorageImage,
    /// Variance of one sample.
    pub variance: StorageImage,
    /// How many frames it goes over, over [`LONGEST`].
    pub frames: StorageImage,
    /// Longest history, frames, 1 to [`LONGEST`].
    pub longest: f32,
    /// 1: three channels of radiance with one variance. 0: four channels on their own.
    pub radiance: u32,
}

/// Pixels on a side of the squares of which one pixel is looked at for changes.
pub const GRADIENT_STRATUM: u32 = 3;

/// Push constants of `blur_gradient.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlurGradientParams {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Changes of each channel.
    pub change: SampledImage,
    /// Their mean around, or the share to forget.
    pub blurred: StorageImage,
    /// Pixels between two taps.
    pub step: u32,
    /// 1: from means to shares.
    pub is_last: u32,
}

/// Frames that 1 stands for in the image of their number.
pub const LONGEST: f32 = 255.0;
/// Where an image is left out.
pub const NO_IMAGE: u32 = 4294967295;

/// Push constants of `spatial_variance.comp`: variance from neighbours where the history is short. The first of the passes over tiles:
/// it also clears their count.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SpatialVarianceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// A [`Tiles`].
    pub tiles: Address,
    /// RG32 uint.
    pub guide: SampledImage,
    /// The G-buffer's, where light depends on the shading normal; or [`NO_IMAGE`].
    pub normals: u32,
    /// What `accumulate.comp` gave.
    pub accumulated: SampledImage,
    /// Its variance.
    pub error: SampledImage,
    /// How many frames it goes over, over [`LONGEST`].
    pub frames: SampledImage,
    /// As in [`LevelParams`].
    pub reach: u32,
    /// Its variance, never 0 by lack of frames.
    pub variance: StorageImage,
    /// As in [`AccumulateParams`].
    pub radiance: u32,
    /// Numbers in the variance.
    pub channels: u32,
}

/// Which tiles are filtered, and how many: what an indirect dispatch reads.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Tiles {
    /// How many.
    pub count: u32,
    /// 1: workgroups in y.
    pub groups_y: u32,
    /// 1: workgroups in z.
    pub groups_z: u32,
}

/// Push constants of `classify.comp`: finds the tiles in which there is anything to filter, and copies the others to where the levels
/// of the filter would have.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ClassifyParams {
    /// A [`Tiles`].
    pub tiles: Address,
    /// The tiles that were found: column in the lower, row in the upper 16 bits of each word.
    pub list: Address,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// What is filtered.
    pub colour: SampledImage,
    /// Its variance.
    pub error: SampledImage,
    /// What the first level writes.
    pub first: StorageImage,
    /// The image that takes turns with `colour`.
    pub other: StorageImage,
    /// The image that takes turns with `error`.
    pub other_error: StorageImage,
    /// The blurred variance.
    pub blurred: StorageImage,
    /// How many channels have a variance.
    pub channels: u32,
}

/// Push constants of `blur_variance.comp`: a 3x3 blur of the variance.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlurVarianceParams {
    /// The tiles to work on.
    pub list: Address,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Variance.
    pub error: SampledImage,
    /// The same, blurred.
    pub blurred: StorageImage,
}

/// Push constants of `level.comp`: one level of the edge-avoiding à-trous filter.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LevelParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// The tiles to work on.
    pub list: Address,
    /// RG32 uint.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// What is filtered.
    pub colour: SampledImage,
    /// Its variance.
    pub error: SampledImage,
    /// The same, blurred.
    pub blurred: SampledImage,
    /// How wide what noise comes from is, pixels over [`PENUMBRA_MOST`](super::shadows::PENUMBRA_MOST); or [`NO_IMAGE`].
    pub reach: u32,
    /// Filtered.
    pub filtered: StorageImage,
    /// Variance of that.
    pub filtered_error: StorageImage,
    /// Pixels between two taps: 2 to the power of the level.
    pub step: u32,
    /// As in [`AccumulateParams`].
    pub radiance: u32,
    /// How many channels have a variance.
    pub channels: u32,
    /// How many standard deviations apart two values may be to be averaged with a weight of 1/e.
    pub sigma: f32,
}

/// Push constants of `bilateral.comp`: one blur along surfaces, the same everywhere.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BilateralParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of samples that are not finite.
    pub not_finite: Address,
    /// RG32 uint.
    pub guide: SampledImage,
    /// As in [`SpatialVarianceParams`].
    pub normals: u32,
    /// What is filtered.
    pub noisy: SampledImage,
    /// Filtered.
    pub filtered: StorageImage,
    /// As in [`LevelParams`].
    pub reach: u32,
    /// Pixels to each side.
    pub radius: u32,
}
