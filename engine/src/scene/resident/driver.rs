//! Acceleration structures built by the driver: one bottom level per mesh, shared by its instances, and one top level.
use super::deform::{Deformation, Deforming};
use super::policy::Seen;
use super::software::Frame;
use super::{AccelerationReport, Geometry, MeshPlace, ResidentError};
use crate::gpu::{
    Accel, AccelDesc, AccelGeometry, AccelInstance, AccelSizes, Buffer, BufferMemory, BufferUse, CompactedSizes, Gpu,
    SPHERE_GROUP, Staging, TRIANGLE_GROUP,
};
use crate::graph::execute::{Executed, Executor, Imports};
use crate::graph::{
    Accel as AccelKind, Access, Blas, BufferDesc, Domain, Extent, FrameGraph, Handle, PassBuilder, Queue, Record, Tlas,
    WriteHandle,
};
use magpie_shaders::Address;
use magpie_shaders::scene as shared;
use std::sync::Arc;

/// Number of meshes that are built before they are compacted, which limits the memory of uncompacted structures.
const BATCH: usize = 64;

/// Bottom levels and top level.
pub(super) struct Driver {
    /// One per mesh, then one per deforming instance.
    bottom: Vec<Arc<Accel>>,
    deforming: Vec<Deformable>,
    top: Top,
}

/// The bottom level of a deforming instance.
struct Deformable {
    accel: Arc<Accel>,
    desc: AccelDesc,
    sizes: AccelSizes,
    /// Whether it has been built, so that it can be refitted.
    made: bool,
}

impl Driver {
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        geometry: &Geometry<'_>,
        deformation: Option<&Deformation>,
        compaction: bool,
        report: &mut AccelerationReport,
    ) -> Result<Self, ResidentError> {
        let descs: Vec<AccelDesc> =
            (0..geometry.scene.meshes.len()).map(|m| bottom_desc(geometry, m, compaction)).collect();
        let mut bottom = Vec::with_capacity(descs.len());
        for batch in descs.chunks(BATCH) {
            let build = Build { gpu, geometry, first: bottom.len(), batch };
            let built = build.build(executor, report)?;
            report.uncompacted_bytes += built.iter().map(|a| a.bytes()).sum::<u64>();
            let kept = if compaction { build.compact(executor, built, report)? } else { built };
            report.bottom_bytes += kept.iter().map(|a| a.bytes()).sum::<u64>();
            bottom.extend(kept);
        }
        let meshes = deformation.map_or(&[][..], |d| &d.meshes);
        let deforming: Vec<_> = meshes.iter().map(|d| deformable(gpu, geometry, d)).collect::<Result<_, _>>()?;
        for deformable in &deforming {
            report.uncompacted_bytes += deformable.accel.bytes();
            report.bottom_bytes += deformable.accel.bytes();
            bottom.push(deformable.accel.clone());
        }
        let top = Top::new(gpu, geometry.scene.instances.len())?;
        report.top_bytes = top.accel.bytes();
        Ok(Self { bottom, deforming, top })
    }

    /// Address of the top level.
    pub fn top(&self) -> Address {
        self.top.accel.address()
    }

    /// Discards the state of the device: the next frame builds instead of refitting.
    pub fn forget(&mut self) {
        self.deforming.iter_mut().for_each(|d| d.made = false);
        self.top.built = None;
    }

    /// Imports the top level into a frame, with the passes that update both levels.
    pub fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        frame: &Frame<'_>,
        instance: impl Fn(usize) -> shared::Instance,
    ) -> Result<Handle<Tlas>, ResidentError> {
        let mut deformed = Vec::with_capacity(self.deforming.len());
        for (index, deformable) in self.deforming.iter_mut().enumerate() {
            let key = imports.accel(&deformable.accel, Address::default());
            let target: WriteHandle<Blas> = g.import_accel(&format!("scene.deforming.{index}"), Access::Trace, key);
            let Some(vertices) = frame.deformed else {
                deformed.push(target.read());
                continue;
            };
            let refit = std::mem::replace(&mut deformable.made, true) && !frame.policy.rebuilds(frame.number, index);
            let (desc, sizes) = (deformable.desc, deformable.sizes);
            let (name, room) = if refit { ("refit", sizes.refit_scratch) } else { ("rebuild", sizes.build_scratch) };
            let made = g.pass(&format!("acceleration.{name}.{index}"), Queue::AsyncCompute, |p| {
                p.build_input(vertices);
                p.build_input(frame.indices);
                update(p, target, desc, room, refit)
            });
            deformed.push(made.read());
        }
        let traced = frame.seen.iter().enumerate().filter(|(_, seen)| seen.traced);
        let entry = |(index, seen): (usize, &Seen)| {
            let instance = instance(index);
            // Instances with a singular transform are not traced.
            (instance.object_from_world != [[0.0; 4]; 3])
                .then(|| top_instance(&instance, index as u32, self.bottom[seen.mesh].address()))
        };
        let table = || traced.filter_map(entry).collect::<Vec<_>>();
        self.top.declare(g, imports, frame, &deformed, table)
    }
}

