//! Placement of the cascades of directional lights.
use super::layer::{Layer, across};
use glam::DVec3;
use magpie::scene::Camera;

/// A cascade follows the camera in steps of its side length over this number. A step is a whole number of texels, so texels keep their
/// positions in the world, edges do not shimmer, and most frames of a moving camera need no new map. Must be a power of two, at most the
/// smallest map size.
const STEPS: f64 = 16.0;

/// A cascade is deeper than the scene by this share on either side, so that no occluder has the clear depth.
const MARGIN: f64 = 1.0 / 64.0;

/// How the view is divided into cascades.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Division {
    /// Greatest number of cascades.
    pub count: u32,
    /// 0 divides distances uniformly, 1 logarithmically; values in between interpolate.
    pub split: f64,
    /// Distance from the camera at which the last cascade ends, metres.
    pub distance: f64,
}

/// Distances at which the cascades end, metres: the uniform and the logarithmic division, interpolated by `split` (Zhang, Sun,
/// Xu and Lun 2006, "Parallel-Split Shadow Maps for Large-scale Virtual Environments").
pub fn ends(near: f64, far: f64, division: &Division) -> Vec<f64> {
    let end = |i: u32| {
        let share = f64::from(i) / f64::from(division.count);
        let (uniform, logarithmic) = (near + (far - near) * share, near * (far / near).powf(share));
        division.split * logarithmic + (1.0 - division.split) * uniform
    };
    (1..=division.count).map(end).collect()
}

/// The smallest sphere around the part of the view frustum between two distances, with its centre on the view axis: distance of the
/// centre, and radius. `spread` is the squared tangent of half the diagonal angle of view.
fn sphere(near: f64, far: f64, spread: f64) -> (f64, f64) {
    let (sum, difference) = (far + near, far - near);
    if spread * sum >= difference {
        // The smallest sphere around the far side also contains the near side.
        (far, far * spread.sqrt())
    } else {
        let centre = 0.5 * sum * (1.0 + spread);
        (centre, ((far - centre).powi(2) + far * far * spread).sqrt())
    }
}

