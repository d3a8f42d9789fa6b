//! Output files: checked before the work begins, and written whole or not at all.
//!
//! Existing paths are treated as by `>` in a shell: links are followed and kept, permissions are kept, a file that is write-protected is
//! refused, and anything that is not a regular file (a pipe, a device, `/dev/stdout`) is written to directly.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, Seek, Write},
    path::{Path, PathBuf},
};

use magpie::files;
use tempfile::{Builder, NamedTempFile};

use crate::exit::Failure;

/// A checked path that will be written.
#[derive(Debug)]
pub(crate) struct Output {
    argument: &'static str,
    /// As given on the command line.
    path: PathBuf,
    target: Target,
    ending: String,
}

/// Where the bytes go.
#[derive(Debug)]
enum Target {
    /// A regular file that exists or will be created, all links followed.
    File(PathBuf),
    /// Not a regular file: a pipe, a device.
    Stream,
    /// This process's own standard output.
    Stdout,
    /// This process's own standard error.
    Stderr,
}

/// Symbolic links followed in a row, as in Linux; more are an error.
const MAX_LINKS: usize = 40;

impl Target {
    fn of(path: &Path) -> Result<Self, String> {
        // Opening a redirected file again by name would overwrite it from its beginning.
        for (number, name, own) in [(1, "stdout", Self::Stdout), (2, "stderr", Self::Stderr)] {
            let names = [format!("/dev/{name}"), format!("/dev/fd/{number}"), format!("/proc/self/fd/{number}")];
            if names.iter().any(|n| path == Path::new(n)) {
                return Ok(own);
            }
        }
        // For a dangling link, its target is created.
        let mut place = path.to_owned();
        let mut links = 0;
        while fs::symlink_metadata(&place).is_ok_and(|m| m.is_symlink()) {
            links += 1;
            if links > MAX_LINKS {
                return Err("too many links in a row".to_owned());
            }
            let next = fs::read_link(&place).map_err(|e| e.to_string())?;
            place = place.parent().unwrap_or(Path::new("")).join(next);
        }
        let Ok(meta) = fs::metadata(path) else { return Ok(Self::File(place)) };
        if meta.is_dir() {
            return Err("wanted a file, this is a folder".to_owned());
        }
        match files::what(meta.file_type()) {
            None if meta.permissions().readonly() => Err("the file is protected against writing".to_owned()),
            None => match OpenOptions::new().write(true).open(path) {
                Ok(_) => Ok(Self::File(place)),
                Err(error) => Err(format!("the file cannot be written: {error}")),
            },
            Some("a socket") => Err("wanted a file, this is a socket".to_owned()),
            Some(_) => Ok(Self::Stream),
        }
    }
}

impl Output {
    /// Checks that `path` has one of `endings` and that a file can be written there. An existing path that is not a regular file, such as
    /// `/dev/null`, needs no ending and counts as the first of `endings`.
    pub(crate) fn plan(argument: &'static str, path: &Path, endings: &[&str]) -> Result<Self, Failure> {
        let refuse = |fault: String| Failure::bad(format!("{argument} {}: {fault}", path.display()));
        let target = Target::of(path);
        let mut ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if !endings.contains(&ending.as_str()) {
            match (&target, endings.first()) {
                (Ok(Target::Stream | Target::Stdout | Target::Stderr), Some(first)) => ending = (*first).to_owned(),
                _ => {
                    let known: Vec<_> = endings.iter().map(|e| format!(".{e}")).collect();
                    return Err(refuse(format!("wanted a file that ends in {}", known.join(" or "))));
                }
            }
        }
        let output = Self { argument, path: path.to_owned(), target: target.map_err(refuse)?, ending };
        if let Target::File(place) = &output.target {
            let folder = folder_of(place);
            if !folder.is_dir() {
                return Err(refuse(format!("the folder {} does not exist", folder.display())));
            }
            // The only sure way to know whether a file can be created is to create one; it is removed on drop.
            temporary(place).map_err(|e| refuse(format!("the folder {} cannot be written: {e}", folder.display())))?;
        }
        Ok(output)
    }

    /// The regular file that is written, links followed, for outputs that are read again later.
    pub(crate) fn file(&self) -> Result<&Path, Failure> {
        match &self.target {
            Target::File(place) => Ok(place),
            _ => Err(Failure::bad(format!("{} {}: wanted a regular file", self.argument, self.path.display()))),
        }
    }

    /// File name extension in lower case, without the dot.
    pub(crate) fn ending(&self) -> &str {
        &self.ending
    }

