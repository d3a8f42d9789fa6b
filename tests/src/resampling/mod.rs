//! Resampling on the CPU, in double precision: what the kernels are compared with. The formulas with their sources and
//! their measured means are in `docs/resampling.md`.
//!
//! Nothing here owns random numbers. Functions take uniform numbers in [0, 1), so that a kernel can be given the same
//! ones.

pub mod direct;
pub mod estimate;
pub mod indirect;
pub mod mis;
pub mod reservoir;
pub mod ris;
pub mod scenes;
