//! One layer of a shadow map: its placement in the world, and tests of what it contains.
use glam::{DVec3, Mat4, Vec4};
use magpie::ray::Bounds;
use magpie_shaders::shadow_map::{MapDrawParams, MapLayer};
use std::hash::{Hash, Hasher};

/// A box along a directional light, or a pyramid with its apex at a local light. Coordinates are absolute world coordinates in `f64`, so they do
/// not depend on the floating origin of the frame. `right`, `down` and `forward` are orthogonal, and `right x down` points along `forward`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// A box rather than a pyramid.
    pub is_box: bool,
    /// Centre of the far side of a box, or apex of a pyramid, metres.
    pub origin: DVec3,
    /// From the centre to the right edge, metres; for a pyramid at a distance of one metre from the apex.
    pub right: DVec3,
    /// From the centre to the lower edge, of the same length as `right`.
    pub down: DVec3,
    /// Unit direction in which light travels through the centre.
    pub forward: DVec3,
    /// Depth of a box, or distance of the near plane of a pyramid from its apex, metres.
    pub depth: f64,
}

/// Unit vectors to the right and down of a map that looks along the unit vector `forward`.
pub fn across(forward: DVec3) -> (DVec3, DVec3) {
    let right = forward.any_orthonormal_vector();
    (right, forward.cross(right))
}

impl Layer {
    /// Clip space from the world relative to `origin`. Depth is reversed: 1 at the near side; 0 at the far side of a box, or infinitely far in a
    /// pyramid.
    pub fn clip_from_world(&self, origin: DVec3) -> Mat4 {
        let from = self.origin - origin;
        let square = self.right.length_squared();
        let row = |v: DVec3| v.extend(-v.dot(from)).as_vec4();
        let (x, y, z) = (row(self.right / square), row(self.down / square), row(self.forward));
        if self.is_box {
            Mat4::from_cols(x, y, -z / self.depth as f32, Vec4::W).transpose()
        } else {
            Mat4::from_cols(x, y, Vec4::W * self.depth as f32, z).transpose()
        }
    }

    /// The shader's struct, relative to `origin`.
    pub fn shared(&self, origin: DVec3) -> MapLayer {
        let single = |v: DVec3| v.as_vec3().to_array();
        MapLayer {
            origin: single(self.origin - origin),
            right: single(self.right),
            down: single(self.down),
            forward: single(self.forward),
            depth: self.depth as f32,
        }
    }

    /// Parameters for drawing the layer, relative to `origin`, with `side` texels on a side. The caller sets `scene`.
    pub fn draw_params(&self, origin: DVec3, side: u32) -> MapDrawParams {
        let light = if self.is_box { self.forward } else { self.origin - origin };
        MapDrawParams {
            clip_from_world: self.clip_from_world(origin).to_cols_array_2d(),
            light: light.as_vec3().to_array(),
            is_parallel: self.is_box.into(),
            texel: (2.0 * self.right.length() / f64::from(side)) as f32,
            ..Default::default()
        }
    }

    /// Whether a bounding box relative to `origin` may intersect the layer.
    pub fn meets(&self, bounds: &Bounds, origin: DVec3) -> bool {
        if bounds.is_empty() {
            return false;
        }
        let half = 0.5 * (bounds.max - bounds.min).as_dvec3();
        let centre = bounds.centre().as_dvec3() + origin - self.origin;
        // Greatest value of the dot product with `along` over the box.
        let max_dot = |along: DVec3| along.dot(centre) + along.abs().dot(half);
        let sides = [self.right, -self.right, self.down, -self.down];
        if self.is_box {
            let square = self.right.length_squared();
            let inside = sides.iter().all(|side| -max_dot(-*side) <= square);
            return inside && max_dot(-self.forward) >= 0.0 && -max_dot(self.forward) <= self.depth;
        }
        let square = self.right.length_squared();
        max_dot(self.forward) >= 0.0 && sides.iter().all(|side| max_dot(square * self.forward - *side) >= 0.0)
    }

    /// Hashes all fields.
    pub fn hash(&self, into: &mut impl Hasher) {
        self.is_box.hash(into);
        for v in [self.origin, self.right, self.down, self.forward] {
            v.to_array().map(f64::to_bits).hash(into);
        }
        self.depth.to_bits().hash(into);
    }
}

/// The faces of a cube around a local light: six, or, for a one-sided light, the five that see the side of `facing`. `near` is the
/// distance of the near plane, metres.
pub fn faces(position: DVec3, facing: Option<DVec3>, near: f64) -> Vec<Layer> {
    let forward = facing.unwrap_or(DVec3::Z);
    let (right, down) = across(forward);
    // The right vector of each face is an axis of the cube, so that the edges of faces coincide.
    let around =
        [(forward, right), (right, down), (-right, down), (down, forward), (-down, forward), (-forward, right)];
    let count = if facing.is_some() { 5 } else { 6 };
    let one = |(forward, right): &(DVec3, DVec3)| Layer {
        is_box: false,
        origin: position,
        right: *right,
        down: forward.cross(*right),
        forward: *forward,
        depth: near,
    };
    around[..count].iter().map(one).collect()
}

/// A pyramid with this tangent of half its angle.
pub fn face(position: DVec3, forward: DVec3, tangent: f64, near: f64) -> Layer {
    let (right, down) = across(forward);
    Layer { is_box: false, origin: position, right: right * tangent, down: down * tangent, forward, depth: near }
}

