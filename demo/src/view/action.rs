//! What is done to the viewer, by hand or by a file.

use std::{
    path::{Path, PathBuf},
    sync::mpsc::{Receiver, channel},
    thread,
};

use serde::{Deserialize, Serialize};

use super::input_events::Input;
use super::look::LookChange;
use crate::{exit::Failure, input};

/// One thing that is done.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Action {
    /// Sets one value of the configuration: `stages.shadows=off`, `SLOT.SETTING=VALUE`.
    Set(String),
    /// Gives a slot its default implementation and settings.
    Reset(String),
    /// Writes the configuration to a file.
    SaveConfig(PathBuf),
    /// Writes the window, with its panels, to a PNG, or the linear radiance of the picture to an EXR.
    Screenshot(PathBuf),
    /// Writes both under the first names of the current folder that are free: `magpie_000.png` and `magpie_000.exr`.
    Snapshot,
    /// Writes the times of the frames that the profiler shows: `.json` and `.csv` as `--timings`, `.trace.json` as `--trace`.
    Export(PathBuf),
    /// Begins to record the path of the camera, to a file.
    Record(PathBuf),
    /// Ends that, and writes it.
    StopRecording,
    /// Begins a recording under the first free name, or ends it.
    ToggleRecording,
    /// Lets the camera follow a recorded path.
    Replay(PathBuf),
    /// Shows or hides a panel.
    Panel(Panel),
    /// Shows or hides all panels.
    Panels,
    /// Shows two configurations beside each other, the second of which begins as a copy of the first; or the first alone again.
    Compare(bool),
    /// Exchanges the two: the other one is then edited.
    Swap,
    /// Shows the path-traced reference beside the picture, for which the time of the scene stops, or no longer.
    Truth(bool),
    /// How it is shown.
    TruthAs(TruthView),
    /// Writes what was measured against it, to a JSON file.
    ExportTruth(PathBuf),
    /// How much of the picture, from the left, shows the configuration that is edited: 0 to 1.
    Split(f32),
    /// How pictures go to the display: `vsync`, `newest`, `immediate`.
    Present(String),
    /// Dark letters on light panels, or light ones on dark panels.
    Light(bool),
    /// Lets time go on, or stops it.
    Play(bool),
    /// Goes to a camera of the scene.
    Camera(String),
    /// Turns about what is seen in a place of the picture: 0 to 1, from the left and from above.
    LookAt([f32; 2]),
    /// Gives the window another size, pixels.
    Resize([u32; 2]),
    /// Minimises the window, or brings it back.
    Minimise(bool),
    /// Shows another scene.
    Open(PathBuf),
    /// Loads the scene again, and stays where the camera is.
    Reload,
    /// Surrounds the scene with an image, latitude over longitude.
    Environment(PathBuf),
    /// Takes the configuration of a file, and follows it from now on.
    Config(PathBuf),
    /// An event of mouse or keyboard.
    Input(Input),
    /// The next frame behaves as if the device were lost in this pass.
    LoseDevice(String),
    /// Shows an output of a pass in place of the picture: names of both.
    Inspect(String, String),
    /// Shows the picture again.
    InspectNothing,
    /// Changes how the inspected image is shown.
    InspectAs(LookChange),
    /// Shows the values of this pixel of the inspected image, or with `null` of the one under the pointer.
    Pick(Option<[u32; 2]>),
    /// Closes the window.
    Close,
}

/// A part of the interface that can be hidden.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Panel {
    /// Implementations and settings.
    Stages,
    /// Times.
    Profiler,
    /// The plan of the frame.
    Graph,
    /// Keys.
    Help,
}

/// How the reference is shown.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum TruthView {
    /// Right of a line, the picture left of it.
    #[default]
    Split,
    /// As a map of the error against it, FLIP.
    Error,
    /// Not at all: numbers only.
    Numbers,
}

/// An action of a file.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Step {
    /// The frame before which it is done, from 0; the number of `--frames` is after the last one.
    pub(crate) frame: u32,
    /// What is done.
    #[serde(rename = "do")]
    pub(crate) action: Action,
}

