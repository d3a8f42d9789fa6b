//! What effects are made of: parts that several of them share, and that an effect from outside can use as well. Each has a page in
//! `docs/parts`.
pub mod denoise;
pub mod hit_shading;
pub(crate) mod previous_radiance;
pub mod reproject;
