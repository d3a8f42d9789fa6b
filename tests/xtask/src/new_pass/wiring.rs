//! Insertions into existing files that a new effect needs.
//!
//! Nothing is parsed: each insertion names an *anchor*, a text that occurs in its file exactly once, and is placed directly before it. New
//! slots are placed next to `post`, the last one of the frame, so the anchors are lines of `post`. Indentation and line breaks are left to
//! rustfmt.

use super::name::Name;
use anyhow::{Result, bail};

/// One insertion.
#[derive(Clone, Copy, Debug)]
pub struct Insertion {
    /// Path of the file from the root.
    pub file: &'static str,
    /// Text that occurs in the file exactly once.
    pub anchor: &'static str,
    /// The text to insert, with `new_pass` as the name.
    pub text: &'static str,
}

const fn insert(file: &'static str, anchor: &'static str, text: &'static str) -> Insertion {
    Insertion { file, anchor, text }
}

/// All insertions.
pub const WIRING: &[Insertion] = &[
    insert("passes/src/contracts.rs", "/// Input of the slot `post`.", include_str!("../../templates/contracts.rs")),
    insert(
        "passes/src/slots.rs",
        "/// Anti-aliasing, exposure and tone curve: from radiance to display values.",
        "/// What a lens does.\nnew_pass: NewPassIn => NewPassOut,\n",
    ),
    insert("passes/src/lib.rs", "mod post;", "mod new_pass;\n"),
    insert(
        "passes/src/frame.rs",
        "let post = slots.post.give(",
        "let radiance = slots.new_pass.give(g, view, NewPassIn { colour: radiance }).colour;\n",
    ),
];

impl Insertion {
    /// `content` of the file with the text for `name` in its place.
    pub fn apply(&self, content: &str, name: &Name) -> Result<String> {
        let places: Vec<usize> = content.match_indices(self.anchor).map(|(at, _)| at).collect();
        let [at] = places[..] else {
            bail!(
                "{}: wanted `{}` once, to insert something there, found it {} times; the places are listed in {}",
                self.file,
                self.anchor,
                places.len(),
                file!(),
            );
        };
        Ok([&content[..at], &name.fill(self.text), &content[at..]].concat())
    }
}
