//! `cargo xtask new-pass NAME`: creates the files of an effect with a working example, and adds it to the frame.
//!
//! All changes are computed in memory first, and either all of them are written or none.

mod name;
mod wiring;

use crate::workplace::Workplace;
use anyhow::{Context, Result, bail};
use name::Name;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use wiring::WIRING;

pub use name::BadName;

/// The files of a new effect: path from the root and contents, both with `new_pass` as the name.
const TEMPLATES: [(&str, &str); 5] = [
    ("passes/src/new_pass/mod.rs", include_str!("../../templates/passes/src/new_pass/mod.rs")),
    ("shaders/new_pass/apply.comp", include_str!("../../templates/shaders/new_pass/apply.comp")),
    ("shaders/src/new_pass.rs", include_str!("../../templates/shaders/src/new_pass.rs")),
    ("docs/passes/new_pass.md", include_str!("../../templates/docs/passes/new_pass.md")),
    ("tests/tests/images_new_pass.rs", include_str!("../../templates/tests/tests/images_new_pass.rs")),
];

/// A file with its previous contents, if it existed, and its new ones.
struct Change {
    path: String,
    before: Option<String>,
    after: String,
}

/// Creates the effect and prints what to do next.
pub fn new_pass(name: &str) -> Result<()> {
    let place = Workplace::find()?;
    let (name, changes) = planned(&place.root, name)?;
    write(&place.root, &changes)?;
    let name = name.snake();
    println!("new-pass: {name}");
    for change in &changes {
        println!("  {:<8} {}", if change.before.is_some() { "changed" } else { "new" }, change.path);
    }
    println!("It is off unless it is asked for. To see it, and to test it:");
    println!("  cargo run --release -- render builtin:cornell --set stages.{name}=example --out {name}.png");
    println!("  cargo test --release -p magpie-tests --test images_{name}");
    println!("How to go on from the example: docs/how-to-add-a-pass.md");
    Ok(())
}

/// The name, and every new or changed file below `root`, new ones first. Writes nothing.
fn planned(root: &Path, name: &str) -> Result<(Name, Vec<Change>)> {
    let name = Name::parse(name, &read(root, "Cargo.toml")?)?;
    let mut changes: Vec<Change> = TEMPLATES
        .iter()
        .map(|(path, text)| Change { path: name.fill(path), before: None, after: name.fill(text) })
        .collect();
    let files: Vec<String> = changes.iter().map(|change| change.path.clone()).collect();
    name.is_free(root, &files, &read(root, "passes/src/contracts.rs")?)?;

    for insertions in WIRING.chunk_by(|a, b| a.file == b.file) {
        let path = insertions[0].file;
        let before = read(root, path)?;
        let mut after = before.clone();
        for insertion in insertions {
            after = insertion.apply(&after, &name)?;
        }
        changes.push(Change { path: path.to_owned(), before: Some(before), after });
    }
    for change in changes.iter_mut().filter(|change| change.path.ends_with(".rs")) {
        change.after = formatted(root, &change.path, &change.after)?;
    }
    Ok((name, changes))
}

fn read(root: &Path, path: &str) -> Result<String> {
    fs::read_to_string(root.join(path)).with_context(|| format!("reading {path}"))
}

/// Rust text after `cargo fmt`: line breaks and the order of lists depend on the length of the name.
fn formatted(root: &Path, path: &str, text: &str) -> Result<String> {
    let mut child = Command::new("rustfmt")
        .args(["--quiet", "--edition", "2024"])
        .current_dir(root)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .context("rustfmt could not be started; `rustup component add rustfmt` installs it")?;
    // rustfmt reads all of its input before it writes, so neither side blocks the other.
    if let Some(mut pipe) = child.stdin.take() {
        pipe.write_all(text.as_bytes()).with_context(|| format!("formatting {path}"))?;
    }
    let output = child.wait_with_output().with_context(|| format!("formatting {path}"))?;
    if !output.status.success() {
        bail!("rustfmt refused {path} as it would become");
    }
    String::from_utf8(output.stdout).with_context(|| format!("formatting {path}"))
}

/// Writes all changes, or restores the previous state.
fn write(root: &Path, changes: &[Change]) -> Result<()> {
    let mut undo = Undo::default();
    for change in changes {
        let path = root.join(&change.path);
        if let Err(error) = undo.write(&path, change) {
            undo.all();
            return Err(error.context(format!("writing {}; nothing was changed", change.path)));
        }
    }
    Ok(())
}

/// The changes written so far.
#[derive(Default)]
struct Undo<'a> {
    folders: Vec<PathBuf>,
    files: Vec<(PathBuf, Option<&'a str>)>,
}

impl<'a> Undo<'a> {
    fn write(&mut self, path: &Path, change: &'a Change) -> Result<()> {
        let missing: Vec<_> = path.ancestors().skip(1).take_while(|folder| !folder.exists()).collect();
        for folder in missing.into_iter().rev() {
            fs::create_dir(folder)?;
            self.folders.push(folder.to_owned());
        }
        if change.before.is_none() {
            // Fails if the file has appeared since the check.
            fs::File::create_new(path)?;
        }
        self.files.push((path.to_owned(), change.before.as_deref()));
        Ok(fs::write(path, &change.after)?)
    }

    /// Best effort: the error that is reported is the original one.
    fn all(self) {
        for (path, before) in self.files.into_iter().rev() {
            let _ = match before {
                Some(text) => fs::write(path, text),
                None => fs::remove_file(path),
            };
        }
        for folder in self.folders.into_iter().rev() {
            let _ = fs::remove_dir(folder);
        }
    }
}
