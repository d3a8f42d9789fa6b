//! Slow, obvious, double-precision answers to compare the GPU with.

pub mod gbuffer;
pub mod rays;
pub mod shading;
