//! Rules about effects: independence of each other, and the files that each must have.

use super::code::code;
use super::tree::Tree;
use std::collections::BTreeSet;

/// Folders that are no effects: contracts, and parts that effects share.
const SHARED: [&str; 2] = ["contracts", PARTS];
const PARTS: &str = "parts";

/// Effects do not refer to each other: they are connected in `contracts`, and share `parts` and the files beside the folders.
pub fn imports(tree: &Tree) -> Vec<String> {
    let effects = tree.folders("passes/src");
    let mut faults = Vec::new();
    for (path, text) in tree.rust() {
        let Some((effect, file)) = path.strip_prefix("passes/src/").and_then(|rest| rest.split_once('/')) else {
            continue;
        };
        // Depth of this module in the crate: that many `super` lead to the root.
        let depth = 1 + file.split('/').count() - usize::from(file.ends_with("mod.rs"));
        let code = code(text);
        for (line, name) in names_from_root(&code, depth) {
            if name != effect && !SHARED.contains(&name.as_str()) && effects.contains(name.as_str()) {
                faults.push(format!("{path}:{line}: {effect} reaches into {name}; let them meet in contracts"));
            }
        }
    }
    faults
}

/// The first name of every path from the root of the crate, with its line.
fn names_from_root(code: &str, depth: usize) -> Vec<(usize, String)> {
    let mut names = Vec::new();
    let line_of = |at: usize| 1 + code[..at].matches('\n').count();
    let supers = "super::".repeat(depth);
    for root in ["crate::", "magpie_passes::", &supers] {
        for (at, _) in code.match_indices(root) {
            // In `super::super::x` the inner `super` does not begin a path of its own.
            let mut rest = code[at + root.len()..].trim_start();
            while let Some(deeper) = rest.strip_prefix("super::") {
                rest = deeper.trim_start();
            }
            names.extend(first_names(rest).into_iter().map(|name| (line_of(at), name)));
        }
    }
    names.sort();
    names.dedup();
    names
}

/// `a` of `a::b`; each first name of a group in braces.
fn first_names(path: &str) -> Vec<String> {
    let word =
        |text: &str| text.trim_start().chars().take_while(|&c| c.is_alphanumeric() || c == '_').collect::<String>();
    let Some(group) = path.strip_prefix('{') else { return vec![word(path)] };
    let mut names = vec![word(group)];
    let mut depth = 0;
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => names.push(word(&group[at + 1..])),
            _ => {}
        }
    }
    names
}

/// An effect has its code, shaders, documentation page and image test under the same name.
pub fn four_folders(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    let mut effects = tree.folders("passes/src");
    effects.retain(|name| !SHARED.contains(name));
    let tested = image_tests(tree);
    for effect in &effects {
        let mut wants = |there: bool, what: String| {
            if !there {
                faults.push(format!("passes/src/{effect} has no {what}"));
            }
        };
        wants(tree.has_folder(&format!("shaders/{effect}")), format!("shaders/{effect}"));
        wants(tree.has(&format!("docs/passes/{effect}.md")), format!("docs/passes/{effect}.md"));
        let named =
            |name: &&String| *name == effect || name.strip_prefix(effect).is_some_and(|rest| rest.starts_with('_'));
        wants(
            tested.iter().any(|name| named(&name)),
            format!("image test: a test `{effect}` or `{effect}_…` in tests/tests/images"),
        );
    }
    // `src` and `tests` are Rust, `lib` is shared by all, `check` belongs to the graph, `bench` to the benchmark, `ray` to every
    // ray-tracing pipeline, `lobe_albedo` to the scene on the device.
    let others = BTreeSet::from(["src", "tests", "lib", "check", "bench", "ray", "lobe_albedo"]);
    let parts = tree.folders("passes/src/parts");
    let is_known = |folder: &str| effects.contains(folder) || parts.contains(folder);
    for folder in tree.folders("shaders").difference(&others).filter(|folder| !is_known(folder)) {
        faults.push(format!("shaders/{folder} has no passes/src/{folder}"));
    }
    faults
}

/// A part that effects share has its code, shaders, documentation page and a test under the same name.
pub fn parts(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    for part in tree.folders("passes/src/parts") {
        let is_tested = tree.has(&format!("tests/tests/{part}.rs"))
            || tree.rust().any(|(path, text)| path.starts_with("tests/") && text.contains(&format!("{part}.")));
        let has_shaders = tree.has_folder(&format!("shaders/{part}")) || tree.has(&format!("shaders/lib/{part}.glsl"));
        for (there, what) in [
            (has_shaders, format!("shaders/{part} or shaders/lib/{part}.glsl")),
            (tree.has(&format!("docs/parts/{part}.md")), format!("docs/parts/{part}.md")),
            (is_tested, format!("test that names a pass `{part}.…` or a file `{part}.rs`")),
        ] {
            if !there {
                faults.push(format!("passes/src/parts/{part} has no {what}"));
            }
        }
    }
    faults
}

