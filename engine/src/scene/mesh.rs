//! Completes meshes: missing normals and tangents, and bounds.
use super::Mesh;
use glam::{Vec2, Vec3, Vec4};

impl Mesh {
    /// Minimum and maximum corner of positions and spheres, object space, before deformation; `None` if there are neither.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        let points = self.positions.iter().map(|p| [*p; 2]);
        let spheres = self.spheres.iter().map(|s| [s.centre - s.radius, s.centre + s.radius]);
        points.chain(spheres).reduce(|[lo, hi], [a, b]| [lo.min(a), hi.max(b)])
    }

    /// Number of influences of each vertex; 0 without a skin.
    pub fn influences_per_vertex(&self) -> usize {
        self.influences.len().checked_div(self.positions.len()).unwrap_or(0)
    }

    /// Gives every triangle three vertices of its own.
    pub(super) fn unweld(&mut self) {
        fn spread<T: Copy>(table: &mut Vec<T>, indices: &[u32]) {
            *table = indices.iter().map(|i| table[*i as usize]).collect();
        }
        spread(&mut self.uv0, &self.indices);
        spread(&mut self.uv1, &self.indices);
        spread(&mut self.colours, &self.indices);
        if !self.normals.is_empty() {
            spread(&mut self.normals, &self.indices);
        }
        if !self.tangents.is_empty() {
            spread(&mut self.tangents, &self.indices);
        }
        let per_vertex = self.influences_per_vertex();
        if per_vertex > 0 {
            let of = |i: &u32| &self.influences[*i as usize * per_vertex..][..per_vertex];
            self.influences = self.indices.iter().flat_map(of).copied().collect();
        }
        for table in self.targets.iter_mut().flat_map(|t| [&mut t.positions, &mut t.normals, &mut t.tangents]) {
            if !table.is_empty() {
                spread(table, &self.indices);
            }
        }
        spread(&mut self.positions, &self.indices);
        self.indices = (0..self.indices.len() as u32).collect();
    }

    /// Replaces the normals by flat ones, as glTF requires where a file has none. Tangents are dropped.
    pub(super) fn flat_normals(&mut self) {
        self.tangents.clear();
        self.normals.clear();
        self.unweld();
        for triangle in self.positions.chunks_exact(3) {
            let normal = face_normal([triangle[0], triangle[1], triangle[2]]);
            self.normals.extend([normal.normalize_or(Vec3::Y); 3]);
        }
    }

    /// Normalises every normal. One that is zero becomes the area-weighted mean of the adjacent faces. Returns the number of those.
    pub(super) fn repair_normals(&mut self) -> usize {
        let mut lost = Vec::new();
        for (i, n) in self.normals.iter_mut().enumerate() {
            // In double precision, since squares of small or large numbers would underflow or overflow.
            match n.as_dvec3().try_normalize() {
                Some(unit) => *n = unit.as_vec3(),
                None => lost.push(i),
            }
        }
        if lost.is_empty() {
            return 0;
        }
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for t in self.indices.chunks_exact(3) {
            let t = [t[0] as usize, t[1] as usize, t[2] as usize];
            let normal = face_normal(t.map(|i| self.positions[i]));
            for i in t {
                sums[i] += normal;
            }
        }
        for i in &lost {
            self.normals[*i] = sums[*i].as_dvec3().normalize_or(glam::DVec3::Y).as_vec3();
        }
        lost.len()
    }

    /// Makes tangents for one set of texture coordinates, in the convention of glTF: v points down, so the bitangent
    /// `cross(normal, tangent) * w` points towards smaller v.
    ///
    /// The tangent of a vertex is the area-weighted sum of `dP/du` over its triangles, orthogonalised to the normal. A vertex
    /// that mirrored and unmirrored triangles share is duplicated. If the texture coordinates have no area, an arbitrary unit
    /// vector orthogonal to the normal is used.
    pub(super) fn make_tangents(&mut self, second_uv: bool) {
        let vertices = self.positions.len();
        // Two sums per vertex, for unmirrored and mirrored triangles.
        let mut sums = vec![[Vec3::ZERO; 2]; vertices];
        let mut used = vec![[false; 2]; vertices];
        let uv = if second_uv { &self.uv1 } else { &self.uv0 };
        let mirrored: Vec<Option<bool>> = self
            .indices
            .chunks_exact(3)
            .map(|t| {
                let t = [t[0] as usize, t[1] as usize, t[2] as usize];
                let (direction, mirrored) = uv_direction(t.map(|i| self.positions[i]), t.map(|i| uv[i]))?;
                for i in t {
                    sums[i][mirrored as usize] += direction;
                    used[i][mirrored as usize] = true;
                }
                Some(mirrored)
            })
            .collect();

        // Index of the duplicate of a vertex; 0 if it has none.
        let per_vertex = self.influences_per_vertex();
        let mut double = vec![0_u32; vertices];
        for i in 0..vertices {
            if used[i] == [true, true] && self.positions.len() < u32::MAX as usize {
                double[i] = self.positions.len() as u32;
                self.positions.push(self.positions[i]);
                self.normals.push(self.normals[i]);
                self.uv0.push(self.uv0[i]);
                self.uv1.push(self.uv1[i]);
                self.colours.push(self.colours[i]);
                self.influences.extend_from_within(i * per_vertex..(i + 1) * per_vertex);
                for table in self.targets.iter_mut().flat_map(|t| [&mut t.positions, &mut t.normals, &mut t.tangents]) {
                    table.extend(table.get(i).copied());
                }
            }
        }
        for (t, mirrored) in self.indices.chunks_exact_mut(3).zip(mirrored) {
            for i in t {
                if mirrored == Some(true) && double[*i as usize] != 0 {
                    *i = double[*i as usize];
                }
            }
        }

        self.tangents = Vec::with_capacity(self.positions.len());
        for i in 0..vertices {
            let mirrored = !used[i][0] && used[i][1];
            self.tangents.push(orthogonal(self.normals[i], sums[i][mirrored as usize], mirrored));
        }
        for i in 0..vertices {
            if double[i] != 0 {
                self.tangents.push(orthogonal(self.normals[i], sums[i][1], true));
            }
        }
    }

    /// Normalises the tangents of a file and makes them orthogonal to the normals, with `w` 1 or -1.
    pub(super) fn repair_tangents(&mut self) {
        for (t, n) in self.tangents.iter_mut().zip(&self.normals) {
            *t = orthogonal(*n, t.truncate(), t.w < 0.0);
        }
    }
}

