//! Emissive meshes and where they are: what the trees over their primitives are made of.
use super::bounds::{sphere_leaf, triangle_leaf};
use crate::scene::light_sampling::{emission, is_emitter, luminance};
use crate::scene::{AlphaMode, Pose, Scene, deform};
use glam::Vec3;
use magpie_shaders::light_tree::{LIGHT_NODE_PRIMITIVE, LIGHT_NODE_TWO_SIDED, LightNode};
use rayon::prelude::*;
use std::collections::HashMap;

/// The emissive instances of a scene. Meshes that keep their shape are shared by all instances with the same material.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    pub(super) meshes: Vec<EmissiveMesh>,
    pub(super) placed: Vec<PlacedMesh>,
    /// Number of instances, those that do not emit among them.
    pub(super) count: usize,
}

/// The primitives of a mesh with what they emit.
#[derive(Clone, Debug)]
pub(super) struct EmissiveMesh {
    shapes: Shapes,
    /// Luminance of the radiance of each primitive, averaged over its texture.
    pub emission: Vec<f32>,
    two_sided: bool,
    /// The instance to which a mesh that deforms belongs.
    pub deforms: Option<u32>,
}

#[derive(Clone, Debug)]
enum Shapes {
    Triangles(Vec<[Vec3; 3]>),
    /// Centre and radius.
    Spheres(Vec<(Vec3, f32)>),
}

/// An emissive instance.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedMesh {
    pub instance: u32,
    /// Index of its mesh among the emissive ones.
    pub mesh: usize,
    /// Entry of its first primitive in the table of lights.
    pub first_entry: u32,
}

impl Emitters {
    /// Those of a scene in a pose. `first_entries`: for each instance the entry of its first primitive.
    pub fn new(scene: &Scene, pose: &Pose, first_entries: &[u32]) -> Self {
        let mut all = Self { count: scene.instances.len(), ..Self::default() };
        let mut known = HashMap::new();
        for (instance, placed) in scene.instances.iter().enumerate() {
            if !is_emitter(scene, placed) {
                continue;
            }
            let deforms = pose.bounds[instance].is_some();
            let key = (placed.mesh, placed.material, deforms.then_some(instance));
            let mesh = *known.entry(key).or_insert_with(|| {
                all.meshes.push(EmissiveMesh::new(scene, pose, instance, deforms));
                all.meshes.len() - 1
            });
            if !all.meshes[mesh].emission.is_empty() {
                let first_entry = first_entries[instance];
                all.placed.push(PlacedMesh { instance: instance as u32, mesh, first_entry });
            }
        }
        all
    }

    /// The instances that emit, and of these the ones that deform.
    pub(crate) fn instances(&self) -> (Vec<usize>, Vec<usize>) {
        let all = self.placed.iter().map(|placed| placed.instance as usize).collect();
        let deforming = self.meshes.iter().filter(|mesh| !mesh.emission.is_empty());
        (all, deforming.filter_map(|mesh| mesh.deforms).map(|instance| instance as usize).collect())
    }
}

impl EmissiveMesh {
    fn new(scene: &Scene, pose: &Pose, instance: usize, deforms: bool) -> Self {
        let placed = &scene.instances[instance];
        let (mesh, material) = (&scene.meshes[placed.mesh as usize], &scene.materials[placed.material as usize]);
        let deformed = deforms.then(|| deform(mesh, &pose.joints[instance], &pose.weights[instance]).positions);
        let positions = deformed.as_deref().unwrap_or(&mesh.positions);
        let deforms = deforms.then_some(instance as u32);
        let two_sided = material.double_sided;
        if !mesh.spheres.is_empty() {
            let alpha = if material.alpha == AlphaMode::Blend { material.base_colour.w.min(1.0) } else { 1.0 };
            let emission = vec![luminance(material.emission) as f32 * alpha; mesh.spheres.len()];
            let spheres = mesh.spheres.iter().map(|sphere| (sphere.centre, sphere.radius)).collect();
            return Self { shapes: Shapes::Spheres(spheres), emission, two_sided, deforms };
        }
        let corners: Vec<[Vec3; 3]> =
            mesh.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| positions[t[k] as usize])).collect();
        let emission =
            mesh.indices.par_chunks_exact(3).map(|t| emission(scene, material, mesh, t).max(0.0) as f32).collect();
        Self { shapes: Shapes::Triangles(corners), emission, two_sided, deforms }
    }

    /// A leaf for each primitive, in its order.
    pub fn leaves(&self) -> Vec<LightNode> {
        let child = |primitive: usize| {
            LIGHT_NODE_PRIMITIVE | primitive as u32 | if self.two_sided { LIGHT_NODE_TWO_SIDED } else { 0 }
        };
        let emission = self.emission.par_iter().enumerate();
        match &self.shapes {
            Shapes::Triangles(all) => {
                emission.zip(all).map(|((i, emission), corners)| triangle_leaf(*corners, *emission, child(i))).collect()
            }
            Shapes::Spheres(all) => emission
                .zip(all)
                .map(|((i, emission), (centre, radius))| sphere_leaf(*centre, *radius, *emission, child(i)))
                .collect(),
        }
    }
}
