//! measure/mod
