//! A scene on the device: tables, vertices, indices, acceleration structures, textures.
mod block;
mod deform;
mod detail;
mod driver;
mod handles;
mod light_tree;
mod lobe_albedo;
mod policy;
mod rounding;
mod sampled_lights;
mod sketch;
mod software;
mod state;
mod tables;
mod textures;

pub use handles::{SceneHandles, SceneToken};
pub use light_tree::LightTreeUpdate;
pub use policy::{Culling, Policy};
pub use sketch::SceneSketch;
pub use state::Moment;

use super::light_sampling::emits;
use super::{Animator, Camera, Daylight, EnvironmentError, Instance, Mesh, Pose, Scene, SceneFacts};
use crate::gpu::{Buffer, BufferUse, Gpu, GpuError, Image};
use crate::graph::execute::{ExecuteError, ExecuteOptions, Executor, Imports};
use crate::graph::{Access, BufferDesc, DrawLists, Extent, FrameGraph};
use crate::measure::Acceleration as AccelerationReport;
use crate::ray::{Bounds, RayError};
use block::Block;
use deform::Deformation;
use detail::Reduced;
use driver::Driver;
use glam::DVec3;
use magpie_shaders::scene as shared;
use magpie_shaders::view::Sky;
use magpie_shaders::{Address, Rays};
use policy::Seen;
use rayon::prelude::*;
use rounding::Shape;
use sampled_lights::SampledLights;
use software::{Frame, Software};
use state::State;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A light that can cast shadows.
#[derive(Clone, Copy, Debug)]
pub struct ShadowLight {
    /// Index in the scene's lights.
    pub light: u32,
    /// What shaders read of it: its place counted from the origin of the frame.
    pub placed: shared::Light,
    /// It is not where it was in the frame before, wherever that was counted from.
    pub moved: bool,
}

/// Why a scene could not be brought to the device.
#[derive(Debug, thiserror::Error)]
pub enum ResidentError {
    /// An acceleration structure could not be built.
    #[error(transparent)]
    Ray(#[from] RayError),
    /// More than the driver's acceleration structures can hold.
    #[error("{what}: {count} are over the limit of {limit}")]
    Limit {
        /// Of what there are too many.
        what: &'static str,
        /// How many.
        count: usize,
        /// The limit.
        limit: u32,
    },
    /// The environment map is faulty, or too bright for the device.
    #[error("environment map {name:?}: {fault}")]
    Environment {
        /// The map.
        name: String,
        /// What is wrong with it.
        fault: EnvironmentError,
    },
    /// The device refused.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The upload or a build failed.
    #[error(transparent)]
    Upload(#[from] ExecuteError),
}

/// How a scene is brought to the device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResidentOptions {
    /// How rays are traced: for this the acceleration structures are built. The device must be able to.
    pub rays: Rays,
    /// The driver's structures over meshes that keep their shape are compacted.
    pub compaction: bool,
    /// Share of the triangles that rays see of each mesh that keeps its shape, 0 to 1. Below 1, surfaces that rays meet lie up to a
    /// hundredth of a mesh's size beside those that are drawn.
    pub ray_detail: f32,
    /// Alpha below which blended surfaces are not there for raster and rays, 0 to 1. At 0 they always are, and whoever meets them asks
    /// for their alpha.
    pub blend_cutoff: f32,
}

impl Default for ResidentOptions {
    fn default() -> Self {
        Self { rays: Rays::Software, compaction: true, ray_detail: 1.0, blend_cutoff: 0.5 }
    }
}

/// A scene on the device.
pub struct ResidentScene {
    tables: Arc<Buffer>,
    lobe_albedo: Arc<Buffer>,
    single_scattering: bool,
    vertices: Arc<Buffer>,
    indices: Arc<Buffer>,
    /// Those of materials, then that of the environment.
    textures: Vec<Arc<Image>>,
    state: State,
    deformation: Option<Deformation>,
    acceleration: Acceleration,
    report: AccelerationReport,
    /// Of each instance: the mesh that it shows, deforming ones after all others, and its box in object space.
    shown: Vec<(usize, Bounds)>,
    /// What is to be traced has changed since the top level was made.
    changed: bool,
    policy: Policy,
    frames: u64,
    cut: bool,
    number: u64,
    placed: Arc<[Placed]>,
    draws: DrawLists,
    shadow_lights: Vec<u32>,
    facts: Arc<SceneFacts>,
    lights: SampledLights,
    sky: Option<Sky>,
}

static SCENES: AtomicU64 = AtomicU64::new(0);

/// An instance of a scene in the moment that was gone to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// A box around it in the world, counted from the scene's origin, metres.
    pub bounds: Bounds,
    /// The same number for as long as it neither moves nor changes its shape; the scene's origin may shift meanwhile.
    pub changed: u64,
}

