//! ray/mod
