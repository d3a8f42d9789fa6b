//! Bilinear filtering where samplers cannot do it: devices need not blend texels of 32-bit floats.

/// First sampler id that stands for no sampler: shaders fetch four texels and blend them. The addressing mode is added to it.
pub const FETCHED: u32 = 4294967040;
/// Addressing mode: repeats in u instead of clamping to the edge.
pub const REPEATS_U: u32 = 1;
/// Addressing mode: repeats in v instead of clamping to the edge.
pub const REPEATS_V: u32 = 2;