/// The acceleration structures, for one way to trace.
enum Acceleration {
    Software(Software),
    Driver(Driver),
}

/// Where the meshes' vertices and indices lie on the device.
struct Geometry<'a> {
    scene: &'a Scene,
    /// Of each mesh what rays see, where that is less.
    reduced: &'a [Option<Reduced>],
    vertices: &'a Arc<Buffer>,
    indices: &'a Arc<Buffer>,
    meshes: Vec<MeshPlace>,
}

/// The tables of one mesh.
#[derive(Clone, Copy)]
struct MeshPlace {
    positions: Address,
    attributes: Address,
    indices: Address,
    /// Those that rays see, and how many triangles that makes.
    ray_indices: Address,
    ray_triangles: u32,
    /// Boxes around its spheres.
    boxes: Option<Address>,
}

/// A scene on the device that several hold: whoever renders it, and the frame that brings it up to date.
pub type SharedScene = Rc<RefCell<ResidentScene>>;

impl ResidentScene {
    /// For several to hold.
    pub fn shared(self) -> SharedScene {
        Rc::new(RefCell::new(self))
    }

    /// Uploads everything and builds the acceleration structures.
    ///
    /// # Errors
    /// Geometry that no tree can hold (with the mesh's name), exhausted memory, a lost device, a device that cannot trace so.
    pub fn new(gpu: &Gpu, scene: &Scene, options: ResidentOptions) -> Result<Self, ResidentError> {
        Self::with_facts(gpu, scene, SceneFacts::new(scene), options)
    }