/// Twice the area times the normal of a triangle with counter-clockwise front. Scaled down first if products would overflow.
fn face_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    let (u, v) = (b.as_dvec3() - a.as_dvec3(), c.as_dvec3() - a.as_dvec3());
    let normal = u.cross(v);
    let size = normal.length();
    if size > 1e30 { (normal / size * 1e30).as_vec3() } else { normal.as_vec3() }
}

/// Direction of increasing u, weighted by area, and whether the coordinates are mirrored; `None` if they have no area.
fn uv_direction(p: [Vec3; 3], uv: [Vec2; 3]) -> Option<(Vec3, bool)> {
    let (e1, e2) = (p[1].as_dvec3() - p[0].as_dvec3(), p[2].as_dvec3() - p[0].as_dvec3());
    let (d1, d2) = (uv[1].as_dvec2() - uv[0].as_dvec2(), uv[2].as_dvec2() - uv[0].as_dvec2());
    let area = d1.perp_dot(d2);
    if area == 0.0 || !area.is_finite() {
        return None;
    }
    // v points down, so unmirrored coordinates are clockwise.
    let direction = ((e1 * d2.y - e2 * d1.y) * area.signum()).try_normalize()?;
    let weight = e1.cross(e2).length().min(1e30);
    Some(((direction * weight).as_vec3(), area > 0.0))
}

