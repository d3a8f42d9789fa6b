//! Simple CPU implementations in double precision, to compare the GPU with.

pub mod albedo;
pub mod gbuffer;
pub mod path;
pub mod rays;
pub mod scenes;
pub mod shading;