/// Declares a refit or a build of a structure in a pass, with `room` bytes of scratch memory, and returns the closure that records it.
fn update<K: AccelKind>(
    p: &mut PassBuilder<'_>,
    target: WriteHandle<K>,
    desc: AccelDesc,
    room: u64,
    refit: bool,
) -> (WriteHandle<K>, impl FnOnce(&mut Record<'_>) + Send + 'static + use<K>) {
    let (made, into) = if refit { p.refit(target) } else { p.rebuild(target) };
    let scratch = p.scratch("scratch", BufferDesc::new(room));
    (made, move |c: &mut Record<'_>| {
        if refit {
            c.refit_accel(into, scratch, &desc);
        } else {
            c.build_accel(into, scratch, &desc);
        }
    })
}

/// Allocates the bottom level of a deforming instance, which allows refits.
fn deformable(gpu: &Gpu, geometry: &Geometry<'_>, deforming: &Deforming) -> Result<Deformable, ResidentError> {
    let mesh = &geometry.scene.meshes[deforming.mesh];
    let (vertices, triangles) = (mesh.positions.len() as u32, (mesh.indices.len() / 3) as u32);
    let indices = geometry.meshes[deforming.mesh].indices;
    let geometry = AccelGeometry::Triangles { positions: deforming.positions, vertices, indices, triangles };
    let desc = AccelDesc { geometry, fast_build: true, update: true, compact: false };
    let sizes = gpu.accel_sizes(&desc)?;
    let accel = Arc::new(Accel::alone(gpu, "deforming bottom level", sizes.bytes, false)?);
    Ok(Deformable { accel, desc, sizes, made: false })
}

/// Meshes that keep their shape are built for fast traversal, and for compaction if `compact`.
fn bottom_desc(geometry: &Geometry<'_>, mesh: usize, compact: bool) -> AccelDesc {
    let of = &geometry.scene.meshes[mesh];
    if let Some(boxes) = geometry.meshes[mesh].boxes {
        let geometry = AccelGeometry::Boxes { boxes, count: of.spheres.len() as u32 };
        return AccelDesc { geometry, fast_build: false, update: false, compact };
    }
    let MeshPlace { positions, ray_indices: indices, ray_triangles: triangles, .. } = geometry.meshes[mesh];
    let vertices = of.positions.len() as u32;
    let geometry = AccelGeometry::Triangles { positions, vertices, indices, triangles };
    AccelDesc { geometry, fast_build: false, update: false, compact }
}

/// A batch of meshes whose bottom levels are built in one frame.
struct Build<'a> {
    gpu: &'a Gpu,
    geometry: &'a Geometry<'a>,
    first: usize,
    batch: &'a [AccelDesc],
}

