//! Looking at rays.
use super::types::{Address, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Parameters of the heat map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct HeatMapParams {
    /// [`View`](super::view::View).
    pub view: Address,
    /// Counter of rays.
    pub rays: Address,
    /// Nodes visited and primitives tested, RG32F.
    pub steps: StorageImage,
    /// Their sum in false colours, RGBA8.
    pub colours: StorageImage,
    /// Steps that are shown as the hottest colour.
    pub hottest: f32,
}
