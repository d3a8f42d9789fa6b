//! Bounds of a mesh in a pose, computed from a few boxes instead of all vertices.
use super::Mesh;
use crate::ray::Bounds;
use glam::{DAffine3, DVec3, Vec3};

/// Bound of a shader's rounding error, relative to the sum of the magnitudes of the terms: one unit roundoff of `f32` for each
/// product and sum in blending eight matrices and applying the result to a point, with a margin.
const ROUNDING: f64 = 32.0 / (1_u64 << 24) as f64;

/// The boxes of a mesh from which its bounds in any pose follow.
#[derive(Clone, Debug)]
pub(super) struct PoseBounds {
    /// Bounding box of all vertices.
    whole: Bounds,
    /// Each joint with influence, and the bounding box of the vertices that it influences.
    joints: Vec<(u32, Bounds)>,
    /// Minimum and maximum delta of each morph target.
    targets: Vec<Bounds>,
}

impl PoseBounds {
    pub fn of(mesh: &Mesh) -> Self {
        let per_vertex = mesh.influences_per_vertex();
        let most = mesh.influences.iter().map(|i| i.joint + 1).max().unwrap_or(0);
        let mut boxes = vec![Bounds::EMPTY; most as usize];
        for (p, influences) in mesh.positions.iter().zip(mesh.influences.chunks(per_vertex.max(1))) {
            for influence in influences.iter().filter(|i| i.weight != 0.0) {
                let joint = &mut boxes[influence.joint as usize];
                *joint = joint.union(Bounds { min: *p, max: *p });
            }
        }
        Self {
            whole: Bounds::of_points(&mesh.positions),
            joints: (0..).zip(boxes).filter(|(_, b)| !b.is_empty()).collect(),
            targets: mesh.targets.iter().map(|t| Bounds::of_points(&t.positions)).collect(),
        }
    }

    /// Bounding box of every vertex as [`deform`](super::deform) computes it; `None` for a mesh without vertices. NaN if a joint
    /// or weight is not finite.
    ///
    /// Weights sum to 1, so a skinned vertex is a convex combination of its images under its joints, and is inside the union of
    /// the transformed boxes of the joints. Each of these boxes is first extended by the weighted extremes of the morph targets.
    pub fn bounds(&self, joints: &[DAffine3], weights: &[f32]) -> Option<[Vec3; 2]> {
        if self.whole.is_empty() {
            return None;
        }
        let (mut least, mut most) = (DVec3::ZERO, DVec3::ZERO);
        let mut sound = true;
        for (target, weight) in self.targets.iter().zip(weights).filter(|(t, _)| !t.is_empty()) {
            let weight = f64::from(*weight);
            let (a, b) = (target.min.as_dvec3() * weight, target.max.as_dvec3() * weight);
            least += a.min(b);
            most += a.max(b);
            sound &= weight.is_finite();
        }
        let mut all: Option<[DVec3; 2]> = None;
        let mut add = |joint: &DAffine3, shape: &Bounds| {
            let (lower, upper) = (shape.min.as_dvec3() + least, shape.max.as_dvec3() + most);
            let moved = around(joint, lower, upper);
            all = Some(all.map_or(moved, |[lo, hi]| [lo.min(moved[0]), hi.max(moved[1])]));
        };
        if joints.is_empty() || self.joints.is_empty() {
            add(&DAffine3::IDENTITY, &self.whole);
        } else {
            for (joint, shape) in &self.joints {
                sound &= joints[*joint as usize].is_finite();
                add(&joints[*joint as usize], shape);
            }
        }
        let all = if sound { all } else { Some([DVec3::NAN; 2]) };
        all.map(|[lo, hi]| [lo.as_vec3().map(f32::next_down), hi.as_vec3().map(f32::next_up)])
    }
}

/// Bounding box of a transformed box (Arvo 1990), widened by [`ROUNDING`].
fn around(m: &DAffine3, lower: DVec3, upper: DVec3) -> [DVec3; 2] {
    let (mut min, mut max, mut size) = (m.translation, m.translation, m.translation.abs());
    for axis in 0..3 {
        let column = m.matrix3.col(axis);
        let (a, b) = (column * lower[axis], column * upper[axis]);
        min += a.min(b);
        max += a.max(b);
        size += a.abs().max(b.abs());
    }
    [min - ROUNDING * size, max + ROUNDING * size]
}
