//! BVHs for tracing in software. The host builds them; the device refits those of deforming meshes.
use super::block::Block;
use super::deform::{Deformation, Deforming};
use super::detail::Reduced;
use super::policy::{Policy, Seen};
use super::{AccelerationReport, Geometry, ResidentError};
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel, Staging};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, Buffer as GraphBuffer, BufferDesc, FrameGraph, Handle, Queue, Record, Tlas};
use crate::ray::{Bounds, MeshBvh, Placement, SceneBvh};
use crate::scene::{Mesh, Pose, Scene, deform};
use magpie_shaders::acceleration::{NodeBox, RefitJob, RefitParams};
use magpie_shaders::scene::{BvhInstance, BvhNode};
use magpie_shaders::{ACCELERATION_REFIT_COMP, Address};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Bottom levels that a traversal reads beside the top level: those of meshes that keep their shape, and those of deforming ones.
pub(super) type Bottom = [Option<Handle<GraphBuffer>>; 2];

/// Bottom levels and top level.
pub(super) struct Software {
    /// Bottom levels of the meshes that keep their shape.
    bottom: Arc<Buffer>,
    /// Addresses of the nodes and leaves of each mesh, then of each deforming instance.
    pub meshes: Vec<(Address, Address)>,
    /// Bounding box and traversal stack of each, in the same order.
    known: Vec<(Bounds, u32)>,
    top: Top,
    deforming: Option<Trees>,
}

impl Software {
    /// Builds the bottom levels on all cores.
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        geometry: &Geometry<'_>,
        deformation: Option<(&Deformation, &Pose)>,
        report: &mut AccelerationReport,
    ) -> Result<Self, ResidentError> {
        let start = Instant::now();
        let scene = geometry.scene;
        let meshes = scene.meshes.par_iter().zip(geometry.reduced);
        let trees: Vec<MeshBvh> =
            meshes.map(|(mesh, reduced)| tree(mesh, reduced.as_ref())).collect::<Result<_, _>>()?;
        let deforming = deformation.map(|(d, pose)| Trees::new(gpu, executor, scene, &d.meshes, pose)).transpose()?;
        report.bottom_ms = start.elapsed().as_secs_f64() * 1e3;

        let mut block = Block::default();
        let offsets: Vec<_> = trees.iter().map(|t| (block.add(&t.nodes), block.add(&t.primitives))).collect();
        let bottom = block.upload(gpu, executor, "bottom levels", BufferUse::Storage)?;
        let at = |(a, b): (u64, u64)| (bottom.address().offset(a), bottom.address().offset(b));
        let mut meshes: Vec<_> = offsets.into_iter().map(at).collect();
        let mut known: Vec<_> = trees.iter().map(|t| (t.bounds, t.stack)).collect();
        report.bottom_bytes = bottom.bytes();
        if let Some(trees) = &deforming {
            meshes.extend(trees.list.iter().map(|t| (t.job.nodes, t.job.primitives)));
            known.extend(trees.list.iter().map(|t| (t.bounds, t.stack)));
            report.bottom_bytes += trees.memory.bytes();
        }
        report.uncompacted_bytes = report.bottom_bytes;
        let top = Top::new(gpu, scene.instances.len())?;
        report.top_bytes = top.memory.bytes();
        Ok(Self { bottom, meshes, known, top, deforming })
    }

    /// Discards the state of the device: the next frame rebuilds the top level.
    pub fn forget(&mut self) {
        self.top.tree = None;
    }

    /// Addresses of the top level's nodes and instances.
    pub fn top(&self) -> (Address, Address) {
        (self.top.memory.address(), self.top.memory.address().offset(self.top.instances))
    }

    /// Imports the BVHs into a frame, with the passes that update them. Returns the top level and the bottom levels.
    pub fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        frame: &Frame<'_>,
    ) -> Result<(Handle<Tlas>, Bottom), ResidentError> {
        let desc = BufferDesc::new(self.bottom.bytes());
        let bottom = g.import_buffer("scene.bottom", desc, Access::CopyWrite, imports.buffer(&self.bottom)).read();
        let deforming = match &mut self.deforming {
            Some(trees) => Some(trees.declare(g, imports, frame)?),
            None => None,
        };
        if let Some(trees) = &self.deforming {
            let first = self.known.len() - trees.list.len();
            for (known, tree) in self.known[first..].iter_mut().zip(&trees.list) {
                known.1 = tree.stack;
            }
        }
        let place = |(index, seen): (usize, &Seen)| {
            let (bounds, stack) = self.known[seen.mesh];
            let bounds = frame.pose.bounds[index].map_or(bounds, |[min, max]| Bounds { min, max });
            // An instance that is culled from ray tracing gets an empty box.
            let bounds = if seen.traced { bounds } else { Bounds::EMPTY };
            Placement { world_from_object: seen.world_from_object, bounds, stack }
        };
        let placements = || frame.seen.iter().enumerate().map(place).collect::<Vec<_>>();
        let tlas = self.top.declare(g, imports, frame, placements)?;
        Ok((tlas, [Some(bottom), deforming]))
    }

    /// Host time of the last top-level build or refit, milliseconds.
    pub fn top_ms(&self) -> f64 {
        self.top.milliseconds
    }
}

