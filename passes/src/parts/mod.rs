//! Parts that several effects share. Effects in other crates can use the public ones as well. Each has a page in `docs/parts`.
pub mod denoise;
pub mod hit_shading;
pub mod inspect;
pub mod light_tree;
pub mod overlay;
pub mod pixel_lists;
pub(crate) mod previous_radiance;
pub mod pyramid;
pub mod reproject;
pub mod upsample;
