//! Lists of tiles that have work.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Pixels on a side of a tile, which is a workgroup.
pub const TILE_SIDE: u32 = 8;

/// Parameters of `clear.comp` and `classify.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TileParams {
    /// Number of workgroups in x, y and z for an indirect dispatch: tiles in the list, 1, 1.
    pub groups: Address,
    /// The tiles: column in the lower, row in the upper 16 bits.
    pub list: Address,
    /// Pixels with a value other than 0 in red have work.
    pub work: SampledImage,
    /// Width and height of that image, pixels.
    pub size: [u32; 2],
}