/// The bottom level of a mesh, simplified if it has less detail for rays.
fn tree(mesh: &Mesh, reduced: Option<&Reduced>) -> Result<MeshBvh, crate::ray::RayError> {
    let built = if mesh.spheres.is_empty() {
        MeshBvh::build(&mesh.positions, reduced.map_or(&mesh.indices, |r| &r.indices))
    } else {
        MeshBvh::build_spheres(&mesh.spheres.iter().map(|s| (s.centre, s.radius)).collect::<Vec<_>>())
    };
    built.map_err(|e| e.in_mesh(&mesh.name))
}

/// What a frame needs of the acceleration structures.
pub(super) struct Frame<'a> {
    pub policy: &'a Policy,
    /// All instances, in the order of the scene.
    pub seen: &'a [Seen],
    pub pose: &'a Pose,
    /// Whether instances have moved, or are culled differently than before.
    pub moved: bool,
    /// The deformed vertices, if they have changed.
    pub deformed: Option<Handle<GraphBuffer>>,
    pub indices: Handle<GraphBuffer>,
    /// Address of the scene's root table.
    pub root: Address,
    /// Number of the frame.
    pub number: u64,
}

/// The top level, on the host and on the device.
struct Top {
    memory: Arc<Buffer>,
    /// Offset of the instances, which follow the nodes.
    instances: u64,
    staging: Staging,
    tree: Option<SceneBvh>,
    milliseconds: f64,
}

impl Top {
    fn new(gpu: &Gpu, count: usize) -> Result<Self, GpuError> {
        // A wide BVH has fewer nodes than leaves, except that an empty scene has one node.
        let instances = (count.max(1) * size_of::<BvhNode>()) as u64;
        let bytes = instances + (count.max(1) * size_of::<BvhInstance>()) as u64;
        let memory = Arc::new(Buffer::new(gpu, "top level", bytes, BufferMemory::Device, BufferUse::Storage)?);
        Ok(Self { memory, instances, staging: Staging::new(gpu, "top level"), tree: None, milliseconds: 0.0 })
    }

    fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        frame: &Frame<'_>,
        placements: impl Fn() -> Vec<Placement>,
    ) -> Result<Handle<Tlas>, ResidentError> {
        let memory = imports.tree(&self.memory, frame.root);
        if self.tree.is_some() && !frame.moved && frame.deformed.is_none() {
            return Ok(g.import_tlas("scene.tlas", Access::Trace, memory));
        }
        // Build or refit on the host.
        let start = Instant::now();
        let placements = placements();
        let tree = match self.tree.take() {
            Some(mut tree) if frame.policy.refits(frame.number) => {
                tree.refit(&placements)?;
                tree
            }
            _ => SceneBvh::build(&placements)?,
        };
        self.milliseconds = start.elapsed().as_secs_f64() * 1e3;

        // Copy to the device.
        let nodes: &[u8] = bytemuck::cast_slice(&tree.nodes);
        let instances: &[u8] = bytemuck::cast_slice(&tree.instances);
        let (node_bytes, instance_bytes, at) = (nodes.len() as u64, instances.len() as u64, self.instances);
        let staged = imports.buffer(self.staging.write(&[nodes, instances].concat())?);
        self.tree = Some(tree);
        let desc = BufferDesc::new(node_bytes + instance_bytes);
        let staged = g.import_buffer("acceleration.staged", desc, Access::CopyRead, staged);
        let target = g.import_accel::<Tlas>("scene.tlas", Access::Trace, memory);
        let made = g.pass("acceleration.top", Queue::Graphics, |p| {
            let from = p.copy_from(staged.read());
            let (made, to) = p.copy_to_accel(target);
            (made, move |c: &mut Record<'_>| {
                c.copy_buffer(from, 0, to, 0, node_bytes);
                if instance_bytes > 0 {
                    c.copy_buffer(from, node_bytes, to, at, instance_bytes);
                }
            })
        });
        Ok(made.read())
    }
}

