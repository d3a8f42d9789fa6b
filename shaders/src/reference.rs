//! The reference path tracer: what it is asked for, and its tables of light.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`PathParams::flags`]: rays go through the centres of pixels, and textures of the first surface are filtered over the pixel.
pub const PATH_CENTRE: u32 = 1;
/// [`PathParams::flags`]: strategies are combined by the balance heuristic, not the power heuristic.
pub const PATH_BALANCE: u32 = 2;
/// [`PathParams::flags`]: some surfaces let light through: blended ones by their alpha, thin smooth ones by what they transmit.
pub const PATH_CLEAR: u32 = 4;
/// [`PathParams::flags`]: what the first surface emits counts.
pub const PATH_EMISSION: u32 = 8;
/// [`PathParams::flags`]: light that comes straight from lights and emissive surfaces to the first surface counts.
pub const PATH_LIGHTS: u32 = 16;
/// [`PathParams::flags`]: the sky that the first surface sees counts.
pub const PATH_SKY: u32 = 32;
/// [`PathParams::flags`]: the sky behind everything counts.
pub const PATH_BACKGROUND: u32 = 64;
/// [`PathParams::flags`]: lights are not sampled; paths find those that have a size.
pub const PATH_NO_LIGHT_SAMPLES: u32 = 128;
/// [`PathParams::flags`]: what paths meet counts only where light samples never find it.
pub const PATH_NO_LIGHT_HITS: u32 = 256;
/// [`LightChoice::light`] of an emissive triangle or sphere.
pub const CHOICE_EMITTER: u32 = 4294967295;
/// In the table at [`LightTables::emitters`]: an instance that does not emit.
pub const NO_EMITTER: u32 = 4294967295;

/// Parameters of every pass of the reference.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PathParams {
    /// [`View`](super::view::View).
    pub view: Address,
    /// Counter of rays.
    pub rays: Address,
    /// [`LightTables`].
    pub lights: Address,
    /// Mean of the samples of this pass, RGBA32F.
    pub mean: StorageImage,
    /// Sum of the squared deviations from that mean, RGBA32F.
    pub squares: StorageImage,
    /// Pixel of the picture at which the tile begins.
    pub tile: [u32; 2],
    /// Number of the first sample.
    pub first_sample: u32,
    /// Samples per pixel.
    pub samples: u32,
    /// Greatest number of scatterings; 0 for no limit.
    pub depth: u32,
    /// Lobes of the first scattering.
    pub first_lobes: u32,
    /// `PATH_*` bits.
    pub flags: u32,
    /// How far away things hide a point from ambient light, metres.
    pub range: f32,
    /// Alpha from which on the camera sees a blended surface, and all of it, as the raster does; at 0 it sees as much as alpha covers.
    pub blend_cutoff: f32,
}

/// What light may be sampled, and how often. A table in which nothing shines has no entries: nothing is chosen from it, and whatever is met is
/// met at a density of 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightTables {
    /// [`LightChoice`] table of lights at a place and of emissive triangles and spheres.
    pub near: Address,
    /// [`LightChoice`] table of directional lights.
    pub far: Address,
    /// [`AreaLight`] table: lights that rays may meet.
    pub areas: Address,
    /// Of each instance the index in `near` of its first primitive, or [`NO_EMITTER`].
    pub emitters: Address,
    /// [`LightChoice`] table of the cells of the sky, rows from the zenith down, all of the same solid angle.
    pub sky: Address,
    /// Entries of `near`.
    pub near_count: u32,
    /// Entries of `far`.
    pub far_count: u32,
    /// Entries of `areas`.
    pub area_count: u32,
    /// Entries of `sky`: as many as cells, or none where no light comes from it.
    pub sky_count: u32,
    /// Columns and rows of the sky's cells; zero without a sky.
    pub sky_cells: [u32; 2],
}

/// One entry of an alias table (Walker 1977, "An Efficient Method for Generating Discrete Random Variables with General
/// Distributions").
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LightChoice {
    /// Below it the entry itself is chosen, else its alias. 0 to 1.
    pub threshold: f32,
    /// The other entry.
    pub alias: u32,
    /// How often the entry is chosen, all in all.
    pub probability: f32,
    /// Index of the light, or [`CHOICE_EMITTER`].
    pub light: u32,
    /// Instance that emits.
    pub instance: u32,
    /// Its triangle or sphere.
    pub primitive: u32,
}

/// A light that a ray may meet: rectangle, disc, sphere, or a directional light with a size.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AreaLight {
    /// Index of the light.
    pub light: u32,
    /// How often it is sampled.
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
    /// Pixels.
    pub size: [u32; 2],
}
