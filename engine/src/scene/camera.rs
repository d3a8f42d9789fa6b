//! Cameras and camera files.
use super::{SceneError, single};
use glam::{Affine3A, DAffine3, DMat3, DVec3, Mat4, Vec3};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::ops::RangeInclusive;
use std::path::Path;

/// Limit on the size of a camera file; a longer file is something else.
const MAX_FILE_BYTES: u64 = 64 * 1024;
/// Default distance of the near plane in a camera file, metres.
pub(super) const DEFAULT_NEAR: f32 = 0.01;

/// Smallest angle of view, radians. For smaller ones, projections overflow `f32` when squared.
pub(super) const MIN_FOV: f32 = 1e-6;
/// Allowed distances of the near plane, metres. With any angle of view and aspect ratio, the projection and its inverse stay
/// within `f32`, and so does the depth of everything in a scene.
pub(super) const NEAR_RANGE: RangeInclusive<f32> = 1e-18..=1e18;

/// A rotation rounded to `f32`, as shaders have it, so that host and device agree.
fn as_on_the_device(rotation: &DMat3) -> DMat3 {
    rotation.as_mat3().as_dmat3()
}

/// A pinhole camera, which looks along its -z with y up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Name, for `--camera` and messages.
    pub name: String,
    /// World-from-camera transform: a rotation and a translation in metres. In `f64`, so that near objects keep their precision
    /// far from the world's origin.
    pub world_from_camera: DAffine3,
    /// Full vertical angle of view, radians, above 0 and below pi.
    pub vertical_fov: f32,
    /// Distance of the near plane, metres, above 0. There is no far plane.
    pub near: f32,
}

impl Camera {
    /// A camera at `eye` (metres) that looks at `target`, with a full vertical angle of view in radians and a near plane
    /// at a thousandth of the distance to the target.
    ///
    /// # Errors
    /// [`SceneError::Camera`] if a number is not finite, `eye` equals `target`, `up` is zero or parallel to the line of sight, or
    /// the angle is below a millionth of a radian or not below pi.
    pub fn look_at(
        name: impl Into<String>,
        eye: impl Into<DVec3>,
        target: impl Into<DVec3>,
        up: Vec3,
        vertical_fov: f32,
    ) -> Result<Self, SceneError> {
        let (name, eye, target) = (name.into(), eye.into(), target.into());
        let refuse = |reason: String| Err(SceneError::Camera { name: name.clone(), reason });
        for (what, v) in [("position", eye), ("target", target), ("up", up.as_dvec3())] {
            if !v.is_finite() {
                return refuse(format!("{what} is {v}, wanted finite numbers"));
            }
        }
        if !(MIN_FOV..std::f32::consts::PI).contains(&vertical_fov) {
            let (degrees, least) = (vertical_fov.to_degrees(), MIN_FOV.to_degrees());
            return refuse(format!(
                "vertical field of view is {degrees} degrees, wanted at least {least:.5} and less than 180"
            ));
        }
        let back = (eye - target).try_normalize();
        let Some(back) = back else {
            return refuse(format!("position and target are both {eye}"));
        };
        let right = up.as_dvec3().try_normalize().map(|u| u.cross(back)).filter(|r| r.length() > 1e-6);
        let Some(right) = right.and_then(|r| r.try_normalize()) else {
            return refuse(format!("up {up} has no length or lies along the line of sight"));
        };
        let rotation = as_on_the_device(&DMat3::from_cols(right, back.cross(right), back));
        let near = (eye.distance(target) * 1e-3) as f32;
        Ok(Self {
            name,
            world_from_camera: DAffine3 { matrix3: rotation, translation: eye },
            vertical_fov,
            near: near.max(f32::MIN_POSITIVE),
        })
    }

    /// The rotation of a camera on a node with this matrix. Only the directions of the y and z axes count; scale is dropped.
    pub(super) fn rigid(matrix: DMat3) -> Option<DMat3> {
        let z = matrix.z_axis.try_normalize()?;
        let y = (matrix.y_axis - z * matrix.y_axis.dot(z)).try_normalize()?;
        let rotation = DMat3::from_cols(y.cross(z), y, z);
        rotation.is_finite().then(|| as_on_the_device(&rotation))
    }

    /// World-from-camera transform on the device, with the world relative to `origin`, metres.
    pub fn placed(&self, origin: DVec3) -> Affine3A {
        single(&DAffine3 { translation: self.eye() - origin, ..self.world_from_camera })
    }

    /// Camera-from-world transform, with the world relative to `origin`, metres.
    pub fn view_from_world(&self, origin: DVec3) -> Mat4 {
        let placed = self.placed(origin);
        // The inverse of a rotation is its transpose, which has no rounding errors.
        let rotation = placed.matrix3.transpose();
        let translation = -(rotation * placed.translation);
        Mat4::from(Affine3A { matrix3: rotation, translation })
    }

