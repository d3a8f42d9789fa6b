//! The world point that is the origin of coordinates on the device.
use super::Camera;
use glam::DVec3;

/// Width of a grid cell, in near-plane distances.
const CELL: f64 = 4096.0;

/// An origin that follows the camera in steps. Near the camera, coordinates in `f32` keep their precision, however far it is from
/// the world's origin, and between two steps nothing changes on the device.
///
/// A cell is about 4096 near-plane distances wide, rounded to a power of two, because the near plane indicates what is small in a picture.
/// The camera is never more than one cell from the origin, so 24 bits resolve at least 1/4096 of the near-plane distance. The origin stays
/// that of the world while the camera is within one cell of it. When the camera is further than one cell away, the origin moves to the
/// nearest grid corner, at most half a cell from the camera, so that small movements back and forth do not move it again.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FloatingOrigin {
    at: DVec3,
}

impl FloatingOrigin {
    /// Updates the origin for a camera and returns it, in metres of the world.
    pub fn follow(&mut self, camera: &Camera) -> DVec3 {
        let cell = (CELL * f64::from(camera.near)).log2().round().exp2();
        let eye = camera.eye();
        if (eye - self.at).abs().max_element() > cell {
            self.at = (eye / cell).round() * cell;
        }
        self.at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, Vec3};

    fn at(x: f64, near: f32) -> Camera {
        let camera = Camera::look_at("t", DVec3::X, DVec3::ZERO, Vec3::Y, 1.0).unwrap();
        Camera { world_from_camera: DAffine3 { translation: DVec3::X * x, ..camera.world_from_camera }, near, ..camera }
    }

    #[test]
    fn it_stays_until_the_eye_is_a_cell_away_and_then_steps_to_the_grid() {
        let mut origin = FloatingOrigin::default();
        let mut went = |x| origin.follow(&at(x, 1.0 / 64.0)).x; // cells of 64 m
        assert_eq!([0.0, 63.0, -64.0].map(&mut went), [0.0; 3]);
        assert_eq!([65.0, 100.0, 128.0, 1.0, 0.0].map(&mut went), [64.0; 5]);
        assert_eq!([-0.5, -63.0, 62.0].map(&mut went), [0.0; 3]);
        assert_eq!([1e6, 1e6 + 50.0].map(&mut went), [1e6, 1e6]);
    }

    #[test]
    fn the_eye_is_near_at_every_scale() {
        for near in [1e-18_f32, 1e-6, 0.01, 3.7, 1e18] {
            for x in [0.0, 1e-3, 1.0, 1e6, -1.234_567_89e9] {
                let origin = FloatingOrigin::default().follow(&at(x, near)).x;
                let most = 6000.0 * f64::from(near);
                // As near as f64 can represent.
                assert!((x - origin).abs() <= most.max(x.abs() * 1e-15), "near {near:e}, eye {x:e}: {origin:e}");
            }
        }
    }
}
