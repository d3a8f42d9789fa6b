//! `cargo xtask test`: all checks that must pass before a change lands, one after the other.

use crate::setup;
use crate::shell::Invocation;
use crate::workplace::{Workplace, on_path};
use anyhow::{Result, bail};
use std::time::{Duration, Instant};

/// Which tests to run.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Leave out everything that needs a Vulkan device.
    pub no_gpu: bool,
    /// Leave out slow tests.
    pub quick: bool,
}

struct Step {
    name: &'static str,
    command: Invocation,
}

/// Sets up, then runs the steps up to the first that fails.
pub fn test(extent: Extent) -> Result<()> {
    let start = Instant::now();
    let place = setup::prepare(extent.no_gpu)?;
    components(&place)?;
    let steps = steps(&place, extent);
    let mut times = vec![("set-up", start.elapsed())];
    let mut failure = None;
    for step in &steps {
        println!("test: {}", step.name);
        let begin = Instant::now();
        failure = step.command.run().err().map(|error| (step.name, error));
        times.push((step.name, begin.elapsed()));
        println!("test: {} took {:.1} s", step.name, begin.elapsed().as_secs_f64());
        if failure.is_some() {
            break;
        }
    }
    let names: Vec<&str> = steps.iter().map(|step| step.name).collect();
    print!("{}", summary(&names, &times, failure.as_ref().map(|(name, _)| *name)));
    match failure {
        None => Ok(()),
        Some((name, error)) => Err(error.context(format!("step `{name}` failed"))),
    }
}

/// Installs rustfmt and clippy if the toolchain lacks them.
fn components(place: &Workplace) -> Result<()> {
    for (command, component) in [("fmt", "rustfmt"), ("clippy", "clippy")] {
        if place.cargo(&[command, "--version"]).output()?.status.success() {
            continue;
        }
        if !on_path("rustup") {
            bail!("`cargo {command}` is missing; install {component} for this Rust toolchain");
        }
        println!("setup: this Rust toolchain has no {component}");
        Invocation::new("rustup", &["component", "add", component]).within(&place.root).run()?;
    }
    Ok(())
}

/// Everything is built in the release profile, so that the shader compiler's C++ is compiled only once.
fn steps(place: &Workplace, extent: Extent) -> Vec<Step> {
    let mut tests = place.cargo(&["test", "--release", "--workspace", "--no-fail-fast"]);
    for (wanted, variable) in [(extent.no_gpu, "MAGPIE_NO_GPU"), (extent.quick, "MAGPIE_QUICK")] {
        if wanted {
            tests = tests.with_env(variable, "1");
        }
    }
    let lints = &["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"];
    let documentation = place.cargo(&["doc", "--release", "--no-deps", "--workspace"]);
    vec![
        Step { name: "format", command: place.cargo(&["fmt", "--all", "--check"]) },
        Step { name: "lints", command: place.cargo(lints) },
        Step { name: "tests", command: tests },
        Step { name: "documentation", command: documentation.with_env("RUSTDOCFLAGS", "-D warnings") },
    ]
}

/// A line for every step: its time, and whether it passed.
fn summary(steps: &[&str], times: &[(&str, Duration)], failed: Option<&str>) -> String {
    let mut text = String::from("summary\n");
    for (name, time) in times {
        let result = if failed == Some(name) { "FAILED" } else { "passed" };
        text.push_str(&format!("  {name:<14}{:>8.1} s  {result}\n", time.as_secs_f64()));
    }
    for name in steps.iter().filter(|step| !times.iter().any(|(name, _)| name == *step)) {
        text.push_str(&format!("  {name:<14}{:>10}  not run\n", ""));
    }
    let total: Duration = times.iter().map(|(_, time)| *time).sum();
    text.push_str(&format!("  {:<14}{:>8.1} s\n", "total", total.as_secs_f64()));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caller_chooses_the_extent() {
        let place = Workplace::find().unwrap();
        let shown = |no_gpu, quick| {
            let steps = steps(&place, Extent { no_gpu, quick });
            steps.iter().map(|step| step.command.to_string()).collect::<Vec<_>>().join("\n")
        };
        let all = shown(false, false);
        for part in [
            "cargo fmt --all --check",
            "clippy --release --workspace --all-targets -- -D warnings",
            "--no-fail-fast",
            "cargo doc",
        ] {
            assert!(all.contains(part), "{part} is missing in {all}");
        }
        assert!(!all.contains("MAGPIE_"), "{all}");
        assert!(shown(true, true).contains("MAGPIE_NO_GPU=1 MAGPIE_QUICK=1 cargo test"));
    }

    #[test]
    fn the_summary_names_what_failed_and_what_was_not_run() {
        let second = Duration::from_secs(1);
        let text = summary(
            &["format", "lints", "tests"],
            &[("set-up", second), ("format", second), ("lints", second)],
            Some("lints"),
        );
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert_eq!(lines[2], "format             1.0 s  passed");
        assert_eq!(lines[3], "lints              1.0 s  FAILED");
        assert!(lines[4].starts_with("tests") && lines[4].ends_with("not run"));
        assert_eq!(lines[5], "total              3.0 s");
    }
}