    /// Writes the file. If anything fails, a file that stood there before is unchanged.
    pub(crate) fn write<E>(&self, write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), E>) -> Result<(), Failure>
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        let name = || format!("{} {}", self.argument, self.path.display());
        let failed = |error: io::Error| Failure::running(error).context(name());
        let fill = |file: &mut File| {
            let mut buffer = BufWriter::new(file);
            write(&mut buffer).map_err(|error| Failure::running(error).context(name()))?;
            buffer.flush().map_err(failed)
        };
        match &self.target {
            Target::File(place) => {
                let mut part = temporary(place).map_err(failed)?;
                fill(part.as_file_mut())?;
                keep_owner(place, part.path()).map_err(failed)?;
                part.persist(place).map_err(|error| failed(error.error))?;
            }
            // Some formats seek while writing, so the file is written to a temporary one and copied.
            Target::Stream | Target::Stdout | Target::Stderr => {
                let mut whole = tempfile::tempfile().map_err(failed)?;
                fill(&mut whole)?;
                whole.rewind().map_err(failed)?;
                self.pour(&mut whole).map_err(failed)?;
            }
        }
        log::info!("wrote {}", self.path.display());
        Ok(())
    }

    fn pour(&self, whole: &mut File) -> io::Result<()> {
        match &self.target {
            Target::Stdout => io::copy(whole, &mut io::stdout().lock()).and_then(|_| io::stdout().flush()),
            Target::Stderr => io::copy(whole, &mut io::stderr().lock()).map(|_| ()),
            _ => io::copy(whole, &mut OpenOptions::new().write(true).open(&self.path)?).map(|_| ()),
        }
    }

    /// [`Self::write`] for text.
    pub(crate) fn write_text(&self, text: &str) -> Result<(), Failure> {
        self.write(|file| file.write_all(text.as_bytes()))
    }
}

/// A file for each frame: the one place for its number in the name, `%d` or, with zeros in front up to a width, `%04d`, is filled in.
pub(crate) struct Numbered {
    argument: &'static str,
    folder: PathBuf,
    before: String,
    /// Least number of digits.
    digits: usize,
    after: String,
    endings: &'static [&'static str],
}

impl Numbered {
    /// `None` if the name has no place for a number. The files of the first and of the last frame are checked as by [`Output::plan`].
    pub(crate) fn plan(
        argument: &'static str,
        path: &Path,
        endings: &'static [&'static str],
        frames: u32,
    ) -> Result<Option<Self>, Failure> {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let Some((before, rest)) = name.split_once('%') else { return Ok(None) };
        let (digits, after) = rest.split_once('d').unwrap_or(("?", ""));
        let digits = if digits.is_empty() { Some(1) } else { digits.strip_prefix('0').and_then(|d| d.parse().ok()) };
        let Some(digits) = digits.filter(|d| (1..=9).contains(d) && !after.contains('%')) else {
            let fault = "wanted one %d or %04d where the number of the frame belongs";
            return Err(Failure::bad(format!("{argument} {}: {fault}", path.display())));
        };
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let numbered = Self { argument, folder, before: before.to_owned(), digits, after: after.to_owned(), endings };
        for frame in [0, frames.saturating_sub(1)] {
            numbered.frame(frame)?;
        }
        Ok(Some(numbered))
    }

    /// Refuses names of which one is a file that is read.
    pub(crate) fn keep_from(&self, inputs: &[(&str, &Path)]) -> Result<(), Failure> {
        let folder = |path: &Path| folder_of(path).canonicalize().ok();
        let own = folder(&self.folder.join("any"));
        for (what, path) in inputs {
            let Ok(path) = path.canonicalize() else { continue };
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            let number = name.strip_prefix(&self.before).and_then(|rest| rest.strip_suffix(&self.after));
            let is_frame = number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
            if is_frame && folder(&path) == own {
                let Self { argument, before, after, .. } = self;
                return Err(Failure::Usage(format!("{argument} {before}%d{after}: would overwrite the {what}")));
            }
        }
        Ok(())
    }

    /// The file of a frame, counted from 0.
    pub(crate) fn frame(&self, frame: u32) -> Result<Output, Failure> {
        let Self { argument, folder, before, digits, after, endings } = self;
        Output::plan(argument, &folder.join(format!("{before}{frame:0digits$}{after}")), endings)
    }
}

fn folder_of(place: &Path) -> &Path {
    match place.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// A new file beside the final place: a rename inside one folder is atomic.
fn temporary(place: &Path) -> io::Result<NamedTempFile> {
    let mut builder = Builder::new();
    builder.prefix(".magpie-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The permissions of any new file, before the umask.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder_of(place))
}

/// Gives a new file the permissions of the one whose place it takes, and its owner as far as the system allows.
pub(crate) fn keep_owner(old: &Path, new: &Path) -> io::Result<()> {
    let Ok(meta) = fs::metadata(old) else { return Ok(()) };
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, chown};
        let now = fs::metadata(new)?;
        if (now.uid(), now.gid()) != (meta.uid(), meta.gid()) {
            // Only the superuser can give files away; otherwise the new file belongs to this user.
            let _ = chown(new, Some(meta.uid()), Some(meta.gid()));
        }
    }
    fs::set_permissions(new, meta.permissions())
}

