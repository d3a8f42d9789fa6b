//! Shared code of Magpie's tests: test devices, scenes, and CPU implementations to compare with.

pub mod against;
pub mod bench;
pub mod chi_square;
pub mod fixtures;
pub mod flip;
pub mod gi;
pub mod harness;
pub mod lit;
pub mod oracle;
pub mod resampling;
pub mod rooms;
