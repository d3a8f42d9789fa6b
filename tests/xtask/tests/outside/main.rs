//! A crate outside of the workspace adds a lighting effect in one file of at most 120 lines: `tests/outside/bounce.rs`. It is built and run
//! as its author would, from a folder of its own.
#![allow(clippy::unwrap_used)] // helpers of tests may fail as tests do

#[allow(dead_code, reason = "shared with the test of new-pass, which uses more of it")]
#[path = "../new_pass/copy.rs"]
mod copy;

use copy::{cargo, root};
use std::fs;

const MAX_LINES: usize = 120;

#[test]
fn a_lighting_effect_from_outside_asks_for_what_ours_can() {
    if std::env::var_os("MAGPIE_NO_GPU").is_some() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dependency = |name: &str, path: &str| format!("{name} = {{ path = {:?} }}\n", root().join(path));
    let manifest = [
        "[package]\nname = \"magpie-outside\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n",
        "anyhow = \"1\"\nbytemuck = { version = \"1\", features = [\"derive\"] }\n",
        &dependency("magpie", "engine"),
        &dependency("magpie-passes", "passes"),
        &dependency("magpie-shaders", "shaders"),
    ];
    fs::create_dir(at("src")).unwrap();
    // With the profiles of this workspace, what it has built already serves here too.
    let workspace = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let profiles = &workspace[workspace.find("[profile.").unwrap()..];
    fs::write(at("Cargo.toml"), manifest.concat() + profiles).unwrap();
    // The versions of this workspace, so that nothing has to be fetched.
    fs::copy(root().join("Cargo.lock"), at("Cargo.lock")).unwrap();
    for name in ["bounce.rs", "main.rs"] {
        fs::copy(root().join("tests/outside").join(name), at("src").join(name)).unwrap();
    }
    let effect = fs::read_to_string(at("src/bounce.rs")).unwrap();
    assert!(effect.lines().count() <= MAX_LINES, "{} lines", effect.lines().count());
    for asked in ["jitter: true", "hit_shading::needs(facts)", "previous_radiance: self.reuse", "Denoiser::new("] {
        assert!(effect.contains(asked), "no {asked:?}");
    }

    let said = cargo(folder.path(), &["run", "--release", "--quiet", "--offline"]);
    let line = |gi: &str| said.lines().find_map(|line| line.strip_prefix(gi)).unwrap_or_else(|| panic!("{said}"));
    let mean = |gi: &str| line(gi).split_whitespace().next().unwrap().parse::<f64>().unwrap();
    // Light bounces, and not more of it than there is.
    let (without, with) = (mean("off:"), mean("bounce:"));
    assert!(with > 1.02 * without && with < 2.0 * without, "{said}");
    for pass in ["gi.gather", "gi.accumulate", "gi.level_4", "previous_radiance.keep"] {
        assert!(line("bounce:").contains(pass) && !line("off:").contains(pass), "{pass}: {said}");
    }
}