impl Build<'_> {
    /// Builds with one pass per mesh. The passes are independent, but their scratch memory is aliased.
    fn build(
        &self,
        executor: &mut Executor,
        report: &mut AccelerationReport,
    ) -> Result<Vec<Arc<Accel>>, ResidentError> {
        let sizes: Vec<AccelSizes> = self.batch.iter().map(|d| self.gpu.accel_sizes(d)).collect::<Result<_, _>>()?;
        let bytes: Vec<u64> = sizes.iter().map(|s| s.bytes).collect();
        let accels = allocate(self.gpu, "bottom levels", &bytes)?;

        let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
        let mut input = |name, buffer: &Arc<Buffer>| {
            g.import_buffer(name, BufferDesc::new(buffer.bytes()), Access::CopyWrite, imports.buffer(buffer)).read()
        };
        let (vertices, indices) = (input("vertices", self.geometry.vertices), input("indices", self.geometry.indices));
        for (at, ((accel, desc), size)) in accels.iter().zip(self.batch).zip(&sizes).enumerate() {
            let key = imports.accel(accel, Address::default());
            let name = format!("mesh {}", self.first + at);
            let target: WriteHandle<Blas> = g.import_accel(&name, Access::Build, key);
            let (desc, scratch_bytes) = (*desc, size.build_scratch);
            let built = g.pass(&format!("acceleration.build.{}", self.first + at), Queue::Graphics, |p| {
                p.build_input(vertices);
                p.build_input(indices);
                let (built, into) = p.rebuild(target);
                let scratch = p.scratch("scratch", BufferDesc::new(scratch_bytes));
                (built, move |c: &mut Record<'_>| c.build_accel(into, scratch, &desc))
            });
            g.output(built.read());
        }
        let executed = executor.run(g, &imports)?;
        report.bottom_ms += milliseconds(&executed);
        Ok(accels)
    }

    /// Reads the compacted sizes back, and compacts each structure into a new one of that size.
    fn compact(
        &self,
        executor: &mut Executor,
        built: Vec<Arc<Accel>>,
        report: &mut AccelerationReport,
    ) -> Result<Vec<Arc<Accel>>, ResidentError> {
        let queries = Arc::new(CompactedSizes::new(self.gpu, built.len() as u32)?);
        let bytes = 8 * built.len() as u64;
        let answers = Buffer::new(self.gpu, "compacted sizes", bytes, BufferMemory::ReadBack, BufferUse::Storage)?;
        let answers = Arc::new(answers);
        let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
        let mut sources = Vec::with_capacity(built.len());
        for (at, accel) in built.iter().enumerate() {
            let key = imports.accel(accel, Address::default());
            let source: Handle<Blas> = g.import_accel(&format!("mesh {at}"), Access::Build, key).read();
            sources.push(source);
        }
        let target = g.import_buffer("sizes", BufferDesc::new(bytes), Access::HostRead, imports.buffer(&answers));
        let sizes = queries.clone(); // keeps the pool alive: the frame drops its clone before the device is done
        let asked = g.pass("acceleration.measure", Queue::Graphics, |p| {
            let sources: Vec<_> = sources.iter().map(|s| p.build_input(*s)).collect();
            let (asked, to) = p.copy_to(target);
            (asked, move |c: &mut Record<'_>| c.compacted_sizes(&sources, &sizes, to))
        });
        g.leave(asked.read(), Access::HostRead, Domain::Copy);
        executor.run(g, &imports)?;
        let sizes: Vec<u64> = bytemuck::pod_collect_to_vec(&answers.contents()[..bytes as usize]);
        let kept = allocate(self.gpu, "bottom levels", &sizes)?;

        let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
        for (at, (source, target)) in built.iter().zip(&kept).enumerate() {
            let key = imports.accel(source, Address::default());
            let source: Handle<Blas> = g.import_accel(&format!("mesh {at}"), Access::Build, key).read();
            let key = imports.accel(target, Address::default());
            let target: WriteHandle<Blas> = g.import_accel(&format!("compacted {at}"), Access::Build, key);
            let made = g.pass(&format!("acceleration.compact.{at}"), Queue::Graphics, |p| {
                let from = p.build_input(source);
                let (made, into) = p.rebuild(target);
                (made, move |c: &mut Record<'_>| c.compact_accel(from, into))
            });
            g.output(made.read());
        }
        let executed = executor.run(g, &imports)?;
        report.bottom_ms += milliseconds(&executed);
        Ok(kept)
    }
}

/// Sum of the device times of all passes, milliseconds.
fn milliseconds(executed: &Executed) -> f64 {
    executed.sample.passes.iter().filter_map(|p| p.gpu_ns).sum::<u64>() as f64 * 1e-6
}

/// Allocates structures of these sizes side by side in one buffer.
fn allocate(gpu: &Gpu, name: &str, sizes: &[u64]) -> Result<Vec<Arc<Accel>>, ResidentError> {
    let room: u64 = sizes.iter().map(|s| s.next_multiple_of(Accel::ALIGN)).sum();
    let memory = Arc::new(Buffer::new(gpu, name, room, BufferMemory::Device, BufferUse::Storage)?);
    let mut offset = 0;
    let mut place = |bytes: &u64| {
        let made = Accel::new(gpu, &memory, offset, *bytes, false);
        offset += bytes.next_multiple_of(Accel::ALIGN);
        made.map(Arc::new)
    };
    Ok(sizes.iter().map(&mut place).collect::<Result<_, _>>()?)
}

/// The top level, with room for all instances.
struct Top {
    accel: Arc<Accel>,
    desc: AccelDesc,
    sizes: AccelSizes,
    staging: Staging,
    /// Indices of the instances in the last build; `None` before the first.
    built: Option<Vec<u32>>,
}

impl Top {
    fn new(gpu: &Gpu, count: usize) -> Result<Self, ResidentError> {
        if count >= AccelInstance::LIMIT as usize {
            return Err(ResidentError::Limit { what: "instances", count, limit: AccelInstance::LIMIT });
        }
        let geometry = AccelGeometry::Instances { instances: Address::default(), count: count as u32 };
        let desc = AccelDesc { geometry, fast_build: false, update: true, compact: false };
        let sizes = gpu.accel_sizes(&desc)?;
        let accel = Arc::new(Accel::alone(gpu, "top level", sizes.bytes, true)?);
        Ok(Self { accel, desc, sizes, staging: Staging::new(gpu, "top level instances"), built: None })
    }

    fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        frame: &Frame<'_>,
        deformed: &[Handle<Blas>],
        table: impl FnOnce() -> Vec<AccelInstance>,
    ) -> Result<Handle<Tlas>, ResidentError> {
        let key = imports.accel(&self.accel, frame.root);
        if self.built.is_some() && !frame.moved && frame.deformed.is_none() {
            return Ok(g.import_tlas("scene.tlas", Access::Trace, key));
        }
        let table = table();
        let count = table.len() as u32;
        // A refit must have exactly the same instances, because their bottom levels may not change.
        let indices: Vec<u32> = table.iter().map(|i| i.index()).collect();
        let refit = self.built.as_ref() == Some(&indices) && frame.policy.refits(frame.number);
        self.built = Some(indices);
        let instances = self.staging.write(bytemuck::cast_slice(&table))?;
        let geometry = AccelGeometry::Instances { instances: instances.address(), count };
        let desc = AccelDesc { geometry, ..self.desc };
        let input = imports.buffer(instances);
        let bytes = (table.len() * size_of::<AccelInstance>()).max(4) as u64;
        let input = g.import_buffer("acceleration.instances", BufferDesc::new(bytes), Access::CopyRead, input);
        let target = g.import_accel::<Tlas>("scene.tlas", Access::Trace, key);
        let room = if refit { self.sizes.refit_scratch } else { self.sizes.build_scratch };
        let made = g.pass("acceleration.top", Queue::AsyncCompute, |p| {
            p.build_input(input.read());
            for bottom in deformed {
                p.build_input(*bottom);
            }
            update(p, target, desc, room, refit)
        });
        Ok(made.read())
    }
}

/// An instance in the format of the driver's top level.
fn top_instance(instance: &shared::Instance, index: u32, bottom: Address) -> AccelInstance {
    // No winding flag: Vulkan's default front face, clockwise in a left-handed system, is counter-clockwise in a right-handed one.
    let mut flags = 0;
    if instance.flags & shared::INSTANCE_DOUBLE_SIDED != 0 {
        flags |= AccelInstance::DOUBLE_SIDED;
    }
    if instance.flags & shared::INSTANCE_ALPHA_TEST != 0 {
        flags |= AccelInstance::NOT_OPAQUE;
    }
    let group = if instance.flags & shared::INSTANCE_SPHERES != 0 { SPHERE_GROUP } else { TRIANGLE_GROUP };
    AccelInstance {
        world_from_object: instance.world_from_object,
        index_and_mask: index | instance.mask << 24,
        group_and_flags: group | flags,
        bottom: bottom.0,
    }
}
