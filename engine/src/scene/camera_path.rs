//! Camera paths: cameras at times, and what lies between them.
use super::{Camera, CameraFile, SceneError};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Limit on the size of a path file: hours of recording; a longer file is something else.
const MAX_FILE_BYTES: u64 = 64 * 1024 * 1024;
/// Keys of a turntable: one for every 2.5 degrees, between which the curve is off the circle by less than a millionth of its radius.
const TURNTABLE_KEYS: u32 = 144;

/// The camera at a time.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CameraKey {
    /// Seconds.
    pub time: f64,
    /// As in a camera file.
    pub camera: CameraFile,
}

/// A camera that moves.
///
/// Positions, targets and up directions go through those of the keys on cubic curves (Hermite, with Bessel's tangents: those of parabolas through
/// three keys), angles of view and near planes change linearly. Before the first key and after the last the camera stands still.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    keys: Vec<CameraKey>,
}

impl CameraPath {
    /// A path through these keys.
    ///
    /// # Errors
    /// [`SceneError::Camera`] if there is no key, times do not increase, or a key does not describe a camera.
    pub fn new(keys: Vec<CameraKey>) -> Result<Self, SceneError> {
        let path = Self { keys };
        path.check().map_err(|reason| SceneError::Camera { name: "path".to_owned(), reason })?;
        Ok(path)
    }

    /// Once around the vertical axis through `centre` (metres), counter-clockwise as seen from above, in so many seconds above 0. It begins and
    /// ends with `camera`.
    ///
    /// # Errors
    /// [`SceneError::Camera`], as of [`Self::new`].
    pub fn turntable(camera: &Camera, centre: DVec3, seconds: f64) -> Result<Self, SceneError> {
        let distance = camera.eye().distance(centre).max(f64::from(camera.near));
        let key = |at: u32| {
            let turn = f64::from(at) / f64::from(TURNTABLE_KEYS);
            let rotation = DMat3::from_rotation_y(turn * std::f64::consts::TAU);
            let around = DAffine3 { matrix3: rotation, translation: centre - rotation * centre };
            let camera = Camera { world_from_camera: around * camera.world_from_camera, ..camera.clone() };
            CameraKey { time: turn * seconds, camera: CameraFile::of(&camera, distance) }
        };
        Self::new((0..=TURNTABLE_KEYS).map(key).collect())
    }

