//! Names of effects: which ones are valid, and their spellings in a template.

use std::fmt;
use std::path::Path;

/// An invalid name with the reason; counts as wrong usage.
#[derive(Debug)]
pub struct BadName(String);

impl fmt::Display for BadName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadName {}

/// Rust's keywords, including reserved ones.
const KEYWORDS: &str = "abstract as async await become box break const continue crate do dyn else enum extern false final fn \
    for gen if impl in let loop macro match mod move mut override priv pub ref return self static struct super trait true \
    try type typeof unsafe unsized use virtual where while yield";
/// Types and crates that a module of that name would shadow.
const HIDDEN: &str = "bool char str u8 u16 u32 u64 u128 usize i8 i16 i32 i64 i128 isize f32 f64 std core alloc magpie magpie_passes \
    magpie_shaders";
/// Names of files and folders with a special meaning to cargo, the shader build or Windows.
const TAKEN: &str = "main bin target aux con nul prn";
/// Most characters of a name.
const MAX_LETTERS: usize = 40;

/// The name of an effect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name(String);

impl Name {
    /// Parses `text` (kebab or snake case); `manifest`, the workspace's, names the crates that it must not shadow.
    pub fn parse(text: &str, manifest: &str) -> Result<Name, BadName> {
        let bad = |why: &str| Err(BadName(format!("the name \"{text}\" {why}")));
        let name = text.replace('-', "_");
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if let Some(odd) = name.chars().find(|&c| !plain(c)) {
            return bad(&format!("has {odd:?} in it; wanted are lower-case letters, digits, _ and - only"));
        }
        if !name.starts_with(|c: char| c.is_ascii_lowercase()) {
            return bad("does not begin with a lower-case letter");
        }
        if name.ends_with('_') || name.contains("__") {
            return bad("has a _ or - that no letter or digit follows"); // GLSL reserves names with __
        }
        if name.len() > MAX_LETTERS {
            return bad(&format!("has {} characters, at most {MAX_LETTERS} are allowed", name.len()));
        }
        let among = |words: &str| words.split_whitespace().any(|word| word == name);
        if among(KEYWORDS) {
            return bad("is a keyword of Rust");
        }
        if among(HIDDEN) || dependencies(manifest).any(|dependency| dependency.replace('-', "_") == name) {
            return bad("would hide the type or crate of that name");
        }
        if among(TAKEN) {
            return bad("means something else to cargo, the build of the shaders or Windows");
        }
        Ok(Name(name))
    }

    /// Checks that the repository has no effect or file of this name, and no slot with types of this name.
    pub fn is_free(&self, root: &Path, files: &[String], stages: &str) -> Result<(), BadName> {
        let name = &self.0;
        if root.join("passes/src").join(name).exists() {
            return Err(BadName(format!("there is an effect \"{name}\" already: passes/src/{name}")));
        }
        let module = format!("passes/src/{name}.rs");
        let folder = format!("shaders/{name}");
        if let Some(file) = files.iter().chain([&module, &folder]).find(|file| root.join(file).exists()) {
            return Err(BadName(format!("the name \"{name}\" is taken: {file} is there already")));
        }
        let camel = self.camel();
        let types = [format!("{camel}In"), format!("{camel}Out")];
        let defined = |name: &&String| stages.contains(&format!("struct {name} "));
        match types.iter().find(defined) {
            Some(taken) => Err(BadName(format!("the name \"{name}\" is taken: passes/src/contracts.rs has a {taken}"))),
            None => Ok(()),
        }
    }

    /// `depth_of_field`.
    pub fn snake(&self) -> &str {
        &self.0
    }

    /// `DepthOfField`.
    fn camel(&self) -> String {
        let word = |word: &str| word[..1].to_uppercase() + &word[1..];
        self.0.split('_').map(word).collect()
    }

    /// A template, or the path of one, with this name filled in.
    pub fn fill(&self, template: &str) -> String {
        let upper = self.0.to_uppercase();
        template.replace("new_pass", &self.0).replace("NewPass", &self.camel()).replace("NEW_PASS", &upper)
    }
}

/// Names in the dependency table of the workspace's manifest.
fn dependencies(manifest: &str) -> impl Iterator<Item = &str> {
    let table = manifest.lines().skip_while(|line| *line != "[workspace.dependencies]").skip(1);
    let keys = table.take_while(|line| !line.starts_with('[')).filter_map(|line| line.split_once('='));
    keys.map(|(key, _)| key.trim())
}
