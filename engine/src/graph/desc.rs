//! Descriptions of resources: format, size and mips of images, size of buffers.

use std::fmt;

use super::handle::{Handle, Image};

/// Formats of images. Channels are linear unless the name says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// One channel, 0 to 1, 8 bits.
    R8Unorm,
    /// Two channels, 0 to 1, 8 bits each.
    Rg8Unorm,
    /// Four channels, 0 to 1, 8 bits each.
    Rgba8Unorm,
    /// Four channels, 0 to 1, 8 bits each; rgb is stored in the sRGB curve and read as linear.
    Rgba8Srgb,
    /// One channel, 0 to 1, 16 bits.
    R16Unorm,
    /// Two channels, 0 to 1, 16 bits each.
    Rg16Unorm,
    /// Four channels, 0 to 1, 16 bits each.
    Rgba16Unorm,
    /// Four channels, 0 to 1: from the highest bit down 2 of alpha, and 10 each of red, green and blue. For pictures that go to a display.
    A2Rgb10Unorm,
    /// Two channels, -1 to 1, 16 bits each.
    Rg16Snorm,
    /// Four channels, -1 to 1, 16 bits each.
    Rgba16Snorm,
    /// One 16-bit float.
    R16Float,
    /// Two 16-bit floats.
    Rg16Float,
    /// Four 16-bit floats.
    Rgba16Float,
    /// One 32-bit float.
    R32Float,
    /// Two 32-bit floats.
    Rg32Float,
    /// Four 32-bit floats.
    Rgba32Float,
    /// One 32-bit unsigned integer.
    R32Uint,
    /// Two 32-bit unsigned integers.
    Rg32Uint,
    /// Depth, one 32-bit float.
    D32Float,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 18] = [
        Self::R8Unorm,
        Self::Rg8Unorm,
        Self::Rgba8Unorm,
        Self::Rgba8Srgb,
        Self::R16Unorm,
        Self::Rg16Unorm,
        Self::Rgba16Unorm,
        Self::Rg16Snorm,
        Self::Rgba16Snorm,
        Self::R16Float,
        Self::Rg16Float,
        Self::Rgba16Float,
        Self::R32Float,
        Self::Rg32Float,
        Self::Rgba32Float,
        Self::R32Uint,
        Self::Rg32Uint,
        Self::D32Float,
    ];

    /// Bytes that one pixel takes.
    pub fn bytes_per_pixel(self) -> u32 {
        match self {
            Self::R8Unorm => 1,
            Self::Rg8Unorm | Self::R16Unorm | Self::R16Float => 2,
            Self::Rgba8Unorm | Self::Rgba8Srgb | Self::Rg16Unorm | Self::Rg16Snorm | Self::Rg16Float => 4,
            Self::R32Float | Self::R32Uint | Self::D32Float | Self::A2Rgb10Unorm => 4,
            Self::Rgba16Unorm | Self::Rgba16Snorm | Self::Rgba16Float | Self::Rg32Float | Self::Rg32Uint => 8,
            Self::Rgba32Float => 16,
        }
    }

    /// Number of channels, 1 to 4.
    pub fn channels(self) -> u32 {
        match self {
            Self::R8Unorm | Self::R16Unorm | Self::R16Float | Self::R32Float | Self::R32Uint | Self::D32Float => 1,
            Self::Rg8Unorm | Self::Rg16Unorm | Self::Rg16Snorm | Self::Rg16Float | Self::Rg32Float | Self::Rg32Uint => {
                2
            }
            Self::Rgba8Unorm
            | Self::Rgba8Srgb
            | Self::Rgba16Unorm
            | Self::A2Rgb10Unorm
            | Self::Rgba16Snorm
            | Self::Rgba16Float
            | Self::Rgba32Float => 4,
        }
    }

    /// Whether channels are floating-point numbers, which can be NaN or infinite.
    pub fn is_float(self) -> bool {
        match self {
            Self::R16Float
            | Self::Rg16Float
            | Self::Rgba16Float
            | Self::R32Float
            | Self::Rg32Float
            | Self::Rgba32Float
            | Self::D32Float => true,
            Self::R8Unorm
            | Self::Rg8Unorm
            | Self::Rgba8Unorm
            | Self::Rgba8Srgb
            | Self::R16Unorm
            | Self::Rg16Unorm
            | Self::Rgba16Unorm
            | Self::A2Rgb10Unorm
            | Self::Rg16Snorm
            | Self::Rgba16Snorm
            | Self::R32Uint
            | Self::Rg32Uint => false,
        }
    }

    /// Whether it is a depth format.
    pub fn is_depth(self) -> bool {
        self == Self::D32Float
    }

    /// Largest finite value of a 16-bit float format; infinite for all other formats. Shaders clamp finite values to it, so that
    /// storing one never gives an infinity.
    pub fn greatest(self) -> f32 {
        match self {
            Self::R16Float | Self::Rg16Float | Self::Rgba16Float => 65504.0,
            _ => f32::INFINITY,
        }
    }

    /// Whether channels are unsigned integers.
    pub fn is_uint(self) -> bool {
        matches!(self, Self::R32Uint | Self::Rg32Uint)
    }

    /// Whether it can be a storage image. Depth formats cannot, nor can sRGB, since stores do not apply the curve, nor what goes to a display.
    pub fn is_storable(self) -> bool {
        !self.is_depth() && !matches!(self, Self::Rgba8Srgb | Self::A2Rgb10Unorm)
    }
}

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Extent {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
}

