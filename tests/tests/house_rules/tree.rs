//! The files of the repository as text.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// All files that git does not ignore: path from the root, with `/`, and contents of text files.
#[derive(Default)]
pub struct Tree {
    paths: BTreeSet<String>,
    texts: BTreeMap<String, String>,
}

/// The root of the repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

impl Tree {
    /// The files of this repository, ignored ones aside.
    pub fn of_repository() -> Tree {
        let mut tree = Tree::default();
        for path in listed_by_git().unwrap_or_else(|| walked(root())) {
            let Ok(bytes) = std::fs::read(root().join(&path)) else { continue }; // deleted, but not yet committed
            tree.paths.insert(path.clone());
            if let Ok(text) = String::from_utf8(bytes) {
                tree.texts.insert(path, text);
            }
        }
        tree
    }

    /// A tree for a test.
    pub fn of(files: &[(&str, &str)]) -> Tree {
        let texts: BTreeMap<_, _> = files.iter().map(|&(path, text)| (path.to_owned(), text.to_owned())).collect();
        Tree { paths: texts.keys().cloned().collect(), texts }
    }

    /// Text of one file.
    pub fn text(&self, path: &str) -> Option<&str> {
        self.texts.get(path).map(String::as_str)
    }

    /// Every text file.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        self.texts.iter().map(|(path, text)| (path.as_str(), text.as_str()))
    }

    /// Every Rust file.
    pub fn rust(&self) -> impl Iterator<Item = (&str, &str)> {
        self.texts().filter(|(path, _)| path.ends_with(".rs"))
    }

    /// Every path, of text files and others.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.paths.iter().map(String::as_str)
    }

    /// Whether `path` is a file, or a folder that contains one.
    pub fn has(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        self.paths.contains(path) || self.has_folder(path)
    }

    /// Whether `path` is a folder that contains a file; true of the root.
    pub fn has_folder(&self, path: &str) -> bool {
        let inside = format!("{path}/");
        path.is_empty() || self.paths.range(inside.clone()..).next().is_some_and(|first| first.starts_with(&inside))
    }

    /// Names of the folders directly below `folder`.
    pub fn folders(&self, folder: &str) -> BTreeSet<&str> {
        let below = self.paths().filter_map(|path| path.strip_prefix(folder)?.strip_prefix('/'));
        below.filter_map(|rest| Some(rest.split_once('/')?.0)).collect()
    }
}

fn listed_by_git() -> Option<Vec<String>> {
    let arguments = ["ls-files", "-z", "--cached", "--others", "--exclude-standard"];
    let output = Command::new("git").args(arguments).current_dir(root()).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let paths: Vec<String> = text.split('\0').filter(|path| !path.is_empty()).map(str::to_owned).collect();
    (output.status.success() && !paths.is_empty()).then_some(paths)
}

/// The same without git, as in an unpacked archive.
fn walked(root: &Path) -> Vec<String> {
    let mut paths = Vec::new();
    let mut open: Vec<PathBuf> = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                if name != "target" && name != ".git" {
                    open.push(path);
                }
            } else {
                let parts: Vec<_> =
                    path.strip_prefix(root).unwrap().iter().map(|part| part.to_string_lossy()).collect();
                paths.push(parts.join("/"));
            }
        }
    }
    paths
}

#[test]
fn git_and_the_walk_see_the_same_sources() {
    let sources = |paths: Vec<String>| paths.into_iter().filter(|path| path.ends_with(".rs")).collect::<BTreeSet<_>>();
    if let Some(listed) = listed_by_git() {
        let there = listed.into_iter().filter(|path| root().join(path).is_file()).collect();
        assert_eq!(sources(there), sources(walked(root())));
    }
}

#[test]
fn folders_are_known_by_what_is_in_them() {
    let tree = Tree::of(&[("a/b/c.rs", ""), ("a/d.rs", ""), ("ab/e.rs", "")]);
    assert_eq!(tree.folders("a"), BTreeSet::from(["b"]));
    assert!(tree.has("a/b") && tree.has("a/b/") && tree.has("a/d.rs") && !tree.has("a/c") && !tree.has("b"));
}
