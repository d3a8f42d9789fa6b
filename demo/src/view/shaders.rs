//! Shaders that are edited while the viewer runs: compiled beside the frames, and put in place between two of them.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::mpsc::{Receiver, Sender, channel},
    thread::{self, JoinHandle},
    time::Duration,
};

use magpie::gpu::{Gpu, Reload};
use magpie_shaders::{Shader, Sources, Stage};
use notify::{RecommendedWatcher, RecursiveMode};

use super::watch::watch_folder;
use crate::exit::Failure;

/// A folder of shaders that is followed.
pub(super) struct ShaderWatch {
    outcomes: Receiver<Outcome>,
    /// Ends the thread when it is dropped.
    watcher: Option<RecommendedWatcher>,
    thread: Option<JoinHandle<()>>,
}

/// What came of an edit.
pub(super) enum Outcome {
    /// Pipelines with the new shaders, and the names of the files that were edited; `None` for a shader that was not in use then.
    Compiled { files: Option<String>, reload: Reload },
    /// A sentence, or what the compiler says.
    Refused(String),
}

/// Editors write a file in more than one step.
const PAUSE: Duration = Duration::from_millis(40);

impl ShaderWatch {
    /// Follows the shaders of `--shaders`, or those of the current folder, if it has any.
    pub(super) fn new(gpu: &Gpu, wanted: Option<&Path>) -> Result<Option<Self>, Failure> {
        let sources = match (wanted, Sources::open(wanted.unwrap_or(Path::new("shaders")))) {
            (_, Some(sources)) => sources,
            (None, None) => return Ok(None),
            (Some(folder), None) => {
                return Err(Failure::bad(format!(
                    "--shaders {}: wanted a folder with Magpie's shaders, with lib/bindless.glsl in it",
                    folder.display()
                )));
            }
        };
        let (edited, edits) = channel();
        let watcher = watch_folder(sources.folder(), RecursiveMode::Recursive, move |paths| {
            let _ = edited.send(paths);
        })?;
        let (sender, outcomes) = channel();
        let gpu = gpu.clone();
        let follow = move || follow(&gpu, &sources, &edits, &sender);
        let thread = thread::Builder::new().name("shaders".to_owned()).spawn(follow).map_err(Failure::running)?;
        Ok(Some(Self { outcomes, watcher: Some(watcher), thread: Some(thread) }))
    }

    /// What has come of edits since the last call.
    pub(super) fn outcomes(&self) -> Vec<Outcome> {
        self.outcomes.try_iter().collect()
    }
}

impl Drop for ShaderWatch {
    fn drop(&mut self) {
        self.watcher.take();
        // It has a share of the device.
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Compiles what is edited, until nobody watches any more.
fn follow(gpu: &Gpu, sources: &Sources, edits: &Receiver<Vec<PathBuf>>, sender: &Sender<Outcome>) {
    let root = sources.folder().canonicalize().unwrap_or_else(|_| sources.folder().to_owned());
    let name = |path: &PathBuf| {
        let path = path.canonicalize().ok()?;
        let name = path.strip_prefix(&root).ok()?.to_string_lossy().replace('\\', "/");
        // Editors leave files of their own beside those that they write.
        let ending = name.rsplit_once('.')?.1;
        (["glsl", "ray", "rs"].contains(&ending) || Stage::of_file(&name).is_some()).then_some(name)
    };
    // What is not in use now, but would run as it was once it is.
    let mut rest: Vec<&'static Shader> = Vec::new();
    loop {
        let mut files = BTreeSet::new();
        if rest.is_empty() {
            let Ok(paths) = edits.recv() else { return };
            files.extend(paths.iter().filter_map(name));
            thread::sleep(PAUSE);
        }
        files.extend(edits.try_iter().flatten().filter_map(|path| name(&path)));
        let outcome = if files.is_empty() {
            let Some(shader) = rest.pop() else { continue };
            compile(gpu, sources, None, &[shader])
        } else {
            let (shared, files): (BTreeSet<_>, BTreeSet<_>) = files.into_iter().partition(|file| file.ends_with(".rs"));
            if let Some(file) = shared.first() {
                let why = "is shared by Rust and shaders: the program has to be built again";
                let _ = sender.send(Outcome::Refused(format!("{file} {why}")));
            }
            if files.is_empty() {
                continue;
            }
            let affected = sources.affected(&files);
            let (used, unused): (Vec<&'static Shader>, Vec<_>) =
                affected.into_iter().partition(|shader: &&'static Shader| gpu.runs(shader));
            rest.retain(|shader| !used.iter().any(|used| std::ptr::eq(*used, *shader)));
            rest.extend::<Vec<&'static Shader>>(unused);
            compile(gpu, sources, Some(Vec::from_iter(files).join(", ")), &used)
        };
        if let Outcome::Refused(_) = outcome {
            rest.clear();
        }
        if sender.send(outcome).is_err() {
            return;
        }
    }
}

fn compile(gpu: &Gpu, sources: &Sources, files: Option<String>, shaders: &[&'static Shader]) -> Outcome {
    let mut compiled = Vec::new();
    for shader in shaders {
        match sources.compile(shader) {
            Ok(words) => compiled.push((*shader, words)),
            Err(error) => return Outcome::Refused(error.to_string()),
        }
    }
    match gpu.reload(&compiled) {
        Ok(reload) => Outcome::Compiled { files, reload },
        Err(error) => Outcome::Refused(error.to_string()),
    }
}