impl Action {
    /// What is done with a file that is dropped on the window, by its ending.
    pub(crate) fn of_dropped(path: &Path) -> Result<Self, Failure> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        match ending.as_str() {
            "gltf" | "glb" => Ok(Self::Open(path.to_owned())),
            "hdr" | "exr" => Ok(Self::Environment(path.to_owned())),
            "toml" => Ok(Self::Config(path.to_owned())),
            _ => {
                let wanted = "a scene (.gltf, .glb), an environment map (.hdr, .exr) or a configuration (.toml)";
                Err(Failure::bad(format!("{}: wanted {wanted}", path.display())))
            }
        }
    }
}

/// Reads a file of actions: a JSON list of `{"frame": 3, "do": {"set": "stages.gi=off"}}`. They are sorted by frame.
pub(crate) fn read(path: &Path) -> Result<Vec<Step>, Failure> {
    let text = input::read_text(path)?;
    let mut steps: Vec<Step> = serde_json::from_str(&text).map_err(|error| {
        Failure::bad(format!("{}: wanted a list of actions such as {EXAMPLE}: {error}", path.display()))
    })?;
    steps.sort_by_key(|step| step.frame);
    Ok(steps)
}

/// Actions that come while the viewer runs: one per line of standard input, such as `{"set": "stages.gi=off"}`, done before the next frame.
pub(crate) fn of_standard_input() -> Result<Receiver<Result<Action, Failure>>, Failure> {
    let (sender, actions) = channel();
    let read = move || {
        for line in std::io::stdin().lines() {
            let action = line.map_err(Failure::input).and_then(|line| {
                serde_json::from_str(&line).map_err(|error| {
                    Failure::bad(format!("{line}: wanted an action such as {{\"set\": \"stages.gi=off\"}}: {error}"))
                })
            });
            if sender.send(action.map_err(|failure| failure.context("--actions"))).is_err() {
                return;
            }
        }
    };
    thread::Builder::new().name("actions".to_owned()).spawn(read).map_err(Failure::running)?;
    Ok(actions)
}

const EXAMPLE: &str = r#"{"frame": 3, "do": {"set": "stages.gi=off"}}"#;

/// Names with these endings and the first number from 0 under which a folder has none of them.
pub(crate) fn free_names<const N: usize>(folder: &Path, endings: [&str; N]) -> Option<[PathBuf; N]> {
    let names = |number: u32| endings.map(|ending| folder.join(format!("magpie_{number:03}.{ending}")));
    (0..MOST_SNAPSHOTS).map(names).find(|both| both.iter().all(|path| !path.exists()))
}

/// Such files in one folder.
const MOST_SNAPSHOTS: u32 = 10_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn snapshots_replace_nothing() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("magpie_000.png"), "").unwrap();
        std::fs::write(folder.path().join("magpie_001.exr"), "").unwrap();
        let names = free_names(folder.path(), ["png", "exr"]).unwrap().map(|path| path.file_name().unwrap().to_owned());
        assert_eq!(names, ["magpie_002.png", "magpie_002.exr"]);
    }

    #[test]
    fn dropped_files_are_told_by_their_endings() {
        let of = |name: &str| Action::of_dropped(Path::new(name)).ok();
        assert_eq!(of("a/b.GLB"), Some(Action::Open("a/b.GLB".into())));
        assert_eq!(of("sky.hdr"), Some(Action::Environment("sky.hdr".into())));
        assert_eq!(of("c.toml"), Some(Action::Config("c.toml".into())));
        assert_eq!([of("glb"), of("picture.png"), of("")], [None, None, None]);
    }

    #[test]
    fn files_are_lists_by_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let text = format!(r#"[{{"frame": 9, "do": "close"}}, {EXAMPLE}, {{"frame": 3, "do": {{"panel": "help"}}}}]"#);
        std::fs::write(&path, text).unwrap();
        let steps = read(&path).unwrap();
        let actions: Vec<_> = steps.into_iter().map(|s| (s.frame, s.action)).collect();
        let set = Action::Set("stages.gi=off".to_owned());
        assert_eq!(actions, [(3, set), (3, Action::Panel(Panel::Help)), (9, Action::Close)]);
        std::fs::write(&path, r#"[{"frame": 1, "do": "dance"}]"#).unwrap();
        let message = read(&path).unwrap_err().message();
        assert!(message.contains("a.json") && message.contains("dance") && message.contains("close"), "{message}");
    }
}
