//! A scene on the device: tables, vertices, indices, acceleration structures, textures.
mod block;
mod driver;
mod software;
mod tables;
mod textures;

use super::{Daylight, Scene};
use crate::gpu::{Buffer, BufferUse, Gpu, GpuError, Image};
use crate::graph::execute::{ExecuteError, ExecuteOptions, Executor, Imports};
use crate::graph::{
    Access, Buffer as GraphBuffer, BufferDesc, BufferToken, Draw, FrameGraph, Handle, PassBuilder, Tlas, TraceToken,
};
use crate::ray::RayError;
use block::Block;
use driver::Driver;
use magpie_shaders::scene as shared;
use magpie_shaders::view::Sky;
use magpie_shaders::{Address, Rays};
use software::Software;
use std::sync::Arc;

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
    /// The device refused.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The upload or a build failed.
    #[error(transparent)]
    Upload(#[from] ExecuteError),
}

/// How a scene is brought to the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResidentOptions {
    /// How rays are traced: for this the acceleration structures are built. The device must be able to.
    pub rays: Rays,
    /// The driver's structures over meshes that keep their shape are compacted.
    pub compaction: bool,
}

impl Default for ResidentOptions {
    fn default() -> Self {
        Self { rays: Rays::Software, compaction: true }
    }
}

/// What the acceleration structures of a scene take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AccelerationReport {
    /// Bytes of all bottom levels.
    pub bottom_bytes: u64,
    /// The same before compaction.
    pub uncompacted_bytes: u64,
    /// Bytes of the top level.
    pub top_bytes: u64,
    /// Milliseconds to build all bottom levels: of the device where the driver builds, else of the host.
    pub bottom_ms: f64,
    /// Milliseconds to build the top level, likewise.
    pub top_ms: f64,
}

/// A scene on the device.
pub struct ResidentScene {
    tables: Arc<Buffer>,
    vertices: Arc<Buffer>,
    indices: Arc<Buffer>,
    textures: Vec<Arc<Image>>,
    acceleration: Acceleration,
    report: AccelerationReport,
    root: Address,
    draws: Arc<[Draw]>,
    key_light: Option<u32>,
    sky: Option<Sky>,
}

/// The acceleration structures, for one way to trace.
enum Acceleration {
    Software(Software),
    Driver(Driver),
}

/// The scene's resources as one frame's graph knows them.
#[derive(Clone, Copy, Debug)]
pub struct SceneHandles {
    /// Root, instances, meshes, materials and lights.
    pub tables: Handle<GraphBuffer>,
    /// Positions and attributes of every mesh.
    pub vertices: Handle<GraphBuffer>,
    /// Indices of every mesh, one after another.
    pub indices: Handle<GraphBuffer>,
    /// The acceleration structure.
    pub tlas: Handle<Tlas>,
}

impl SceneHandles {
    /// Declares that a pass looks up what the scene is made of. The token is that of the tables.
    pub fn read(self, p: &mut PassBuilder<'_>) -> BufferToken {
        p.read(self.vertices);
        p.read(self.indices);
        p.read(self.tables)
    }

    /// Declares that a pass traces rays, and may look up what they hit.
    pub fn trace(self, p: &mut PassBuilder<'_>) -> TraceToken {
        self.read(p);
        p.trace(self.tlas)
    }
}

/// Where the meshes' vertices and indices lie on the device.
struct Geometry<'a> {
    scene: &'a Scene,
    vertices: &'a Arc<Buffer>,
    indices: &'a Arc<Buffer>,
    /// Of each mesh: positions and indices.
    meshes: Vec<(Address, Address)>,
}

