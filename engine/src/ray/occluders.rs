//! Visibility between two points, computed on the host: for decisions about a scene, not for rendering.
use super::Bounds;
use super::split::binary_tree;
use glam::{DMat3, DVec3, Vec3};
use obvhs::bvh2::Bvh2;
use obvhs::ray::Ray;

/// Fraction of a segment at either end in which hits are ignored, because the ends are on surfaces.
const ENDS: f64 = 1e-3;

/// Opaque geometry that blocks light from both sides.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Occluder {
    /// Three corners, metres.
    Triangle([DVec3; 3]),
    /// An ellipsoid: its centre, and the transform of the unit sphere to world space, which must be invertible.
    Ball(DVec3, DMat3),
}

impl Occluder {
    fn bounds(&self) -> [DVec3; 2] {
        match self {
            Self::Triangle([a, b, c]) => [a.min(*b).min(*c), a.max(*b).max(*c)],
            Self::Ball(centre, shape) => {
                let rows = shape.transpose();
                let half = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
                [centre - half, centre + half]
            }
        }
    }

    /// Whether the segment from `from` to `from + d` hits it, apart from the ends.
    fn meets(&self, from: DVec3, d: DVec3) -> bool {
        let inner = |t: f64| t > ENDS && t < 1.0 - ENDS;
        match self {
            Self::Triangle([a, b, c]) => {
                // Möller and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection".
                let (u, v, s) = (b - a, c - a, from - a);
                let (p, q) = (d.cross(v), s.cross(u));
                let determinant = u.dot(p);
                let [x, y, t] = [s.dot(p), d.dot(q), v.dot(q)].map(|k| k / determinant);
                x >= 0.0 && y >= 0.0 && x + y <= 1.0 && inner(t)
            }
            Self::Ball(centre, shape) => {
                let into = shape.inverse();
                let (o, d) = (into * (from - centre), into * d);
                let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
                let root = (b * b - a * c).max(0.0).sqrt();
                b * b >= a * c && (inner((-b - root) / a) || inner((-b + root) / a))
            }
        }
    }
}

/// A BVH over occluders.
pub(crate) struct Occluders {
    all: Vec<Occluder>,
    tree: Bvh2,
    low: DVec3,
    scale: f64,
}

impl Occluders {
    /// Builds the BVH. Occluders that are not finite are left out.
    pub fn new(all: impl Iterator<Item = Occluder>) -> Self {
        let mut all: Vec<Occluder> = all.filter(|o| o.bounds().iter().all(|p| p.is_finite())).collect();
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let [low, high] = all.iter().map(Occluder::bounds).fold(none, |[l, h], [a, b]| [l.min(a), h.max(b)]);
        // At unit size, boxes in single precision suffice, if they are slightly enlarged.
        let scale = 1.0 / (high - low).max_element().max(f64::MIN_POSITIVE);
        let boxed = |o: &Occluder| {
            let [min, max] = o.bounds().map(|p| ((p - low) * scale).as_vec3());
            Bounds { min: min - Vec3::splat(1e-6), max: max + Vec3::splat(1e-6) }
        };
        let boxes: Vec<Bounds> = all.iter().map(boxed).collect();
        let tree = binary_tree(&boxes);
        all = tree.primitive_indices.iter().map(|i| all[*i as usize]).collect();
        Self { all, tree, low, scale }
    }

    /// Whether any occluder lies between two points.
    pub fn between(&self, from: DVec3, to: DVec3) -> bool {
        if self.all.is_empty() {
            return false;
        }
        let unit = |p: DVec3| ((p - self.low) * self.scale).as_vec3a();
        let ray = Ray::new(unit(from), unit(to) - unit(from), 0.0, 1.0);
        let met = |_: &Ray, at: usize| if self.all[at].meets(from, to - from) { 0.5 } else { f32::INFINITY };
        !self.tree.ray_traverse_miss(ray, met)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_says_what_a_search_through_all_says() {
        let at = |i: f64| DVec3::new((i * 0.754_877).fract(), (i * 0.569_840).fract(), (i * 0.618_034).fract()) * 10.0;
        let occluder = |i: u32| {
            let (i, p) = (f64::from(i), at(f64::from(i)));
            match i as u32 % 3 {
                0 => Occluder::Ball(p, DMat3::from_diagonal(DVec3::new(0.3, 0.5, 0.2))),
                _ => Occluder::Triangle([p, p + at(i + 0.3) * 0.1, p + at(i + 0.7) * 0.1]),
            }
        };
        let all: Vec<Occluder> = (1..300).map(occluder).collect();
        let tree = Occluders::new(all.iter().copied());
        let mut hidden = 0;
        for i in 0..2000 {
            let (from, to) = (at(f64::from(i) + 0.123), at(f64::from(i) * 3.0 + 0.456));
            let wanted = all.iter().any(|o| o.meets(from, to - from));
            assert_eq!(tree.between(from, to), wanted, "{from} {to}");
            hidden += usize::from(wanted);
        }
        assert!((300..1700).contains(&hidden), "{hidden}");
        assert!(!Occluders::new(std::iter::empty()).between(DVec3::ZERO, DVec3::ONE));
    }
}
