//! Poses.
