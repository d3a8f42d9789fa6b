//! Parameters of marching rays through the depth image: `lib/screen_march.glsl`.
use super::types::SampledImage;
use bytemuck::{Pod, Zeroable};

/// How rays are marched through the depth image.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScreenMarch {
    /// Least and greatest reversed depth of 2x2 pixels in mip 0, 4x4 in mip 1 and so on: the part `pyramid` over the depth image. No image
    /// for steps of equal length on the screen.
    pub pyramid: SampledImage,
    /// Mips of `pyramid`.
    pub levels: u32,
    /// Greatest number of steps of a ray.
    pub steps: u32,
    /// Assumed thickness of what the depth image shows, metres.
    pub thickness: f32,
    /// Greatest length of a ray, metres.
    pub distance: f32,
}

/// What rays that hit the screen find there: `lib/screen_light.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScreenLight {
    /// How rays are marched.
    pub march: ScreenMarch,
    /// Radiance of the previous frame, RGBA16F, 0 in alpha where it is not known.
    pub previous_radiance: SampledImage,
    /// The guide of the previous frame, RG32 unsigned: which surfaces that radiance belongs to.
    pub previous_guide: SampledImage,
    /// Share of the picture's width and height over which confidence falls to 0 at each border.
    pub edge: f32,
    /// 1 if the G-buffer has an image of emission.
    pub has_emission: u32,
}
