//! A lock on a folder, so that one run at a time writes to it.

use std::{
    fs::{self, File, TryLockError},
    io::{self, Read, Write},
    path::{Path, PathBuf},
};

use crate::exit::Failure;

/// Name of the lock file, held locked while a run writes to the folder. The system releases it when the process ends.
const NAME: &str = "magpie.lock";

/// The lock on a folder, released on drop.
#[derive(Debug)]
pub(crate) struct Lock {
    place: PathBuf,
    /// Whether this run created the folder.
    made: bool,
    _file: File,
}

impl Lock {
    /// Locks the folder that `argument` names for a run of `what`, and creates it where there is none.
    ///
    /// # Errors
    /// [`Failure::Input`] if another run holds the lock (the message names it), or the folder cannot be written.
    pub(crate) fn take(argument: &str, folder: &Path, what: &str) -> Result<Self, Failure> {
        let name = || format!("{argument} {}", folder.display());
        let failed = |error: io::Error| Failure::input(error).context(name());
        let made = !folder.exists();
        fs::create_dir_all(folder).map_err(failed)?;
        let place = folder.join(NAME);
        let mut file = loop {
            let mut options = File::options();
            let file = options.create(true).truncate(false).read(true).write(true).open(&place).map_err(failed)?;
            match file.try_lock() {
                // The last holder may have removed the file between these two calls.
                Ok(()) if is_at(&file, &place) => break file,
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut holder = String::new();
                    let read = Read::take(&file, 1024).read_to_string(&mut holder);
                    let holder = if read.is_ok() && !holder.is_empty() { holder.as_str() } else { "another run" };
                    let advice = "wait for it, or choose another folder";
                    return Err(Failure::bad(format!("{}: {holder} is writing to this folder: {advice}", name())));
                }
                // A file system without locks: avoiding two runs at once is left to the user.
                Err(TryLockError::Error(error)) => {
                    log::warn!("{}: cannot be locked: {error}", name());
                    break file;
                }
            }
        };
        let holder = format!("`magpie {what}` (process {})", std::process::id());
        file.set_len(0).and_then(|()| file.write_all(holder.as_bytes())).map_err(failed)?;
        Ok(Self { place, made, _file: file })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Errors do not matter here. A folder that this run created is removed if it is still empty.
        let _ = fs::remove_file(&self.place);
        if let Some(folder) = self.place.parent().filter(|_| self.made) {
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Whether the path still names the open file.
fn is_at(file: &File, place: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let same = |a: fs::Metadata, b: fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
        file.metadata().is_ok_and(|own| fs::metadata(place).is_ok_and(|there| same(own, there)))
    }
    #[cfg(not(unix))]
    {
        let _ = (file, place);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_and_the_other_is_told_who() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("new/report");
        let first = Lock::take("--out", &place, "accuracy builtin:cornell").unwrap();
        let failure = Lock::take("--out", &place, "accuracy builtin:courtyard").unwrap_err();
        assert_eq!(failure.status(), 2);
        let holder = format!("`magpie accuracy builtin:cornell` (process {})", std::process::id());
        assert!(failure.message().contains(&holder), "{}", failure.message());
        drop(Lock::take("--out", folder.path(), "accuracy builtin:courtyard").unwrap());
        drop(first);
        assert!(folder.path().exists() && !place.exists(), "what was made for nothing is gone, and nothing else");
        let second = Lock::take("--out", &place, "accuracy merge").unwrap();
        assert!(fs::read_to_string(place.join(NAME)).unwrap().starts_with("`magpie accuracy merge`"));
        fs::write(place.join("report.json"), "{}").unwrap();
        drop(second);
        assert_eq!(fs::read_dir(&place).unwrap().count(), 1, "the report stays, the lock does not");
    }
}