impl Extent {
    /// Longest side that the graph accepts, pixels. Current Vulkan devices support at most this.
    pub const MAX_SIDE: u32 = 32768;

    /// An extent of `width` by `height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Half of it on each side, rounded up, so that every pixel of the full image has one in the half image.
    pub fn half(self) -> Self {
        Self { width: self.width.div_ceil(2), height: self.height.div_ceil(2) }
    }

    /// Number of mips down to one pixel.
    pub fn full_mips(self) -> u32 {
        u32::BITS - self.width.max(self.height).leading_zeros()
    }

    /// Size of a mip, at least 1 pixel on each side; mip 0 is the extent itself.
    pub fn mip(self, level: u32) -> Self {
        let side = |s: u32| s.checked_shr(level).unwrap_or(0).max(1);
        Self { width: side(self.width), height: side(self.height) }
    }
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// Size of an image, relative to the frame where possible: effects do not read the window's size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// As large as the frame.
    Full,
    /// Half the frame on each side, rounded up.
    Half,
    /// As large as another image.
    Like(Handle<Image>),
    /// A fixed size in pixels, for tables and maps that do not depend on the frame's size.
    Fixed(Extent),
}

/// A part of an image: a range of its mips and a range of its layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// First mip.
    pub mip: u16,
    /// Number of mips; [`Part::REST`] for all from the first on.
    pub mips: u16,
    /// First layer.
    pub layer: u16,
    /// Number of layers; [`Part::REST`] for all from the first on.
    pub layers: u16,
}

impl Part {
    /// As a count: all from the first on.
    pub const REST: u16 = u16::MAX;

    /// All mips of all layers.
    pub const ALL: Self = Self { mip: 0, mips: Self::REST, layer: 0, layers: Self::REST };

    /// One mip of all layers.
    pub fn mip(mip: u32) -> Self {
        Self { mip: mip as u16, mips: 1, ..Self::ALL }
    }

    /// All mips of one layer.
    pub fn layer(layer: u32) -> Self {
        Self { layer: layer as u16, layers: 1, ..Self::ALL }
    }

    /// Whether it is [`Part::ALL`].
    pub fn is_all(self) -> bool {
        self == Self::ALL
    }

    /// The same part with [`Part::REST`] replaced by actual counts, for an image with `mips` mips and `layers` layers.
    pub fn of(self, mips: u32, layers: u32) -> Self {
        let rest = |first: u16, count: u16, all: u32| if count == Self::REST { all as u16 - first } else { count };
        Self { mips: rest(self.mip, self.mips, mips), layers: rest(self.layer, self.layers, layers), ..self }
    }

    /// Whether it is not empty and lies inside an image with `mips` mips and `layers` layers.
    pub fn fits(self, mips: u32, layers: u32) -> bool {
        let inside = |first: u16, count: u16, all: u32| {
            u32::from(first) < all && (count == Self::REST || (count > 0 && u32::from(first) + u32::from(count) <= all))
        };
        inside(self.mip, self.mips, mips) && inside(self.layer, self.layers, layers)
    }

    /// Whether `other` contains all of it; counts of both must be resolved.
    pub fn is_within(self, other: Self) -> bool {
        let inside = |a: u16, a_count: u16, b: u16, b_count: u16| {
            a >= b && u32::from(a) + u32::from(a_count) <= u32::from(b) + u32::from(b_count)
        };
        inside(self.mip, self.mips, other.mip, other.mips) && inside(self.layer, self.layers, other.layer, other.layers)
    }

