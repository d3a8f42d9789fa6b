//! Paths of the camera that are recorded by hand, and replayed.

use magpie::scene::{Camera, CameraFile, CameraKey, CameraPath, SceneError};

use crate::output::Output;

/// Seconds between two keys of a recording: between them the camera goes on a curve.
const SPACING: f64 = 0.1;

/// A path that is being recorded.
pub(super) struct Recording {
    keys: Vec<CameraKey>,
    /// When it was begun, seconds of the viewer's clock.
    begun: f64,
    /// Where it is written.
    pub(super) output: Output,
}

impl Recording {
    pub(super) fn new(begun: f64, output: Output) -> Self {
        Self { keys: Vec::new(), begun, output }
    }

    /// Adds a key, if the last one is long enough ago.
    pub(super) fn add(&mut self, clock: f64, camera: &Camera, distance: f64) {
        let time = clock - self.begun;
        if self.keys.last().is_none_or(|last| time >= last.time + SPACING) {
            self.keys.push(CameraKey { time, camera: CameraFile::of(camera, distance) });
        }
    }

    /// The whole path, with a key at its end.
    pub(super) fn path(&mut self, clock: f64, camera: &Camera, distance: f64) -> Result<CameraPath, SceneError> {
        let last = CameraKey { time: clock - self.begun, camera: CameraFile::of(camera, distance) };
        self.keys.retain(|key| key.time < last.time);
        self.keys.push(last);
        CameraPath::new(std::mem::take(&mut self.keys))
    }
}

/// A path that the camera follows.
pub(super) struct Replay {
    pub(super) path: CameraPath,
    /// When it was begun, seconds of the viewer's clock.
    pub(super) begun: f64,
}

impl Replay {
    /// The camera, and whether it has come to the end.
    pub(super) fn camera(&self, clock: f64) -> Result<(Camera, bool), SceneError> {
        let [first, last] = self.path.times();
        let time = first + clock - self.begun;
        Ok((self.path.camera(time)?, time >= last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::path::Path;

    fn camera(x: f32) -> Camera {
        Camera::look_at("t", Vec3::new(x, 1.0, 4.0), Vec3::new(x, 1.0, 0.0), Vec3::Y, 0.7).unwrap()
    }

    #[test]
    fn what_was_recorded_is_replayed() {
        let output = Output::plan("path", Path::new("/dev/null"), &["json"]).unwrap();
        let mut recording = Recording::new(5.0, output);
        // 60 frames per second, at one metre per second.
        for frame in 0..120 {
            let seconds = f64::from(frame) / 60.0;
            recording.add(5.0 + seconds, &camera(seconds as f32), 4.0);
        }
        let path = recording.path(7.0, &camera(2.0), 4.0).unwrap();
        assert_eq!(path.times(), [0.0, 2.0]);
        assert!((15..=22).contains(&path.keys().len()), "{}", path.keys().len());
        let replay = Replay { path, begun: 100.0 };
        for (clock, x, ends) in [(100.0, 0.0, false), (100.73, 0.73, false), (102.0, 2.0, true), (110.0, 2.0, true)] {
            let (camera, ended) = replay.camera(clock).unwrap();
            assert!((camera.eye().x - x).abs() < 1e-3 && ended == ends, "{clock}: {} {ended}", camera.eye());
        }
    }
}