/// Names of the test functions in the files of the image tests.
fn image_tests(tree: &Tree) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let places = ["tests/tests/images", "tests/images"];
    for (_, text) in tree.rust().filter(|(path, _)| places.iter().any(|place| path.starts_with(place))) {
        let code = code(text);
        for test in code.split("#[test]").skip(1) {
            let name = test.split_whitespace().skip_while(|&word| word != "fn").nth(1).unwrap_or_default();
            names.insert(name.chars().take_while(|&c| c.is_alphanumeric() || c == '_').collect());
        }
    }
    names
}

#[test]
fn an_effect_that_reaches_into_another_is_found() {
    let files = |text: &'static str, path: &'static str| {
        imports(&Tree::of(&[("passes/src/gi/mod.rs", ""), ("passes/src/parts/mod.rs", ""), (path, text)]))
    };
    let fine = "use crate::{parts::{Svgf, gi}, stages::{A, B}, sky::own};\nuse super::stages;\nuse magpie::gi::X; // crate::gi";
    assert_eq!(files(fine, "passes/src/sky/mod.rs"), [""; 0]);
    assert_eq!(files("use super::gi;", "passes/src/sky/part.rs"), [""; 0]); // sky::gi
    assert_eq!(files("use crate::gi::X;", "passes/src/lib.rs"), [""; 0]);
    let broken = [
        ("use crate::gi::X;", "passes/src/sky/mod.rs"),
        ("use crate::{stages::{A, B}, gi::X};", "passes/src/sky/mod.rs"),
        ("use crate::{\n    gi,\n};", "passes/src/sky/part.rs"),
        ("fn f() { crate::gi::g() }", "passes/src/ao/part.rs"),
        ("use super::gi::X;", "passes/src/sky/mod.rs"),
        ("use super::super::gi::X;", "passes/src/sky/part.rs"),
        ("mod m { use super::super::super::gi::X; }", "passes/src/sky/part.rs"),
        ("use super::{stages::A, gi};", "passes/src/sky/mod.rs"),
    ];
    for (text, path) in broken {
        let faults = files(text, path);
        assert!(faults.len() == 1 && faults[0].contains("into gi"), "{text} in {path}: {faults:?}");
    }
}

#[test]
fn an_effect_that_lacks_a_folder_is_found() {
    let whole = [
        ("passes/src/sky/mod.rs", ""),
        ("shaders/sky/sky.comp", ""),
        ("docs/passes/sky.md", ""),
        ("tests/tests/images.rs", "#[test]\nfn sky_is_blue() {}"),
        ("shaders/src/sky.rs", ""),
        ("shaders/lib/rng.glsl", ""),
        ("shaders/check/nan.comp", ""),
        ("shaders/bench/buffer.comp", ""),
        ("shaders/ray/hit.rchit", ""),
    ];
    assert_eq!(four_folders(&Tree::of(&whole)), [""; 0]);
    for (missing, part) in
        [(0, "shaders/sky has no"), (1, "has no shaders/sky"), (2, "docs/passes/sky.md"), (3, "image test")]
    {
        let mut files = whole.to_vec();
        files.remove(missing);
        let faults = four_folders(&Tree::of(&files));
        assert!(faults.len() == 1 && faults[0].contains(part), "{part}: {faults:?}");
    }
    let mut files = whole.to_vec();
    files[3].1 = "fn sky() {}\n#[test]\nfn skyline() {} // #[test] fn sky() {}";
    assert_eq!(four_folders(&Tree::of(&files)).len(), 1);
}

#[test]
fn a_part_without_page_shaders_or_test_is_found() {
    let whole = [
        ("passes/src/parts/blur/mod.rs", ""),
        ("shaders/blur/blur.comp", ""),
        ("docs/parts/blur.md", ""),
        ("tests/tests/blurred.rs", "\"blur.horizontal\""),
    ];
    assert_eq!(parts(&Tree::of(&whole)), [""; 0]);
    for (left_out, part) in [(1, "shaders/blur"), (2, "docs/parts/blur.md"), (3, "test that names")] {
        let files: Vec<_> = whole.iter().enumerate().filter(|(at, _)| *at != left_out).map(|(_, file)| *file).collect();
        let faults = parts(&Tree::of(&files));
        assert!(faults.len() == 1 && faults[0].contains(part), "{faults:?}");
    }
}