    /// The same where the facts of the scene are gathered already.
    ///
    /// # Errors
    /// As [`ResidentScene::new`].
    pub fn with_facts(
        gpu: &Gpu,
        scene: &Scene,
        facts: SceneFacts,
        options: ResidentOptions,
    ) -> Result<Self, ResidentError> {
        let facts = Arc::new(facts);
        gpu.check_rays(options.rays)?;
        let mut executor = Executor::new(gpu)?;
        executor.set_options(ExecuteOptions { measure: true, ..executor.options() });
        let mut textures = textures::upload_textures(gpu, &mut executor, scene)?;

        // Indices and vertices.
        let mut indices = Block::default();
        let index_offsets: Vec<_> = scene.meshes.iter().map(|m| indices.add(&tables::raster_indices(m))).collect();
        let animator = Animator::new(scene);
        let reduced = reduce(scene, &animator, options.ray_detail);
        let ray_offsets: Vec<_> = reduced
            .iter()
            .zip(&index_offsets)
            .map(|(r, own)| r.as_ref().map_or(*own, |r| indices.add(&r.indices)))
            .collect();
        let indices = indices.upload(gpu, &mut executor, "scene indices", BufferUse::Index)?;
        let mut vertices = Block::default();
        let offsets: Vec<_> = scene.meshes.iter().map(|m| tables::add_vertices(&mut vertices, m)).collect();
        let vertices = vertices.upload(gpu, &mut executor, "scene vertices", BufferUse::Storage)?;
        let base = vertices.address();
        let place = |mesh: usize| {
            let [positions, attributes, boxes] = offsets[mesh];
            let own = scene.meshes[mesh].indices.len();
            MeshPlace {
                positions: base.offset(positions),
                attributes: base.offset(attributes),
                indices: indices.address().offset(index_offsets[mesh]),
                ray_indices: indices.address().offset(ray_offsets[mesh]),
                ray_triangles: (reduced[mesh].as_ref().map_or(own, |r| r.indices.len()) / 3) as u32,
                boxes: (boxes > 0).then(|| base.offset(boxes)),
            }
        };
        let meshes = (0..scene.meshes.len()).map(place).collect();
        let geometry = Geometry { scene, reduced: &reduced, vertices: &vertices, indices: &indices, meshes };

        // What moves, and the acceleration structures.
        let deformation = Deformation::new(gpu, &mut executor, &animator, &geometry)?;
        let mut report = AccelerationReport::default();
        let pose = animator.pose(0.0);
        let acceleration = match options.rays {
            Rays::Software => {
                let deforming = deformation.as_ref().map(|d| (d, &pose));
                Acceleration::Software(Software::new(gpu, &mut executor, &geometry, deforming, &mut report)?)
            }
            Rays::Query | Rays::Pipeline => {
                let compaction = options.compaction;
                let deforming = deformation.as_ref();
                let driver = Driver::new(gpu, &mut executor, &geometry, deforming, compaction, &mut report)?;
                Acceleration::Driver(driver)
            }
        };

        // Tables. Every instance that deforms has a mesh of its own behind those of the scene.
        let mut tables = Block::default();
        let (materials, layers) = tables::materials(gpu, scene, &textures, options.blend_cutoff)?;
        let (material_table, layer_table) = (tables.add(&materials), tables.add(&layers));
        let deforming = deformation.as_ref().map_or(&[][..], |d| &d.meshes);
        let mut entries: Vec<shared::Mesh> =
            (0..scene.meshes.len()).map(|m| entry(&geometry, &acceleration, m)).collect();
        let mut shown: Vec<(usize, Bounds)> = scene
            .instances
            .iter()
            .map(|i| {
                let [min, max] = scene.meshes[i.mesh as usize].bounds().unwrap_or_default();
                (i.mesh as usize, Bounds { min, max })
            })
            .collect();
        for (at, d) in deforming.iter().enumerate() {
            let mesh = scene.meshes.len() + at;
            let (nodes, primitives) = acceleration.mesh(mesh);
            let (positions, previous_positions, attributes) = (d.positions, d.previous_positions, d.attributes);
            entries.push(shared::Mesh {
                positions,
                previous_positions,
                attributes,
                nodes,
                primitives,
                ..entries[d.mesh]
            });
            shown[d.instance].0 = mesh;
        }
        let mesh_table = tables.add(&entries);
        let tables = tables.upload(gpu, &mut executor, "scene tables", BufferUse::Storage)?;
        let fixed: Vec<shared::Instance> =
            (0..scene.instances.len()).map(|i| tables::instance(scene, &scene.instances[i], shown[i].0)).collect();
        let shape = |(s, i): (&(usize, Bounds), &Instance)| {
            let deviation = reduced[i.mesh as usize].as_ref().map_or(0.0, |r| r.deviation);
            Shape { bounds: s.1, deviation }
        };
        let shapes = shown.iter().zip(&scene.instances).map(shape).collect();
        let lobe_albedo = lobe_albedo::lobe_albedo(gpu, &mut executor)?;
        let root = shared::Scene {
            lobe_albedo: lobe_albedo::address_in(&lobe_albedo, false),
            meshes: tables.address().offset(mesh_table),
            materials: tables.address().offset(material_table),
            layers: if layers.is_empty() { Address::default() } else { tables.address().offset(layer_table) },
            ..acceleration.root()
        };
        let mut sky = scene.daylight.as_ref().map(Daylight::to_gpu);
        if let Some(environment) = &scene.environment {
            let (image, around) = textures::upload_environment(gpu, &mut executor, environment)?;
            textures.push(image);
            sky = Some(around);
        }
        let mut made = Self {
            state: State::new(gpu, animator, fixed, shapes, root)?,
            tables,
            lobe_albedo,
            single_scattering: false,
            deformation,
            acceleration,
            report,
            shown,
            changed: true,
            policy: Policy::default(),
            frames: 0,
            cut: false,
            number: SCENES.fetch_add(1, Ordering::Relaxed),
            placed: Arc::default(),
            draws: tables::draws(scene, &index_offsets),
            shadow_lights: tables::shadow_lights(&scene.lights),
            facts,
            lights: SampledLights::new(scene, &pose),
            sky,
            textures,
            vertices,
            indices,
        };
        made.place();
        // A frame of its own, so that those to come have nothing to bring up to date where nothing moves.
        let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
        made.declare(&mut g, &mut imports, None, &Policy::default())?;
        let executed = executor.run(g, &imports)?;
        if matches!(made.acceleration, Acceleration::Driver(_)) {
            let top = executed.sample.passes.iter().filter(|p| p.name == "acceleration.top");
            made.report.top_ms = top.filter_map(|p| p.gpu_ns).sum::<u64>() as f64 * 1e-6;
        }
        Ok(made)
    }

