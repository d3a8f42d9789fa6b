//! Bare geometry on the device, whose top level can be rebuilt and refitted; the three set-ups trace it.
use super::trace::{upload, write};
use super::{DriverTree, RayBenchError, SoftwareTree};
use glam::{Affine3A, Vec3};
use magpie::gpu::{Buffer, Gpu};
use magpie::graph::execute::{Executor, Imports};
use magpie::graph::{Access, Buffer as GraphBuffer, BufferDesc, FrameGraph, Handle, PassBuilder, Tlas, TraceToken};
use magpie::ray::object_from_world;
use magpie_shaders::scene as shared;
use magpie_shaders::{Address, Rays};
use std::sync::Arc;

/// A triangle mesh in object space.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Vertex positions, metres.
    pub positions: Vec<Vec3>,
    /// Three per triangle, counter-clockwise as seen from the front.
    pub indices: Vec<u32>,
}

/// An instance of a shape.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// World from object.
    pub world_from_object: Affine3A,
    /// Index of the shape.
    pub shape: u32,
    /// Rays hit it only if their masks share a bit; 8 bits.
    pub mask: u32,
    /// Whether rays with culling hit its back faces too.
    pub double_sided: bool,
}

impl Placed {
    /// An instance that all rays hit.
    pub fn new(shape: u32, world_from_object: Affine3A) -> Self {
        Self { world_from_object, shape, mask: shared::INSTANCE_MASK_ALL, double_sided: false }
    }

    fn flags(&self) -> u32 {
        if self.double_sided { shared::INSTANCE_DOUBLE_SIDED } else { 0 }
    }
}

/// Build options of a world.
#[derive(Clone, Copy, Debug)]
pub struct WorldOptions {
    /// Backend; the two hardware backends share their structures.
    pub rays: Rays,
    /// Whether the driver's bottom levels are compacted.
    pub compaction: bool,
    /// Whether the driver's bottom levels are built for fast builds instead of fast tracing.
    pub fast_build: bool,
    /// Whether the top level can be refitted.
    pub refit: bool,
}

impl WorldOptions {
    /// Built for fast tracing, compacted, without refits.
    pub fn new(rays: Rays) -> Self {
        Self { rays, compaction: true, fast_build: false, refit: false }
    }
}

/// Cost of building a world. Bytes of hardware structures are those requested by the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorldReport {
    /// Bytes of all bottom levels.
    pub bottom_bytes: u64,
    /// Bytes of all bottom levels before compaction.
    pub uncompacted_bytes: u64,
    /// Scratch memory of the largest bottom-level build, bytes; none for builds on the CPU.
    pub scratch_bytes: u64,
    /// Bytes of the top level.
    pub top_bytes: u64,
    /// Nanoseconds to build all bottom levels, on the device for hardware structures, else on the CPU.
    pub bottom_ns: u64,
    /// Nanoseconds to compact them; 0 without compaction.
    pub compact_ns: u64,
    /// Nanoseconds to build the top level.
    pub top_ns: u64,
}

/// How a top level is updated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Builds it anew.
    Rebuild,
    /// Keeps its topology and updates the boxes.
    Refit,
}

/// Shapes and instances on the device.
pub struct World {
    gpu: Gpu,
    geometry: Arc<Buffer>,
    tables: Arc<Buffer>,
    meshes: Vec<shared::Mesh>,
    tree: Tree,
    report: WorldReport,
    options: WorldOptions,
    count: usize,
}

/// Acceleration structures for one kind of backend.
enum Tree {
    Software(Box<SoftwareTree>),
    Driver(Box<DriverTree>),
}

/// A world's handles in a frame graph.
#[derive(Clone, Copy)]
pub(super) struct WorldHandles {
    tables: Handle<GraphBuffer>,
    geometry: Handle<GraphBuffer>,
    bottom: Option<Handle<GraphBuffer>>,
    tlas: Handle<Tlas>,
}

impl WorldHandles {
    pub fn trace(self, p: &mut PassBuilder<'_>) -> TraceToken {
        p.read(self.tables);
        p.read(self.geometry);
        if let Some(bottom) = self.bottom {
            p.read(bottom);
        }
        p.trace(self.tlas)
    }
}

