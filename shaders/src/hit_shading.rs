//! What shading at the hits of rays reads.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Greatest number of rays in a row of one path: bounces, and surfaces that it goes straight through.
pub const MOST_TURNS: u32 = 24;
/// Transmitting surfaces along a shadow ray after which light is given up: more panes in a row are dark anyway, and the loop must end.
pub const MOST_SHEETS: u32 = 16;

/// What `lib/hit_shading.glsl` reads, as a block for the parameters of a pass.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HitShadingParams {
    /// [`LightTables`](super::light_sampling::LightTables) of every light.
    pub lights: Address,
    /// [`SurfelGrid`](super::surfels::SurfelGrid) of surfels that know the indirect light; 0 for none.
    pub cache: Address,
    /// Radiance of the previous frame, RGBA16F, 0 in alpha where it is not known; no image if hits do not look there.
    pub previous_radiance: SampledImage,
    /// The denoisers' guide of the previous frame, RG32 unsigned: which surfaces that radiance belongs to.
    pub previous_guide: SampledImage,
}
