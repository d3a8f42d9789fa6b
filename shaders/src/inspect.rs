//! Parameters of `shaders/inspect`: an image of the frame as colours to look at, and what its values range over.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`InspectMapParams::channel`]: red, green and blue; of an image with one channel, grey.
pub const INSPECT_RGB: u32 = 0;
/// [`InspectMapParams::channel`]: red. Green, blue and alpha follow.
pub const INSPECT_RED: u32 = 1;
/// [`InspectMapParams::channel`]: luminance, Rec.709; of an image with fewer than three channels, red.
pub const INSPECT_LUMINANCE: u32 = 5;
/// [`InspectMapParams::channel`]: length of the vector of red, green and blue.
pub const INSPECT_LENGTH: u32 = 6;

/// [`InspectMapParams::colours`]: grey, or the colours themselves.
pub const INSPECT_PLAIN: u32 = 0;
/// [`InspectMapParams::colours`]: false colours.
pub const INSPECT_FALSE: u32 = 1;
/// [`InspectMapParams::colours`]: blue below the middle of the range, red above.
pub const INSPECT_SIGNED: u32 = 2;
/// [`InspectMapParams::colours`]: a colour for each value, black for zero.
pub const INSPECT_DISTINCT: u32 = 3;

/// Push constants of `map.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct InspectMapParams {
    /// What is looked at: one mip of one layer.
    pub image: SampledImage,
    /// Display values, RGBA8.
    pub target: StorageImage,
    /// Width and height of the mip, pixels.
    pub size: [u32; 2],
    /// Width and height of the target, pixels.
    pub target_size: [u32; 2],
    /// Where the image lies in the target: left, top, width and height, pixels.
    pub place: [f32; 4],
    /// A value times this, plus `bias`, is 0 at the lower end of the range and 1 at the upper.
    pub gain: f32,
    /// See `gain`.
    pub bias: f32,
    /// 1 if pixels are unsigned integers, else 0.
    pub is_uint: u32,
    /// Number of channels that the format has.
    pub channels: u32,
    /// `INSPECT_*`, or `INSPECT_RED` and the number of the channel.
    pub channel: u32,
    /// `INSPECT_*`.
    pub colours: u32,
    /// 1 if what is shown is encoded as sRGB, else 0.
    pub encodes: u32,
}

/// Push constants of `measure.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct InspectMeasureParams {
    /// What is looked at: one mip of one layer.
    pub image: SampledImage,
    /// 1 if pixels are unsigned integers, else 0.
    pub is_uint: u32,
    /// Width and height of the mip, pixels.
    pub size: [u32; 2],
    /// The pixel that is read; none if it lies outside.
    pub pixel: [u32; 2],
    /// Number of channels that the format has.
    pub channels: u32,
    /// The [`Measured`] to add to.
    pub measured: Address,
}

/// What was found in an image.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Measured {
    /// Bits of the channels of the pixel that is read, as 32-bit floats or unsigned integers.
    pub bits: [u32; 4],
    /// Least finite value of each channel, as a key: integers as they are, floats by their bits, of which negative ones have all inverted
    /// and others the highest. All ones before.
    pub least: [u32; 4],
    /// Greatest finite value of each channel, as a key. Zero before.
    pub greatest: [u32; 4],
    /// Pixels with a NaN.
    pub nan: u32,
    /// Pixels with positive infinity.
    pub above: u32,
    /// Pixels with negative infinity.
    pub below: u32,
}