impl World {
    /// Uploads the shapes and builds both levels.
    ///
    /// # Errors
    /// Geometry that a BVH cannot represent, exhausted memory, a device without the backend.
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        shapes: &[Shape],
        placed: &[Placed],
        options: WorldOptions,
    ) -> Result<Self, RayBenchError> {
        gpu.check_rays(options.rays)?;
        let mut bytes = Vec::new();
        let mut offsets = Vec::new();
        for shape in shapes {
            let positions = bytes.len() as u64;
            bytes.extend_from_slice(bytemuck::cast_slice(&shape.positions));
            offsets.push((positions, bytes.len() as u64));
            bytes.extend_from_slice(bytemuck::cast_slice(&shape.indices));
        }
        let geometry = upload(gpu, executor, "bench geometry", &bytes)?;
        let at = |offset| geometry.address().offset(offset);
        let mut meshes: Vec<shared::Mesh> = shapes
            .iter()
            .zip(&offsets)
            .map(|(shape, &(positions, indices))| shared::Mesh {
                positions: at(positions),
                previous_positions: at(positions),
                indices: at(indices),
                ray_indices: at(indices),
                primitive_count: (shape.indices.len() / 3) as u32,
                ..Default::default()
            })
            .collect();

        let mut report = WorldReport::default();
        let tree = if options.rays == Rays::Software {
            let tree = SoftwareTree::new(gpu, executor, shapes, placed, &mut report)?;
            for (mesh, (nodes, triangles)) in meshes.iter_mut().zip(tree.meshes()) {
                (mesh.nodes, mesh.primitives) = (nodes, triangles);
            }
            Tree::Software(Box::new(tree))
        } else {
            let sizes = shapes.iter().map(|s| s.positions.len() as u32);
            let inputs: Vec<_> = meshes.iter().copied().zip(sizes).collect();
            Tree::Driver(Box::new(DriverTree::new(gpu, executor, &geometry, &inputs, placed, options, &mut report)?))
        };
        let count = placed.len();
        let tables = meshes.len() * size_of::<shared::Mesh>()
            + count * size_of::<shared::Instance>()
            + size_of::<shared::Scene>();
        let tables = upload(gpu, executor, "bench tables", &vec![0; tables])?;
        let world = Self { gpu: gpu.clone(), geometry, tables, meshes, tree, report, options, count };
        world.write_tables(executor, placed)?;
        Ok(world)
    }

    /// Writes the scene's root, mesh and instance tables, in this order.
    fn write_tables(&self, executor: &mut Executor, placed: &[Placed]) -> Result<(), RayBenchError> {
        let meshes = size_of::<shared::Scene>() as u64;
        let instances = meshes + (self.meshes.len() * size_of::<shared::Mesh>()) as u64;
        let at = |offset| self.tables.address().offset(offset);
        let mut root = shared::Scene {
            instances: at(instances),
            meshes: at(meshes),
            instance_count: self.count as u32,
            ..Default::default()
        };
        match &self.tree {
            Tree::Software(tree) => (root.tlas_nodes, root.tlas_instances) = tree.top(),
            Tree::Driver(tree) => root.tlas = tree.top(),
        }
        let table: Vec<_> = placed.iter().map(instance).collect();
        let mut bytes = bytemuck::bytes_of(&root).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&self.meshes));
        bytes.extend_from_slice(bytemuck::cast_slice(&table));
        write(&self.gpu, executor, &self.tables, &bytes)
    }

    /// Moves the instances and updates the top level; returns nanoseconds, on the device for hardware structures, else on the CPU. `None`
    /// if this kind of update is not supported; nothing is done then.
    ///
    /// # Errors
    /// [`RayBenchError::Count`] if the number of instances differs; a lost device.
    pub fn follow(
        &mut self,
        executor: &mut Executor,
        placed: &[Placed],
        change: Change,
    ) -> Result<Option<u64>, RayBenchError> {
        if placed.len() != self.count {
            return Err(RayBenchError::Count { wanted: self.count, got: placed.len() });
        }
        let taken = match &mut self.tree {
            Tree::Software(tree) => Some(tree.follow(&self.gpu, executor, placed, change)?),
            Tree::Driver(tree) => tree.follow(&self.gpu, executor, placed, change)?,
        };
        if taken.is_some() {
            self.write_tables(executor, placed)?;
        }
        Ok(taken)
    }

    /// The backend it was built for.
    pub fn rays(&self) -> Rays {
        self.options.rays
    }

    /// Who builds it: `software` or `driver`.
    pub fn builder(&self) -> &'static str {
        match self.tree {
            Tree::Software(_) => "software",
            Tree::Driver(_) => "driver",
        }
    }

    /// Whether its top level can be refitted.
    pub fn refits(&self) -> bool {
        match self.tree {
            Tree::Software(_) => true,
            Tree::Driver(_) => self.options.refit,
        }
    }

    /// Cost of building it.
    pub fn report(&self) -> WorldReport {
        self.report
    }

    /// Address of the scene's root table.
    fn root(&self) -> Address {
        self.tables.address()
    }

    pub(super) fn import(&self, g: &mut FrameGraph, imports: &mut Imports) -> WorldHandles {
        let mut buffer = |name, buffer: &Arc<Buffer>, g: &mut FrameGraph| {
            g.import_buffer(name, BufferDesc::new(buffer.bytes()), Access::CopyWrite, imports.buffer(buffer)).read()
        };
        let (tables, geometry) = (buffer("tables", &self.tables, g), buffer("geometry", &self.geometry, g));
        let (bottom, tlas) = match &self.tree {
            Tree::Software(tree) => {
                let bottom = buffer("bottom", tree.bottom_memory(), g);
                let key = imports.tree(tree.top_memory(), self.root());
                (Some(bottom), g.import_tlas("tlas", Access::CopyWrite, key))
            }
            Tree::Driver(tree) => {
                let key = imports.accel(tree.top_accel(), self.root());
                (None, g.import_tlas("tlas", Access::Build, key))
            }
        };
        WorldHandles { tables, geometry, bottom, tlas }
    }
}

/// An instance in the shaders' format.
fn instance(placed: &Placed) -> shared::Instance {
    let world_from_object = rows(&placed.world_from_object);
    let inverse = object_from_world(&placed.world_from_object).unwrap_or(Affine3A::ZERO);
    shared::Instance {
        world_from_object,
        object_from_world: rows(&inverse),
        previous_world_from_object: world_from_object,
        mesh: placed.shape,
        material: 0,
        mask: placed.mask,
        flags: placed.flags(),
        ..Default::default()
    }
}

pub(super) fn rows(m: &Affine3A) -> [[f32; 4]; 3] {
    let (a, t) = (m.matrix3, m.translation);
    [0, 1, 2].map(|r| [a.x_axis[r], a.y_axis[r], a.z_axis[r], t[r]])
}