/// Refuses two outputs that are one file, and an output that is one of the files that are read.
pub(crate) fn keep_apart(outputs: &[&Output], inputs: &[(&str, &Path)]) -> Result<(), Failure> {
    // A file that does not exist yet has no canonical path, but its folder does. Pipes and devices can take several.
    let place = |output: &Output| {
        let Target::File(place) = &output.target else { return None };
        place.canonicalize().ok().or_else(|| Some(folder_of(place).canonicalize().ok()?.join(place.file_name()?)))
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
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
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
                Err(io::Error::other("disk full"))
            })
            .unwrap_err();
        assert_eq!(failure.status(), 1);
        assert!(failure.message().contains("a.txt: disk full"), "{}", failure.message());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn planning_leaves_nothing_behind_and_refuses_what_cannot_be() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("folder.png")).unwrap();
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
    fn names_of_frames_have_one_place_for_a_number() {
        let folder = tempfile::tempdir().unwrap();
        let plan = |name: &str| Numbered::plan("--out", &folder.path().join(name), &["png"], 12);
        let name = |pattern: &str, frame| {
            let output = plan(pattern).unwrap().unwrap().frame(frame).unwrap();
            output.path.file_name().unwrap().to_string_lossy().into_owned()
        };
        assert!(plan("a.png").unwrap().is_none());
        assert_eq!(name("a_%d.png", 7), "a_7.png");
        assert_eq!(name("%04d.png", 12), "0012.png");
        assert_eq!(name("a%02d.png", 1234), "a1234.png");
        for wrong in ["a%.png", "a%d%d.png", "a%4d.png", "a%0d.png", "a%00d.png", "a%xd.png", "a%d%.png", "100 %.png"] {
            let failure = plan(wrong).err().unwrap();
            assert!(failure.message().contains("%04d") && failure.status() == 2, "{wrong}: {}", failure.message());
        }
        assert!(plan("a%d.jpg").err().unwrap().message().contains("ends in .png"));
        fs::write(folder.path().join("a7.png"), "").unwrap();
        let (numbered, input) = (plan("a%02d.png").unwrap().unwrap(), folder.path().join("a7.png"));
        assert!(numbered.keep_from(&[("map", &input)]).unwrap_err().message().contains("overwrite the map"));
        numbered.keep_from(&[("map", &folder.path().join("b7.png"))]).unwrap();
        assert!(plan("none/a%d.png").err().unwrap().message().contains("does not exist"));
    }

    #[test]
    fn files_are_kept_apart() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let plan = |argument, name: &str| Output::plan(argument, &at(name), &["json"]).unwrap();
        fs::create_dir(at("sub")).unwrap();
        fs::write(at("in.json"), "{}").unwrap();
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
        fs::write(&plain, "x").unwrap();
        Output::plan("--out", &ours, &["txt"]).unwrap().write_text("x").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_their_targets_are_written() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("sub")).unwrap();
        fs::write(at("sub/old.txt"), "old").unwrap();
        symlink("sub/old.txt", at("near.txt")).unwrap();
        symlink(at("near.txt"), at("far.txt")).unwrap();
        symlink("sub/new.txt", at("dangling.txt")).unwrap();
        symlink("round.txt", at("round.txt")).unwrap();
        symlink("nowhere/new.txt", at("lost.txt")).unwrap();
        for (link, target) in [("far.txt", "sub/old.txt"), ("dangling.txt", "sub/new.txt")] {
            let output = Output::plan("--out", &at(link), &["txt"]).unwrap();
            assert_eq!(output.file().unwrap().canonicalize().ok(), at(target).canonicalize().ok());
            output.write_text(link).unwrap();
            assert!(fs::symlink_metadata(at(link)).unwrap().is_symlink(), "{link}");
            assert_eq!(fs::read_to_string(at(target)).unwrap(), link);
        }
        let refused = |name: &str| Output::plan("--out", &at(name), &["txt"]).unwrap_err().message();
        assert!(refused("round.txt").contains("too many links"));
        assert!(refused("lost.txt").contains("nowhere does not exist"), "{}", refused("lost.txt"));
        assert_eq!(names(&at("sub")), ["new.txt", "old.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn protected_files_are_refused_and_permissions_stay() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").unwrap();
        let set = |mode| fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        set(0o444);
        let failure = Output::plan("--out", &path, &["txt"]).unwrap_err();
        assert_eq!(failure.status(), 2);
        assert!(failure.message().ends_with("a.txt: the file is protected against writing"), "{}", failure.message());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        set(0o640);
        Output::plan("--out", &path, &["txt"]).unwrap().write_text("new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o640);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_needs_no_ending_and_stays_what_it_is() {
        let null = Output::plan("--out", Path::new("/dev/null"), &["png", "exr"]).unwrap();
        assert_eq!(null.ending(), "png");
        null.write_text("x").unwrap();
        assert!(files::what(fs::metadata("/dev/null").unwrap().file_type()) == Some("a device"));
        assert_eq!(null.file().unwrap_err().status(), 2);
        keep_apart(&[&null, &Output::plan("--trace", Path::new("/dev/null"), &["json"]).unwrap()], &[]).unwrap();
        assert!(matches!(Target::of(Path::new("/dev/stdout")), Ok(Target::Stdout)));
    }
}
