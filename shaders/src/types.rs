//! The building blocks of shared structs: GPU addresses and bindless indices.
use bytemuck::{Pod, Zeroable};

/// A buffer device address as two words, low first: a GLSL `uvec2` aligns to 4 where a Rust `u64` aligns to 8.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Address(pub [u32; 2]);

impl Address {
    /// From a 64-bit device address.
    pub const fn new(address: u64) -> Self {
        Self([address as u32, (address >> 32) as u32])
    }

    /// As one number.
    pub const fn get(self) -> u64 {
        self.0[0] as u64 | (self.0[1] as u64) << 32
    }

    /// The address `bytes` further on.
    pub const fn offset(self, bytes: u64) -> Self {
        Self::new(self.get() + bytes)
    }
}

/// Index of a sampled image in the bindless set. Only a token of a pass that declared the image gives one out, and the engine's own `Image`
/// where one lives longer than a frame.
///
/// The default, which is also what zeroed memory holds, is the place of an image of one black pixel that every device has: a field that was
/// left out reads zeros, and nobody's picture. Structs that hold it are plain bytes, so that whoever casts a number to it, or declares the
/// field as a `u32`, gets past this type; what the shader reads then is up to the driver, and may end the program.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SampledImage(u32);

impl SampledImage {
    /// No image, for shaders that ask: `NO_TEXTURE` and `NO_IMAGE` in GLSL. Not to be read.
    pub const NONE: Self = Self(u32::MAX);

    /// The number that the shader sees.
    pub const fn index(self) -> u32 {
        self.0
    }
}

/// Index of a storage image in the bindless set. Only a token of a pass that declared the image gives one out. The default stands for one
/// pixel that nobody reads, as with [`SampledImage`].
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct StorageImage(u32);

impl StorageImage {
    /// The number that the shader sees.
    pub const fn index(self) -> u32 {
        self.0
    }
}

/// Index of a sampler in the bindless set, which the device gives out when it makes one.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SamplerId(u32);

impl SamplerId {
    /// The number that the shader sees.
    pub const fn index(self) -> u32 {
        self.0
    }
}