impl ResidentScene {
    /// Uploads everything and builds the acceleration structures.
    ///
    /// # Errors
    /// Geometry that no tree can hold (with the mesh's name), exhausted memory, a lost device, a device that cannot trace so.
    pub fn new(gpu: &Gpu, scene: &Scene, options: ResidentOptions) -> Result<Self, ResidentError> {
        gpu.check_rays(options.rays)?;
        let mut executor = Executor::new(gpu)?;
        executor.set_options(ExecuteOptions { measure: true, ..executor.options() });
        let textures = textures::upload_textures(gpu, &mut executor, scene)?;

        // Indices and vertices.
        let mut indices = Block::default();
        let index_offsets: Vec<_> = scene.meshes.iter().map(|m| indices.add(&m.indices)).collect();
        let indices = indices.upload(gpu, &mut executor, "scene indices", BufferUse::Index)?;
        let mut vertices = Block::default();
        let vertex_offsets: Vec<_> =
            scene.meshes.iter().map(|m| (vertices.add(&m.positions), vertices.add(&tables::attributes(m)))).collect();
        let vertices = vertices.upload(gpu, &mut executor, "scene vertices", BufferUse::Storage)?;
        let places = vertex_offsets.iter().zip(&index_offsets);
        let place = |((positions, _), indexed): (&(u64, u64), &u64)| {
            (vertices.address().offset(*positions), indices.address().offset(*indexed))
        };
        let geometry = Geometry { scene, vertices: &vertices, indices: &indices, meshes: places.map(place).collect() };

        // Acceleration structures.
        let mut report = AccelerationReport::default();
        let acceleration = match options.rays {
            Rays::Software => Acceleration::Software(Software::new(gpu, &mut executor, scene, &mut report)?),
            Rays::Query | Rays::Pipeline => {
                Acceleration::Driver(Driver::new(gpu, &mut executor, &geometry, options.compaction, &mut report)?)
            }
        };

        // Tables; their addresses follow from the base, so places are taken first and filled once the base is known.
        let mut tables = Block::default();
        let materials = tables::materials(gpu, scene, &textures)?;
        let material_table = tables.add(&materials);
        let lights: Vec<_> = scene.lights.iter().map(tables::light).collect();
        let light_table = tables.add(&lights);
        let instances: Vec<_> = scene.instances.iter().map(|i| tables::instance(scene, i)).collect();
        let instance_table = tables.add(&instances);
        let mesh_table = tables.add(&vec![shared::Mesh::default(); scene.meshes.len()]);
        let root_table = tables.add(&[shared::Scene::default()]);
        let buffer = tables.buffer(gpu, "scene tables", BufferUse::Storage)?;
        let base = buffer.address();
        let meshes: Vec<_> = (0..scene.meshes.len())
            .map(|i| {
                let (positions, indices) = geometry.meshes[i];
                let (nodes, primitives) = acceleration.mesh(i);
                shared::Mesh {
                    positions,
                    previous_positions: positions,
                    attributes: vertices.address().offset(vertex_offsets[i].1),
                    indices,
                    nodes,
                    primitives,
                    primitive_count: (scene.meshes[i].indices.len() / 3) as u32,
                }
            })
            .collect();
        tables.put(mesh_table, &meshes);
        let root = shared::Scene {
            instances: base.offset(instance_table),
            meshes: base.offset(mesh_table),
            materials: base.offset(material_table),
            lights: base.offset(light_table),
            instance_count: instances.len() as u32,
            light_count: lights.len() as u32,
            ..acceleration.root()
        };
        tables.put(root_table, &[root]);
        tables.copy_to(gpu, &mut executor, &buffer)?;

        Ok(Self {
            root: base.offset(root_table),
            tables: buffer,
            vertices,
            indices,
            textures,
            acceleration,
            report,
            draws: tables::draws(scene, &index_offsets),
            key_light: tables::key_light(&scene.lights),
            sky: scene.daylight.as_ref().map(Daylight::to_gpu),
        })
    }

    /// Brings the scene's buffers into a frame.
    pub fn import(&self, g: &mut FrameGraph, imports: &mut Imports) -> SceneHandles {
        let mut buffer = |name, buffer: &Arc<Buffer>, g: &mut FrameGraph| {
            g.import_buffer(name, BufferDesc::new(buffer.bytes()), Access::CopyWrite, imports.buffer(buffer)).read()
        };
        let tables = buffer("scene.tables", &self.tables, g);
        let vertices = buffer("scene.vertices", &self.vertices, g);
        let indices = buffer("scene.indices", &self.indices, g);
        let tlas = match &self.acceleration {
            Acceleration::Software(tree) => {
                g.import_tlas("scene.tlas", Access::CopyWrite, imports.tree(&tree.memory, self.root))
            }
            Acceleration::Driver(driver) => {
                g.import_tlas("scene.tlas", Access::Build, imports.accel(&driver.top, self.root))
            }
        };
        SceneHandles { tables, vertices, indices, tlas }
    }

    /// Address of the [`magpie_shaders::scene::Scene`].
    pub fn root(&self) -> Address {
        self.root
    }

    /// One draw per instance: opaque ones first, then by what culls them.
    pub fn draws(&self) -> &Arc<[Draw]> {
        &self.draws
    }

    /// The light that the shadow stage traces: the first directional one, else the strongest lamp.
    pub fn key_light(&self) -> Option<u32> {
        self.key_light
    }

    /// The sky, if the scene has one.
    pub fn sky(&self) -> Option<Sky> {
        self.sky
    }

    /// What the acceleration structures take.
    pub fn acceleration(&self) -> AccelerationReport {
        self.report
    }

    /// Bytes of geometry, tables and textures.
    pub fn scene_bytes(&self) -> u64 {
        let textures: u64 = self.textures.iter().map(|t| t.bytes()).sum();
        self.tables.bytes() + self.vertices.bytes() + self.indices.bytes() + textures
    }

    /// Bytes of acceleration structures.
    pub fn acceleration_bytes(&self) -> u64 {
        self.report.bottom_bytes + self.report.top_bytes
    }
}

impl Acceleration {
    /// Nodes and leaves of a mesh's tree; none where the driver traces.
    fn mesh(&self, mesh: usize) -> (Address, Address) {
        match self {
            Self::Software(tree) => tree.meshes[mesh],
            Self::Driver(_) => Default::default(),
        }
    }

    /// The part of the scene's root that says where rays begin.
    fn root(&self) -> shared::Scene {
        match self {
            Self::Software(tree) => {
                let (tlas_nodes, tlas_instances) = tree.top;
                shared::Scene { tlas_nodes, tlas_instances, ..Default::default() }
            }
            Self::Driver(driver) => shared::Scene { tlas: driver.top.address(), ..Default::default() },
        }
    }
}
