//! What a new effect adds to files that stand already.
//!
//! Nothing is parsed: each insertion names an *anchor*, a piece of text that stands in its file exactly once, and goes directly
//! before it. Every slot is built in beside `post`, the last one of the frame, so that anchors are lines of `post`.
//! Indentation, the order of lists and line breaks are left to rustfmt.

use super::name::Name;
use anyhow::{Result, bail};

/// One insertion.
#[derive(Clone, Copy, Debug)]
pub struct Insertion {
    /// The file, from the root.
    pub file: &'static str,
    /// Text that stands in the file once.
    pub anchor: &'static str,
    /// What goes in, with `new_pass` for the name.
    pub text: &'static str,
}

const fn insert(file: &'static str, anchor: &'static str, text: &'static str) -> Insertion {
    Insertion { file, anchor, text }
}

/// Every insertion.
pub const WIRING: &[Insertion] = &[
    insert("passes/src/contracts/mod.rs", "/// Slot `post`.", include_str!("../../templates/contracts.rs")),
    insert(
        "passes/src/slots.rs",
        "/// From radiance to a display.",
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
