//! Every triangle of every instance, in `f64`, one after the other: slow, and obviously right.
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};

/// Positions and indices of a mesh.
pub struct Soup {
    pub positions: Vec<Vec3>,
    pub indices: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
pub struct Found {
    pub t: f64,
    pub instance: u32,
    pub triangle: u32,
    /// Weights of the three corners.
    pub weights: [f64; 3],
    pub front: bool,
}

/// A triangle in the world.
pub struct Facet {
    pub instance: u32,
    pub triangle: u32,
    pub corners: [DVec3; 3],
    /// The transform turns the winding round.
    pub mirrored: bool,
}

/// All triangles in the world.
pub fn facets(meshes: &[Soup], instances: &[(Affine3A, u32)]) -> Vec<Facet> {
    let mut facets = Vec::new();
    for (instance, (world_from_object, mesh)) in instances.iter().enumerate() {
        let m = world_from_object.matrix3;
        let columns = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.as_dvec3());
        let world = DAffine3 {
            matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]),
            translation: world_from_object.translation.as_dvec3(),
        };
        let mesh = &meshes[*mesh as usize];
        for (triangle, corners) in mesh.indices.as_chunks::<3>().0.iter().enumerate() {
            facets.push(Facet {
                instance: instance as u32,
                triangle: triangle as u32,
                corners: corners.map(|i| world.transform_point3(mesh.positions[i as usize].as_dvec3())),
                mirrored: world.matrix3.determinant() < 0.0,
            });
        }
    }
    facets
}

/// The hit of one triangle: plane equation, then areas. Without area, none.
pub fn hit_facet(facet: &Facet, origin: DVec3, direction: DVec3) -> Option<Found> {
    let [a, b, c] = facet.corners;
    let normal = (b - a).cross(c - a);
    let along = normal.dot(direction);
    if normal == DVec3::ZERO || along == 0.0 {
        return None;
    }
    let t = normal.dot(a - origin) / along;
    let p = origin + t * direction;
    let square = normal.length_squared();
    let weights = [(b, c), (c, a), (a, b)].map(|(from, to)| (to - from).cross(p - from).dot(normal) / square);
    let front = (along < 0.0) != facet.mirrored;
    weights.iter().all(|&w| w >= 0.0).then_some(Found {
        t,
        instance: facet.instance,
        triangle: facet.triangle,
        weights,
        front,
    })
}

/// The nearest hit with `t_min < t < t_max`.
pub fn nearest(facets: &[Facet], origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<Found> {
    facets
        .iter()
        .filter_map(|facet| hit_facet(facet, origin.as_dvec3(), direction.as_dvec3()))
        .filter(|found| found.t > f64::from(t_min) && found.t < f64::from(t_max))
        .min_by(|a, b| a.t.total_cmp(&b.t))
}
