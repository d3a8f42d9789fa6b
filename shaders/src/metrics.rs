//! Parameters of `shaders/metrics`: the error of one image against another.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Pixels of a tile, from left to right.
pub const TILE_WIDTH: u32 = 16;
/// Pixels of a tile, from top to bottom.
pub const TILE_HEIGHT: u32 = 8;
/// Threads of both passes: `TILE_WIDTH * TILE_HEIGHT`.
pub const METRICS_GROUP: u32 = 128;

/// Added to the squared reference where an error is relative.
pub const RELMSE_EPSILON: f32 = 0.0001;
/// Added to the sum of both values in the symmetric error.
pub const SMAPE_EPSILON: f32 = 0.01;

/// How to read an image: red, green and blue as they are.
pub const READ_COLOUR: u32 = 0;
/// How to read an image: the one channel that it has, as grey.
pub const READ_GREY: u32 = 1;
/// How to read an image: what a display is sent, to be sRGB-decoded.
pub const READ_DISPLAY: u32 = 2;

/// Sums over the pixels of a tile of the mean over their channels; divided by the pixels, the errors of a picture.
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
    /// One [`ErrorSums`]: their sum over the number of pixels.
    pub errors: Address,
    /// How many tiles.
    pub count: u32,
    /// How many pixels.
    pub pixels: u32,
}
