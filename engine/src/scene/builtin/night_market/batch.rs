//! Gathers what stands still into few meshes: one for each material and stretch of the street, so that bounds stay tight.
use super::super::shapes::Shape;
use super::super::stage::Stage;
use crate::scene::{Mesh, Sphere};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::collections::BTreeMap;
use std::f32::consts::TAU;

/// Edge of a stretch, metres.
const CELL: f32 = 7.0;

/// The stretch of a place, then the index of the material.
type Key = (i32, i32, u32);

/// Triangles and spheres, by stretch and material.
#[derive(Default)]
pub struct Batch {
    shapes: BTreeMap<Key, Shape>,
    spheres: BTreeMap<Key, Vec<Sphere>>,
}

fn key(at: Vec3, material: u32) -> Key {
    ((-at.z / CELL).floor() as i32, (at.x / CELL).round() as i32, material)
}

impl Batch {
    /// Adds a shape under a rigid transform.
    pub fn add(&mut self, shape: &Shape, material: u32, at: Affine3A) {
        self.shapes.entry(key(at.translation.into(), material)).or_default().join(shape, at);
    }

    /// Adds a shape that is in the world already; `near` says where it belongs.
    pub fn add_placed(&mut self, shape: &Shape, material: u32, near: Vec3) {
        self.shapes.entry(key(near, material)).or_default().join(shape, Affine3A::IDENTITY);
    }

    /// Adds a sphere in the world.
    pub fn ball(&mut self, centre: Vec3, radius: f32, material: u32) {
        self.spheres.entry(key(centre, material)).or_default().push(Sphere { centre, radius });
    }

    /// Adds one mesh with one instance for each stretch and material.
    pub fn build(self, stage: &mut Stage) {
        let name = |stage: &Stage, material: u32| stage.scene.materials[material as usize].name.clone();
        for ((_, _, material), shape) in self.shapes {
            stage.add(&name(stage, material), shape, material, Affine3A::IDENTITY);
        }
        for ((_, _, material), spheres) in self.spheres {
            let mesh = Mesh { name: name(stage, material), spheres, ..Mesh::default() };
            stage.scene.meshes.push(mesh);
            stage.put(stage.scene.meshes.len() as u32 - 1, material, Affine3A::IDENTITY);
        }
    }
}

/// A tube with flat ends around a line of points, or a ring where the first and the last point are the same. Bends must be wider than the
/// tube.
pub fn pipe(points: &[Vec3], radius: f32, sides: usize) -> Shape {
    let mut shape = Shape::default();
    let last = points.len() - 1;
    let is_ring = points[0].abs_diff_eq(points[last], 1e-5);
    let step = |i: usize| (points[i + 1] - points[i]).normalize_or(Vec3::Y);
    let tangent = |i: usize| match i {
        0 if is_ring => step(last - 1) + step(0),
        0 => step(0),
        _ if i < last => step(i - 1) + step(i),
        _ if is_ring => step(last - 1) + step(0),
        _ => step(last - 1),
    };
    let mut side = tangent(0).normalize_or(Vec3::Y).any_orthonormal_vector();
    let (mut before, mut length) = (Vec::new(), 0.0);
    for (i, point) in points.iter().enumerate() {
        let along = tangent(i).normalize_or(Vec3::Y);
        side = (side - along * side.dot(along)).normalize_or(along.any_orthonormal_vector());
        let other = along.cross(side);
        length += if i > 0 { point.distance(points[i - 1]) } else { 0.0 };
        let ring: Vec<u32> = (0..=sides)
            .map(|j| {
                let turn = if j == sides { 0.0 } else { j as f32 / sides as f32 };
                let (s, c) = (turn * TAU).sin_cos();
                let normal = side * c + other * s;
                let uv = Vec2::new(j as f32 / sides as f32 * radius * TAU, -length);
                shape.vertex(*point + normal * radius, normal, uv)
            })
            .collect();
        for j in 0..if i > 0 { sides } else { 0 } {
            let from: &[u32] = &before;
            shape.triangle([from[j], from[j + 1], ring[j + 1]]);
            shape.triangle([from[j], ring[j + 1], ring[j]]);
        }
        if !is_ring && (i == 0 || i == last) {
            cap(&mut shape, *point, if i == 0 { -along } else { along }, &ring);
        }
        before = ring;
    }
    shape
}

