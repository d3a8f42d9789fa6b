//! Tests of Magpie, in tiers.

pub mod against;
pub mod bench;
pub mod chi_square;
pub mod flip;
pub mod harness;
pub mod made;
pub mod oracle;
