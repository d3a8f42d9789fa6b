//! Tests of Magpie, in tiers.
