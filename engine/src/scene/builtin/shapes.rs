//! Procedural shapes with smooth normals, texture coordinates in metres, and counter-clockwise front faces.
use crate::scene::Mesh;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A mesh under construction: positions, normals, first texture coordinates and indices.
#[derive(Default)]
pub(super) struct Shape {
    pub mesh: Mesh,
}

impl Shape {
    pub fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) -> u32 {
        self.mesh.positions.push(position);
        self.mesh.normals.push(normal);
        self.mesh.uv0.push(uv);
        self.mesh.positions.len() as u32 - 1
    }

    /// Adds a triangle, unless two of its corners are the same.
    pub fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners.map(|i| self.mesh.positions[i as usize]);
        if (b - a).cross(c - a).length_squared() > 1e-16 {
            self.mesh.indices.extend(corners);
        }
    }

    /// Adds a flat quad with corners counter-clockwise from the front. Texture coordinates run along its first and last edge.
    pub fn quad(&mut self, corners: [Vec3; 4]) {
        let [a, b, c, d] = corners;
        let normal = (b - a).cross(d - a).normalize_or((c - b).cross(d - c).normalize_or(Vec3::Y));
        let along = (b - a).normalize_or((c - d).normalize_or(Vec3::X));
        let up = normal.cross(along);
        let uv = |p: Vec3| Vec2::new((p - a).dot(along), -(p - a).dot(up));
        let i = corners.map(|p| self.vertex(p, normal, uv(p)));
        self.triangle([i[0], i[1], i[2]]);
        self.triangle([i[0], i[2], i[3]]);
    }

    /// Adds another shape under a rigid transform (without scale).
    pub fn join(&mut self, other: &Shape, by: glam::Affine3A) {
        let first = self.mesh.positions.len() as u32;
        self.mesh.positions.extend(other.mesh.positions.iter().map(|p| by.transform_point3(*p)));
        self.mesh.normals.extend(other.mesh.normals.iter().map(|n| by.transform_vector3(*n)));
        self.mesh.uv0.extend(&other.mesh.uv0);
        self.mesh.indices.extend(other.mesh.indices.iter().map(|i| i + first));
    }
}

/// A box on the plane y = 0, centred on the y axis, with edges chamfered at 45 degrees by `cut` metres.
pub(super) fn block(width: f32, height: f32, depth: f32, cut: f32) -> Shape {
    let half = 0.5 * Vec3::new(width, height, depth);
    let inner = half - Vec3::splat(cut);
    let mut shape = Shape::default();
    // The corner in the direction of `sign`, on the face perpendicular to `axis`.
    let corner = |axis: usize, sign: Vec3| {
        let mut p = inner * sign;
        p[axis] = half[axis] * sign[axis];
        p + Vec3::Y * half.y
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [-1.0, 1.0] {
            let s = |su: f32, sv: f32| {
                let mut sign = Vec3::ZERO;
                (sign[axis], sign[u], sign[v]) = (side, su, sv);
                corner(axis, sign)
            };
            let (a, b, c, d) = (s(-1.0, -1.0), s(1.0, -1.0), s(1.0, 1.0), s(-1.0, 1.0));
            shape.quad(if side > 0.0 { [a, b, c, d] } else { [a, d, c, b] });
        }
    }
    if cut > 0.0 {
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (su, sv) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let at = |on: usize, along: f32| {
                    let mut sign = Vec3::ZERO;
                    (sign[axis], sign[u], sign[v]) = (along, su, sv);
                    corner(on, sign)
                };
                let q = [at(u, -1.0), at(v, -1.0), at(v, 1.0), at(u, 1.0)];
                shape.quad(if su * sv > 0.0 { q } else { [q[3], q[2], q[1], q[0]] });
            }
        }
        for i in 0..8 {
            let sign = Vec3::new([-1.0, 1.0][i & 1], [-1.0, 1.0][i >> 1 & 1], [-1.0, 1.0][i >> 2]);
            let [a, b, c] = [0, 1, 2].map(|axis| corner(axis, sign));
            let normal = sign.normalize();
            let corners = if sign.x * sign.y * sign.z > 0.0 { [a, b, c] } else { [a, c, b] };
            let i = corners.map(|p| shape.vertex(p, normal, Vec2::new(p.x + p.z, -p.y)));
            shape.triangle(i);
        }
    }
    shape
}

