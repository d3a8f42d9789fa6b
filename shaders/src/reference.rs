//! Parameters of the reference path tracer, and its light tables.
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
/// [`LightChoice::light`] of an emissive triangle or sphere.
pub const CHOICE_EMITTER: u32 = 4294967295;
/// Entry of [`LightTables::emitters`] for an instance that does not emit.
pub const NO_EMITTER: u32 = 4294967295;

/// Parameters of every pass of the reference.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathParams {
    /// [`View`](super::view::View).
    pub view: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// [`LightTables`].
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

/// Sampling tables of lights. A table whose lights emit nothing has no entries: nothing is sampled from it, and hits have a light-sampling
/// pdf of 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTables {
    /// [`LightChoice`] table of local lights and of emissive triangles and spheres.
    pub near: Address,
    /// [`LightChoice`] table of directional lights.
    pub far: Address,
    /// [`AreaLight`] table: lights that rays can hit.
    pub areas: Address,
    /// For each instance the index in `near` of its first primitive, or [`NO_EMITTER`].
    pub emitters: Address,
    /// [`LightChoice`] table of the cells of the sky, rows from the zenith down, all of the same solid angle.
    pub sky: Address,
    /// Entries of `near`.
    pub near_count: u32,
    /// Entries of `far`.
    pub far_count: u32,
    /// Entries of `areas`.
    pub area_count: u32,
    /// Entries of `sky`: one per cell, or 0 if the sky is black.
    pub sky_count: u32,
    /// Columns and rows of the sky's cells; zero without a sky.
    pub sky_cells: [u32; 2],
}

/// One entry of an alias table (Walker 1977, "An Efficient Method for Generating Discrete Random Variables with General
/// Distributions").
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LightChoice {
    /// With a uniform number below it the entry itself is chosen, else its alias. 0 to 1.
    pub threshold: f32,
    /// Index of the alias entry.
    pub alias: u32,
    /// Total probability of the entry.
    pub probability: f32,
    /// Index of the light, or [`CHOICE_EMITTER`].
    pub light: u32,
    /// Index of the emissive instance.
    pub instance: u32,
    /// Index of its triangle or sphere.
    pub primitive: u32,
}

/// A light that a ray can hit: rectangle, disc, sphere, or a directional light with a size.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AreaLight {
    /// Index of the light.
    pub light: u32,
    /// Probability with which light sampling chooses it.
    pub probability: f32,
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
