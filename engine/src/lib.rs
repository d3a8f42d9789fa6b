//! Magpie: a frame-graph-based hybrid renderer on Vulkan.
//!
//! One rule: strings choose implementations; types carry data; the graph owns every barrier; an effect has one name in
//! every folder.

pub mod config;
pub mod files;
pub mod frame;
pub mod gpu;
pub mod graph;
pub mod measure;
pub mod pixels;
pub mod prelude;
pub mod ray;
pub mod scene;
pub mod slot;
