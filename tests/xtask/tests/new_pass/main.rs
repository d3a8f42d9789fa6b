//! `cargo xtask new-pass` as its caller sees it, on copies of this workspace.
#![allow(clippy::unwrap_used)] // helpers of tests may fail as tests do

mod copy;

use copy::{Files, cargo, fresh, mirror, new_pass, rename_version, root, text, walked};
use std::fs;

const FRAME: &str = "passes/src/frame.rs";

/// What a new effect adds, without white space, which rustfmt places: four places beside its own files.
const WIRED: [(&str, &[&str]); 4] = [
    ("passes/src/lib.rs", &["modpaper_lantern;"]),
    ("passes/src/contracts.rs", &["pubstructPaperLanternIn{", "pubstructPaperLanternOut{"]),
    ("passes/src/slots.rs", &["paper_lantern:PaperLanternIn=>PaperLanternOut,"]),
    (FRAME, &["letradiance=slots.paper_lantern.give("]),
];

/// What comes to stand there.
const MADE: [&str; 5] = [
    "docs/passes/paper_lantern.md",
    "passes/src/paper_lantern/mod.rs",
    "shaders/paper_lantern/apply.comp",
    "shaders/src/paper_lantern.rs",
    "tests/tests/images_paper_lantern.rs",
];

fn without_space(text: &str) -> String {
    text.split_whitespace().collect()
}

/// Fails when the command did not end with `status`, or said something else, or changed a file.
fn refused(folder: &std::path::Path, name: &str, status: i32, parts: &[&str]) {
    let before = walked(folder);
    let ended = new_pass(folder, name, &[]);
    assert_eq!(ended.status, Some(status), "{name}: {}", ended.stderr);
    for part in parts {
        assert!(ended.stderr.contains(part), "{name}: no {part:?} in: {}", ended.stderr);
    }
    assert!(walked(folder) == before, "{name}: a file changed");
}

#[test]
fn the_files_of_the_four_folders_come_and_are_wired() {
    let copy = fresh();
    let before: Files = walked(copy.path());
    let ended = new_pass(copy.path(), "paper-lantern", &[]);
    assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    let after = walked(copy.path());
    let new: Vec<&str> = after.keys().filter(|path| !before.contains_key(*path)).map(String::as_str).collect();
    assert_eq!(new, MADE);
    let mut changed: Vec<&str> =
        before.iter().filter(|(path, bytes)| after[*path] != **bytes).map(|(path, _)| path.as_str()).collect();
    for (path, parts) in WIRED {
        let (text, old) = (without_space(text(&after, path)), without_space(text(&before, path)));
        for part in parts {
            assert!(text.contains(part) && !old.contains(part), "{path}: {part}");
        }
        let at = changed.iter().position(|changed| *changed == path);
        changed.remove(at.unwrap_or_else(|| panic!("{path} did not change")));
    }
    assert_eq!(changed, [""; 0], "nothing else changes");
    for path in MADE.iter().copied().chain(WIRED.map(|(path, _)| path)) {
        let text = text(&after, path);
        assert!(!["new_pass", "NewPass", "NEW_PASS"].iter().any(|place| text.contains(place)), "{path}");
        assert!(ended.stdout.contains(path), "{path} is not in: {}", ended.stdout);
    }
    for hint in ["--set stages.paper_lantern=example", "--test images_paper_lantern"] {
        assert!(ended.stdout.contains(hint), "{hint} is not in: {}", ended.stdout);
    }
    // The lens acts on the light, so it stands before the tone map.
    let frame = text(&after, FRAME);
    assert!(frame.find("slots.paper_lantern.give(") < frame.find("slots.post.give("), "{frame}");
    refused(copy.path(), "paper_lantern", 2, &["an effect \"paper_lantern\" already", "passes/src/paper_lantern"]);
}

