//! What the viewer remembers from one run to the next: window, panels, recent scenes, and where the camera was in each.

use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
};

use magpie::scene::{Camera, CameraFile};
use serde::{Deserialize, Serialize};

use crate::{exit::Failure, output::Output};

/// Scenes that are remembered.
const RECENT: usize = 12;
/// File in the folder of [`folder`].
const FILE: &str = "viewer.json";

/// What is remembered.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(default)]
pub(super) struct Remembered {
    /// Width and height of the window, pixels.
    pub(super) window: Option<[u32; 2]>,
    /// Which panels are shown.
    pub(super) panels: Panels,
    /// Dark letters on light panels.
    pub(super) light: bool,
    /// Size of the panels: 1 is that of the system.
    pub(super) scale: f32,
    /// Name of the way in which pictures go to the display.
    pub(super) present: String,
    /// Scenes, the newest first.
    pub(super) recent: Vec<String>,
    cameras: BTreeMap<String, Place>,
}

/// Which panels are shown.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(default)]
pub(super) struct Panels {
    pub(super) stages: bool,
    pub(super) profiler: bool,
    pub(super) graph: bool,
}

/// Where a camera was.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
struct Place {
    camera: CameraFile,
    /// Distance of the point that is turned about, metres.
    distance: f64,
}

impl Default for Panels {
    fn default() -> Self {
        Self { stages: true, profiler: true, graph: false }
    }
}

impl Default for Remembered {
    fn default() -> Self {
        Self {
            window: None,
            panels: Panels::default(),
            light: false,
            scale: 1.0,
            present: String::new(),
            recent: Vec::new(),
            cameras: BTreeMap::new(),
        }
    }
}

impl Remembered {
    /// Reads it. What cannot be read is forgotten.
    pub(super) fn load() -> Self {
        let Some(path) = folder().map(|folder| folder.join(FILE)) else { return Self::default() };
        let Ok(text) = fs::read_to_string(&path) else { return Self::default() };
        serde_json::from_str(&text).unwrap_or_else(|error| {
            log::warn!("{}: {error}; nothing of it is used", path.display());
            Self::default()
        })
    }

    /// Writes it.
    pub(super) fn save(&self) -> Result<(), Failure> {
        let Some(folder) = folder() else { return Ok(()) };
        let failed = |error: std::io::Error| Failure::running(error).context(folder.display().to_string());
        fs::create_dir_all(&folder).map_err(failed)?;
        let text = serde_json::to_string_pretty(self).map_err(Failure::running)?;
        Output::plan("what the viewer remembers", &folder.join(FILE), &["json"])?.write_text(&(text + "\n"))
    }

    /// The camera of a scene as it was last, and the distance of what was turned about.
    pub(super) fn camera(&self, scene: &str) -> Option<(Camera, f64)> {
        let place = self.cameras.get(&key(scene))?;
        // A file may have been edited by hand.
        Some((place.camera.camera("remembered").ok()?, place.distance))
    }

    /// Notes a scene, and where its camera is.
    pub(super) fn note(&mut self, scene: &str, camera: &Camera, distance: f64) {
        let key = key(scene);
        self.recent.retain(|other| *other != key);
        self.recent.insert(0, key.clone());
        self.recent.truncate(RECENT);
        self.cameras.insert(key, Place { camera: CameraFile::of(camera, distance), distance });
        self.cameras.retain(|scene, _| self.recent.contains(scene));
    }
}

/// What a scene is called from any folder.
fn key(scene: &str) -> String {
    let path = Path::new(scene).canonicalize();
    path.map_or_else(|_| scene.to_owned(), |path| path.display().to_string())
}

/// `$MAGPIE_STATE`, or else `magpie` in the user's folder for the state of programs.
fn folder() -> Option<PathBuf> {
    let from = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    from("MAGPIE_STATE")
        .or_else(|| from("XDG_STATE_HOME").map(|path| path.join("magpie")))
        .or_else(|| from("LOCALAPPDATA").map(|path| path.join("magpie")))
        .or_else(|| from("HOME").map(|path| path.join(".local/state/magpie")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn scenes_are_remembered_with_their_cameras_and_old_ones_are_not() {
        let at = |x: f32| Camera::look_at("c", Vec3::new(x, 1.0, 4.0), Vec3::ZERO, Vec3::Y, 0.7).unwrap();
        let mut remembered = Remembered::default();
        for scene in 0..RECENT + 3 {
            remembered.note(&format!("builtin:{scene}"), &at(scene as f32), 2.5);
        }
        remembered.note("builtin:5", &at(0.5), 3.0);
        assert_eq!((remembered.recent.len(), remembered.cameras.len()), (RECENT, RECENT));
        assert_eq!(remembered.recent[..2], ["builtin:5".to_owned(), format!("builtin:{}", RECENT + 2)]);
        assert!(remembered.camera("builtin:0").is_none());
        let text = serde_json::to_string(&remembered).unwrap();
        let again: Remembered = serde_json::from_str(&text).unwrap();
        let names = |of: &Remembered| of.cameras.keys().cloned().collect::<Vec<_>>();
        assert_eq!((&again.recent, names(&again)), (&remembered.recent, names(&remembered)));
        let (camera, distance) = again.camera("builtin:5").unwrap();
        assert!((camera.eye().as_vec3() - Vec3::new(0.5, 1.0, 4.0)).length() < 1e-5 && distance == 3.0);
        // Fields of other versions do no harm.
        let other: Remembered = serde_json::from_str(r#"{"light": true, "more": [1]}"#).unwrap();
        assert!(other.light && other.panels == Panels::default());
    }
}
