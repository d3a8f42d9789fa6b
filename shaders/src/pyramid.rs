//! Parameters of image pyramids.
use super::types::{SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Levels that one dispatch makes.
pub const PYRAMID_LEVELS: u32 = 4;
/// Threads on a side of a workgroup: pixels of the first level that it makes.
pub const PYRAMID_GROUP: u32 = 16;
/// [`PyramidParams::content`]: a value in red becomes its minimum and maximum.
pub const PYRAMID_FIRST_MIN_MAX: u32 = 0;
/// [`PyramidParams::content`]: minimum in red, maximum in green.
pub const PYRAMID_MIN_MAX: u32 = 1;
/// [`PyramidParams::content`]: the mean of all channels.
pub const PYRAMID_MEAN: u32 = 2;

/// Parameters of `reduce.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PyramidParams {
    /// The level below, of which squares of two by two pixels become one.
    pub source: SampledImage,
    /// Mip of `source`.
    pub source_mip: u32,
    /// Width and height of that level, pixels. What lies outside has the value of the nearest pixel inside.
    pub source_size: [u32; 2],
    /// `PYRAMID_*`.
    pub content: u32,
    /// Levels to make, 1 to 4.
    pub count: u32,
    /// Width and height of the first of them, pixels.
    pub size: [u32; 2],
    /// The levels.
    pub levels: [StorageImage; 4],
}
