//! Compressed wide BVHs (Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
//! BVHs"): eight children per node of 80 bytes, widened and compressed by `obvhs`.
use super::fit::{Levels, fit, levels, stack_need};
use super::split::binary_tree;
use super::{Bounds, COORDINATE_LIMIT, PRIMITIVE_LIMIT, RayError};
use glam::{DVec3, Vec3};
use magpie_shaders::scene::{BvhNode, BvhPrimitive, TRAVERSAL_STACK};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use std::mem::offset_of;

/// Largest number of primitives in a leaf; the format allows three. With two, rays test fewer triangles and visit as many nodes,
/// which is a few per cent faster for a tenth more nodes.
const PRIMITIVES_PER_LEAF: u32 = 2;

// Nodes are copied from `obvhs` byte by byte, so the layouts must be equal.
const _: () = {
    assert!(size_of::<BvhNode>() == 80 && size_of::<CwBvhNode>() == 80);
    assert!(offset_of!(BvhNode, origin) == offset_of!(CwBvhNode, p));
    assert!(offset_of!(BvhNode, exponents_and_mask) == offset_of!(CwBvhNode, e));
    assert!(offset_of!(BvhNode, exponents_and_mask) + 3 == offset_of!(CwBvhNode, imask));
    assert!(offset_of!(BvhNode, child_base) == offset_of!(CwBvhNode, child_base_idx));
    assert!(offset_of!(BvhNode, primitive_base) == offset_of!(CwBvhNode, primitive_base_idx));
    assert!(offset_of!(BvhNode, meta) == offset_of!(CwBvhNode, child_meta));
    assert!(offset_of!(BvhNode, min_x) == offset_of!(CwBvhNode, child_min_x));
    assert!(offset_of!(BvhNode, max_x) == offset_of!(CwBvhNode, child_max_x));
    assert!(offset_of!(BvhNode, min_y) == offset_of!(CwBvhNode, child_min_y));
    assert!(offset_of!(BvhNode, max_y) == offset_of!(CwBvhNode, child_max_y));
    assert!(offset_of!(BvhNode, min_z) == offset_of!(CwBvhNode, child_min_z));
    assert!(offset_of!(BvhNode, max_z) == offset_of!(CwBvhNode, child_max_z));
};

/// Bottom-level BVH over the triangles or spheres of one mesh, in object space.
#[derive(Clone, Debug)]
pub struct MeshBvh {
    /// The root first, and every node before its children. Never empty: a mesh without primitives has one node without children.
    pub nodes: Vec<BvhNode>,
    /// In the order of the leaves. Triangles without area and spheres without radius are left out, since no ray hits them.
    pub primitives: Vec<BvhPrimitive>,
    /// Bounding box of `primitives`, object space.
    pub bounds: Bounds,
    /// Largest number of stack entries that a traversal needs.
    pub stack: u32,
}

impl MeshBvh {
    /// Builds the BVH of an indexed triangle list in object space. Deterministic, in O(n log n).
    ///
    /// # Errors
    /// An index table that is incomplete or out of range, a position that is not finite or beyond [`COORDINATE_LIMIT`], more than
    /// [`PRIMITIVE_LIMIT`] triangles, or a BVH too deep for the shader's stack. Add the name of the mesh with [`RayError::in_mesh`].
    pub fn build(positions: &[Vec3], indices: &[u32]) -> Result<Self, RayError> {
        if !indices.len().is_multiple_of(3) {
            return Err(RayError::PartialTriangle { count: indices.len() });
        }
        if indices.len() / 3 > PRIMITIVE_LIMIT {
            return Err(RayError::TooMany { count: indices.len() / 3 });
        }
        if let Some(vertex) = positions.iter().position(|&p| !in_range(p)) {
            return Err(RayError::Position { vertex, position: positions[vertex].to_array() });
        }
        if let Some(at) = indices.iter().position(|&i| i as usize >= positions.len()) {
            return Err(RayError::Index { at, vertex: indices[at], vertices: positions.len() });
        }
        let triangles = indices.as_chunks::<3>().0.iter().enumerate();
        let (kept, boxes): (Vec<_>, Vec<_>) = triangles
            .map(|(primitive, &corners)| {
                (BvhPrimitive { corners, primitive: primitive as u32 }, corners.map(|i| positions[i as usize]))
            })
            .filter(|(_, corners)| has_area(corners))
            .map(|(kept, corners)| (kept, Bounds::of_points(&corners)))
            .unzip();
        Self::over(&kept, &boxes)
    }