    /// Goes to a moment: the next frame that is declared shows it.
    pub fn set_moment(&mut self, moment: &Moment) {
        let shifted = self.state.origin != moment.origin;
        self.changed |= self.state.set_moment(moment);
        self.cut = moment.cut;
        if shifted || self.state.is_animated() {
            self.place();
        }
    }

    /// Says anew where every instance is.
    fn place(&mut self) {
        let one = |i: usize| {
            let bounds = self.state.pose.bounds[i].map_or(self.shown[i].1, |[min, max]| Bounds { min, max });
            Placed { bounds: bounds.transformed(&self.state.placed(i)), changed: self.state.changed[i] }
        };
        self.placed = (0..self.shown.len()).map(one).collect();
    }

    /// Multiplies the strength of a light with a factor, at least 0, from the next frame on: 0 switches it off. Without such a light
    /// nothing happens.
    pub fn scale_light(&mut self, light: u32, factor: f32) {
        self.state.scale_light(light as usize, factor);
        Arc::make_mut(&mut self.facts).scale_light(light as usize, factor);
    }

    /// What the scene is made of, with lights as they are dimmed now.
    pub fn facts(&self) -> &Arc<SceneFacts> {
        &self.facts
    }

    /// The frame that was declared did not run: the next one brings everything up to date.
    pub fn forget(&mut self) {
        self.state.forget();
        self.lights.forget();
        if let Some(deformation) = &mut self.deformation {
            deformation.forget();
        }
        match &mut self.acceleration {
            Acceleration::Software(trees) => trees.forget(),
            Acceleration::Driver(driver) => driver.forget(),
        }
        self.changed = true;
    }