/// The cascades of a directional light that travels along `forward`, the finest first. Each is a square around the bounding sphere of a
/// part of the view, so that it neither rotates nor changes its size with the camera. `scene` is a bounding box of everything; each cascade
/// spans its whole depth along the light, so that all occluders are drawn. A cascade that would be wider than the scene covers the scene
/// instead, and is the last one.
pub fn cascades(camera: &Camera, aspect: f64, scene: [DVec3; 2], forward: DVec3, division: &Division) -> Vec<Layer> {
    let (right, down) = across(forward);
    let (middle, half) = (0.5 * (scene[0] + scene[1]), 0.5 * (scene[1] - scene[0]));
    let reach = |along: DVec3| along.abs().dot(half);
    // Along the light: depth of the scene, and where it ends.
    let depth = 2.0 * (1.0 + 2.0 * MARGIN) * reach(forward).max(1e-6 * half.length());
    let end = middle.dot(forward) + 0.5 * depth;
    let layer = |x: f64, y: f64, half_side: f64| Layer {
        is_box: true,
        origin: right * x + down * y + forward * end,
        right: right * half_side,
        down: down * half_side,
        forward,
        depth,
    };
    let scene_half_side = reach(right).max(reach(down)) * (1.0 + MARGIN);

    let (eye, near) = (camera.eye(), f64::from(camera.near));
    let furthest = [scene[0], scene[1]].map(|c| (c - eye).abs()).iter().fold(DVec3::ZERO, |a, b| a.max(*b)).length();
    // Rounded up in steps of sqrt(2), so that it rarely changes.
    let furthest = (0.5 * (2.0 * furthest.log2()).ceil()).exp2();
    let far = division.distance.min(furthest).max(2.0 * near);
    let tangent = (0.5 * f64::from(camera.vertical_fov)).tan();
    let spread = tangent * tangent * (1.0 + aspect * aspect);
    let ahead = -camera.world_from_camera.matrix3.z_axis;

    let mut layers = Vec::new();
    let mut begin = near;
    for end in ends(near, far, division) {
        let (centre, radius) = sphere(begin, end, spread);
        begin = end;
        // Wider by half a step on either side, as rounding may move the centre by that much.
        let half_side = radius * STEPS / (STEPS - 1.0);
        if half_side >= scene_half_side {
            layers.push(layer(middle.dot(right), middle.dot(down), scene_half_side));
            break;
        }
        let step = 2.0 * half_side / STEPS;
        let snapped = |v: f64| (v / step).round() * step;
        let centre = eye + centre * ahead;
        layers.push(layer(snapped(centre.dot(right)), snapped(centre.dot(down)), half_side));
    }
    layers
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const DIVISION: Division = Division { count: 4, split: 0.75, distance: 100.0 };
    const SCENE: [DVec3; 2] = [DVec3::new(-512.0, -16.0, -512.0), DVec3::new(512.0, 64.0, 512.0)];

    fn camera(eye: DVec3, to: DVec3) -> Camera {
        Camera { near: 0.1, ..Camera::look_at("t", eye, to, Vec3::Y, 0.7).unwrap() }
    }

    fn cascades_of(eye: DVec3, to: DVec3) -> Vec<Layer> {
        cascades(&camera(eye, to), 16.0 / 9.0, SCENE, DVec3::new(0.4, -0.7, 0.3).normalize(), &DIVISION)
    }

    #[test]
    fn the_division_ends_at_the_far_distance_and_lies_between_its_limits() {
        let at = |split: f64| ends(0.1, 100.0, &Division { split, ..DIVISION });
        let (uniform, mixed, logarithmic) = (at(0.0), at(0.5), at(1.0));
        for i in 0..4 {
            assert!(logarithmic[i] <= mixed[i] && mixed[i] <= uniform[i]);
            assert!(i == 0 || mixed[i] > mixed[i - 1]);
        }
        for ends in [&uniform, &mixed, &logarithmic] {
            assert!((ends[3] - 100.0).abs() < 1e-9, "{ends:?}");
        }
        assert!((logarithmic[1] / logarithmic[0] - logarithmic[2] / logarithmic[1]).abs() < 1e-9);
    }

    #[test]
    fn spheres_hold_the_corners_of_their_part_and_touch_one() {
        for (near, far, spread) in [(0.1, 1.0, 0.05), (1.0, 50.0, 0.4), (0.1, 100.0, 2.0), (10.0, 11.0, 0.01_f64)] {
            let (centre, radius) = sphere(near, far, spread);
            let to = |z: f64| ((z - centre).powi(2) + z * z * spread).sqrt();
            assert!(to(near).max(to(far)) <= radius * (1.0 + 1e-12));
            assert!(to(far) >= radius * (1.0 - 1e-12) || to(near) >= radius * (1.0 - 1e-12));
        }
    }

    #[test]
    fn the_view_is_covered_wherever_the_camera_is() {
        for i in 0..50 {
            let t = f64::from(i);
            let (eye, to) =
                (DVec3::new(3.0 * t, 2.0 + t.sin(), -2.0 * t), DVec3::new((2.1 * t).cos() * 900.0, 0.0, 300.0));
            let camera = camera(eye, to);
            let (layers, ends) = (cascades_of(eye, to), ends(0.1, 100.0, &DIVISION));
            assert_eq!(layers.len(), 4);
            let tangent = (0.5 * f64::from(camera.vertical_fov)).tan();
            let mut begin = 0.1;
            for (layer, end) in layers.iter().zip(ends) {
                for (z, x, y) in
                    [(begin, -1.0, -1.0), (begin, 1.0, 1.0), (end, -1.0, 1.0), (end, 1.0, 1.0), (end, 1.0, -1.0)]
                {
                    let local = DVec3::new(x * tangent * z * 16.0 / 9.0, y * tangent * z, -z);
                    let v = camera.world_from_camera.transform_point3(local) - layer.origin;
                    let square = layer.right.length_squared() * (1.0 + 1e-9);
                    assert!(v.dot(layer.right).abs() <= square && v.dot(layer.down).abs() <= square, "{i}");
                }
                begin = end;
            }
        }
    }

    #[test]
    fn texels_stay_where_they_are_and_the_size_does_not_change() {
        let first = cascades_of(DVec3::ZERO, DVec3::Z);
        let mut still = 0;
        for i in 1..200 {
            let t = 0.01 * f64::from(i);
            let moved = cascades_of(DVec3::new(t, 0.2 * t, -t), DVec3::new(t.sin(), 0.0, t.cos()));
            for (a, b) in first.iter().zip(&moved) {
                assert_eq!((a.right, a.down, a.forward, a.depth), (b.right, b.down, b.forward, b.depth));
                let texel = 2.0 * a.right.length() / 512.0;
                let unit = [a.right, a.down].map(DVec3::normalize);
                for axis in unit {
                    let texels = (b.origin - a.origin).dot(axis) / texel;
                    assert!((texels - texels.round()).abs() < 1e-6, "{texels}");
                }
                assert!((b.origin - a.origin).dot(a.forward).abs() < 1e-9);
                still += usize::from(a.origin == b.origin);
            }
        }
        assert!(still > 100, "{still} of 796 did not move at all");
    }

    #[test]
    fn a_small_scene_has_one_map_that_never_moves() {
        let scene = [DVec3::splat(-1.0), DVec3::splat(1.0)];
        let of = |eye: DVec3| cascades(&camera(eye, DVec3::ZERO), 1.0, scene, DVec3::NEG_Y, &DIVISION);
        let layers = of(DVec3::new(0.0, 1.0, 20.0));
        assert!(layers.len() < 4, "{}", layers.len());
        assert_eq!(layers.last(), of(DVec3::new(4.0, 1.0, 19.0)).last());
        assert!(layers.last().unwrap().right.length() < 1.1);
    }
}
