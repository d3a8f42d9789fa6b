//! Tests of Magpie, in tiers.

pub mod bench;
pub mod flip;
pub mod harness;
pub mod made;
pub mod oracle;
