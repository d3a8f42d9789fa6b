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

/// Index of a sampled image in the bindless set.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SampledImage(pub u32);

/// Index of a storage image in the bindless set.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct StorageImage(pub u32);

/// Index of a sampler in the bindless set.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SamplerId(pub u32);
