//! What accuracy costs: error metrics, sweeps of error against time, and the configuration that they recommend.
//!
//! A [`sweep`](sweep::sweep) finds truths ([`truth`]), renders what a [`plan`] lists ([`measure`]) and leaves results in a folder
//! ([`results`]), within a budget as a [`race`]; a [`report`] is made from those, with the Pareto [`front`] of each slot by one
//! [`metric`]; [`agreement`] compares two of them; [`tune`] [composes](compose) what choices make together, and chooses.

pub mod agreement;
pub mod compose;
pub mod display;
mod error;
pub mod front;
mod hash;
#[cfg(test)]
mod made_up;
pub mod measure;
pub mod metric;
pub mod metrics;
pub mod pictures;
pub mod plan;
pub mod race;
pub mod report;
pub mod results;
pub mod sweep;
pub mod truth;
pub mod tune;
pub mod worth;

pub use error::AccuracyError;
