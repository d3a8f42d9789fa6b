//! Brute-force ray intersection with every triangle of a scene, in double precision (Möller and Trumbore 1997).
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use magpie::scene::{AlphaMode, Scene};
use magpie_shaders::rays::RayTask;

/// Intersection of a ray with the plane of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// Index of the instance.
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Distance in lengths of the direction.
    pub t: f64,
    /// Least of the three barycentric coordinates: 0 on an edge, negative outside.
    pub inside: f64,
    /// Cosine of the angle between ray and normal.
    pub cosine: f64,
    /// Longest edge over the height on it, at least 1.15: the factor by which rounding of the vertices moves the intersection.
    pub slender: f64,
    /// Whether its material is alpha-tested.
    pub tested: bool,
}

/// The triangles of a scene in world space, by instance.
pub struct Triangles {
    instances: Vec<Placed>,
}

struct Placed {
    corners: Vec<[DVec3; 3]>,
    lower: DVec3,
    upper: DVec3,
    tested: bool,
}

/// A transform of the device in double precision.
pub fn double(m: &Affine3A) -> DAffine3 {
    let a = m.matrix3;
    let columns = [a.x_axis, a.y_axis, a.z_axis].map(|c| Vec3::from(c).as_dvec3());
    DAffine3 {
        matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]),
        translation: Vec3::from(m.translation).as_dvec3(),
    }
}

impl Triangles {
    /// All triangles of a scene.
    pub fn new(scene: &Scene) -> Self {
        let placed = |instance: &magpie::scene::Instance| {
            let (mesh, world) =
                (&scene.meshes[instance.mesh as usize], double(&magpie::scene::single(&instance.world_from_object)));
            let corner = |i: u32| world.transform_point3(mesh.positions[i as usize].as_dvec3());
            let corners: Vec<_> = mesh.indices.as_chunks::<3>().0.iter().map(|t| t.map(corner)).collect();
            let all = || corners.iter().flatten().copied();
            let lower = all().fold(DVec3::MAX, DVec3::min);
            let upper = all().fold(DVec3::MIN, DVec3::max);
            let margin = 1e-4 * (upper - lower).length() + 1e-5 * lower.abs().max(upper.abs()).max_element();
            let tested = scene.materials[instance.material as usize].alpha != AlphaMode::Opaque;
            Placed { corners, lower: lower - margin, upper: upper + margin, tested }
        };
        Self { instances: scene.instances.iter().map(placed).collect() }
    }

    /// Every triangle that the ray crosses, the nearest first, including near misses by up to `near` in barycentric coordinates.
    pub fn crossings(&self, ray: &RayTask, near: f64) -> Vec<Crossing> {
        let (origin, direction) = (Vec3::from(ray.origin).as_dvec3(), Vec3::from(ray.direction).as_dvec3());
        let mut found = Vec::new();
        for (instance, placed) in (0..).zip(&self.instances) {
            if !passes(origin, direction, placed) {
                continue;
            }
            for (primitive, corners) in (0..).zip(&placed.corners) {
                let Some((t, inside, cosine)) = cross(origin, direction, corners) else { continue };
                let slender = slender(corners);
                if inside >= -near && t > f64::from(ray.t_min) && t < f64::from(ray.t_max) {
                    found.push(Crossing { instance, primitive, t, inside, cosine, slender, tested: placed.tested });
                }
            }
        }
        found.sort_by(|a, b| a.t.total_cmp(&b.t));
        found
    }

    /// Intersection with the plane of one triangle.
    pub fn crossing(&self, ray: &RayTask, instance: u32, primitive: u32) -> Option<Crossing> {
        let placed = self.instances.get(instance as usize)?;
        let (origin, direction) = (Vec3::from(ray.origin).as_dvec3(), Vec3::from(ray.direction).as_dvec3());
        let corners = placed.corners.get(primitive as usize)?;
        let ((t, inside, cosine), slender) = (cross(origin, direction, corners)?, slender(corners));
        Some(Crossing { instance, primitive, t, inside, cosine, slender, tested: placed.tested })
    }

    /// Greatest absolute coordinate, metres.
    pub fn reach(&self) -> f64 {
        self.instances.iter().map(|p| p.lower.abs().max(p.upper.abs()).max_element()).fold(0.0, f64::max)
    }
}

/// Whether the ray's line passes through an instance's bounds.
fn passes(origin: DVec3, direction: DVec3, placed: &Placed) -> bool {
    let (a, b) = ((placed.lower - origin) / direction, (placed.upper - origin) / direction);
    let (mut from, mut to) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if origin[axis] < placed.lower[axis] || origin[axis] > placed.upper[axis] {
                return false;
            }
            continue;
        }
        (from, to) = (from.max(a[axis].min(b[axis])), to.min(a[axis].max(b[axis])));
    }
    from <= to
}

/// Distance, least barycentric coordinate, cosine; none for a ray in the plane or a degenerate triangle.
fn cross(origin: DVec3, direction: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<(f64, f64, f64)> {
    let (u, v) = (*b - *a, *c - *a);
    let normal = u.cross(v);
    let slope = normal.dot(direction);
    if slope == 0.0 {
        return None;
    }
    let from = origin - *a;
    let t = -normal.dot(from) / slope;
    let across = direction.cross(from);
    let (second, third) = (v.dot(across) / slope, -u.dot(across) / slope);
    let inside = second.min(third).min(1.0 - second - third);
    Some((t, inside, slope.abs() / (normal.length() * direction.length())))
}

/// Longest edge of a triangle over the height on it.
fn slender([a, b, c]: &[DVec3; 3]) -> f64 {
    let longest = (*b - *a).length_squared().max((*c - *b).length_squared()).max((*a - *c).length_squared());
    longest / (*b - *a).cross(*c - *a).length()
}

/// Whether a point is inside a closed mesh: the triangles' solid angles sum to a full turn (Van Oosterom and Strackee 1983, "The Solid
/// Angle of a Plane Triangle").
pub fn is_inside(positions: &[Vec3], indices: &[u32], point: DVec3) -> bool {
    let sum: f64 = indices
        .as_chunks::<3>()
        .0
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| positions[i as usize].as_dvec3() - point);
            let (x, y, z) = (a.length(), b.length(), c.length());
            2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
        })
        .sum();
    (sum.abs() / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_crosses_a_triangle_where_it_should() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let (t, inside, cosine) = cross(DVec3::new(0.25, 0.25, 4.0), DVec3::NEG_Z * 2.0, &corners).unwrap();
        assert_eq!((t, inside, cosine), (2.0, 0.25, 1.0));
        assert!(cross(DVec3::new(0.7, 0.7, 4.0), DVec3::NEG_Z, &corners).unwrap().1 < -0.3);
        assert!(cross(DVec3::new(0.2, 0.1, 4.0), DVec3::NEG_Z, &corners).unwrap().1 > 0.0);
        assert!(cross(DVec3::Z, DVec3::X, &corners).is_none());
    }

    #[test]
    fn inside_is_told_from_outside() {
        let mesh = crate::fixtures::sphere(8);
        assert!(is_inside(&mesh.positions, &mesh.indices, DVec3::splat(0.3)));
        assert!(!is_inside(&mesh.positions, &mesh.indices, DVec3::splat(0.7)));
    }
}
