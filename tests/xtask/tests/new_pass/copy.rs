//! Copies of this workspace, and commands in them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Files by their path from the root.
pub type Files = BTreeMap<String, Vec<u8>>;

/// The root of this workspace.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap()
}

/// Every file below `root`, what git and cargo keep for themselves aside.
pub fn walked(root: &Path) -> Files {
    let mut files = Files::new();
    let mut open: Vec<PathBuf> = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if [".git", "target"].iter().any(|&own| path.file_name().is_some_and(|name| name == own)) {
                continue;
            }
            if path.is_dir() {
                open.push(path);
            } else {
                let parts: Vec<_> =
                    path.strip_prefix(root).unwrap().iter().map(|part| part.to_string_lossy()).collect();
                files.insert(parts.join("/"), fs::read(&path).unwrap());
            }
        }
    }
    files
}

/// Text of one file.
pub fn text<'a>(files: &'a Files, path: &str) -> &'a str {
    std::str::from_utf8(&files[path]).unwrap()
}

/// Makes `to` a copy of `from`. Files that are the same already keep their times.
pub fn mirror(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    let (wanted, mut there) = (walked(from), walked(to));
    for (path, bytes) in wanted {
        if there.remove(&path).as_ref() != Some(&bytes) {
            let path = to.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
    }
    for path in there.into_keys() {
        fs::remove_file(to.join(path)).unwrap();
    }
}

/// A copy of this workspace in a folder that goes away.
pub fn fresh() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    mirror(root(), folder.path());
    folder
}

/// Gives the crates of a copy a version of their own. Cargo tells the crates of two workspaces in one target folder apart by
/// name and version only: without this, those of the copy would pass for those of the workspace.
pub fn rename_version(folder: &Path) {
    let manifest = folder.join("Cargo.toml");
    let text = fs::read_to_string(&manifest).unwrap();
    let (before, rest) = text.split_once("[workspace.package]\nversion = \"").unwrap();
    let (version, rest) = rest.split_once('"').unwrap();
    fs::write(manifest, format!("{before}[workspace.package]\nversion = \"{version}-new-pass\"{rest}")).unwrap();
}

/// How a command ended.
pub struct Ended {
    /// Its exit status.
    pub status: Option<i32>,
    /// What it said.
    pub stdout: String,
    /// What it complained of.
    pub stderr: String,
}

fn end(mut command: Command) -> Ended {
    let output = command.stdin(Stdio::null()).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    Ended { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// `cargo xtask new-pass NAME` in a copy.
pub fn new_pass(folder: &Path, name: &str, env: &[(&str, &str)]) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.args(["new-pass", name]).env("CARGO_MANIFEST_DIR", folder.join("tests/xtask"));
    command.envs(env.iter().copied()).current_dir(folder);
    end(command)
}

/// A cargo command in a copy, with the target folder of this workspace: crates from elsewhere are built already. Fails when it
/// fails; gives what it said.
pub fn cargo(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    // What cargo told this program about itself is not true of the next cargo.
    for (name, _) in std::env::vars_os() {
        let own = |prefix: &&str| name.to_str().is_some_and(|name| name.starts_with(prefix));
        if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_"].iter().any(own) {
            command.env_remove(&name);
        }
    }
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    command.args(arguments).env("CARGO_TARGET_DIR", target).current_dir(folder);
    let ended = end(command);
    assert_eq!(ended.status, Some(0), "cargo {}\n{}\n{}", arguments.join(" "), ended.stdout, ended.stderr);
    ended.stdout
}
