//! What rays see of a scene, and how its acceleration structures are kept up to date.
use crate::measure::Acceleration;
use crate::ray::Bounds;
use crate::scene::Camera;
use glam::{Affine3A, DVec3, Vec3};

/// How the acceleration structures follow a scene that moves, and what is left out of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Policy {
    /// Frames between two rebuilds of a deforming mesh's tree; between them it is refitted. 0 never rebuilds.
    pub rebuild_every: u32,
    /// The top level is refitted and rebuilt likewise, instead of being built anew every frame in which something moved.
    pub refit_top: bool,
    /// What rays do not see.
    pub culling: Culling,
}

impl Default for Policy {
    fn default() -> Self {
        Self { rebuild_every: 64, refit_top: false, culling: Culling::default() }
    }
}

impl Policy {
    /// Whether the top level is refitted in a frame.
    pub(super) fn refits(&self, frame: u64) -> bool {
        self.refit_top && (self.rebuild_every == 0 || !frame.is_multiple_of(u64::from(self.rebuild_every)))
    }

    /// Whether a deforming mesh is rebuilt in a frame; they take turns.
    pub(super) fn rebuilds(&self, frame: u64, mesh: usize) -> bool {
        self.rebuild_every > 0 && (frame + mesh as u64).is_multiple_of(u64::from(self.rebuild_every))
    }
}

/// Instances that rays do not see, to save the time of tracing them. All off by default: shadows and reflections of what is left out
/// are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Culling {
    /// Those further from the eye than this, metres; 0 leaves none out.
    pub distance: f32,
    /// Those outside of the view frustum with its half angles times this, at least 1, and not around the eye; 0 leaves none out.
    pub frustum: f32,
    /// Those that the eye sees under a smaller solid angle than this, steradians; 0 leaves none out.
    pub solid_angle: f32,
}

/// An instance as the top level wants it.
pub(super) struct Seen {
    /// Index into the meshes, deforming ones after all others.
    pub mesh: usize,
    pub world_from_object: Affine3A,
    pub traced: bool,
}

impl Culling {
    /// Nothing is left out.
    pub fn is_off(&self) -> bool {
        *self == Self::default()
    }

    /// Decides about a box in the world, `bounds` and the camera counted from the same `origin`.
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

    /// Whether a sphere touches the cone around the frustum, its half angle times the factor. The cone holds the corners of a frame
    /// twice as wide as it is high.
    fn in_cone(&self, towards: Vec3, radius: f32, camera: &Camera) -> bool {
        let half = (0.5 * camera.vertical_fov).tan() * 5.0_f32.sqrt();
        let widest = half.atan() * self.frustum;
        let forward = camera.forward();
        let away = forward.angle_between(towards.normalize_or(forward));
        let reach = (radius / towards.length().max(radius)).asin();
        away - reach <= widest
    }
}

/// Solid angle of a sphere, steradians; all around for one that holds the eye.
fn solid_angle(distance: f32, radius: f32) -> f32 {
    let sine = (radius / distance.max(radius)).min(1.0);
    if distance <= radius {
        return 4.0 * std::f32::consts::PI;
    }
    // 2 pi (1 - cos), without the difference of near numbers.
    let cosine = (1.0 - sine * sine).sqrt();
    2.0 * std::f32::consts::PI * sine * sine / (1.0 + cosine)
}
