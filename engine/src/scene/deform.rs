//! Morph targets and skins on the CPU, for rebuilding acceleration structures and as a reference for the GPU.
use super::Mesh;
use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};
use rayon::prelude::*;

/// The vertices of a mesh in a pose, object space. The tables are as long as those of the mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deformed {
    /// Positions, metres.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents, orthogonal to the normals; `w` is the sign of the bitangent.
    pub tangents: Vec<Vec4>,
}

/// Deforms a mesh by its morph targets and then its skin, in the order of glTF 2.0. Computed in `f64` and rounded once.
///
/// - Morph: `p + sum(weight * delta)`, and the same for normals and tangents. Targets beyond `weights` have weight 0.
/// - Skin: with `M = sum(weight * joint)` over the influences of the vertex, the position is `M p`, the normal `cof(M) n` and the
///   tangent `M t`. `joints` are object-from-bind matrices ([`Pose::joints`](super::Pose::joints)). Without joints or influences,
///   nothing is skinned.
/// - Normals are normalised; one that vanishes keeps its direction in the mesh. Tangents are made orthogonal to the normal; their
///   `w` does not change.
///
/// The cofactor matrix is the inverse transpose times the determinant. It needs no inverse, and if `M` mirrors it flips the
/// normal along with the winding, so that normal, tangent and `w` still give the correct bitangent.
///
/// # Panics
/// If an influence refers to a joint beyond `joints`.
pub fn deform(mesh: &Mesh, joints: &[DAffine3], weights: &[f32]) -> Deformed {
    let per_vertex = if joints.is_empty() { 0 } else { mesh.influences_per_vertex() };
    let vertices: Vec<(Vec3, Vec3, Vec4)> = (0..mesh.positions.len())
        .into_par_iter()
        .map(|i| {
            let mut position = mesh.positions[i].as_dvec3();
            let mut normal = mesh.normals[i].as_dvec3();
            let mut tangent = mesh.tangents[i].truncate().as_dvec3();
            for (target, weight) in mesh.targets.iter().zip(weights) {
                let add = |to: &mut DVec3, deltas: &[Vec3]| {
                    if let Some(delta) = deltas.get(i) {
                        *to += f64::from(*weight) * delta.as_dvec3();
                    }
                };
                add(&mut position, &target.positions);
                add(&mut normal, &target.normals);
                add(&mut tangent, &target.tangents);
            }
            if per_vertex > 0 {
                let mut blend = DAffine3::ZERO;
                for influence in &mesh.influences[i * per_vertex..(i + 1) * per_vertex] {
                    // Influences without weight may be padding with any joint.
                    if influence.weight != 0.0 {
                        let (joint, weight) = (&joints[influence.joint as usize], f64::from(influence.weight));
                        blend.matrix3 += joint.matrix3 * weight;
                        blend.translation += joint.translation * weight;
                    }
                }
                position = blend.transform_point3(position);
                normal = cofactor(&blend.matrix3) * normal;
                tangent = blend.matrix3 * tangent;
            }
            let normal = normal.try_normalize().unwrap_or(mesh.normals[i].as_dvec3());
            let tangent = across(tangent, normal);
            (position.as_vec3(), normal.as_vec3(), tangent.as_vec3().extend(mesh.tangents[i].w))
        })
        .collect();
    let mut out = Deformed {
        positions: Vec::with_capacity(vertices.len()),
        normals: Vec::with_capacity(vertices.len()),
        tangents: Vec::with_capacity(vertices.len()),
    };
    for (position, normal, tangent) in vertices {
        out.positions.push(position);
        out.normals.push(normal);
        out.tangents.push(tangent);
    }
    out
}

/// The cofactor matrix, which transforms normals as the cross product of two transformed edges.
fn cofactor(m: &DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// The unit vector nearest to `tangent` that is orthogonal to a unit normal; an arbitrary one if the two are parallel.
fn across(tangent: DVec3, normal: DVec3) -> DVec3 {
    let flat = tangent - normal * normal.dot(tangent);
    // Below this fraction, the direction is dominated by rounding errors.
    let flat = if flat.length() > 1e-6 * tangent.length() { flat.try_normalize() } else { None };
    flat.unwrap_or_else(|| normal.any_orthonormal_vector())
}
