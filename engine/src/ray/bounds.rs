//! Axis-aligned bounding boxes.
use glam::{Affine3A, DVec3, Vec3};

/// An axis-aligned bounding box. It is empty if `min > max` on any axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box around some points; empty for none.
    pub fn of_points(points: &[Vec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.union(Self { min: p, max: p }))
    }

    /// The smallest box around two boxes.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether it contains no point.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The centre of a box that is not empty.
    pub fn centre(&self) -> Vec3 {
        0.5 * self.min + 0.5 * self.max
    }

    /// Distance from a point to the nearest point of the box: 0 inside of it, infinite where it is empty.
    pub fn distance_to(&self, point: DVec3) -> f64 {
        let beyond = (self.min.as_dvec3() - point).max(point - self.max.as_dvec3());
        beyond.max(DVec3::ZERO).length()
    }

    /// Half the surface area of a box that is not empty.
    pub fn half_area(&self) -> f32 {
        let d = self.max - self.min;
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// A world-space box around this one after a transform.
    ///
    /// Each axis is the sum of the smallest and largest products (Arvo 1990, "Transforming axis-aligned bounding boxes"), in `f64`. The
    /// result is widened by the rounding error of a shader that transforms points in `f32`, so that a point on the mesh is never outside.
    pub fn transformed(&self, world_from_object: &Affine3A) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        /// Eight unit roundoffs of `f32`: one per product and sum of a row, in both directions, with a margin.
        const ROUNDING: f64 = 8.0 / (1_u64 << 24) as f64;
        let (lower, upper) = (self.min.as_dvec3(), self.max.as_dvec3());
        let offset = world_from_object.translation.as_dvec3();
        let (mut min, mut max, mut size) = (offset, offset, offset.abs());
        for axis in 0..3 {
            let column = world_from_object.matrix3.col(axis).as_dvec3();
            let (a, b) = (column * lower[axis], column * upper[axis]);
            min += a.min(b);
            max += a.max(b);
            size += a.abs().max(b.abs());
        }
        let (min, max) = (min - ROUNDING * size, max + ROUNDING * size);
        Self { min: min.as_vec3().map(f32::next_down), max: max.as_vec3().map(f32::next_up) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_is_that_to_the_nearest_point() {
        let unit = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
        let to = |x: f64, y: f64, z: f64| unit.distance_to(DVec3::new(x, y, z));
        assert_eq!([to(0.5, 0.2, 0.9), to(1.0, 1.0, 1.0)], [0.0; 2]);
        assert_eq!([to(3.0, 0.5, 0.5), to(0.5, -2.0, 0.5), to(4.0, 0.5, -4.0)], [2.0, 2.0, 5.0]);
        assert_eq!(Bounds::EMPTY.distance_to(DVec3::ZERO), f64::INFINITY);
    }
}
