//! Parameters of the reference path tracer.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`PathParams::flags`]: rays go through the centres of pixels, and textures of the first surface are filtered over the pixel.
pub const PATH_CENTRE: u32 = 1;
/// [`PathParams::flags`]: multiple importance sampling by the balance heuristic instead of the power heuristic.
pub const PATH_BALANCE: u32 = 2;
/// [`PathParams::flags`]: the scene has surfaces that transmit light straight through: blended ones by their alpha, thin smooth ones by
/// their transmission.
pub const PATH_CLEAR: u32 = 4;
/// [`PathParams::flags`]: emission of the first surface counts.
pub const PATH_EMISSION: u32 = 8;
/// [`PathParams::flags`]: light that comes directly from lights and emissive surfaces to the first surface counts.
pub const PATH_LIGHTS: u32 = 16;
/// [`PathParams::flags`]: light that comes directly from the sky to the first surface counts.
pub const PATH_SKY: u32 = 32;
/// [`PathParams::flags`]: the sky counts where the camera sees it.
pub const PATH_BACKGROUND: u32 = 64;
/// [`PathParams::flags`]: no light sampling; only paths find lights, if they have a size.
pub const PATH_NO_LIGHT_SAMPLES: u32 = 128;
/// [`PathParams::flags`]: light that paths hit counts only where light sampling cannot find it.
pub const PATH_NO_LIGHT_HITS: u32 = 256;
/// Parameters of every pass of the reference.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathParams {
    /// [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// Mean of the samples of this pass, RGBA32F.
    pub mean: StorageImage,
    /// Sum of the squared deviations from that mean, RGBA32F.
    pub squares: StorageImage,
    /// Upper left pixel of the tile that is traced.
    pub tile: [u32; 2],
    /// Index of the first sample of this pass.
    pub first_sample: u32,
    /// Samples per pixel of this pass.
    pub samples: u32,
    /// Greatest number of scatterings; 0 for no limit.
    pub depth: u32,
    /// `LOBE_*` bits of `lib/bsdf.glsl`: lobes of the first scattering.
    pub first_lobes: u32,
    /// `PATH_*` bits.
    pub flags: u32,
    /// Distance up to which geometry occludes ambient light, metres.
    pub range: f32,
    /// Alpha from which on camera rays hit a blended surface, as the raster does; 0 to blend by alpha.
    pub blend_cutoff: f32,
}

/// Parameters of `present.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PresentParams {
    /// Three `f32` per pixel, rows from the top.
    pub values: Address,
    /// RGBA32F.
    pub image: StorageImage,
    /// Width and height, pixels.
    pub size: [u32; 2],
}
