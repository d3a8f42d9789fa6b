//! The examples run as programs. Needs a device; `minimal` is run with the tests of the viewer.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use std::{
    env, fs,
    path::Path,
    process::{Command, Output},
};

/// Runs an example in a folder; `None` where no device is wanted.
fn example(name: &str, folder: &Path, arguments: &[&str]) -> Option<Output> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    let program = env::current_exe().unwrap().parent().unwrap().parent().unwrap().join("examples").join(name);
    let output = Command::new(&program).args(arguments).current_dir(folder).output().unwrap_or_else(|error| {
        panic!("{}: {error}; `cargo test --release -p magpie-demo` builds it", program.display())
    });
    Some(output)
}

/// What it printed, if it ended well.
fn printed(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.is_empty(), "{}: {said}", output.status);
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Number of colours in a picture of this size.
fn colours(file: &Path, size: (u32, u32)) -> usize {
    let picture = image::open(file).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), size, "{}", file.display());
    picture.pixels().map(|pixel| pixel.0).collect::<std::collections::BTreeSet<_>>().len()
}

#[test]
fn embed_writes_what_the_application_copied() {
    let folder = tempfile::tempdir().unwrap();
    let Some(output) = example("embed", folder.path(), &["turn_%d.png"]) else { return };
    let files = ["turn_0.png", "turn_1.png", "turn_2.png"];
    assert_eq!(printed(&output).lines().collect::<Vec<_>>(), files);
    let bytes = files.map(|file| {
        assert!(colours(&folder.path().join(file), (320, 180)) > 1000, "{file} shows little");
        fs::read(folder.path().join(file)).unwrap()
    });
    assert!(bytes[0] != bytes[1] && bytes[1] != bytes[2], "nothing moves");
}

#[test]
fn custom_pass_takes_the_implementation_that_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let Some(lines) = example("custom_pass", folder.path(), &["lines.png"]) else { return };
    assert_eq!(printed(&lines), "lines.png\n");
    let haze =
        example("custom_pass", folder.path(), &["haze.png", "stages.style=haze", "style.half_metres=1"]).unwrap();
    assert_eq!(printed(&haze), "haze.png\n");
    let [lines, haze] = ["lines.png", "haze.png"].map(|file| colours(&folder.path().join(file), (320, 180)));
    assert!(lines > 1000 && haze < lines, "{lines} colours with lines, {haze} in haze");
    let wrong = example("custom_pass", folder.path(), &["wrong.png", "stages.style=lions"]).unwrap();
    let said = String::from_utf8_lossy(&wrong.stderr);
    assert!(!wrong.status.success() && said.contains("did you mean \"lines\""), "{said}");
    assert!(!folder.path().join("wrong.png").exists());
}

#[test]
fn own_pass_writes_a_picture_and_times() {
    let folder = tempfile::tempdir().unwrap();
    let Some(output) = example("own_pass", folder.path(), &["dark.png", "post.exposure=-1"]) else { return };
    let said = printed(&output);
    assert!(said.contains("post.vignette") && said.ends_with("dark.png\n"), "{said}");
    assert!(colours(&folder.path().join("dark.png"), (320, 180)) > 1000);
}

#[test]
fn headless_turntable_writes_every_frame() {
    let folder = tempfile::tempdir().unwrap();
    let Some(output) = example("headless_turntable", folder.path(), &["builtin:cornell", "f_%04d.png", "3"]) else {
        return;
    };
    assert_eq!(printed(&output), "");
    for file in ["f_0000.png", "f_0001.png", "f_0002.png"] {
        assert!(colours(&folder.path().join(file), (640, 360)) > 1000, "{file} shows little");
    }
}

#[test]
fn swap_at_runtime_prints_a_time_per_implementation() {
    let folder = tempfile::tempdir().unwrap();
    let Some(output) = example("swap_at_runtime", folder.path(), &["ao"]) else { return };
    let said = printed(&output);
    let lines: Vec<Vec<&str>> = said.lines().map(|line| line.split_whitespace().collect()).collect();
    let timed = |line: &[&str]| line.last() == Some(&"ms") && line[line.len() - 2].parse::<f64>().is_ok();
    assert_eq!(lines.len(), 6, "{said}");
    for (line, name) in lines.iter().zip(["ray-traced", "screen-space", "off"]) {
        assert!(line[..2] == ["ao", name] && timed(line), "{said}");
    }
    assert!(timed(&lines[3]) && timed(&lines[5]), "{said}");
    assert!(said.contains("did you mean \"screen-space\""), "{said}");
}