    /// Builds the BVH of spheres, given by centre and radius in object space.
    ///
    /// # Errors
    /// A sphere that is not finite, has a negative radius, or reaches beyond [`COORDINATE_LIMIT`]; more than [`PRIMITIVE_LIMIT`]
    /// spheres; or a BVH too deep for the shader's stack.
    pub fn build_spheres(spheres: &[(Vec3, f32)]) -> Result<Self, RayError> {
        if spheres.len() > PRIMITIVE_LIMIT {
            return Err(RayError::TooMany { count: spheres.len() });
        }
        let fits = |&(centre, radius): &(Vec3, f32)| radius >= 0.0 && in_range(centre.abs() + radius);
        if let Some(sphere) = spheres.iter().position(|s| !fits(s)) {
            let (centre, radius) = spheres[sphere];
            return Err(RayError::Sphere { sphere, centre: centre.to_array(), radius });
        }
        let (kept, boxes): (Vec<_>, Vec<_>) = spheres
            .iter()
            .enumerate()
            .filter(|(_, (_, radius))| *radius > 0.0)
            .map(|(primitive, &(centre, radius))| {
                let (min, max) = ((centre - radius).map(f32::next_down), (centre + radius).map(f32::next_up));
                (BvhPrimitive { corners: [0; 3], primitive: primitive as u32 }, Bounds { min, max })
            })
            .unzip();
        Self::over(&kept, &boxes)
    }

    fn over(primitives: &[BvhPrimitive], boxes: &[Bounds]) -> Result<Self, RayError> {
        let tree = Tree::build(boxes);
        let stack = stack_need(&tree.nodes, |_| None);
        if stack > TRAVERSAL_STACK {
            return Err(RayError::Stack { needed: stack, limit: TRAVERSAL_STACK });
        }
        let primitives = tree.order.iter().map(|&i| primitives[i as usize]).collect();
        Ok(Self { nodes: tree.nodes, primitives, bounds: tree.bounds, stack })
    }

    /// The nodes by depth, for refits from the leaves up.
    pub fn levels(&self) -> Levels {
        levels(&self.nodes)
    }
}

pub(super) fn in_range(p: Vec3) -> bool {
    p.abs().cmple(Vec3::splat(COORDINATE_LIMIT)).all()
}

/// Whether a triangle has area. Products of `f32` are exact in `f64`, so that collinear corners give exactly zero.
fn has_area(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|c| c.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

/// A compressed wide BVH over boxes.
pub(super) struct Tree {
    pub nodes: Vec<BvhNode>,
    /// Index of the box behind each primitive, in the order of the leaves.
    pub order: Vec<u32>,
    pub bounds: Bounds,
}

impl Tree {
    pub fn build(boxes: &[Bounds]) -> Self {
        if boxes.is_empty() {
            return Self { nodes: vec![BvhNode::default()], order: Vec::new(), bounds: Bounds::EMPTY };
        }
        // The topology does not depend on scale. At unit size no surface area overflows or underflows, which would make the
        // heuristic meaningless.
        let all = boxes.iter().fold(Bounds::EMPTY, |b, &c| b.union(c));
        let scale = 1.0 / (all.max - all.min).max_element().max(f32::MIN_POSITIVE);
        let unit = |p: Vec3| (p - all.min) * scale;
        let unit_boxes: Vec<_> = boxes.iter().map(|b| Bounds { min: unit(b.min), max: unit(b.max) }).collect();
        let wide = bvh2_to_cwbvh(&binary_tree(&unit_boxes), PRIMITIVES_PER_LEAF, true, false);

        let mut nodes: Vec<BvhNode> = bytemuck::cast_slice(&wide.nodes).to_vec();
        let in_order: Vec<Bounds> = wide.primitive_indices.iter().map(|&i| boxes[i as usize]).collect();
        let bounds = fit(&mut nodes, &in_order);
        Self { nodes, order: wide.primitive_indices, bounds }
    }
}
