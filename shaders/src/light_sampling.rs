//! Tables by which lights are sampled.
use super::types::Address;
use bytemuck::{Pod, Zeroable};

/// [`LightChoice::light`] of an emissive triangle or sphere.
pub const CHOICE_EMITTER: u32 = 4294967295;
/// Entry of [`LightTables::emitters`] for an instance that does not emit.
pub const NO_EMITTER: u32 = 4294967295;

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
    /// [`LightTree`](super::light_tree::LightTree) by which entries of `near` are chosen for a point; 0 to choose them from the table, by power.
    pub tree: Address,
    /// Entries of `near`.
    pub near_count: u32,
    /// Entries of `far`.
    pub far_count: u32,
    /// Entries of `areas`.
    pub area_count: u32,
    /// The first of them that is directional; all others come before it.
    pub first_far_area: u32,
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
    /// Its index in [`LightTables::near`], or in [`LightTables::far`] if it is directional.
    pub entry: u32,
}
