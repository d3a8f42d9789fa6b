//! Slow, obvious, double-precision answers to compare the GPU with.

pub mod shading;
