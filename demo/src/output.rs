//! Files that are written: checked before the work begins, and put in place whole or not at all.

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

use tempfile::{Builder, NamedTempFile};

use crate::exit::Failure;

/// A file that will be written.
#[derive(Debug)]
pub(crate) struct Output {
    argument: &'static str,
    path: PathBuf,
    ending: String,
}

impl Output {
    /// Checks that `path` has one of these endings and that a file can be written there.
    pub(crate) fn plan(argument: &'static str, path: &Path, endings: &[&str]) -> Result<Self, Failure> {
        let refuse = |fault: String| Failure::bad(format!("{argument} {}: {fault}", path.display()));
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if !endings.contains(&ending.as_str()) {
            let known: Vec<_> = endings.iter().map(|e| format!(".{e}")).collect();
            return Err(refuse(format!("wanted a file that ends in {}", known.join(" or "))));
        }
        if path.is_dir() {
            return Err(refuse("wanted a file, this is a folder".to_owned()));
        }
        let output = Self { argument, path: path.to_owned(), ending };
        let folder = output.folder();
        if !folder.is_dir() {
            return Err(refuse(format!("the folder {} does not exist", folder.display())));
        }
        // The only sure way to know whether a file can be made is to make one; dropped, it is gone.
        output.temporary().map_err(|e| refuse(format!("the folder {} cannot be written: {e}", folder.display())))?;
        Ok(output)
    }

    fn folder(&self) -> &Path {
        match self.path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        }
    }

    /// A new file beside the final place: a rename inside one folder is atomic.
    fn temporary(&self) -> std::io::Result<NamedTempFile> {
        let mut builder = Builder::new();
        builder.prefix(".magpie-").suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As any new file has it; the umask takes its part away.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        builder.tempfile_in(self.folder())
    }

    /// Ending in lower case, without the dot.
    pub(crate) fn ending(&self) -> &str {
        &self.ending
    }

    /// Writes the file; when anything fails, the file that may have stood there before still does.
    pub(crate) fn write<E>(&self, write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), E>) -> Result<(), Failure>
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        let name = || format!("{} {}", self.argument, self.path.display());
        let failed = |error: std::io::Error| Failure::running(error).context(name());
        let mut file = self.temporary().map_err(failed)?;
        let mut buffer = BufWriter::new(file.as_file_mut());
        write(&mut buffer).map_err(|error| Failure::running(error).context(name()))?;
        buffer.flush().map_err(failed)?;
        drop(buffer);
        file.persist(&self.path).map_err(|error| failed(error.error))?;
        log::info!("wrote {}", self.path.display());
        Ok(())
    }

    /// Writes text.
    pub(crate) fn write_text(&self, text: &str) -> Result<(), Failure> {
        self.write(|file| file.write_all(text.as_bytes()))
    }
}

/// Refuses two outputs that are one file, and an output that is one of the files that are read.
pub(crate) fn keep_apart(outputs: &[&Output], inputs: &[(&str, &Path)]) -> Result<(), Failure> {
    // A file that does not exist yet has no canonical path, but its folder does.
    let place = |output: &Output| {
        output
            .path
            .canonicalize()
            .ok()
            .or_else(|| Some(output.folder().canonicalize().ok()?.join(output.path.file_name()?)))
    };
    for (at, output) in outputs.iter().enumerate() {
        let here = place(output);
        let (argument, name) = (output.argument, output.path.display());
        if let Some(other) = outputs[..at].iter().find(|o| here.is_some() && place(o) == here) {
            return Err(Failure::Usage(format!("{argument} {name}: {} writes the same file", other.argument)));
        }
        if let Some((what, _)) = inputs.iter().find(|(_, p)| here.is_some() && p.canonicalize().ok() == here) {
            return Err(Failure::Usage(format!("{argument} {name}: would overwrite the {what}")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let output = Output::plan("--out", &path, &["txt"]).unwrap();
        output.write_text("old").unwrap();
        let failure = output
            .write(|file| {
                file.write_all(b"half of the n")?;
                file.flush()?;
                Err(std::io::Error::other("disk full"))
            })
            .unwrap_err();
        assert_eq!(failure.status(), 1);
        assert!(failure.message().contains("a.txt: disk full"), "{}", failure.message());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn planning_leaves_nothing_behind_and_refuses_what_cannot_be() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("folder.png")).unwrap();
        let refused = |name: &str| Output::plan("--out", &at(name), &["png", "exr"]).unwrap_err().message();
        assert!(refused("a.jpg").contains("ends in .png or .exr"));
        assert!(refused("png").contains("ends in"));
        assert!(refused(".png").contains("ends in"));
        assert!(refused("folder.png").contains("this is a folder"));
        assert!(refused("none/a.png").contains("does not exist"));
        assert_eq!(Output::plan("--out", &at("A.PNG"), &["png"]).unwrap().ending(), "png");
        assert_eq!(names(folder.path()), ["folder.png"]);
    }

    #[test]
    fn files_are_kept_apart() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let plan = |argument, name: &str| Output::plan(argument, &at(name), &["json"]).unwrap();
        std::fs::create_dir(at("sub")).unwrap();
        std::fs::write(at("in.json"), "{}").unwrap();
        let (a, b, c) =
            (plan("--timings", "t.json"), plan("--trace", "sub/../t.json"), plan("--dump-graph", "in.json"));
        let input = at("in.json");
        keep_apart(&[&a, &c], &[]).unwrap();
        assert!(keep_apart(&[&a, &b], &[]).unwrap_err().message().contains("--timings writes the same file"));
        assert!(keep_apart(&[&a, &c], &[("scene", &input)]).unwrap_err().message().contains("overwrite the scene"));
    }

    #[cfg(unix)]
    #[test]
    fn new_files_have_the_usual_permissions() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (plain, ours) = (folder.path().join("plain.txt"), folder.path().join("ours.txt"));
        std::fs::write(&plain, "x").unwrap();
        Output::plan("--out", &ours, &["txt"]).unwrap().write_text("x").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
