//! A scene as the declaration of a frame needs it, without a device.
use super::state::shift;
use super::tables::{draws, light, raster_index_count, shadow_lights};
use super::{Placed, SceneHandles, ShadowLight};
use crate::graph::{Access, BufferDesc, DrawLists, FrameGraph, ImportKey};
use crate::ray::Bounds;
use crate::scene::light_tree::has_lights;
use crate::scene::{Animator, Camera, FloatingOrigin, Scene, SceneFacts, single};
use crate::slot::Needs;
use glam::{DVec3, Vec3};
use magpie_shaders::scene as shared;
use std::sync::Arc;

/// What a frame of a scene is declared from where there is no device: everything but the objects behind the handles. The frame can be
/// planned, not run.
///
/// It shows the scene at rest, brought up to date. Passes that move instances and rebuild acceleration structures are not in it.
#[derive(Clone, Debug)]
pub struct SceneSketch {
    /// What the scene is made of.
    pub facts: Arc<SceneFacts>,
    /// What the raster passes draw.
    pub draws: DrawLists,
    /// The lights that can cast shadows, the one that matters most first.
    pub shadow_lights: Vec<ShadowLight>,
    /// Where the instances are.
    pub placed: Arc<[Placed]>,
    /// From where coordinates are counted.
    pub origin: DVec3,
    bytes: Bytes,
    deforms: bool,
    emits: bool,
    lights: bool,
    light_tree: bool,
}

/// Sizes of the scene's buffers.
#[derive(Clone, Copy, Debug)]
struct Bytes {
    state: u64,
    tables: u64,
    vertices: u64,
    indices: u64,
}

impl SceneSketch {
    /// Sketches a scene as this camera sees it, with the tables that `needs` asks for.
    #[must_use]
    pub fn new(scene: &Scene, facts: Arc<SceneFacts>, camera: &Camera, needs: &Needs) -> Self {
        let origin = FloatingOrigin::default().follow(camera);
        let (animator, pose) = (Animator::new(scene), Animator::new(scene).pose(0.0));
        let shadow_light = |index: u32| ShadowLight {
            light: index,
            placed: light(&pose.lights[index as usize], origin),
            moved: false,
        };
        let place = |(i, instance): (usize, &crate::scene::Instance)| {
            let [min, max] =
                pose.bounds[i].or_else(|| scene.meshes[instance.mesh as usize].bounds()).unwrap_or_default();
            let world_from_object = single(&shift(&pose.instances[i], origin));
            Placed { bounds: Bounds { min, max }.transformed(&world_from_object), changed: 0 }
        };
        let mut first = 0;
        let offsets: Vec<u64> = scene
            .meshes
            .iter()
            .map(|mesh| {
                first += 4 * raster_index_count(mesh) as u64;
                first - 4 * raster_index_count(mesh) as u64
            })
            .collect();
        let vertex = (size_of::<Vec3>() + size_of::<shared::VertexAttributes>()) as u64;
        Self {
            draws: draws(scene, &offsets),
            shadow_lights: shadow_lights(&scene.lights).into_iter().map(shadow_light).collect(),
            placed: scene.instances.iter().enumerate().map(place).collect(),
            origin,
            bytes: Bytes {
                state: (size_of::<shared::Scene>()
                    + scene.instances.len() * size_of::<shared::Instance>()
                    + 2 * scene.lights.len() * size_of::<shared::Light>()) as u64,
                tables: (scene.materials.len() * size_of::<shared::Material>()
                    + scene.meshes.len() * size_of::<shared::Mesh>()) as u64,
                vertices: vertex * scene.meshes.iter().map(|m| m.positions.len() as u64).sum::<u64>(),
                indices: first,
            },
            deforms: (0..scene.instances.len()).any(|i| animator.deforms(i)),
            emits: needs.emitters && facts.emits(),
            lights: needs.light_tables || needs.light_tree,
            light_tree: needs.light_tree && has_lights(scene),
            facts,
        }
    }

    /// Brings the scene into a frame.
    pub fn declare(&self, g: &mut FrameGraph) -> SceneHandles {
        let mut key = 0;
        let mut next = || {
            key += 1;
            ImportKey::Caller(key)
        };
        let mut buffer = |name, bytes: u64, g: &mut FrameGraph| {
            g.import_buffer(name, BufferDesc::new(bytes.max(4)), Access::BufferRead, next()).read()
        };
        let Bytes { state, tables, vertices, indices } = self.bytes;
        SceneHandles {
            state: buffer("scene.state", state, g),
            tables: buffer("scene.tables", tables, g),
            vertices: buffer("scene.vertices", vertices, g),
            deformed: self.deforms.then(|| buffer("scene.deformed", vertices, g)),
            indices: buffer("scene.indices", indices, g),
            emitters: self.emits.then(|| buffer("scene.emitters", 4, g)),
            lights: self.lights.then(|| buffer("scene.lights", 4, g)),
            light_tree: self.light_tree.then(|| buffer("scene.light_tree", 4, g)),
            bottom: [None; 2],
            tlas: g.import_tlas("scene.tlas", Access::Trace, ImportKey::Caller(u32::MAX)),
        }
    }
}
