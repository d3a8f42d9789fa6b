//! Rules for all files.

use super::code::lines_with;
use super::tree::Tree;

/// Most lines of a source file.
const MAX_LINES: usize = 600;
/// Most lines of a shader with an entry point.
const MAX_ENTRY_LINES: usize = 250;
/// Extensions of shaders with an entry point.
const ENTRIES: [&str; 10] = ["comp", "vert", "frag", "mesh", "task", "rgen", "rmiss", "rchit", "rahit", "rint"];

/// Source files are limited in length, except tables of data.
pub fn length(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in tree.texts() {
        let (stem, extension) = path.rsplit_once('.').unwrap_or((path, ""));
        let most = match extension {
            entry if ENTRIES.contains(&entry) => MAX_ENTRY_LINES,
            "rs" | "glsl" | "py" | "sh" => MAX_LINES,
            _ => continue,
        };
        let data = path.contains("/tables/") || stem.ends_with("_table") || stem.ends_with("/table_data");
        let lines = text.lines().count();
        if lines > most && !data {
            faults.push(format!("{path}: {lines} lines, at most {most}"));
        }
    }
    faults
}

/// Whether a file is hand-written by this project, for the next two rules.
fn written_here(path: &str) -> bool {
    path != "Cargo.lock" && !path.starts_with("LICENSE")
}

/// Occurrences of `words` in all text files.
fn places_of(tree: &Tree, words: &[String], begins: fn(&str) -> bool) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in tree.texts().filter(|(path, _)| written_here(path)) {
        for word in words {
            for line in lines_with(text, word) {
                let line_text = text.lines().nth(line - 1).unwrap_or_default();
                if line_text.match_indices(word.as_str()).any(|(at, _)| begins(&line_text[..at])) {
                    faults.push(format!("{path}:{line}: {word}"));
                }
            }
        }
    }
    faults
}

/// Joins the parts, which are split so that this file does not break its own rule.
fn joined(parts: &[(&str, &str)]) -> Vec<String> {
    parts.iter().map(|(a, b)| format!("{a}{b}")).collect()
}

/// No markers of unfinished work, and no disabled tests.
pub fn marks(tree: &Tree) -> Vec<String> {
    let words = joined(&[("TO", "DO"), ("FIX", "ME"), ("todo", "!("), ("unimplement", "ed!("), ("#[ig", "nore")]);
    places_of(tree, &words, |before| !before.ends_with(|c: char| c.is_alphanumeric()))
}

/// No absolute paths of a machine, and no hosts of package registries: the set-up takes both from its environment.
pub fn places(tree: &Tree) -> Vec<String> {
    let paths = joined(&[("/ro", "ot/"), ("/ho", "me/"), ("/wo", "rk/"), ("/Us", "ers/"), ("C:\\", "Users")]);
    let hosts = joined(&[
        ("crates", ".io"),
        ("deb.deb", "ian.org"),
        ("ftp.deb", "ian.org"),
        ("snapshot.deb", "ian.org"),
        ("security.deb", "ian.org"),
        ("archive.ubu", "ntu.com"),
        ("security.ubu", "ntu.com"),
        ("ports.ubu", "ntu.com"),
        ("pypi", ".org"),
        ("pythonhosted", ".org"),
        ("npmjs", ".org"),
        ("proxy.gol", "ang.org"),
        ("ghcr", ".io"),
        ("docker", ".io"),
    ]);
    // After another path component it is a path inside the repository.
    let absolute = |before: &str| !before.ends_with(|c: char| c.is_alphanumeric() || "._-}".contains(c));
    let mut faults = places_of(tree, &paths, absolute);
    faults.extend(places_of(tree, &hosts, |_| true));
    faults
}

fn one_fault(rule: fn(&Tree) -> Vec<String>, path: &str, text: &str) {
    let faults = rule(&Tree::of(&[(path, text)]));
    assert!(faults.len() == 1 && faults[0].starts_with(path), "wanted one fault in {path}, got {faults:?}");
}

#[test]
fn a_file_that_is_too_long_is_found() {
    let (most, entry) = ("\n".repeat(MAX_LINES), "\n".repeat(MAX_ENTRY_LINES));
    let more = "\n".repeat(MAX_LINES + 1);
    let fine = [
        ("a.rs", most.as_str()),
        ("b.comp", &entry),
        ("src/tables/c.rs", &more),
        ("src/noise_table.rs", &more),
        ("d.md", &more),
    ];
    assert_eq!(length(&Tree::of(&fine)), [""; 0]);
    for path in ["a.rs", "shaders/lib/a.glsl", "src/table.rs"] {
        one_fault(length, path, &more);
    }
    for extension in ENTRIES {
        one_fault(length, &format!("shaders/a/b.{extension}"), &"\n".repeat(MAX_ENTRY_LINES + 1));
    }
}

#[test]
fn a_mark_of_unfinished_work_is_found() {
    let words = joined(&[
        ("// TO", "DO: later"),
        ("FIX", "ME"),
        ("todo", "!()"),
        ("unimplement", "ed!()"),
        ("#[ig", "nore = \"slow\"]"),
    ]);
    for word in words {
        one_fault(marks, "engine/src/a.rs", &word);
        one_fault(marks, "docs/a.md", &word);
        assert_eq!(marks(&Tree::of(&[("Cargo.lock", &word)])), [""; 0]);
    }
    assert_eq!(marks(&Tree::of(&[("a.rs", &format!("let {}DO = 1;", "CUSTOM_TO".replace('_', "")))])), [""; 0]);
}

#[test]
fn a_path_of_a_machine_or_a_host_of_a_registry_is_found() {
    for (path, text) in
        [("a.rs", ["\"/ho", "me/me/a\""]), ("docs/a.md", ["see /ro", "ot/.cargo"]), ("a.toml", ["x = '/wo", "rk/a'"])]
    {
        one_fault(places, path, &text.concat());
    }
    for text in [["http://deb.deb", "ian.org/debian"], ["on crates", ".io"]] {
        one_fault(places, "README.md", &text.concat());
    }
    let inside = ["see frame/wo", "rk/a, ../wo", "rk/b, http://mirror.example/debian"].concat();
    assert_eq!(places(&Tree::of(&[("a.md", &inside)])), [""; 0]);
}