/// Closes an end of a tube.
fn cap(shape: &mut Shape, centre: Vec3, out: Vec3, ring: &[u32]) {
    let middle = shape.vertex(centre, out, Vec2::ZERO);
    let across = out.any_orthonormal_vector();
    let up = out.cross(across);
    let rim: Vec<u32> = ring
        .iter()
        .map(|i| {
            let p = shape.mesh.positions[*i as usize];
            shape.vertex(p, out, Vec2::new((p - centre).dot(across), -(p - centre).dot(up)))
        })
        .collect();
    for pair in rim.windows(2) {
        let [a, b] = [pair[0], pair[1]].map(|i| shape.mesh.positions[i as usize] - centre);
        shape.triangle(if a.cross(b).dot(out) > 0.0 { [middle, pair[0], pair[1]] } else { [middle, pair[1], pair[0]] });
    }
}

/// A straight rod.
pub fn rod(from: Vec3, to: Vec3, radius: f32, sides: usize) -> Shape {
    pipe(&[from, to], radius, sides)
}

/// A cable between two points that hangs through by `sag` metres, as a parabola.
pub fn hanging(from: Vec3, to: Vec3, sag: f32, steps: usize) -> Vec<Vec3> {
    (0..=steps).map(|i| hung(from, to, sag, i as f32 / steps as f32)).collect()
}

/// A point of such a cable, at a share of its span.
pub fn hung(from: Vec3, to: Vec3, sag: f32, t: f32) -> Vec3 {
    from.lerp(to, t) - Vec3::Y * (4.0 * sag * t * (1.0 - t))
}

/// A curved sheet through a grid of points, row by row, with smooth normals. Its front is on the side of `along the row x along the column`.
pub fn sheet(rows: &[Vec<Vec3>]) -> Shape {
    let mut shape = Shape::default();
    let (height, width) = (rows.len(), rows[0].len());
    let mut indices = Vec::with_capacity(height * width);
    let mut down = vec![0.0; width];
    for r in 0..height {
        let mut across = 0.0;
        for c in 0..width {
            let p = rows[r][c];
            let along_row = rows[r][(c + 1).min(width - 1)] - rows[r][c.saturating_sub(1)];
            let along_column = rows[(r + 1).min(height - 1)][c] - rows[r.saturating_sub(1)][c];
            across += if c > 0 { p.distance(rows[r][c - 1]) } else { 0.0 };
            down[c] += if r > 0 { p.distance(rows[r - 1][c]) } else { 0.0 };
            let normal = along_row.cross(along_column).normalize_or(Vec3::Y);
            indices.push(shape.vertex(p, normal, Vec2::new(across, -down[c])));
        }
    }
    for r in 1..height {
        for c in 1..width {
            let at = |r: usize, c: usize| indices[r * width + c];
            shape.triangle([at(r - 1, c - 1), at(r - 1, c), at(r, c)]);
            shape.triangle([at(r - 1, c - 1), at(r, c), at(r, c - 1)]);
        }
    }
    shape
}

/// A rotation about x, degrees.
pub fn tilt(degrees: f32) -> Affine3A {
    Affine3A::from_quat(Quat::from_rotation_x(degrees.to_radians()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pipes_and_sheets_face_outwards() {
        let bend: Vec<Vec3> = (0..9).map(|i| Vec3::new((i as f32 * 0.2).sin(), i as f32 * 0.1, 0.0)).collect();
        let around = |i: usize| (i as f32 / 12.0 * TAU).sin_cos();
        let ring: Vec<Vec3> = (0..=12).map(around).map(|(s, c)| Vec3::new(s, 0.0, c)).collect();
        let rows: Vec<Vec<Vec3>> =
            (0..3).map(|r| (0..3).map(|c| Vec3::new(c as f32, 0.1 * (r * c) as f32, -(r as f32))).collect()).collect();
        for shape in [pipe(&bend, 0.05, 6), pipe(&ring, 0.05, 6), sheet(&rows)] {
            for t in shape.mesh.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|i| shape.mesh.positions[i as usize]);
                let mean: Vec3 = t.iter().map(|i| shape.mesh.normals[*i as usize]).sum();
                assert!((b - a).cross(c - a).dot(mean) > 0.0);
            }
        }
        // Along the row is x and along the column -z, so the front is up.
        assert!(sheet(&rows).mesh.normals.iter().all(|n| n.y > 0.9));
    }
}