    /// Clip-from-camera transform for an aspect ratio (width over height). Vulkan's y down, with reversed infinite depth: 1 at
    /// the near plane and 0 at infinity.
    pub fn clip_from_view(&self, aspect: f32) -> Mat4 {
        let f = 1.0 / (0.5 * self.vertical_fov).tan();
        Mat4::from_cols_array_2d(&[
            [f / aspect, 0.0, 0.0, 0.0],
            [0.0, -f, 0.0, 0.0],
            [0.0, 0.0, 0.0, -1.0],
            [0.0, 0.0, self.near, 0.0],
        ])
    }

    /// Position of the camera in the world, metres.
    pub fn eye(&self) -> DVec3 {
        self.world_from_camera.translation
    }

    /// Unit direction in which the camera looks.
    pub fn forward(&self) -> Vec3 {
        -self.world_from_camera.matrix3.z_axis.as_vec3()
    }
}

/// The content of a camera file in TOML; unknown keys are errors.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    /// Position of the camera, metres.
    pub position: [f64; 3],
    /// Point that it looks at, metres.
    pub target: [f64; 3],
    /// Up direction; y by default.
    #[serde(default = "default_up")]
    pub up: [f32; 3],
    /// Full vertical angle of view, degrees, at least 0.00006 and below 180; 40 by default.
    #[serde(default = "default_fov")]
    pub vertical_fov_degrees: f32,
    /// Distance of the near plane, metres, 1e-18 to 1e18; 0.01 by default.
    pub near: Option<f32>,
}

fn default_up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

fn default_fov() -> f32 {
    40.0
}

/// The text of a camera file or path file of at most so many bytes.
pub(super) fn read_text(path: &Path, limit: u64) -> Result<String, SceneError> {
    let failed = |source| SceneError::Read { path: path.to_owned(), source };
    let mut text = String::new();
    let (file, _) = crate::files::open_regular(path).map_err(failed)?;
    file.take(limit + 1).read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > limit {
        return Err(SceneError::CameraFile {
            path: path.to_owned(),
            reason: format!("it is longer than {limit} bytes"),
        });
    }
    Ok(text)
}

impl CameraFile {
    /// The file of a camera that looks at a point so many metres ahead.
    pub fn of(camera: &Camera, distance: f64) -> Self {
        let DAffine3 { matrix3: rotation, translation: eye } = camera.world_from_camera;
        Self {
            position: eye.to_array(),
            target: (eye - distance * rotation.z_axis).to_array(),
            up: rotation.y_axis.as_vec3().to_array(),
            vertical_fov_degrees: camera.vertical_fov.to_degrees(),
            near: Some(camera.near),
        }
    }