/// A surface of revolution about y. Each curve is a smooth run of (radius, height); there is a crease where one ends and the next
/// begins. The outside is to the right of the curves, for example from the bottom of an outer wall to its top.
pub(super) fn lathe(curves: &[Vec<Vec2>], segments: usize) -> Shape {
    let mut shape = Shape::default();
    let mut length = 0.0;
    for curve in curves {
        let n = curve.len();
        let widest = curve.iter().fold(0.0_f32, |w, p| w.max(p.x));
        let mut rings = Vec::with_capacity(n);
        for (i, p) in curve.iter().enumerate() {
            if i > 0 {
                length += p.distance(curve[i - 1]);
            }
            let tangent = (curve[(i + 1).min(n - 1)] - curve[i.saturating_sub(1)]).normalize_or(Vec2::Y);
            // On the axis, the normal of a smooth surface is parallel to the axis.
            let normal = if p.x == 0.0 && n > 2 {
                Vec2::new(0.0, -tangent.x.signum())
            } else {
                Vec2::new(tangent.y, -tangent.x)
            };
            let ring: Vec<u32> = (0..=segments)
                .map(|j| {
                    let (s, c) = (j as f32 / segments as f32 * TAU).sin_cos();
                    let (s, c) = if j == segments { (0.0, 1.0) } else { (s, c) };
                    let u = j as f32 / segments as f32 * (TAU * widest);
                    shape.vertex(
                        Vec3::new(p.x * c, p.y, p.x * s),
                        Vec3::new(normal.x * c, normal.y, normal.x * s),
                        Vec2::new(-u, -length),
                    )
                })
                .collect();
            rings.push(ring);
        }
        for pair in rings.windows(2) {
            for j in 0..segments {
                let (a, b, c, d) = (pair[0][j], pair[1][j], pair[1][j + 1], pair[0][j + 1]);
                shape.triangle([a, b, c]);
                shape.triangle([a, c, d]);
            }
        }
    }
    shape
}

/// A polyline of (radius, height).
pub(super) fn line(points: &[[f32; 2]]) -> Vec<Vec2> {
    points.iter().map(|p| Vec2::from(*p)).collect()
}

/// A Catmull-Rom spline through the points (Catmull and Rom 1974), with `steps` segments per span. Radii are clamped to 0.
pub(super) fn curve(points: &[[f32; 2]], steps: usize) -> Vec<Vec2> {
    let p = line(points);
    let n = p.len();
    let mut out = vec![p[0]];
    for i in 0..n - 1 {
        let (a, b, c, d) = (p[i.saturating_sub(1)], p[i], p[i + 1], p[(i + 2).min(n - 1)]);
        for k in 1..=steps {
            let t = k as f32 / steps as f32;
            let q = 0.5
                * (2.0 * b
                    + (c - a) * t
                    + (2.0 * a - 5.0 * b + 4.0 * c - d) * (t * t)
                    + (3.0 * b - a - 3.0 * c + d) * (t * t * t));
            out.push(if k == steps { c } else { Vec2::new(q.x.max(0.0), q.y) });
        }
    }
    out
}

/// A sphere around the origin.
pub(super) fn sphere(radius: f32, rings: usize, segments: usize) -> Shape {
    let points = (0..=rings)
        .map(|i| {
            let (s, c) = (i as f32 / rings as f32 * PI).sin_cos();
            Vec2::new(if i == 0 || i == rings { 0.0 } else { radius * s }, -radius * c)
        })
        .collect();
    lathe(&[points], segments)
}

/// A cushion: a superellipsoid (Barr 1981) around the origin with these half sizes, rounder for larger `power` up to 1.
pub(super) fn cushion(half: Vec3, power: f32, rings: usize, segments: usize) -> Shape {
    let raise = |x: f32, e: f32| x.signum() * x.abs().powf(e);
    let mut shape = sphere(1.0, rings, segments);
    for (p, n) in shape.mesh.positions.iter_mut().zip(&mut shape.mesh.normals) {
        let around = Vec2::new(p.x, p.z);
        let flat = around.length();
        let dir = around.normalize_or(Vec2::X);
        let (cx, cz) = (raise(dir.x, power), raise(dir.y, power));
        let (r, y) = (raise(flat, power), raise(p.y, power));
        let (nr, ny) = (raise(flat, 2.0 - power), raise(p.y, 2.0 - power));
        *n = (Vec3::new(nr * raise(dir.x, 2.0 - power), ny, nr * raise(dir.y, 2.0 - power)) / half)
            .normalize_or(Vec3::Y);
        *p = half * Vec3::new(r * cx, y, r * cz);
    }
    let indices = std::mem::take(&mut shape.mesh.indices);
    for t in indices.chunks_exact(3) {
        shape.triangle([t[0], t[1], t[2]]);
    }
    shape
}

