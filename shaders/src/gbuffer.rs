//! Parameters of `shaders/gbuffer`.
use super::types::Address;
use bytemuck::{Pod, Zeroable};

/// Push constants of one draw list.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DrawParams {
    /// The [`View`](super::view::View).
    pub view: Address,
}
