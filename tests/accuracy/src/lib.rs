//! What accuracy costs: error metrics, sweeps of error against time, and the configuration that they recommend.
//!
//! A [`sweep`](sweep::sweep) traces ground truths ([`truth`]), renders what a [`plan`] lists ([`measure`]) and writes results to a folder
//! ([`results`]); within a time limit it is a [`race`]. A [`report`] is built from those, with the Pareto [`front`] of each slot by one
//! [`metric`]; [`agreement`] compares two reports; [`tune`] [composes](compose) predictions for combinations, and chooses one.

pub mod agreement;
pub mod compose;
pub mod display;
mod error;
#[cfg(test)]
mod fixture;
pub mod front;
mod hash;
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
