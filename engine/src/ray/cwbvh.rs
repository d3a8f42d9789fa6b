//! Compressed wide BVHs (Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
//! BVHs"): eight children per node of 80 bytes, widened and compressed by `obvhs`.
use super::fit::{fit, stack_need};
use super::split::binary_tree;
use super::{Bounds, COORDINATE_LIMIT, PRIMITIVE_LIMIT, RayError};
use glam::{Affine3A, DAffine3, DMat3, DVec3, Mat3, Vec3};
use magpie_shaders::scene::{BvhNode, BvhTriangle, TRAVERSAL_STACK};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use std::mem::offset_of;

/// A leaf counts its primitives in three bits, in unary.
const PRIMITIVES_PER_LEAF: u32 = 3;

// A node is taken over from `obvhs` byte by byte.
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

/// Bottom level: the triangles of one mesh, in object space.
#[derive(Clone, Debug)]
pub struct MeshBvh {
    /// Root first; never empty: a mesh without triangles has one node without children.
    pub nodes: Vec<BvhNode>,
    /// In the order of the tree. Triangles without area are left out: no ray hits them.
    pub triangles: Vec<BvhTriangle>,
    /// Box around `triangles`, object space.
    pub bounds: Bounds,
    /// Stack entries that a walk needs at most.
    pub stack: u32,
}

impl MeshBvh {
    /// Builds the tree of an indexed triangle list. `positions`: object space. Deterministic; time is `n log n`.
    ///
    /// # Errors
    /// A table that is out of shape or range, a position that is not finite or beyond [`COORDINATE_LIMIT`], or more triangles
    /// than [`PRIMITIVE_LIMIT`]. Add the name of the mesh with [`RayError::in_mesh`].
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
        let corners = indices.as_chunks::<3>().0.iter().map(|t| t.map(|i| positions[i as usize]));
        let (kept, boxes): (Vec<BvhTriangle>, Vec<Bounds>) = corners
            .enumerate()
            .filter(|(_, corners)| has_area(corners))
            .map(|(triangle, corners)| {
                let [v0, v1, v2] = corners.map(|c| c.to_array());
                (BvhTriangle { v0, v1, v2, triangle: triangle as u32 }, Bounds::of_points(&corners))
            })
            .unzip();
        let tree = Tree::build(&boxes);
        let stack = stack_need(&tree.nodes, |_| None);
        if stack > TRAVERSAL_STACK {
            return Err(RayError::Stack { needed: stack, limit: TRAVERSAL_STACK });
        }
        let triangles = tree.order.iter().map(|&i| kept[i as usize]).collect();
        Ok(Self { nodes: tree.nodes, triangles, bounds: tree.bounds, stack })
    }
}

/// Top level: the placed meshes, in world space.
#[derive(Clone, Debug)]
pub struct SceneBvh {
    /// Root first; never empty: a scene that no ray can hit has one node without children.
    pub nodes: Vec<BvhNode>,
    /// Index of the instance of each primitive, in the order of the tree.
    pub instances: Vec<u32>,
    /// Instances that are not in the tree because their transform has no inverse (a scale of zero).
    pub flat: Vec<u32>,
    /// Box around all of it, world space, metres.
    pub bounds: Bounds,
    /// Stack entries that a walk through both levels needs at most.
    pub stack: u32,
}

impl SceneBvh {
    /// Builds the tree over `instances`: world from object, and index into `meshes`.
    ///
    /// # Errors
    /// An instance of a mesh that is not there, with a transform that is not finite, or beyond [`COORDINATE_LIMIT`]; more than
    /// [`PRIMITIVE_LIMIT`] instances; or two levels so deep together that the stack of the shader would not hold a walk.
    pub fn build(instances: &[(Affine3A, u32)], meshes: &[MeshBvh]) -> Result<Self, RayError> {
        if instances.len() > PRIMITIVE_LIMIT {
            return Err(RayError::TooMany { count: instances.len() });
        }
        let (mut kept, mut boxes, mut flat) = (Vec::new(), Vec::new(), Vec::new());
        for (instance, &(world_from_object, mesh)) in instances.iter().enumerate() {
            let Some(bvh) = meshes.get(mesh as usize) else {
                return Err(RayError::Mesh { instance, mesh, meshes: meshes.len() });
            };
            let bounds = bvh.bounds.transformed(&world_from_object);
            let reachable = bounds.is_empty() || in_range(bounds.min) && in_range(bounds.max);
            if !world_from_object.is_finite() || !reachable {
                let (min, max) = (bounds.min.to_array(), bounds.max.to_array());
                return Err(RayError::Instance { instance, min, max });
            }
            if object_from_world(&world_from_object).is_none() {
                flat.push(instance as u32);
            } else if !bounds.is_empty() {
                kept.push(instance as u32);
                boxes.push(bounds);
            }
        }
        let tree = Tree::build(&boxes);
        let order: Vec<u32> = tree.order.iter().map(|&i| kept[i as usize]).collect();
        let stack = stack_need(&tree.nodes, |p| Some(meshes[instances[order[p] as usize].1 as usize].stack));
        if stack > TRAVERSAL_STACK {
            return Err(RayError::Stack { needed: stack, limit: TRAVERSAL_STACK });
        }
        Ok(Self { nodes: tree.nodes, instances: order, flat, bounds: tree.bounds, stack })
    }
}

/// The inverse of an instance's transform, computed in `f64` and rounded once; `None` where there is none in `f32`.
///
/// The shader's table and the tree must agree on which instances have one: take it from here.
pub fn object_from_world(world_from_object: &Affine3A) -> Option<Affine3A> {
    let m = world_from_object.matrix3;
    let columns = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.as_dvec3());
    let offset = world_from_object.translation.as_dvec3();
    let world = DAffine3 { matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]), translation: offset };
    if world.matrix3.determinant() == 0.0 {
        return None;
    }
    let inverse = world.inverse();
    let [x, y, z] = [inverse.matrix3.x_axis, inverse.matrix3.y_axis, inverse.matrix3.z_axis].map(|c| c.as_vec3());
    let object = Affine3A::from_mat3_translation(Mat3::from_cols(x, y, z), inverse.translation.as_vec3());
    object.is_finite().then_some(object)
}

fn in_range(p: Vec3) -> bool {
    p.abs().cmple(Vec3::splat(COORDINATE_LIMIT)).all()
}

/// Whether a triangle has area: products of `f32` are exact in `f64`, so that three corners in a line give zero.
fn has_area(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|c| c.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

/// A compressed wide tree over boxes.
struct Tree {
    nodes: Vec<BvhNode>,
    /// Index of the box of each primitive, in the order of the tree.
    order: Vec<u32>,
    bounds: Bounds,
}

impl Tree {
    fn build(boxes: &[Bounds]) -> Self {
        if boxes.is_empty() {
            return Self { nodes: vec![BvhNode::default()], order: Vec::new(), bounds: Bounds::EMPTY };
        }
        // The shape of the tree does not depend on scale. At unit size no surface area overflows or fades to zero, which
        // would leave the heuristic without a guide.
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