    /// Reads and checks a path file, in JSON: `{"keys": [{"time": 0, "camera": {"position": [0, 1, 4], "target": [0, 1, 0]}}, ...]}`.
    ///
    /// # Errors
    /// [`SceneError::Read`] if the file cannot be read, [`SceneError::CameraFile`] if it is not valid JSON, has an unknown key, lacks one, or
    /// does not describe a path.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let refuse = |reason: String| SceneError::CameraFile { path: path.to_owned(), reason };
        let text = super::camera::read_text(path, MAX_FILE_BYTES)?;
        let read: Self = serde_json::from_str(&text).map_err(|e| refuse(e.to_string()))?;
        read.check().map_err(refuse)?;
        Ok(read)
    }

    /// The keys, in the order of time.
    pub fn keys(&self) -> &[CameraKey] {
        &self.keys
    }

    /// Time of the first and of the last key, seconds.
    pub fn times(&self) -> [f64; 2] {
        [self.keys[0].time, self.keys[self.keys.len() - 1].time]
    }

    /// The camera at a time, seconds.
    ///
    /// # Errors
    /// [`SceneError::Camera`] if there is none, because between two keys the position meets the target or the up direction vanishes.
    pub fn camera(&self, seconds: f64) -> Result<Camera, SceneError> {
        let after = self.keys.partition_point(|key| key.time <= seconds);
        let file = if after == 0 {
            self.keys[0].camera.clone()
        } else if after == self.keys.len() {
            self.keys[after - 1].camera.clone()
        } else {
            self.between(after - 1, seconds)
        };
        file.camera("path").map_err(|error| match error {
            SceneError::Camera { name, reason } => {
                SceneError::Camera { name, reason: format!("at {seconds} seconds: {reason}") }
            }
            other => other,
        })
    }

    fn between(&self, at: usize, seconds: f64) -> CameraFile {
        let (from, to) = (&self.keys[at], &self.keys[at + 1]);
        let share = (seconds - from.time) / (to.time - from.time);
        let curve = |value: &dyn Fn(&CameraKey) -> DVec3| {
            // That of the parabola through a key and its neighbours; at the ends, through the outer three keys.
            let slope = |key: usize| {
                let first = key.saturating_sub(1).min(self.keys.len().saturating_sub(3));
                let [a, b] = [&self.keys[first], &self.keys[first + 1]];
                let before = (value(b) - value(a)) / (b.time - a.time);
                let Some(c) = self.keys.get(first + 2) else { return before };
                let after = (value(c) - value(b)) / (c.time - b.time);
                before + (after - before) / (c.time - a.time) * (2.0 * self.keys[key].time - a.time - b.time)
            };
            let (squared, span) = (share * share, to.time - from.time);
            let cubed = squared * share;
            value(from) * (2.0 * cubed - 3.0 * squared + 1.0)
                + value(to) * (3.0 * squared - 2.0 * cubed)
                + slope(at) * span * (cubed - 2.0 * squared + share)
                + slope(at + 1) * span * (cubed - squared)
        };
        let mixed = |from: f32, to: f32| (f64::from(from) + share * (f64::from(to) - f64::from(from))) as f32;
        let near = |key: &CameraKey| key.camera.near.unwrap_or(super::camera::DEFAULT_NEAR);
        CameraFile {
            position: curve(&|key| DVec3::from(key.camera.position)).to_array(),
            target: curve(&|key| DVec3::from(key.camera.target)).to_array(),
            up: curve(&|key| Vec3::from(key.camera.up).as_dvec3()).as_vec3().to_array(),
            vertical_fov_degrees: mixed(from.camera.vertical_fov_degrees, to.camera.vertical_fov_degrees),
            near: Some(mixed(near(from), near(to))),
        }
    }

    fn check(&self) -> Result<(), String> {
        if self.keys.is_empty() {
            return Err("the path has no key".to_owned());
        }
        for (at, key) in self.keys.iter().enumerate() {
            if !key.time.is_finite() {
                return Err(format!("keys[{at}]: time is {}, wanted a finite number", key.time));
            }
            if at > 0 && key.time <= self.keys[at - 1].time {
                return Err(format!("keys[{at}]: time is {}, wanted more than {}", key.time, self.keys[at - 1].time));
            }
            key.camera.camera("path").map_err(|error| match error {
                SceneError::Camera { reason, .. } => format!("keys[{at}]: {reason}"),
                other => other.to_string(),
            })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at("t", DVec3::new(3.0, 2.0, 1.0), DVec3::new(0.5, 1.0, 0.0), Vec3::Y, 0.7).unwrap()
    }

    fn key(time: f64, x: f64) -> CameraKey {
        CameraKey { time, camera: CameraFile { position: [x, 1.0, 4.0], ..CameraFile::of(&camera(), 2.0) } }
    }

    /// How far apart two cameras are: metres, and the greatest difference of their axes.
    fn apart(a: &Camera, b: &Camera) -> [f64; 2] {
        let (a, b) = (a.world_from_camera, b.world_from_camera);
        let axes = [a.matrix3.x_axis - b.matrix3.x_axis, a.matrix3.y_axis - b.matrix3.y_axis];
        [a.translation.distance(b.translation), axes[0].length().max(axes[1].length())]
    }

    #[test]
    fn a_path_goes_through_its_keys_and_stands_before_and_after() {
        let path = CameraPath::new(vec![key(1.0, 0.0), key(2.0, 3.0), key(4.0, -1.0)]).unwrap();
        for (time, x) in [(-7.0, 0.0), (1.0, 0.0), (2.0, 3.0), (4.0, -1.0), (1e9, -1.0)] {
            assert_eq!(path.camera(time).unwrap().eye(), DVec3::new(x, 1.0, 4.0), "at {time}");
        }
        assert_eq!(path.times(), [1.0, 4.0]);
    }

    #[test]
    fn steady_motion_stays_steady_whatever_the_times() {
        let times = [0.0, 0.1, 1.0, 1.5, 4.0];
        let path = CameraPath::new(times.iter().map(|&t| key(t, 2.0 * t)).collect()).unwrap();
        for step in 0..=40 {
            let time = f64::from(step) * 0.1;
            let x = path.camera(time).unwrap().eye().x;
            assert!((x - 2.0 * time).abs() < 1e-12, "at {time}: {x}");
        }
    }

    #[test]
    fn speed_does_not_jump_at_keys() {
        let path = CameraPath::new(vec![key(0.0, 0.0), key(1.0, 2.0), key(1.5, -1.0), key(3.0, 5.0)]).unwrap();
        let speed = |time: f64| {
            let [before, after] = [time - 1e-5, time + 1e-5].map(|t| path.camera(t).unwrap().eye().x);
            (after - before) / 2e-5
        };
        for time in [1.0, 1.5] {
            let [before, after] = [speed(time - 2e-5), speed(time + 2e-5)];
            assert!((before - after).abs() < 1e-2, "at {time}: {before} and {after} metres per second");
        }
    }

    #[test]
    fn a_turntable_is_a_circle_that_looks_the_same_way_in() {
        let (camera, centre) = (camera(), DVec3::new(-2.0, 5.0, 0.5));
        let path = CameraPath::turntable(&camera, centre, 6.0).unwrap();
        let flat = |c: &Camera| ((c.eye() - centre) * DVec3::new(1.0, 0.0, 1.0)).length();
        for step in 0..=200 {
            let time = f64::from(step) * 0.03;
            let now = path.camera(time).unwrap();
            assert!((flat(&now) / flat(&camera) - 1.0).abs() < 1e-6 && (now.eye().y - 2.0).abs() < 1e-9, "at {time}");
            let turn = DMat3::from_rotation_y(time / 6.0 * std::f64::consts::TAU);
            let turned = DAffine3::from_mat3(turn) * camera.world_from_camera;
            let expected =
                Camera { world_from_camera: DAffine3 { translation: now.eye(), ..turned }, ..camera.clone() };
            assert!(apart(&now, &expected)[1] < 1e-5, "at {time}: {:?}", apart(&now, &expected));
        }
        let [metres, axes] = apart(&path.camera(6.0).unwrap(), &camera);
        assert!(metres < 1e-9 && axes < 1e-6, "the end is {metres} m and {axes} from the beginning");
    }

    #[test]
    fn files_keep_a_path_and_are_checked() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("p.json");
        let read = |text: &str| {
            std::fs::write(&place, text).unwrap();
            CameraPath::read(&place)
        };
        let path = CameraPath::turntable(&camera(), DVec3::ZERO, 2.0).unwrap();
        let again = read(&serde_json::to_string(&path).unwrap()).unwrap();
        let [metres, axes] = apart(&again.camera(0.7).unwrap(), &path.camera(0.7).unwrap());
        assert!(metres < 1e-12 && axes < 1e-6, "{metres}, {axes}");

        let base = r#""position": [0, 1, 4], "target": [0, 1, 0]"#;
        let two = |time: &str, more: &str| {
            let first = format!(r#"{{"time": 0, "camera": {{{base}}}}}"#);
            format!(r#"{{"keys": [{first}, {{{time}"camera": {{{base}{more}}}}}]}}"#)
        };
        assert_eq!(read(&two(r#""time": 1, "#, "")).unwrap().keys()[1].camera.up, [0.0, 1.0, 0.0]);
        for (text, says) in [
            (two("", ""), "time"),
            (two(r#""time": 0, "#, ""), "more than 0"),
            (two(r#""time": -1, "#, ""), "keys[1]"),
            (two(r#""time": 1, "#, r#", "upp": [0, 1, 0]"#), "upp"),
            (two(r#""time": 1, "#, r#", "up": [0, 0, 1]"#), "line of sight"),
            (two(r#""time": 1, "#, r#", "near": 0"#), "near"),
            (r#"{"keys": []}"#.to_owned(), "no key"),
            (r#"{"key": []}"#.to_owned(), "key"),
            ("{".to_owned(), "EOF"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            assert!(message.contains("p.json") && message.contains(says), "{text}: {message}");
        }
        assert!(matches!(CameraPath::read(&folder.path().join("none.json")), Err(SceneError::Read { .. })));
    }

    #[test]
    fn a_place_without_a_camera_is_named() {
        let through = |time, target| CameraKey { time, camera: CameraFile { target, ..key(time, 0.0).camera } };
        // The target passes the camera between the keys.
        let path = CameraPath::new(vec![through(0.0, [0.0, 1.0, 3.0]), through(1.0, [0.0, 1.0, 5.0])]).unwrap();
        let message = path.camera(0.5).unwrap_err().to_string();
        assert!(message.contains("at 0.5 seconds"), "{message}");
    }
}
