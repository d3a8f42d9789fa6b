//! Tests of Magpie, in tiers.

pub mod oracle;
