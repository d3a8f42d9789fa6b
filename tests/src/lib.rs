//! Tests of Magpie, in tiers.

pub mod harness;
pub mod oracle;
