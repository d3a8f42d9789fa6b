//! The CPU reference of resampling: reservoirs, merging, and toy scenes of ReSTIR DI and ReSTIR GI, against closed
//! forms and brute force. Numbers F01 to F42 are statements about resampling, H1 to H16 its hazards;
//! `docs/resampling.md` has both lists, and the table of means that `cargo test --release --workspace --test resampling
//! -- --nocapture` prints.
#![allow(clippy::unwrap_used)] // helpers of tests may panic

#[path = "resampling/direct.rs"]
mod direct;
#[path = "resampling/hazards.rs"]
mod hazards;
#[path = "resampling/indirect.rs"]
mod indirect;
#[path = "resampling/merging.rs"]
mod merging;
#[path = "resampling/streams.rs"]
mod streams;

use magpie_tests::oracle::path::random::Random;
use magpie_tests::resampling::estimate::Estimate;

/// Independent runs, each with a stream of random numbers of its own.
fn runs(count: u64, seed: u64, run: impl Fn(&mut dyn FnMut() -> f64) -> f64) -> Estimate {
    let one = |stream| {
        let mut random = Random::new(seed, stream);
        run(&mut || random.unit())
    };
    Estimate::of((0..count).map(one))
}

/// A line of the table of means.
fn row(name: &str, found: &Estimate, truth: f64) {
    let off = 100.0 * (found.mean() / truth - 1.0);
    println!(
        "| {name} | {:.5} | {truth:.5} | {:.5} | {off:+.2} % | {:+.1} |",
        found.mean(),
        found.error(),
        found.deviate(truth)
    );
}

/// The mean is the truth, within three standard errors, which are known to 1 % of it.
#[track_caller]
fn is_truth(name: &str, found: &Estimate, truth: f64) {
    row(name, found, truth);
    assert!(found.error() < 0.01 * truth, "{name}: standard error {} of {truth}", found.error());
    assert!(found.deviate(truth).abs() < 3.0, "{name}: {} for {truth}, error {}", found.mean(), found.error());
}

/// The mean is too dark by at least this part of the truth, and by ten standard errors.
#[track_caller]
fn is_darker(name: &str, found: &Estimate, truth: f64, part: f64) {
    row(name, found, truth);
    assert!(found.mean() < truth * (1.0 - part), "{name}: {} for {truth}", found.mean());
    assert!(found.deviate(truth) < -10.0, "{name}: {} standard errors", found.deviate(truth));
}