/// BVHs of deforming meshes: refitted every frame on the device, and rebuilt from time to time on the host.
struct Trees {
    memory: Arc<Buffer>,
    kernel: Kernel,
    jobs: Address,
    list: Vec<Tree>,
    /// The meshes, for rebuilds.
    meshes: Vec<Mesh>,
    stagings: Vec<Staging>,
    made: bool,
}

/// The BVH of one deforming instance, in its own range of the memory.
struct Tree {
    instance: usize,
    /// Index into [`Trees::meshes`].
    source: usize,
    bounds: Bounds,
    stack: u32,
    /// Number of nodes that the range has room for.
    room: usize,
    /// Offset of the range, and of its job in the table, bytes.
    place: (u64, u64),
    job: RefitJob,
}

/// Limit on the levels of a BVH; one that deep would be refused earlier because of its stack.
const MAX_LEVELS: usize = 256;

impl Trees {
    fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        scene: &Scene,
        deforming: &[Deforming],
        pose: &Pose,
    ) -> Result<Self, ResidentError> {
        let mut sources: Vec<usize> = deforming.iter().map(|d| d.mesh).collect();
        sources.sort_unstable();
        sources.dedup();
        let built: Vec<MeshBvh> = deforming
            .par_iter()
            .map(|d| posed_tree(&scene.meshes[d.mesh], d.instance, pose))
            .collect::<Result<_, _>>()?;
        // Each range has room for a BVH of another topology; the job table follows.
        let mut bytes = 0_u64;
        let pieces: Vec<(u64, usize)> = built
            .iter()
            .map(|tree| {
                let room = tree.nodes.len() + tree.nodes.len() / 2 + 4;
                let place = bytes;
                bytes += Piece::new(room, tree.primitives.len()).bytes;
                (place, room)
            })
            .collect();
        let job_table = bytes;
        let bytes = bytes + (built.len() * size_of::<RefitJob>()) as u64;
        let memory = Arc::new(Buffer::new(gpu, "deforming trees", bytes, BufferMemory::Device, BufferUse::Storage)?);
        let base = memory.address();
        let mut block = Block(vec![0; bytes as usize]);
        let mut list = Vec::with_capacity(built.len());
        for (index, ((tree, &(place, room)), from)) in built.iter().zip(&pieces).zip(deforming).enumerate() {
            let piece = Piece::new(room, tree.primitives.len());
            let at = |offset: u64| base.offset(place + offset);
            let job = RefitJob {
                nodes: at(0),
                primitives: at(piece.primitives),
                positions: from.positions,
                boxes: at(piece.boxes),
                order: at(piece.order),
                levels: at(piece.levels),
                level_count: 0,
            };
            let job_at = job_table + (index * size_of::<RefitJob>()) as u64;
            let source = sources.binary_search(&from.mesh).unwrap_or_default();
            let (bounds, stack) = (tree.bounds, tree.stack);
            let mut made = Tree { instance: from.instance, source, bounds, stack, room, place: (place, job_at), job };
            let bytes = made.pack(tree);
            block.put(place, &bytes);
            block.put(job_at, &[made.job]);
            list.push(made);
        }
        block.copy_to(gpu, executor, &memory)?;
        Ok(Self {
            jobs: base.offset(job_table),
            memory,
            kernel: gpu.kernel(&ACCELERATION_REFIT_COMP)?,
            stagings: list.iter().map(|_| Staging::new(gpu, "rebuilt tree")).collect(),
            list,
            meshes: sources.into_iter().map(|m| scene.meshes[m].clone()).collect(),
            made: false,
        })
    }

    fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        frame: &Frame<'_>,
    ) -> Result<Handle<GraphBuffer>, ResidentError> {
        let desc = BufferDesc::new(self.memory.bytes());
        let mut memory =
            g.import_buffer("scene.deforming_trees", desc, Access::BufferRead, imports.buffer(&self.memory));
        let Some(deformed) = frame.deformed else { return Ok(memory.read()) };
        let was_made = std::mem::replace(&mut self.made, true);

        // Rebuild the BVHs whose turn it is, for the mesh in its current pose.
        for (index, tree) in self.list.iter_mut().enumerate() {
            if !was_made || !frame.policy.rebuilds(frame.number, index) {
                continue;
            }
            let built = posed_tree(&self.meshes[tree.source], tree.instance, frame.pose)?;
            if built.nodes.len() > tree.room {
                log::debug!("a rebuilt tree has no room: {} nodes of {}", built.nodes.len(), tree.room);
                continue;
            }
            tree.stack = built.stack;
            let bytes = tree.pack(&built);
            let (place, job_at) = tree.place;
            let (length, job) = (bytes.len() as u64, tree.job);
            let staged = self.stagings[index].write(&[bytes.as_slice(), bytemuck::bytes_of(&job)].concat())?;
            let staged = imports.buffer(staged);
            let desc = BufferDesc::new(length + size_of::<RefitJob>() as u64);
            let staged = g.import_buffer(&format!("acceleration.rebuilt.{index}"), desc, Access::CopyRead, staged);
            memory = g.pass(&format!("acceleration.rebuild.{index}"), Queue::Graphics, |p| {
                let from = p.copy_from(staged.read());
                let (memory, to) = p.copy_to(memory);
                (memory, move |c: &mut Record<'_>| {
                    c.copy_buffer(from, 0, to, place, length);
                    c.copy_buffer(from, length, to, job_at, size_of::<RefitJob>() as u64);
                })
            });
        }

        // Refit all of them to the vertices.
        let (kernel, groups) = (self.kernel, [self.list.len() as u32, 1, 1]);
        let params = RefitParams { jobs: self.jobs };
        let memory = g.pass("acceleration.refit", Queue::Graphics, |p| {
            p.read(deformed);
            let (memory, _) = p.write_buffer(memory);
            (memory, move |c: &mut Record<'_>| c.dispatch_groups(kernel, &params, groups))
        });
        Ok(memory.read())
    }
}