/// The unit tangent nearest to `direction` that is orthogonal to a unit normal.
fn orthogonal(normal: Vec3, direction: Vec3, mirrored: bool) -> Vec4 {
    let (n, d) = (normal.as_dvec3(), direction.as_dvec3());
    let size = d.length();
    let flat = d - n * n.dot(d);
    // Below this fraction of its length, the direction is dominated by rounding errors.
    let tangent = if size > 0.0 && flat.length() > 1e-6 * size {
        (flat / flat.length()).as_vec3()
    } else {
        normal.any_orthonormal_vector()
    };
    tangent.extend(if mirrored { -1.0 } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Influence, MorphTarget, Sphere};

    /// A unit square in x and y, facing z, with these texture coordinates.
    fn square(uv: [Vec2; 4]) -> Mesh {
        Mesh {
            name: "square".into(),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
            normals: vec![Vec3::Z; 4],
            uv0: uv.to_vec(),
            uv1: vec![Vec2::ZERO; 4],
            colours: vec![Vec4::ONE; 4],
            indices: vec![0, 1, 2, 0, 2, 3],
            ..Mesh::default()
        }
    }

    #[test]
    fn tangents_follow_u_and_bitangents_go_up_the_texture() {
        let v = Vec2::new;
        let mut mesh = square([v(0.0, 1.0), v(1.0, 1.0), v(1.0, 0.0), v(0.0, 0.0)]);
        mesh.make_tangents(false);
        assert!(mesh.tangents.iter().all(|t| t.abs_diff_eq(Vec4::new(1.0, 0.0, 0.0, 1.0), 1e-6)));
        let mut mesh = square([v(1.0, 1.0), v(0.0, 1.0), v(0.0, 0.0), v(1.0, 0.0)]);
        mesh.make_tangents(false);
        assert!(mesh.tangents.iter().all(|t| t.abs_diff_eq(Vec4::new(-1.0, 0.0, 0.0, -1.0), 1e-6)));
    }

    #[test]
    fn a_mirror_seam_doubles_its_vertices() {
        let v = Vec2::new;
        let mut mesh = square([v(0.0, 1.0), v(1.0, 1.0), v(1.0, 0.0), v(2.0, 1.0)]);
        mesh.make_tangents(false);
        assert_eq!((mesh.positions.len(), mesh.tangents.len(), mesh.uv1.len()), (6, 6, 6));
        assert_eq!(mesh.indices.len(), 6);
        assert!(mesh.tangents[4].w == -1.0 && mesh.tangents[0].w == 1.0);
    }

    /// A square whose vertex `i` follows joint `i` and moves by `i` in its only target, which has no normals.
    fn bending(uv: [Vec2; 4]) -> Mesh {
        let mut mesh = square(uv);
        let influence = |joint, weight| Influence { joint, weight };
        mesh.influences = (0..4)
            .flat_map(|i| [influence(i, 0.75), influence(9, 0.25), influence(0, 0.0), influence(0, 0.0)])
            .collect();
        mesh.targets = vec![MorphTarget {
            positions: (0..4).map(|i| Vec3::splat(i as f32)).collect(),
            tangents: (0..4).map(|i| Vec3::X * i as f32).collect(),
            ..MorphTarget::default()
        }];
        mesh
    }

    /// Asserts, for every table, that each vertex is a copy of the given vertex of the square.
    fn assert_origins(mesh: &Mesh, origins: &[u32]) {
        assert_eq!((mesh.positions.len(), mesh.influences_per_vertex()), (origins.len(), 4));
        let corners = square([Vec2::ZERO; 4]).positions;
        let target = &mesh.targets[0];
        assert!(target.normals.is_empty());
        assert_eq!((target.positions.len(), target.tangents.len()), (origins.len(), origins.len()));
        for (i, from) in origins.iter().enumerate() {
            assert_eq!(mesh.positions[i], corners[*from as usize], "{i}");
            assert_eq!(mesh.influences[4 * i], Influence { joint: *from, weight: 0.75 }, "{i}");
            assert_eq!(mesh.influences[4 * i + 1], Influence { joint: 9, weight: 0.25 }, "{i}");
            assert_eq!(target.positions[i], Vec3::splat(*from as f32), "{i}");
            assert_eq!(target.tangents[i], Vec3::X * *from as f32, "{i}");
        }
    }

    #[test]
    fn influences_and_targets_follow_their_vertices() {
        let v = Vec2::new;
        let mut mesh = bending([v(0.0, 1.0), v(1.0, 1.0), v(1.0, 0.0), v(2.0, 1.0)]);
        mesh.make_tangents(false);
        assert_origins(&mesh, &[0, 1, 2, 3, 0, 2]);
        let mut mesh = bending([Vec2::ZERO; 4]);
        mesh.flat_normals();
        assert_origins(&mesh, &[0, 1, 2, 0, 2, 3]);
    }

    #[test]
    fn bounds_hold_spheres() {
        let sphere = |x, radius| Sphere { centre: Vec3::X * x, radius };
        let mesh = Mesh { spheres: vec![sphere(1.0, 0.5), sphere(-2.0, 1.0)], ..Mesh::default() };
        assert_eq!(mesh.bounds(), Some([Vec3::new(-3.0, -1.0, -1.0), Vec3::new(1.5, 1.0, 1.0)]));
        assert_eq!(mesh.influences_per_vertex(), 0);
        assert_eq!(Mesh::default().bounds(), None);
    }

    #[test]
    fn degenerate_coordinates_still_give_unit_tangents() {
        let mut mesh = square([Vec2::ONE; 4]);
        mesh.positions[2] = mesh.positions[1];
        mesh.make_tangents(false);
        for t in &mesh.tangents {
            assert!((t.truncate().length() - 1.0).abs() < 1e-6 && t.truncate().dot(Vec3::Z).abs() < 1e-6);
        }
    }

    #[test]
    fn lost_normals_come_from_the_faces() {
        let mut mesh = square([Vec2::ZERO; 4]);
        mesh.normals = vec![Vec3::ZERO, Vec3::Z * 3.0, Vec3::splat(1e-30), Vec3::Z];
        assert_eq!(mesh.repair_normals(), 1);
        assert_eq!(mesh.normals[0], Vec3::Z);
        assert!((mesh.normals[2].length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn flat_normals_belong_to_one_triangle_each() {
        let mut mesh = square([Vec2::ZERO; 4]);
        mesh.positions[3].z = 1.0;
        mesh.flat_normals();
        assert_eq!((mesh.positions.len(), mesh.normals.len(), mesh.colours.len()), (6, 6, 6));
        assert_eq!(mesh.normals[0], Vec3::Z);
        assert!(mesh.normals[3] != Vec3::Z && mesh.normals[3] == mesh.normals[5]);
    }
}
