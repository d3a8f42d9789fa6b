//! Which instances rays see, and how the acceleration structures are updated.
use crate::measure::Acceleration;
use crate::ray::Bounds;
use crate::scene::Camera;
use glam::{Affine3A, DVec3, Vec3};

/// How acceleration structures follow a changing scene, and which instances they leave out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Policy {
    /// Number of frames between rebuilds of a deforming mesh's bottom level, which is refitted in between. 0 never rebuilds.
    pub rebuild_every: u32,
    /// Whether the top level is refitted between rebuilds too, instead of being rebuilt in every frame in which something moved.
    pub refit_top: bool,
    /// Which instances are culled from ray tracing.
    pub culling: Culling,
}

impl Default for Policy {
    fn default() -> Self {
        Self { rebuild_every: 64, refit_top: false, culling: Culling::default() }
    }
}

impl Policy {
    /// Whether the top level is refitted in this frame, rather than rebuilt.
    pub(super) fn refits(&self, frame: u64) -> bool {
        self.refit_top && (self.rebuild_every == 0 || !frame.is_multiple_of(u64::from(self.rebuild_every)))
    }

    /// Whether the bottom level of a deforming mesh is rebuilt in this frame. Meshes take turns.
    pub(super) fn rebuilds(&self, frame: u64, mesh: usize) -> bool {
        self.rebuild_every > 0 && (frame + mesh as u64).is_multiple_of(u64::from(self.rebuild_every))
    }
}

/// Culls instances from ray tracing, to save time. All off by default, because culled instances have no shadows and no reflections.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Culling {
    /// Culls instances further from the camera than this, metres; 0 is off.
    pub distance: f32,
    /// Culls instances outside a cone around the view frustum, enlarged by this factor on the half angle, at least 1. Instances
    /// that contain the camera are kept; 0 is off.
    pub frustum: f32,
    /// Culls instances whose solid angle from the camera is smaller than this, steradians; 0 is off.
    pub solid_angle: f32,
}

/// An instance as the top level needs it.
pub(super) struct Seen {
    /// Index into the meshes, with those of deforming instances after all others.
    pub mesh: usize,
    pub world_from_object: Affine3A,
    pub traced: bool,
}

impl Culling {
    /// Whether nothing is culled.
    pub fn is_off(&self) -> bool {
        *self == Self::default()
    }

    /// Decides whether an instance with this bounding box is traced, and counts the decision. `bounds` are relative to `origin`, metres.
    pub(super) fn decide(&self, bounds: &Bounds, camera: &Camera, origin: DVec3, counts: &mut Acceleration) -> bool {
        let eye = (camera.eye() - origin).as_vec3();
        let nearest = eye.clamp(bounds.min, bounds.max);
        let distance = eye.distance(nearest);
        let (centre, radius) = (bounds.centre(), 0.5 * (bounds.max - bounds.min).length());
        let verdict = if self.distance > 0.0 && distance > self.distance {
            &mut counts.far
        } else if self.frustum > 0.0 && distance > 0.0 && !self.in_cone(centre - eye, radius, camera) {
            &mut counts.outside
        } else if self.solid_angle > 0.0 && solid_angle(eye.distance(centre), radius) < self.solid_angle {
            &mut counts.small
        } else {
            counts.traced += 1;
            return true;
        };
        *verdict += 1;
        false
    }

    /// Whether a sphere touches the cone around the frustum, with its half angle enlarged. The cone contains the corners of a
    /// frame of aspect ratio 2.
    fn in_cone(&self, towards: Vec3, radius: f32, camera: &Camera) -> bool {
        let half = (0.5 * camera.vertical_fov).tan() * 5.0_f32.sqrt();
        let widest = half.atan() * self.frustum;
        let forward = camera.forward();
        let away = forward.angle_between(towards.normalize_or(forward));
        let reach = (radius / towards.length().max(radius)).asin();
        away - reach <= widest
    }
}

/// Solid angle of a sphere, steradians; 4 pi if it contains the camera.
fn solid_angle(distance: f32, radius: f32) -> f32 {
    let sine = (radius / distance.max(radius)).min(1.0);
    if distance <= radius {
        return 4.0 * std::f32::consts::PI;
    }
    // 2 pi (1 - cos), without cancellation.
    let cosine = (1.0 - sine * sine).sqrt();
    2.0 * std::f32::consts::PI * sine * sine / (1.0 + cosine)
}