    /// Brings the scene into a frame, with the passes that bring it up to date: none where nothing has changed. The camera decides
    /// what the policy leaves out.
    ///
    /// # Errors
    /// Exhausted memory, or a pose that no tree can hold. The frame cannot be run then.
    pub fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        camera: Option<&Camera>,
        policy: &Policy,
    ) -> Result<SceneHandles, ResidentError> {
        self.frames += 1;
        let mut buffer = |name, buffer: &Arc<Buffer>, g: &mut FrameGraph| {
            g.import_buffer(name, BufferDesc::new(buffer.bytes()), Access::CopyWrite, imports.buffer(buffer)).read()
        };
        let tables = buffer("scene.tables", &self.tables, g);
        let vertices = buffer("scene.vertices", &self.vertices, g);
        let indices = buffer("scene.indices", &self.indices, g);
        let emitters = self.lights.emitters.as_ref().map(|b| buffer("scene.emitters", b, g));
        let lights = self.lights.all.as_ref().map(|b| buffer("scene.lights", b, g));
        let state = self.state.declare(g, imports)?;
        let mut moved = std::mem::take(&mut self.changed) | (self.policy != *policy);
        // What the camera decides changes with the camera.
        moved |= !policy.culling.is_off();
        self.policy = *policy;

        // Vertices that move.
        let (mut deformed, mut changed) = (None, None);
        if let Some(deformation) = &mut self.deformation {
            let (made, anew) =
                deformation.declare(g, imports, &self.state.pose, self.state.is_animated(), self.cut, vertices)?;
            deformed = Some(made);
            changed = deformed.filter(|_| anew);
        }

        // What rays see.
        let mut counts = AccelerationReport::default();
        let seen: Vec<Seen> = if moved || changed.is_some() {
            (0..self.shown.len()).map(|i| self.seen(i, camera, policy, &mut counts)).collect()
        } else {
            Vec::new()
        };
        if !seen.is_empty() {
            let AccelerationReport { traced, far, outside, small, .. } = counts;
            self.report = AccelerationReport { traced, far, outside, small, ..self.report };
        }
        let now = &self.state;
        let (pose, root, number) = (&now.pose, now.root(), self.frames);
        let frame = Frame { policy, seen: &seen, pose, moved, deformed: changed, indices, root, number };
        let (tlas, bottom) = match &mut self.acceleration {
            Acceleration::Software(trees) => {
                let made = trees.declare(g, imports, &frame)?;
                self.report.top_ms = trees.top_ms();
                made
            }
            Acceleration::Driver(driver) => (driver.declare(g, imports, &frame, |i| now.instance(i))?, [None; 2]),
        };
        let light_tree = None;
        Ok(SceneHandles { state, tables, vertices, deformed, indices, emitters, lights, light_tree, tlas, bottom })
    }

    /// An instance for the top level.
    fn seen(&self, index: usize, camera: Option<&Camera>, policy: &Policy, counts: &mut AccelerationReport) -> Seen {
        let (mesh, bounds) = self.shown[index];
        let world_from_object = self.state.placed(index);
        let traced = match camera.filter(|_| !policy.culling.is_off()) {
            Some(camera) => {
                let bounds = self.state.pose.bounds[index].map_or(bounds, |[min, max]| Bounds { min, max });
                policy.culling.decide(&bounds.transformed(&world_from_object), camera, self.state.origin, counts)
            }
            None => {
                counts.traced += 1;
                true
            }
        };
        Seen { mesh, world_from_object, traced }
    }

    /// The world point that is the origin on the device, of the moment that was gone to. Metres.
    pub fn origin(&self) -> DVec3 {
        self.state.origin
    }

    /// One draw per instance, in lists by class.
    pub fn draws(&self) -> &DrawLists {
        &self.draws
    }

    /// Where every instance is in the moment that was gone to, and since when.
    pub fn placed(&self) -> &Arc<[Placed]> {
        &self.placed
    }

    /// A number that no other scene of this run has.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// The lights that can cast shadows, at most [`MAX_SHADOW_LIGHTS`](magpie_shaders::view::MAX_SHADOW_LIGHTS), as they are in the
    /// moment that was gone to. The one that matters most comes first: directional lights in the order of the scene, then lamps by power, as they
    /// are at rest, so that none changes its place while it moves.
    pub fn shadow_lights(&self) -> Vec<ShadowLight> {
        let shadow_light = |light: u32| {
            let index = light as usize;
            ShadowLight { light, placed: self.state.light(index), moved: self.state.light_moved(index) }
        };
        self.shadow_lights.iter().map(|light| shadow_light(*light)).collect()
    }

    /// The sky, if the scene has one: that of its environment map, else that of its daylight.
    pub fn sky(&self) -> Option<Sky> {
        self.sky
    }

    /// From the next frame on, the surface model leaves out light that scatters more than once between microfacets, or has it again.
    pub fn set_single_scattering(&mut self, single: bool) {
        self.single_scattering = single;
        self.state.set_lobe_albedo(self.lobe_albedo_address());
    }

    /// The tables of the specular lobe's albedo, [`LobeAlbedo`](magpie_shaders::lobe_albedo::LobeAlbedo), on the device.
    pub fn lobe_albedo(&self) -> &Arc<Buffer> {
        &self.lobe_albedo
    }

    /// The address of the one that is in use.
    pub fn lobe_albedo_address(&self) -> Address {
        lobe_albedo::address_in(&self.lobe_albedo, self.single_scattering)
    }

    /// Where everything is in the moment that was gone to.
    pub fn pose(&self) -> &Pose {
        &self.state.pose
    }

    /// Whether anything in it ever moves.
    pub fn is_animated(&self) -> bool {
        self.state.is_animated()
    }

    /// What rays see as of the newest top level, and what the acceleration structures take.
    pub fn acceleration(&self) -> AccelerationReport {
        self.report
    }

    /// Bytes of geometry, tables and textures.
    pub fn scene_bytes(&self) -> u64 {
        let textures: u64 = self.textures.iter().map(|t| t.bytes()).sum();
        let deforming = self.deformation.as_ref().map_or(0, Deformation::bytes);
        let tables = self.tables.bytes() + self.state.memory.bytes() + self.lights.bytes();
        tables + self.vertices.bytes() + self.indices.bytes() + deforming + textures
    }

    /// Bytes of acceleration structures.
    pub fn acceleration_bytes(&self) -> u64 {
        self.report.bottom_bytes + self.report.top_bytes
    }
}

