//! The command line of Magpie as a library.
