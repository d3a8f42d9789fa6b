//! Parameters of `shaders/check`: the NaN and infinity scan.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `scan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScanParams {
    /// The image to scan, a float format.
    pub image: SampledImage,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The [`Finding`] to add to.
    pub finding: Address,
}

/// What a scan found. Cleared to zero before the frame, except `first` to all ones.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Finding {
    /// Pixels with a NaN.
    pub nan: u32,
    /// Pixels with an infinity and no NaN.
    pub infinite: u32,
    /// Least `y * width + x` among them.
    pub first: u32,
}