    /// Reads and checks a camera file.
    ///
    /// # Errors
    /// [`SceneError::Read`] if the file cannot be read, [`SceneError::CameraFile`] if it is not valid TOML, has an unknown key,
    /// lacks one, or does not describe a camera.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let refuse = |reason: String| SceneError::CameraFile { path: path.to_owned(), reason };
        let text = read_text(path, MAX_FILE_BYTES)?;
        let file: Self = toml::from_str(&text).map_err(|e| refuse(e.to_string().trim_end().to_owned()))?;
        match file.camera("file") {
            Ok(_) => Ok(file),
            Err(SceneError::Camera { reason, .. }) => Err(refuse(reason)),
            Err(other) => Err(other),
        }
    }

    /// The camera that the file describes.
    ///
    /// # Errors
    /// [`SceneError::Camera`], as [`Camera::look_at`] does, and if `near` is not between 1e-18 and 1e18 metres.
    pub fn camera(&self, name: &str) -> Result<Camera, SceneError> {
        let near = self.near.unwrap_or(DEFAULT_NEAR);
        if !NEAR_RANGE.contains(&near) {
            let (least, most) = (NEAR_RANGE.start(), NEAR_RANGE.end());
            let reason = format!("near is {near:e}, wanted {least:e} to {most:e} metres");
            return Err(SceneError::Camera { name: name.to_owned(), reason });
        }
        let fov = self.vertical_fov_degrees.to_radians();
        let camera = Camera::look_at(name, DVec3::from(self.position), DVec3::from(self.target), self.up.into(), fov)?;
        Ok(Camera { near, ..camera })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec4;

    fn camera() -> Camera {
        Camera::look_at("t", Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 0.5, -2.0), Vec3::Y, 0.7).unwrap()
    }

    #[test]
    fn clip_space_is_reversed_infinite_and_y_down() {
        let c = Camera { near: 0.25, ..camera() };
        let clip = c.clip_from_view(1.5);
        let project = |v: Vec3| {
            let p: Vec4 = clip * v.extend(1.0);
            p / p.w
        };
        assert!((project(Vec3::new(0.0, 0.0, -0.25)).z - 1.0).abs() < 1e-6);
        assert!(project(Vec3::new(0.0, 0.0, -1e9)).z < 1e-9);
        let top = project(Vec3::new(0.0, 2.0 * (0.35_f32).tan(), -2.0));
        assert!((top.y + 1.0).abs() < 1e-6, "the top edge is at y = -1: {top}");
        let right = project(Vec3::new(1.5 * 2.0 * (0.35_f32).tan(), 0.0, -2.0));
        assert!((right.x - 1.0).abs() < 1e-6, "the right edge is at x = 1: {right}");
    }

    #[test]
    fn the_projection_has_an_inverse_at_every_limit() {
        for near in [*NEAR_RANGE.start(), *NEAR_RANGE.end()] {
            for vertical_fov in [MIN_FOV, std::f32::consts::PI.next_down()] {
                for aspect in [1.0 / 16384.0, 1.0, 16384.0] {
                    let clip = Camera { near, vertical_fov, ..camera() }.clip_from_view(aspect);
                    let inverse = clip.inverse();
                    assert!(inverse.is_finite(), "{near:e} {vertical_fov:e} {aspect}: {inverse}");
                    assert!(
                        (inverse.z_axis.w * near - 1.0).abs() < 1e-3,
                        "{near:e} {vertical_fov:e} {aspect}: {inverse}"
                    );
                }
            }
        }
    }

    #[test]
    fn view_undoes_the_camera_and_sees_the_target_ahead() {
        let c = camera();
        let both = c.view_from_world(DVec3::ONE) * Mat4::from(c.placed(DVec3::ONE));
        assert!(both.abs_diff_eq(Mat4::IDENTITY, 1e-5), "{both}");
        let seen = c.view_from_world(DVec3::ZERO).transform_point3(Vec3::new(-4.0, 0.5, -2.0));
        assert!(seen.x.abs() < 1e-5 && seen.y.abs() < 1e-5 && seen.z < 0.0, "{seen}");
        assert!((c.world_from_camera.matrix3.determinant() - 1.0).abs() < 1e-5);
        assert!(c.world_from_camera.matrix3.y_axis.y > 0.0);
    }

    #[test]
    fn degenerate_cameras_are_refused() {
        let look = |eye, target, up, fov| Camera::look_at("t", eye, target, up, fov).unwrap_err().to_string();
        assert!(look(Vec3::ONE, Vec3::ONE, Vec3::Y, 0.7).contains("both"));
        assert!(look(Vec3::Y, Vec3::ZERO, Vec3::Y, 0.7).contains("line of sight"));
        assert!(look(Vec3::X, Vec3::ZERO, Vec3::ZERO, 0.7).contains("no length"));
        assert!(look(Vec3::X, Vec3::splat(f32::NAN), Vec3::Y, 0.7).contains("target"));
        for fov in [0.0, -1.0, 3.2, f32::NAN] {
            assert!(look(Vec3::X, Vec3::ZERO, Vec3::Y, fov).contains("field of view"), "{fov}");
        }
    }

    #[test]
    fn camera_files_are_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            CameraFile::read(&path)
        };
        let good = read("position = [0.0, 1, 4]\ntarget = [0, 1, 0]\n").unwrap();
        assert_eq!((good.up, good.vertical_fov_degrees, good.near), ([0.0, 1.0, 0.0], 40.0, None));
        assert_eq!(good.camera("c").unwrap().near, DEFAULT_NEAR);
        let base = "position = [0, 1, 4]\ntarget = [0, 1, 0]\n";
        for (extra, says) in [
            ("upp = [0, 1, 0]\n", "upp"),
            ("vertical_fov_degrees = 180\n", "field of view"),
            ("vertical_fov_degrees = nan\n", "field of view"),
            ("vertical_fov_degrees = 1e-30\n", "field of view"),
            ("near = 0.0\n", "near"),
            ("near = 1e-40\n", "near"),
            ("near = 1e38\n", "near"),
            ("up = [0, 0, 1]\n", "line of sight"),
            ("up = [0, inf, 1]\n", "up"),
        ] {
            let message = read(&format!("{base}{extra}")).unwrap_err().to_string();
            assert!(message.contains("c.toml") && message.contains(says), "{extra}: {message}");
        }
        assert!(read("position = [0, 1, 4]\n").unwrap_err().to_string().contains("target"));
        assert!(matches!(CameraFile::read(&folder.path().join("none.toml")), Err(SceneError::Read { .. })));
    }
}
