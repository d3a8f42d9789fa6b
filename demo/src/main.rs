//! The command line of Magpie.
fn main() {}