#[test]
fn names_that_cannot_be_are_wrong_usage() {
    let copy = fresh();
    let long = "a".repeat(41);
    let cases: [(&str, &[&str]); 18] = [
        ("", &["does not begin with a lower-case letter"]),
        ("Bloom", &["\"Bloom\"", "'B'", "lower-case"]),
        ("blüte", &["'ü'"]),
        ("../bloom", &["'.'"]),
        ("2d-fog", &["does not begin with a lower-case letter"]),
        ("_bloom", &["does not begin with a lower-case letter"]),
        ("bloom-", &["no letter or digit follows"]),
        ("big__bloom", &["no letter or digit follows"]),
        (&long, &["41 characters", "at most 40"]),
        ("match", &["keyword"]),
        ("gen", &["keyword"]),
        ("f32", &["would hide"]),
        ("gpu-allocator", &["would hide"]),
        ("bin", &["means something else"]),
        ("post", &["an effect \"post\" already", "passes/src/post"]),
        ("renderer", &["is taken", "passes/src/renderer.rs"]),
        ("check", &["is taken", "shaders/src/check.rs"]),
        ("shadow", &["is taken", "passes/src/contracts.rs has a ShadowIn"]),
    ];
    for (name, parts) in cases {
        refused(copy.path(), name, 2, parts);
    }
}

#[test]
fn nothing_is_overwritten_or_left_half_done() {
    let copy = fresh();
    let at = |path: &str| copy.path().join(path);
    for (taken, file) in [
        ("shaders/paper_moon", "shaders/paper_moon/other.comp"),
        ("docs/passes/paper_moon.md", "docs/passes/paper_moon.md"),
    ] {
        fs::create_dir_all(at(file).parent().unwrap()).unwrap();
        fs::write(at(file), "mine").unwrap();
        refused(copy.path(), "paper-moon", 2, &["is taken", taken]);
        fs::remove_file(at(file)).unwrap();
    }
    fs::remove_dir(at("shaders/paper_moon")).unwrap();

    // A folder that cannot be made is met after other files have been written.
    fs::rename(at("tests/tests"), at("aside")).unwrap();
    fs::write(at("tests/tests"), "a file").unwrap();
    refused(copy.path(), "paper-rain", 1, &["tests/tests/images_paper_rain.rs", "nothing was changed"]);
    assert!(
        !at("passes/src/paper_rain").exists() && !at("shaders/paper_rain").exists(),
        "an empty folder stays behind"
    );
    fs::remove_file(at("tests/tests")).unwrap();
    fs::rename(at("aside"), at("tests/tests")).unwrap();

    let before = walked(copy.path());
    let ended = new_pass(copy.path(), "paper-rain", &[("PATH", "")]);
    assert_eq!(ended.status, Some(1));
    assert!(ended.stderr.contains("rustfmt") && ended.stderr.contains("component add"), "{}", ended.stderr);
    assert!(walked(copy.path()) == before, "a file changed");

    let frame = fs::read_to_string(at(FRAME)).unwrap();
    let anchor = "let post = slots.post.give(";
    for (text, times) in [(frame.replace(anchor, "let post = slots.last.add("), 0), (frame.clone() + "// " + anchor, 2)]
    {
        fs::write(at(FRAME), text).unwrap();
        refused(copy.path(), "paper-rain", 1, &[FRAME, anchor, &format!("{times} times"), "wiring.rs"]);
    }
    fs::write(at(FRAME), frame).unwrap();
    assert_eq!(new_pass(copy.path(), "paper-rain", &[]).status, Some(0), "with everything in its place it works");
}

/// The short and the long name wrap the same lines differently; two effects must fit beside each other.
#[test]
fn what_it_makes_builds_and_passes_every_check() {
    if std::env::var_os("MAGPIE_QUICK").is_some() {
        eprintln!("skipped: MAGPIE_QUICK is set");
        return;
    }
    let names = ["q", "the-longest-name-that-an-effect-can-have"];
    let copy = fresh();
    for name in names {
        let ended = new_pass(copy.path(), name, &[]);
        assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    }
    rename_version(copy.path());
    // In a place that stays, so that only what changed is built the next time.
    let built = root().join("target/new-pass");
    mirror(copy.path(), &built);

    cargo(&built, &["fmt", "--all", "--check"]);
    let packages = ["--offline", "-p", "magpie-shaders", "-p", "magpie-passes", "-p", "magpie-tests"];
    let with = |before: &[&'static str], after: &[&'static str]| {
        cargo(&built, &[before, if cfg!(debug_assertions) { &[] } else { &["--release"] }, &packages, after].concat())
    };
    with(&["clippy"], &["--all-targets", "--", "-D", "warnings"]);
    with(&["test"], &["--test", "house_rules", "--test", "layout"]);
    let tests = ["images_q", "images_the_longest_name_that_an_effect_can_have"];
    let said = with(&["test"], &["--test", tests[0], "--test", tests[1]]);
    assert_eq!(said.matches("2 passed").count(), 2, "{said}");
}
