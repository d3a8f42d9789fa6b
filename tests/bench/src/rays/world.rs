//! Bare geometry on the device, whose top level can be rebuilt and refitted: what the three set-ups trace.
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

/// Triangles, object space.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Corners, metres.
    pub positions: Vec<Vec3>,
    /// Three per triangle, counter-clockwise from the front.
    pub indices: Vec<u32>,
}

/// A shape in the world.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// World from object.
    pub world_from_object: Affine3A,
    /// Index of the shape.
    pub shape: u32,
    /// Rays see it where they share a bit; 8 bits.
    pub mask: u32,
    /// No ray goes through its faces for their side.
    pub double_sided: bool,
}

impl Placed {
    /// One that every ray sees.
    pub fn new(shape: u32, world_from_object: Affine3A) -> Self {
        Self { world_from_object, shape, mask: shared::INSTANCE_MASK_ALL, double_sided: false }
    }

    fn flags(&self) -> u32 {
        if self.double_sided { shared::INSTANCE_DOUBLE_SIDED } else { 0 }
    }
}

/// How a world is built.
#[derive(Clone, Copy, Debug)]
pub struct WorldOptions {
    /// For Magpie's own walk or for the driver; the two ways through the driver share what it builds.
    pub rays: Rays,
    /// Bottom levels of the driver are compacted.
    pub compaction: bool,
    /// Bottom levels of the driver are built fast rather than for fast rays.
    pub fast_build: bool,
    /// The top level can be refitted.
    pub refit: bool,
}

impl WorldOptions {
    /// For fast rays, compacted, and never refitted.
    pub fn new(rays: Rays) -> Self {
        Self { rays, compaction: true, fast_build: false, refit: false }
    }
}

/// What building took. Bytes of the driver's structures are what was asked of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorldReport {
    /// Bytes of all bottom levels.
    pub bottom_bytes: u64,
    /// The same before compaction.
    pub uncompacted_bytes: u64,
    /// Working memory of the largest build of a bottom level, bytes; none where the host builds.
    pub scratch_bytes: u64,
    /// Bytes of the top level.
    pub top_bytes: u64,
    /// Nanoseconds to build all bottom levels: of the device where the driver builds, else of the host.
    pub bottom_ns: u64,
    /// Nanoseconds to compact them; 0 where that was not done.
    pub compact_ns: u64,
    /// Nanoseconds to build the top level.
    pub top_ns: u64,
}

/// How a top level follows its instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// A new tree.
    Rebuild,
    /// The tree of before, with new boxes.
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

/// The acceleration structures, for one way to trace.
enum Tree {
    Software(Box<SoftwareTree>),
    Driver(Box<DriverTree>),
}

/// A world as one frame's graph knows it.
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
    /// Uploads and builds.
    ///
    /// # Errors
    /// Geometry that no tree can hold, exhausted memory, a device that cannot trace so.
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

    /// Root, meshes, instances, in this order.
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

    /// Moves the instances; gives nanoseconds for the top level: of the device where the driver builds, else of the host. `None`
    /// where this tree cannot change so, and nothing was done.
    ///
    /// # Errors
    /// [`RayBenchError::Count`] for another number of instances; a lost device.
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

    /// For which way to trace it was built.
    pub fn rays(&self) -> Rays {
        self.options.rays
    }

    /// Who builds: `software` or `driver`.
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

    /// What building took.
    pub fn report(&self) -> WorldReport {
        self.report
    }

    /// Address of the root of the tables.
    pub fn root(&self) -> Address {
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

/// An instance as shaders see it.
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
