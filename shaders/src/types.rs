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

    /// The 64-bit device address.
    pub const fn get(self) -> u64 {
        self.0[0] as u64 | (self.0[1] as u64) << 32
    }

    /// The address `bytes` further on.
    pub const fn offset(self, bytes: u64) -> Self {
        Self::new(self.get() + bytes)
    }
}

/// Index of a sampled image in the bindless set. Only the token of a pass that declared the image hands it out, or the engine's `Image` for
/// one that lives longer than a frame.
///
/// The default, which is also what zeroed memory holds, is a black 1x1 image that every device has, so a field that was left out reads
/// zeros. Structs with this type are plain bytes: whoever casts a number to it, or declares the field as `u32`, bypasses the type. What the
/// shader then reads is up to the driver, and may crash the program.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SampledImage(u32);

impl SampledImage {
    /// No image, for optional inputs: `NO_TEXTURE` and `NO_IMAGE` in GLSL. Must not be read.
    pub const NONE: Self = Self(u32::MAX);

    /// The index that the shader uses.
    pub const fn index(self) -> u32 {
        self.0
    }
}

/// Index of a storage image in the bindless set. Only the token of a pass that declared the image hands it out. The default is a 1x1 image
/// that nothing reads, as with [`SampledImage`].
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct StorageImage(u32);

impl StorageImage {
    /// The index that the shader uses.
    pub const fn index(self) -> u32 {
        self.0
    }
}

/// Index of a sampler in the bindless set; the device assigns it when the sampler is created.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SamplerId(u32);

impl SamplerId {
    /// The index that the shader uses.
    pub const fn index(self) -> u32 {
        self.0
    }
}