fn posed_tree(mesh: &Mesh, instance: usize, pose: &Pose) -> Result<MeshBvh, ResidentError> {
    let posed = deform(mesh, &pose.joints[instance], &pose.weights[instance]);
    Ok(MeshBvh::build(&posed.positions, &mesh.indices).map_err(|e| e.in_mesh(&mesh.name))?)
}

impl Tree {
    /// The BVH in the layout of its range; updates the number of levels.
    fn pack(&mut self, tree: &MeshBvh) -> Vec<u8> {
        let piece = Piece::new(self.room, tree.primitives.len());
        let levels = tree.levels();
        self.job.level_count = levels.offsets.len() as u32 - 1;
        let mut block = Block(vec![0; piece.bytes as usize]);
        block.put(0, &tree.nodes);
        block.put(piece.primitives, &tree.primitives);
        block.put(piece.order, &levels.nodes);
        block.put(piece.levels, &levels.offsets);
        block.0
    }
}

/// Offsets of the tables of one BVH in its range, bytes; nodes come first.
struct Piece {
    primitives: u64,
    boxes: u64,
    order: u64,
    levels: u64,
    bytes: u64,
}

impl Piece {
    fn new(nodes: usize, primitives: usize) -> Self {
        let align = |bytes: usize| (bytes as u64).next_multiple_of(16);
        let primitives_at = align(nodes * size_of::<BvhNode>());
        let boxes = primitives_at + align(primitives * size_of::<magpie_shaders::scene::BvhPrimitive>());
        let order = boxes + align(nodes * size_of::<NodeBox>());
        let levels = order + align(nodes * 4);
        Self { primitives: primitives_at, boxes, order, levels, bytes: levels + align(MAX_LEVELS * 4) }
    }
}
