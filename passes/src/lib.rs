//! The effects of Magpie, one folder each.
