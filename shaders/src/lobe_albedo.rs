//! The table of the specular lobe's directional albedo, which `lib/brdf.glsl` reads.
use super::types::Address;
use bytemuck::{Pod, Zeroable};

/// Entries along each axis: fourth root of the cosine towards the viewer (rows are filled with it), from 0 to 1, and perceptual roughness,
/// from the least that the lobe can have to 1.
pub const LOBE_ALBEDO_SIZE: u32 = 96;
/// Samples of the lobe per entry: rings of visible normals.
pub const LOBE_ALBEDO_RINGS: u32 = 96;
/// Samples per ring, over half a turn: the lobe is symmetric.
pub const LOBE_ALBEDO_TURNS: u32 = 24;

/// Directional albedo of the specular lobe, `f0 * a + f90 * b`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LobeAlbedo {
    /// Factor of the reflectance at normal incidence.
    pub a: f32,
    /// Factor of the reflectance at grazing incidence.
    pub b: f32,
    /// Share of the light lost by single scattering that is given back: 1, or 0 with the single-scattering model.
    pub given_back: f32,
}

/// Push constants of `shaders/lobe_albedo/tabulate.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TabulateParams {
    /// Output: two tables of [`LobeAlbedo`], one after the other. The second one gives nothing back.
    pub table: Address,
}
