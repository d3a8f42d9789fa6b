//! Insertions into existing files that a new effect needs.
//!
//! Nothing is parsed: each insertion names an *anchor*, a text that occurs in its file exactly once, and is placed directly before or after
//! it. New slots are placed next to `post`, the last one of the frame, so most anchors are lines of `post`. Indentation, the order of lists
//! and line breaks are left to rustfmt.

use super::name::Name;
use anyhow::{Result, bail};

/// Where an insertion goes, relative to its anchor.
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// Directly before the anchor.
    Before,
    /// Directly after the anchor.
    Behind,
}
use Place::{Before, Behind};

/// One insertion.
#[derive(Clone, Copy, Debug)]
pub struct Insertion {
    /// Path of the file from the root.
    pub file: &'static str,
    /// Before or after the anchor.
    pub place: Place,
    /// Text that occurs in the file exactly once.
    pub anchor: &'static str,
    /// The text to insert, with `new_pass` as the name.
    pub text: &'static str,
}

const fn insert(file: &'static str, place: Place, anchor: &'static str, text: &'static str) -> Insertion {
    Insertion { file, place, anchor, text }
}

const TYPES: &str = "NewPassIn, NewPassOut, ";
const STAGES: &str = "passes/src/stages.rs";
const SLOTS: &str = "passes/src/slots.rs";
const FRAME: &str = "passes/src/frame.rs";

/// All insertions, those of one file together.
pub const WIRING: &[Insertion] = &[
    insert("shaders/src/lib.rs", Before, "pub mod post;", "pub mod new_pass;\n"),
    insert("passes/src/lib.rs", Before, "mod post;", "mod new_pass;\n"),
    insert(STAGES, Before, "/// Slot `post`.", include_str!("../../templates/stages.rs")),
    insert(SLOTS, Behind, "use crate::stages::{", TYPES),
    insert(SLOTS, Behind, "use crate::{", "new_pass, "),
    insert(
        SLOTS,
        Before,
        "/// From radiance to a display.",
        "/// What a lens does.\npub new_pass: Stage<NewPassIn, NewPassOut>,\n",
    ),
    insert(SLOTS, Before, "post: post::stage(),", "new_pass: new_pass::stage(),\n"),
    insert(SLOTS, Before, "self.post.info(),", "self.new_pass.info(),\n"),
    insert(FRAME, Behind, "use crate::stages::{", TYPES),
    insert(FRAME, Before, "post: Filled<PostIn, PostOut>,", "new_pass: Filled<NewPassIn, NewPassOut>,\n"),
    insert(
        FRAME,
        Before,
        "let post = stages.post.give(",
        "let radiance = stages.new_pass.add(g, view, NewPassIn { colour: radiance }).colour;\n",
    ),
    insert(FRAME, Before, "post: slots.post.from_config(", "new_pass: slots.new_pass.from_config(build, config)?,\n"),
    insert(FRAME, Before, "slots.post.change(", "slots.new_pass.change(&mut self.new_pass, build, config)?,\n"),
    insert(
        "tests/tests/images.rs",
        Before,
        "use anyhow::{Context, Result, ensure};",
        "#[path = \"images/new_pass.rs\"]\nmod new_pass;\n",
    ),
    insert("demo/configs/default.toml", Before, "post = \"standard\"", "new_pass = \"off\" # or \"example\"\n"),
    insert("README.md", Before, "[post](docs/passes/post.md)", "[new_pass](docs/passes/new_pass.md) · "),
];

impl Insertion {
    /// `content` of the file with the text for `name` inserted.
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
        let at = match self.place {
            Before => at,
            Behind => at + self.anchor.len(),
        };
        Ok([&content[..at], &name.fill(self.text), &content[at..]].concat())
    }
}
