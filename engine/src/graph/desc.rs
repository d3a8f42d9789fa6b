//! What a resource is like: format, size and mips of images, bytes of buffers.

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
    /// Four channels, 8 bits each, rgb in the sRGB curve; shaders read it linear.
    Rgba8Srgb,
    /// Four channels, -1 to 1, 16 bits each.
    Rgba16Snorm,
    /// Two half floats.
    Rg16Float,
    /// Four half floats.
    Rgba16Float,
    /// One float.
    R32Float,
    /// Two floats.
    Rg32Float,
    /// Four floats.
    Rgba32Float,
    /// One unsigned integer.
    R32Uint,
    /// Two unsigned integers.
    Rg32Uint,
    /// Depth, one float.
    D32Float,
}

impl Format {
    /// Bytes that one pixel takes.
    pub fn bytes_per_pixel(self) -> u32 {
        match self {
            Self::R8Unorm => 1,
            Self::Rg8Unorm => 2,
            Self::Rgba8Unorm | Self::Rgba8Srgb | Self::Rg16Float | Self::R32Float | Self::R32Uint | Self::D32Float => 4,
            Self::Rgba16Snorm | Self::Rgba16Float | Self::Rg32Float | Self::Rg32Uint => 8,
            Self::Rgba32Float => 16,
        }
    }

    /// Numbers per pixel.
    pub fn channels(self) -> u32 {
        match self {
            Self::R8Unorm | Self::R32Float | Self::R32Uint | Self::D32Float => 1,
            Self::Rg8Unorm | Self::Rg16Float | Self::Rg32Float | Self::Rg32Uint => 2,
            Self::Rgba8Unorm | Self::Rgba8Srgb | Self::Rgba16Snorm | Self::Rgba16Float | Self::Rgba32Float => 4,
        }
    }

    /// Whether pixels are floating-point numbers, so that they can be NaN or infinite.
    pub fn is_float(self) -> bool {
        match self {
            Self::Rg16Float
            | Self::Rgba16Float
            | Self::R32Float
            | Self::Rg32Float
            | Self::Rgba32Float
            | Self::D32Float => true,
            Self::R8Unorm
            | Self::Rg8Unorm
            | Self::Rgba8Unorm
            | Self::Rgba8Srgb
            | Self::Rgba16Snorm
            | Self::R32Uint
            | Self::Rg32Uint => false,
        }
    }

    /// Whether it is a depth attachment's format.
    pub fn is_depth(self) -> bool {
        self == Self::D32Float
    }

    /// Whether pixels are unsigned integers.
    pub fn is_uint(self) -> bool {
        matches!(self, Self::R32Uint | Self::Rg32Uint)
    }

    /// Whether it can be a storage image: not depth, and not sRGB, whose curve stores do not apply.
    pub fn is_storable(self) -> bool {
        !self.is_depth() && self != Self::Rgba8Srgb
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
    /// Longest side that the graph accepts, pixels. No Vulkan device of today makes larger images.
    pub const MAX_SIDE: u32 = 32768;

    /// An extent in pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Half of it on each side, rounded up, so that every full pixel has a half one.
    pub fn half(self) -> Self {
        Self { width: self.width.div_ceil(2), height: self.height.div_ceil(2) }
    }

    /// Number of mips down to one pixel.
    pub fn full_mips(self) -> u32 {
        u32::BITS - self.width.max(self.height).leading_zeros()
    }

    /// Extent of a mip; mip 0 is the whole.
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

/// How large an image is. No effect reads the window's size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// As large as the frame.
    Full,
    /// Half the frame on each side, rounded up.
    Half,
    /// As large as another image.
    Like(Handle<Image>),
    /// So many pixels, for tables and maps that do not follow the frame.
    Fixed(Extent),
}

/// An image to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageDesc {
    /// Format of its pixels.
    pub format: Format,
    /// Size of mip 0.
    pub size: Size,
    /// Number of mips, 1 for none but the whole.
    pub mips: u32,
}

impl ImageDesc {
    /// As large as the frame, without further mips.
    pub fn full(format: Format) -> Self {
        Self { format, size: Size::Full, mips: 1 }
    }

    /// Half the frame on each side, without further mips.
    pub fn half(format: Format) -> Self {
        Self { format, size: Size::Half, mips: 1 }
    }

    /// As large as another image, without further mips.
    pub fn like(format: Format, other: Handle<Image>) -> Self {
        Self { format, size: Size::Like(other), mips: 1 }
    }

    /// So many pixels, without further mips.
    pub fn fixed(format: Format, extent: Extent) -> Self {
        Self { format, size: Size::Fixed(extent), mips: 1 }
    }
}

/// A buffer to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferDesc {
    /// Its size in bytes.
    pub bytes: u64,
}

impl BufferDesc {
    /// Largest size that the graph accepts: a tebibyte, more than any device holds.
    pub const MAX_BYTES: u64 = 1 << 40;

    /// A buffer of so many bytes.
    pub fn new(bytes: u64) -> Self {
        Self { bytes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
