//! Lamps by cells of the view frustum, for `direct = clustered`.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Greatest number of lamps that a cell lists.
pub const CELL_LAMPS: u32 = 128;
/// Invocations for a cell, and for a corner.
pub const CLUSTER_GROUP: u32 = 64;
/// Invocations of the one workgroup that finds how far lamps reach.
pub const REACH_GROUP: u32 = 256;
/// Pixels on a side of the blocks over which the range of depth is taken.
pub const DEPTH_BLOCK: u32 = 32;

/// Lamps that are near a cell.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LampCell {
    /// How many there are.
    pub count: u32,
    /// What reaches are multiplied with in this cell at most, 0 to 1, so that the list holds all.
    pub scale: f32,
    /// Their indices.
    pub lamps: [u32; 128],
}

/// Light at a corner of cells, of lamps as far as they are not near.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CornerLight {
    /// What reaches are multiplied with here, 0 to 1.
    pub scale: f32,
    /// Irradiances at normal incidence as order-2 spherical harmonics of the directions that they come from, in the order of
    /// [`Sky::irradiance_sh`](super::view::Sky::irradiance_sh), not convolved.
    pub harmonics: [[f32; 3]; 9],
}

/// How many cells there are, and where what is known of them is kept.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LampTables {
    /// How many there are across, down, and from near to far.
    pub cells: [u32; 3],
    /// Of each light its position and how far it reaches, metres (`vec4`): infinite for what counts everywhere, 0 for what does not shine.
    pub reaches: Address,
    /// [`LampCell`], x first.
    pub lists: Address,
    /// [`CornerLight`], x first: one more each way than there are cells.
    pub corners: Address,
    /// The [`LightTables`](super::light_sampling::LightTables), unless `lobe` is 0.
    pub lights: Address,
    /// The [`LightTree`](super::light_tree::LightTree), likewise.
    pub tree: Address,
    /// Roughness up to which surfaces show all lamps in their specular lobe; 0 for none.
    pub lobe: f32,
}

/// Cells and what is in them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LampGrid {
    /// What the frame says.
    pub tables: LampTables,
    /// View depth of the nearest surface, metres, rounded down to a power of two.
    pub nearest: f32,
    /// log2 of that of the farthest over it, rounded up.
    pub octaves: f32,
    /// How far a lamp of an intensity of 1 reaches, metres.
    pub reach: f32,
    /// Places of the lamps that cast shadows, which count everywhere; then the last one again, or infinity.
    pub everywhere: [[f32; 3]; 8],
}

/// Push constants of `depth_range.comp`: the range of depth in blocks of the picture.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DepthRangeParams {
    /// Reversed depth.
    pub depth: SampledImage,
    /// Output: of each block the least and the greatest, as the bits of floats (`uint`). The least of a block without a surface is infinite.
    pub blocks: Address,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
}

/// Push constants of `lamp_reach.comp`: how far each lamp reaches, and where the cells are.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LampReachParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// What `depth_range.comp` has found.
    pub blocks: Address,
    /// Number of blocks.
    pub block_count: u32,
    /// Lamps that are near a place, in the mean.
    pub near: f32,
    /// Output: the [`LampGrid`].
    pub grid: Address,
    /// What is written there as it is.
    pub tables: LampTables,
}

/// Push constants of `clusters.comp` and `far_lamps.comp`: lists of lamps, and the light of those that are far.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ClusterParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// The [`LampGrid`].
    pub grid: Address,
}
