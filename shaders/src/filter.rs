//! Bilinear filtering where samplers cannot do it: devices need not blend texels of 32-bit floats.

/// Ids of samplers from here on are none: shaders fetch four texels and blend them. Added to it is how the image goes on beyond its edges.
pub const FETCHED: u32 = 4294967040;
/// It repeats from left to right; else its edge goes on.
pub const REPEATS_U: u32 = 1;
/// The same from top to bottom.
pub const REPEATS_V: u32 = 2;
