//! Top-level BVH over the instances, in world space. Scenes with moving instances build or refit it every frame.
use super::cwbvh::{Tree, in_range};
use super::fit::{fit, stack_need};
use super::{Bounds, MeshBvh, PRIMITIVE_LIMIT, RayError};
use glam::{Affine3A, DAffine3, DMat3, Mat3};
use magpie_shaders::scene::{BvhInstance, BvhNode, TRAVERSAL_STACK};
use rayon::prelude::*;

/// Least number of instances per parallel task.
const GRAIN: usize = 1024;

/// What the top level needs to know about an instance.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Transform from object to world space.
    pub world_from_object: Affine3A,
    /// Bounding box of its mesh, object space; empty if no ray can hit the mesh.
    pub bounds: Bounds,
    /// Stack entries that a traversal of its mesh needs: [`MeshBvh::stack`].
    pub stack: u32,
}

/// Placements of instances, each given by its world-from-object transform and the index of its mesh in `meshes`.
///
/// # Errors
/// An instance of a mesh that does not exist.
pub fn placements(instances: &[(Affine3A, u32)], meshes: &[MeshBvh]) -> Result<Vec<Placement>, RayError> {
    let place = |(instance, &(world_from_object, mesh)): (usize, &(Affine3A, u32))| {
        let bvh = meshes.get(mesh as usize).ok_or(RayError::Mesh { instance, mesh, meshes: meshes.len() })?;
        Ok(Placement { world_from_object, bounds: bvh.bounds, stack: bvh.stack })
    };
    instances.iter().enumerate().map(place).collect()
}

/// Top-level BVH over the instances, in world space.
#[derive(Clone, Debug)]
pub struct SceneBvh {
    /// The root first, and every node before its children. Never empty: a scene that no ray can hit has one node without children.
    pub nodes: Vec<BvhNode>,
    /// In the order of the leaves.
    pub instances: Vec<BvhInstance>,
    /// Indices of the instances that are left out because their transform has no inverse, such as a scale of zero.
    pub flat: Vec<u32>,
    /// Bounding box of all instances, world space, metres.
    pub bounds: Bounds,
    /// Largest number of stack entries that a traversal of both levels needs.
    pub stack: u32,
    /// Number of placements that it was built from.
    placed: usize,
}

impl SceneBvh {
    /// Builds the BVH over all instances, on all cores.
    ///
    /// # Errors
    /// An instance whose transform is not finite or that reaches beyond [`super::COORDINATE_LIMIT`], more than
    /// [`PRIMITIVE_LIMIT`] instances, or two levels too deep for the shader's stack.
    pub fn build(placements: &[Placement]) -> Result<Self, RayError> {
        if placements.len() > PRIMITIVE_LIMIT {
            return Err(RayError::TooMany { count: placements.len() });
        }
        Self::over(placements, &in_the_world(placements)?)
    }

    /// Refits the boxes to moved instances and keeps the topology. This is far cheaper than [`Self::build`], but rays get slower
    /// the further instances have moved apart. Rebuilds if an instance was added or removed, or if its transform became or
    /// stopped being invertible.
    ///
    /// # Errors
    /// As [`Self::build`]. The BVH is then unchanged.
    pub fn refit(&mut self, placements: &[Placement]) -> Result<(), RayError> {
        let found = in_the_world(placements)?;
        let reached = found.iter().filter(|w| matches!(w, World::Box(_))).count();
        let boxes: Option<Vec<Bounds>> = self
            .instances
            .iter()
            .map(|i| match found.get(i.instance as usize) {
                Some(World::Box(bounds)) => Some(*bounds),
                _ => None,
            })
            .collect();
        let same = placements.len() == self.placed && reached == self.instances.len();
        let (true, Some(boxes)) = (same, boxes) else {
            *self = Self::over(placements, &found)?;
            return Ok(());
        };
        let order: Vec<u32> = self.instances.iter().map(|i| i.instance).collect();
        let stack = stack(&self.nodes, &order, placements)?;
        let bounds = fit(&mut self.nodes, &boxes);
        let instances = instances(&order, &boxes);
        *self = Self {
            nodes: std::mem::take(&mut self.nodes),
            instances,
            flat: flat(&found),
            bounds,
            stack,
            placed: self.placed,
        };
        Ok(())
    }

    fn over(placements: &[Placement], found: &[World]) -> Result<Self, RayError> {
        let (kept, boxes): (Vec<u32>, Vec<Bounds>) = (0..)
            .zip(found)
            .filter_map(
                |(instance, world)| if let World::Box(bounds) = world { Some((instance, *bounds)) } else { None },
            )
            .unzip();
        let tree = Tree::build(&boxes);
        let order: Vec<u32> = tree.order.iter().map(|&i| kept[i as usize]).collect();
        let boxes: Vec<Bounds> = tree.order.iter().map(|&i| boxes[i as usize]).collect();
        let stack = stack(&tree.nodes, &order, placements)?;
        Ok(Self {
            nodes: tree.nodes,
            instances: instances(&order, &boxes),
            flat: flat(found),
            bounds: tree.bounds,
            stack,
            placed: placements.len(),
        })
    }
}

/// Where an instance is in the world.
enum World {
    /// It has this bounding box.
    Box(Bounds),
    /// Its mesh is empty.
    Empty,
    /// Its transform has no inverse.
    Flat,
}

fn in_the_world(placements: &[Placement]) -> Result<Vec<World>, RayError> {
    let one = |(instance, placement): (usize, &Placement)| {
        let bounds = placement.bounds.transformed(&placement.world_from_object);
        let reachable = bounds.is_empty() || in_range(bounds.min) && in_range(bounds.max);
        if !placement.world_from_object.is_finite() || !reachable {
            return Err(RayError::Instance { instance, min: bounds.min.to_array(), max: bounds.max.to_array() });
        }
        Ok(match object_from_world(&placement.world_from_object) {
            None => World::Flat,
            Some(_) if bounds.is_empty() => World::Empty,
            Some(_) => World::Box(bounds),
        })
    };
    let all: Vec<_> = placements.par_iter().enumerate().with_min_len(GRAIN).map(one).collect();
    // In order, so that the first error is the one reported.
    all.into_iter().collect()
}

fn flat(found: &[World]) -> Vec<u32> {
    (0..).zip(found).filter(|(_, world)| matches!(world, World::Flat)).map(|(instance, _)| instance).collect()
}

fn instances(order: &[u32], boxes: &[Bounds]) -> Vec<BvhInstance> {
    order
        .iter()
        .zip(boxes)
        .map(|(&instance, b)| BvhInstance { min: b.min.to_array(), instance, max: b.max.to_array(), unused: 0 })
        .collect()
}

fn stack(nodes: &[BvhNode], order: &[u32], placements: &[Placement]) -> Result<u32, RayError> {
    let needed = stack_need(nodes, |p| Some(placements[order[p] as usize].stack));
    if needed > TRAVERSAL_STACK { Err(RayError::Stack { needed, limit: TRAVERSAL_STACK }) } else { Ok(needed) }
}

/// The inverse of an instance's transform, computed in `f64` and rounded once; `None` if it has none in `f32`.
///
/// The instance table of the shaders and the BVH must agree on which instances have an inverse, so both use this function.
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
