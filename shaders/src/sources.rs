//! The GLSL of this crate in a folder, where it is edited while a program runs.
use crate::{ALL, CompileError, Includes, Shader, compile_with};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A folder with `lib/` and the folders of the effects.
#[derive(Clone, Debug)]
pub struct Sources {
    folder: PathBuf,
}

impl Sources {
    /// The folder, if it has the file that every shader includes.
    #[must_use]
    pub fn open(folder: &Path) -> Option<Self> {
        folder.join("lib/bindless.glsl").is_file().then(|| Self { folder: folder.to_owned() })
    }

    /// Where it is.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The shaders that have one of these files in them, as the folder is now. Files are named as in `#include`: `gi/gather.comp`,
    /// `lib/brdf.glsl`.
    #[must_use]
    pub fn affected(&self, files: &BTreeSet<String>) -> Vec<&'static Shader> {
        let mut known = BTreeMap::new();
        ALL.iter().copied().filter(|shader| self.has(shader.name, files, &mut known)).collect()
    }

    /// Whether a file is one of these or includes one, through others too.
    fn has(&self, name: &str, files: &BTreeSet<String>, known: &mut BTreeMap<String, bool>) -> bool {
        if files.contains(name) {
            return true;
        }
        if let Some(has) = known.get(name) {
            return *has;
        }
        // A file that includes itself ends here.
        known.insert(name.to_owned(), false);
        let text = fs::read_to_string(self.folder.join(name)).unwrap_or_default();
        let included = text.lines().filter_map(|line| {
            line.trim_start()
                .strip_prefix('#')?
                .trim_start()
                .strip_prefix("include")?
                .trim()
                .strip_prefix('"')?
                .split('"')
                .next()
        });
        let has = included.into_iter().any(|name| self.has(name, files, known));
        known.insert(name.to_owned(), has);
        has
    }

    /// Compiles a shader from its file. The shared structs are those that were built with the program.
    ///
    /// # Errors
    /// [`CompileError`] with file, line and message.
    pub fn compile(&self, shader: &Shader) -> Result<Vec<u32>, CompileError> {
        let unreadable =
            |e: std::io::Error| CompileError::Unreadable { name: shader.name.to_owned(), reason: e.to_string() };
        let source = fs::read_to_string(self.folder.join(shader.name)).map_err(unreadable)?;
        let defines: Vec<_> = shader.rays.iter().map(|rays| (rays.define(), None)).collect();
        compile_with(shader.name, &source, shader.stage, &defines, &mut self.clone())
    }
}

impl Includes for Sources {
    fn find(&mut self, name: &str) -> Option<String> {
        if name.starts_with("shared/") {
            return crate::Embedded.find(name);
        }
        fs::read_to_string(self.folder.join(name)).ok()
    }
}