    /// Whether two parts of one image overlap.
    pub fn overlaps(self, other: Self) -> bool {
        let meet = |a: u16, a_count: u16, b: u16, b_count: u16| {
            u32::from(a) < u32::from(b) + u32::from(b_count) && u32::from(b) < u32::from(a) + u32::from(a_count)
        };
        meet(self.mip, self.mips, other.mip, other.mips) && meet(self.layer, self.layers, other.layer, other.layers)
    }
}

/// Description of an image to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageDesc {
    /// Format of its pixels.
    pub format: Format,
    /// Size of mip 0.
    pub size: Size,
    /// Number of mips, at least 1.
    pub mips: u32,
    /// Number of layers, at least 1. With more than one, shaders see the image as an array.
    pub layers: u32,
}

impl ImageDesc {
    /// Most layers that the graph accepts; every Vulkan device supports that many.
    pub const MAX_LAYERS: u32 = 256;

    /// As large as the frame, with one mip and one layer.
    pub fn full(format: Format) -> Self {
        Self { format, size: Size::Full, mips: 1, layers: 1 }
    }

    /// Half the frame on each side, with one mip and one layer.
    pub fn half(format: Format) -> Self {
        Self { format, size: Size::Half, mips: 1, layers: 1 }
    }

    /// As large as another image, with one mip and one layer.
    pub fn like(format: Format, other: Handle<Image>) -> Self {
        Self { format, size: Size::Like(other), mips: 1, layers: 1 }
    }

    /// A fixed size in pixels, with one mip and one layer.
    pub fn fixed(format: Format, extent: Extent) -> Self {
        Self { format, size: Size::Fixed(extent), mips: 1, layers: 1 }
    }
}

/// Description of a buffer to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferDesc {
    /// Size in bytes.
    pub bytes: u64,
    /// What the contents are.
    pub content: Content,
}

/// What the 32-bit words of a buffer hold, as far as the graph needs to know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Content {
    /// Any data; the scan for NaN skips it.
    #[default]
    Raw,
    /// Only 32-bit floats, so that the scan of [`check`](super::check) can look for NaN and infinity.
    Floats,
}

impl BufferDesc {
    /// Largest size that the graph accepts: a tebibyte, above what devices offer.
    pub const MAX_BYTES: u64 = 1 << 40;

    /// A buffer of `bytes` bytes of any data.
    pub fn new(bytes: u64) -> Self {
        Self { bytes, content: Content::Raw }
    }

    /// A buffer of `count` 32-bit floats.
    pub fn floats(count: u64) -> Self {
        Self { bytes: count.saturating_mul(4), content: Content::Floats }
    }

    /// The same buffer, declared to hold only 32-bit floats.
    pub fn of_floats(self) -> Self {
        Self { content: Content::Floats, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_know_where_they_end() {
        let (whole, mip, layer) = (Part::ALL, Part::mip(1), Part::layer(2));
        assert_eq!(whole.of(4, 3), Part { mip: 0, mips: 4, layer: 0, layers: 3 });
        assert_eq!(mip.of(4, 3), Part { mip: 1, mips: 1, layer: 0, layers: 3 });
        assert!(
            whole.overlaps(mip)
                && mip.overlaps(layer)
                && !mip.overlaps(Part::mip(2))
                && !layer.overlaps(Part::layer(1))
        );
        assert!(mip.fits(2, 1) && !mip.fits(1, 1) && layer.fits(1, 3) && !layer.fits(1, 2));
        assert!(!Part { mips: 0, ..Part::ALL }.fits(1, 1) && !Part { mips: 3, ..mip }.fits(3, 1));
        assert!(whole.fits(1, 1) && whole.is_all() && !mip.is_all());
    }

    #[test]
    fn halves_round_up_and_mips_end_at_one_pixel() {
        let odd = Extent::new(641, 3);
        assert_eq!(odd.half(), Extent::new(321, 2));
        assert_eq!(odd.full_mips(), 10);
        assert_eq!(odd.mip(9), Extent::new(1, 1));
        assert_eq!(odd.mip(8), Extent::new(2, 1));
        assert_eq!(Extent::new(1, 1).full_mips(), 1);
        assert_eq!(Extent::new(0, 0).full_mips(), 0);
        assert_eq!(odd.mip(40), Extent::new(1, 1));
    }
}
