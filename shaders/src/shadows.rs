//! Parameters of `shaders/shadows`.
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `trace.comp`: one hard shadow ray per pixel towards the key light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TraceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// Instance + 1 and primitive.
    pub ids: SampledImage,
    /// R8: 1 where the key light is visible, 0 where it is hidden.
    pub visibility: StorageImage,
    /// One ray for so many pixels in each direction: 1, or 2 for half resolution.
    pub step: u32,
}

/// Push constants of `upsample.comp`: visibility of half resolution brought to full.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct UpsampleParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Reversed depth.
    pub depth: SampledImage,
    /// Octahedral normals: shading in xy, geometric in zw.
    pub normal: SampledImage,
    /// R8, half as large: visibility of the upper left one of four pixels.
    pub half_visibility: SampledImage,
    /// R8, full size.
    pub visibility: StorageImage,
}