/// What rays see of each mesh that keeps its shape and does not emit, where that is less than all.
fn reduce(scene: &Scene, animator: &Animator, detail: f32) -> Vec<Option<Reduced>> {
    let mut whole = vec![false; scene.meshes.len()];
    for (index, instance) in scene.instances.iter().enumerate() {
        // What emits is sampled triangle by triangle, and must not hide its own light.
        whole[instance.mesh as usize] |= animator.deforms(index) || emits(&scene.materials[instance.material as usize]);
    }
    let one = |(mesh, whole): (&Mesh, bool)| if whole { None } else { detail::reduce(mesh, detail) };
    scene.meshes.par_iter().zip(whole).map(one).collect()
}

/// A mesh of the scene as shaders read it.
fn entry(geometry: &Geometry<'_>, acceleration: &Acceleration, mesh: usize) -> shared::Mesh {
    let MeshPlace { positions, attributes, indices, ray_indices, .. } = geometry.meshes[mesh];
    let of = &geometry.scene.meshes[mesh];
    let (nodes, primitives) = acceleration.mesh(mesh);
    let primitive_count = (of.indices.len() / 3 + of.spheres.len()) as u32;
    let previous_positions = positions;
    shared::Mesh { positions, previous_positions, attributes, indices, ray_indices, nodes, primitives, primitive_count }
}

impl Acceleration {
    /// Nodes and leaves of a mesh's tree; none where the driver traces.
    fn mesh(&self, mesh: usize) -> (Address, Address) {
        match self {
            Self::Software(trees) => trees.meshes[mesh],
            Self::Driver(_) => Default::default(),
        }
    }

    /// The part of the scene's root that says where rays begin.
    fn root(&self) -> shared::Scene {
        match self {
            Self::Software(trees) => {
                let (tlas_nodes, tlas_instances) = trees.top();
                shared::Scene { tlas_nodes, tlas_instances, ..Default::default() }
            }
            Self::Driver(driver) => shared::Scene { tlas: driver.top(), ..Default::default() },
        }
    }
}
