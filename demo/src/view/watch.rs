//! Files that are edited while the viewer runs.

use std::{
    path::{Path, PathBuf},
    sync::mpsc::{Receiver, channel},
};

use notify::{Event, EventKind, RecommendedWatcher, RecursiveMode, Watcher};

use crate::exit::Failure;

/// Tells when a file was written, also where an editor puts another one in its place.
pub(super) struct Watch {
    path: PathBuf,
    changes: Receiver<()>,
    _watcher: RecommendedWatcher,
}

impl Watch {
    pub(super) fn new(path: &Path) -> Result<Self, Failure> {
        let (sender, changes) = channel();
        let name = path.file_name().map(ToOwned::to_owned);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let watcher = watch_folder(folder, RecursiveMode::NonRecursive, move |paths| {
            if paths.iter().any(|path| path.file_name() == name.as_deref()) {
                // The viewer may have ended.
                let _ = sender.send(());
            }
        })?;
        Ok(Self { path: path.to_owned(), changes, _watcher: watcher })
    }

    /// The scene in a file: with a `.gltf` all that lies beside it, since it names other files.
    pub(super) fn scene(path: &Path) -> Result<Self, Failure> {
        if path.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("gltf")) {
            return Self::new(path);
        }
        let (sender, changes) = channel();
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let watcher = watch_folder(folder, RecursiveMode::Recursive, move |paths| {
            let belongs = |path: &PathBuf| {
                let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
                ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
            };
            if paths.iter().any(belongs) {
                let _ = sender.send(());
            }
        })?;
        Ok(Self { path: path.to_owned(), changes, _watcher: watcher })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it was written since the last call.
    pub(super) fn has_changed(&self) -> bool {
        self.changes.try_iter().count() > 0
    }
}

/// Endings of the files of a scene.
const ENDINGS: [&str; 5] = ["gltf", "bin", "png", "jpg", "jpeg"];

/// Tells `changed` which files of a folder were written, made, moved or removed.
pub(super) fn watch_folder(
    folder: &Path,
    mode: RecursiveMode,
    mut changed: impl FnMut(Vec<PathBuf>) + Send + 'static,
) -> Result<RecommendedWatcher, Failure> {
    let failed =
        |error: notify::Error| Failure::bad(format!("{}: changes cannot be watched: {error}", folder.display()));
    let mut watcher = notify::recommended_watcher(move |event: notify::Result<Event>| {
        if let Ok(Event { paths, kind, .. }) = event
            && !matches!(kind, EventKind::Access(_))
        {
            changed(paths);
        }
    })
    .map_err(failed)?;
    watcher.watch(folder, mode).map_err(failed)?;
    Ok(watcher)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        fs, thread,
        time::{Duration, Instant},
    };

    fn is_seen(watch: &Watch) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(5) {
            if watch.has_changed() {
                return true;
            }
            thread::sleep(Duration::from_millis(10));
        }
        false
    }

    #[test]
    fn writing_and_replacing_are_seen_and_other_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        fs::write(&path, "").unwrap();
        let watch = Watch::new(&path).unwrap();
        fs::write(folder.path().join("b.toml"), "x = 1").unwrap();
        fs::read(&path).unwrap();
        thread::sleep(Duration::from_millis(200));
        assert!(!watch.has_changed());
        fs::write(&path, "x = 1").unwrap();
        assert!(is_seen(&watch));
        thread::sleep(Duration::from_millis(100));
        watch.has_changed();
        fs::rename(folder.path().join("b.toml"), &path).unwrap();
        assert!(is_seen(&watch));
        assert!(Watch::new(Path::new("no/such/folder/a.toml")).is_err());
    }
}