/// A wall along x on the plane y = 0 with round arches. `openings` are centres and half widths, from left to right; `spring` is
/// the height at which the arches begin.
pub(super) fn arcade(width: f32, height: f32, depth: f32, openings: &[[f32; 2]], spring: f32) -> Shape {
    const STEPS: usize = 20;
    // Positions along x with the height of the wall's lower edge; `None` where it stands on the ground.
    let mut stations: Vec<(f32, Option<f32>)> = vec![(-0.5 * width, None)];
    for [centre, half] in openings {
        for i in 0..=STEPS {
            let (s, c) = (i as f32 / STEPS as f32 * PI).sin_cos();
            let rise = if i == 0 || i == STEPS { 0.0 } else { half * s };
            stations.push((centre - half * c, Some(spring + rise)));
        }
    }
    stations.push((0.5 * width, None));
    let z = 0.5 * depth;
    let mut shape = Shape::default();
    let p = Vec3::new;
    let mut both = |x0: f32, x1: f32, lo: [f32; 2], hi: f32| {
        shape.quad([p(x0, lo[0], z), p(x1, lo[1], z), p(x1, hi, z), p(x0, hi, z)]);
        shape.quad([p(x1, lo[1], -z), p(x0, lo[0], -z), p(x0, hi, -z), p(x1, hi, -z)]);
    };
    for (k, pair) in stations.windows(2).enumerate() {
        let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
        // The piers are between the last position of one opening and the first of the next.
        if k % (STEPS + 1) == 0 {
            both(x0, x1, [0.0; 2], spring);
            both(x0, x1, [spring; 2], height);
        } else if let (Some(y0), Some(y1)) = (y0, y1) {
            both(x0, x1, [y0, y1], height);
        }
    }
    for pair in stations.windows(2) {
        let (x0, x1) = (pair[0].0, pair[1].0);
        shape.quad([p(x0, height, z), p(x1, height, z), p(x1, height, -z), p(x0, height, -z)]);
    }
    for [centre, half] in openings {
        let (x0, x1) = (centre - half, centre + half);
        shape.quad([p(x0, 0.0, z), p(x0, 0.0, -z), p(x0, spring, -z), p(x0, spring, z)]);
        shape.quad([p(x1, 0.0, -z), p(x1, 0.0, z), p(x1, spring, z), p(x1, spring, -z)]);
        let ribs: Vec<[u32; 2]> = (0..=STEPS)
            .map(|i| {
                let angle = i as f32 / STEPS as f32 * PI;
                let (s, c) = angle.sin_cos();
                let rise = if i == 0 || i == STEPS { 0.0 } else { half * s };
                let (position, normal) = (p(centre - half * c, spring + rise, 0.0), p(c, -s, 0.0));
                let u = half * angle;
                [z, -z].map(|z| shape.vertex(position + Vec3::Z * z, normal, Vec2::new(u, z)))
            })
            .collect();
        for pair in ribs.windows(2) {
            let [[a, b], [d, c]] = [pair[0], pair[1]];
            shape.triangle([a, b, c]);
            shape.triangle([a, c, d]);
        }
    }
    for x in [-0.5 * width, 0.5 * width] {
        for (lo, hi) in [(0.0, spring), (spring, height)] {
            let q = [p(x, lo, -z), p(x, hi, -z), p(x, hi, z), p(x, lo, z)];
            shape.quad(if x > 0.0 { q } else { [q[3], q[2], q[1], q[0]] });
        }
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Asserts that every directed edge occurs once and so does its reverse: the surface is closed and consistently wound.
    fn assert_closed(shape: &Shape, what: &str) {
        let key = |i: u32| (shape.mesh.positions[i as usize] * 1e4).round().as_ivec3().to_array();
        let (mut edges, mut volume) = (HashMap::<_, i32>::new(), 0.0);
        for t in shape.mesh.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| shape.mesh.positions[i as usize]);
            volume += a.dot(b.cross(c));
            let keys = [t[0], t[1], t[2]].map(key);
            if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
                continue; // a degenerate triangle at a pole
            }
            for i in 0..3 {
                *edges.entry((keys[i], keys[(i + 1) % 3])).or_default() += 1;
            }
        }
        for ((from, to), count) in &edges {
            assert_eq!(*count, 1, "{what}: edge {from:?} to {to:?}");
            assert!(edges.contains_key(&(*to, *from)), "{what}: nothing lies across edge {from:?} to {to:?}");
        }
        assert!(volume > 0.0, "{what} is inside out");
    }

    #[test]
    fn solids_are_closed_and_face_outwards() {
        assert_closed(&block(1.0, 2.0, 3.0, 0.0), "block with sharp edges");
        assert_closed(&block(1.0, 2.0, 3.0, 0.1), "block with cut edges");
        assert_closed(&sphere(1.0, 8, 12), "sphere");
        assert_closed(&cushion(Vec3::new(1.0, 0.3, 0.8), 0.5, 8, 12), "cushion");
    }

    #[test]
    fn normals_point_where_the_winding_does() {
        for shape in [block(1.0, 2.0, 3.0, 0.1), sphere(1.0, 8, 12), lathe(&[line(&[[1.0, 0.0], [0.5, 2.0]])], 12)] {
            for t in shape.mesh.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|i| shape.mesh.positions[i as usize]);
                let face = (b - a).cross(c - a);
                for i in t {
                    assert!(face.dot(shape.mesh.normals[*i as usize]) >= 0.0, "{face}");
                }
            }
        }
    }
}
