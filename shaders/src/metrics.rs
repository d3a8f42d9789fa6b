//! Parameters of `shaders/metrics`: the error of one image against another.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Width of a tile, pixels.
pub const TILE_WIDTH: u32 = 16;
/// Height of a tile, pixels.
pub const TILE_HEIGHT: u32 = 8;
/// Threads of both passes: `TILE_WIDTH * TILE_HEIGHT`.
pub const METRICS_GROUP: u32 = 128;

/// Added to the squared reference in the relative error.
pub const RELMSE_EPSILON: f32 = 0.0001;
/// Added to the sum of both values in the symmetric error.
pub const SMAPE_EPSILON: f32 = 0.01;

/// How to read an image: red, green and blue unchanged.
pub const READ_COLOUR: u32 = 0;
/// How to read an image: its single channel as grey.
pub const READ_GREY: u32 = 1;
/// How to read an image: sRGB-encoded display values, which are decoded.
pub const READ_DISPLAY: u32 = 2;

/// Error sums of a tile, of the mean over the channels of each pixel; divided by the number of pixels, the errors of a picture.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ErrorSums {
    /// Squared error.
    pub squared: f32,
    /// Squared error over the squared reference plus [`RELMSE_EPSILON`].
    pub relative: f32,
    /// Absolute error over the sum of the absolute values plus [`SMAPE_EPSILON`].
    pub symmetric: f32,
}

/// Push constants of `error.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ErrorParams {
    /// The image under test.
    pub test: SampledImage,
    /// The reference.
    pub reference: SampledImage,
    /// Squared, relative and symmetric error of each pixel, RGBA32F.
    pub error: StorageImage,
    /// `READ_*` of the image under test.
    pub read_test: u32,
    /// `READ_*` of the reference.
    pub read_reference: u32,
    /// Width and height of the reference, pixels.
    pub size: [u32; 2],
    /// Width and height of the image under test, pixels. Where it differs from `size`, every error is NaN.
    pub test_size: [u32; 2],
    /// One [`ErrorSums`] per tile, rows from the top.
    pub tiles: Address,
}

/// Push constants of `sum.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SumParams {
    /// One [`ErrorSums`] per tile.
    pub tiles: Address,
    /// Output, one [`ErrorSums`]: the sum of `tiles` over `pixels`.
    pub errors: Address,
    /// Number of tiles.
    pub count: u32,
    /// Number of pixels.
    pub pixels: u32,
}
