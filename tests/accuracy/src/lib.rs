//! What accuracy costs: error metrics, sweeps of error against time, and the configuration that they recommend.

pub mod metrics;
