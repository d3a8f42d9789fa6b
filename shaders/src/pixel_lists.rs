//! Lists of pixels that have work, tile by tile.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Pixels on a side of a tile, which is a workgroup.
pub const TILE_SIDE: u32 = 8;
/// Greatest key of a pixel with work.
pub const GREATEST_KEY: u32 = 255;
/// Bytes before the pixels of a list.
pub const LIST_HEAD: u32 = 32;

/// Parameters of the kernels that make a list.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ListParams {
    /// The list, as `lib/pixel_list.glsl` has it.
    pub list: Address,
    /// Number of pixels of each key from 0 to [`GREATEST_KEY`], a `uint` each, for lists with a limit.
    pub histogram: Address,
    /// Keys over [`GREATEST_KEY`] in red: a pixel with 0 has no work.
    pub keys: SampledImage,
    /// Width and height of that image, pixels.
    pub size: [u32; 2],
    /// Greatest number of pixels in the list; of the pixels with work those with lesser keys come first.
    pub most: u32,
    /// 1 if there is a limit.
    pub is_limited: u32,
}