/// The bounding box of all bounds, which are relative to `origin`, in absolute world coordinates. It is enlarged to a coarse grid, so that it
/// does not change when something in the scene moves a little. `None` if it is empty or not finite.
pub fn coarse_box<'a>(all: impl Iterator<Item = &'a Bounds>, origin: DVec3) -> Option<[DVec3; 2]> {
    /// The diagonal is at least half this many cells long.
    const CELLS: f64 = 16.0;
    /// Least diagonal, metres, for scenes that are a single point.
    const LEAST: f64 = 1e-6;
    let all = all.fold(Bounds::EMPTY, |sum, one| sum.union(*one));
    let finite = all.min.is_finite() && all.max.is_finite();
    if all.is_empty() || !finite {
        return None;
    }
    let diagonal = f64::from((all.max - all.min).length()).max(LEAST);
    let cell = (diagonal / CELLS).log2().ceil().exp2();
    let [min, max] = [all.min, all.max].map(|corner| (corner.as_dvec3() + origin) / cell);
    Some([min.floor() * cell, max.ceil() * cell])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn seen(layer: &Layer, point: DVec3) -> Vec3 {
        let origin = DVec3::new(100.0, -20.0, 3.0);
        let clip = layer.clip_from_world(origin) * (point - origin).as_vec3().extend(1.0);
        clip.truncate() / clip.w
    }

    #[test]
    fn depth_is_reversed_in_boxes_and_pyramids() {
        let forward = DVec3::new(0.3, -0.8, 0.2).normalize();
        let (right, down) = across(forward);
        assert!(right.cross(down).distance(forward) < 1e-12);
        let layer = Layer { is_box: true, origin: DVec3::X, right: right * 2.0, down: down * 2.0, forward, depth: 8.0 };
        for (along, depth) in [(0.0, 0.0), (-4.0, 0.5), (-8.0, 1.0)] {
            let at = seen(&layer, DVec3::X + 2.0 * right - down + along * forward);
            assert!(at.distance(Vec3::new(1.0, -0.5, depth)) < 1e-4, "{at}");
        }
        let layer = face(DVec3::Y, forward, 0.5, 0.25);
        for (along, depth) in [(0.25, 1.0), (1.0, 0.25), (10.0, 0.025)] {
            let at = seen(&layer, DVec3::Y + along * (forward + 0.5 * right - 0.25 * down));
            assert!(at.distance(Vec3::new(1.0, -0.5, depth)) < 1e-4, "{at}");
        }
    }

    #[test]
    fn every_direction_goes_through_one_face() {
        for (facing, count) in [(None, 6), (Some(DVec3::new(0.1, -0.9, 0.2).normalize()), 5)] {
            let all = faces(DVec3::ZERO, facing, 1e-3);
            assert_eq!(all.len(), count);
            let mut through = 0;
            for i in 0..1000 {
                let (y, turn) = (1.0 - (2.0 * f64::from(i) + 1.0) / 1000.0, 2.4 * f64::from(i));
                let flat = (1.0 - y * y).sqrt();
                let way = DVec3::new(flat * turn.cos(), y, flat * turn.sin());
                let met = all.iter().filter(|f| {
                    let z = way.dot(f.forward);
                    z > 0.0 && way.dot(f.right).abs() <= z && way.dot(f.down).abs() <= z
                });
                let met = met.count();
                through += met;
                assert!(met <= 1 && (met == 1 || facing.is_some_and(|f| way.dot(f) < 0.0)), "{way}: {met}");
            }
            assert!(through >= 500, "{through}");
        }
    }

    #[test]
    fn what_lies_beside_a_layer_is_left_out() {
        let unit = |x: f32, y: f32, z: f32| {
            let at = Vec3::new(x, y, z);
            Bounds { min: at - 0.5, max: at + 0.5 }
        };
        let layer = face(DVec3::ZERO, DVec3::NEG_Z, 1.0, 1e-3);
        let meets = |b: Bounds| layer.meets(&b, DVec3::ZERO);
        assert!(meets(unit(0.0, 0.0, -3.0)) && meets(unit(0.0, 0.0, 0.0)) && meets(unit(3.9, 0.0, -3.0)));
        assert!(!meets(unit(0.0, 0.0, 2.0)) && !meets(unit(4.2, 0.0, -3.0)) && !meets(Bounds::EMPTY));
        let down = DVec3::NEG_Y;
        let layer =
            Layer { is_box: true, origin: DVec3::ZERO, right: DVec3::X, down: DVec3::Z, forward: down, depth: 5.0 };
        let meets = |b: Bounds| layer.meets(&b, DVec3::ZERO);
        assert!(meets(unit(1.4, 0.0, 0.0)) && meets(unit(0.0, 5.4, 0.0)) && meets(unit(0.0, 2.0, -1.4)));
        assert!(!meets(unit(1.6, 0.0, 0.0)) && !meets(unit(0.0, 5.6, 0.0)) && !meets(unit(0.0, -0.6, 0.0)));
    }

    #[test]
    fn a_box_around_the_scene_stays_where_it_is_while_little_moves() {
        let origin = DVec3::new(1e6, 0.0, 0.0);
        let at = |x: f32| Bounds { min: Vec3::new(x, 0.1, 0.1), max: Vec3::new(x + 9.0, 9.0, 9.0) };
        let of = |x: f32| coarse_box([at(x)].iter(), origin).unwrap();
        assert_eq!(of(0.1), of(0.2));
        let [min, max] = of(0.1);
        assert!(min.cmple(DVec3::new(1e6 + 0.1, 0.1, 0.1)).all() && max.cmpge(DVec3::new(1e6 + 9.1, 9.0, 9.0)).all());
        assert!((max - min).max_element() <= 9.0 + 4.0, "{min} {max}");
        assert!(coarse_box([].iter(), origin).is_none());
    }
}
