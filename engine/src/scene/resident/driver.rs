//! The driver's acceleration structures over a scene: a bottom level per mesh, shared by its instances, and one top level.
use super::{AccelerationReport, Geometry, ResidentError};
use crate::gpu::{
    Accel, AccelDesc, AccelGeometry, AccelInstance, AccelSizes, Buffer, BufferMemory, BufferUse, CompactedSizes, Gpu,
    TRIANGLE_GROUP,
};
use crate::graph::execute::{Executed, Executor, Imports};
use crate::graph::{Access, Blas, BufferDesc, Domain, Extent, Handle, Queue, Record, WriteHandle};
use crate::scene::Scene;
use magpie_shaders::Address;
use magpie_shaders::scene::{INSTANCE_ALPHA_TEST, INSTANCE_DOUBLE_SIDED};
use std::sync::Arc;

/// Meshes that are built together before they are compacted: it bounds what is there uncompacted.
const BATCH: usize = 64;

/// Both levels.
pub(super) struct Driver {
    /// One per mesh.
    _bottom: Vec<Arc<Accel>>,
    pub top: Arc<Accel>,
}

impl Driver {
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        geometry: &Geometry<'_>,
        compaction: bool,
        report: &mut AccelerationReport,
    ) -> Result<Self, ResidentError> {
        let descs: Vec<AccelDesc> = (0..geometry.scene.meshes.len()).map(|m| bottom_desc(geometry, m, compaction)).collect();
        let mut bottom = Vec::with_capacity(descs.len());
        for batch in descs.chunks(BATCH) {
            let build = Build { gpu, geometry, first: bottom.len(), batch };
            let built = build.build(executor, report)?;
            report.uncompacted_bytes += built.iter().map(|a| a.bytes()).sum::<u64>();
            let kept = if compaction { build.compact(executor, built, report)? } else { built };
            report.bottom_bytes += kept.iter().map(|a| a.bytes()).sum::<u64>();
            bottom.extend(kept);
        }
        let top = build_top(gpu, executor, geometry.scene, &bottom, report)?;
        Ok(Self { _bottom: bottom, top })
    }
}

/// Meshes that keep their shape are built for fast rays, and to be compacted.
fn bottom_desc(geometry: &Geometry<'_>, mesh: usize, compact: bool) -> AccelDesc {
    let (positions, indices) = geometry.meshes[mesh];
    let of = &geometry.scene.meshes[mesh];
    let (vertices, triangles) = (of.positions.len() as u32, (of.indices.len() / 3) as u32);
    let geometry = AccelGeometry::Triangles { positions, vertices, indices, triangles };
    AccelDesc { geometry, fast_build: false, update: false, compact }
}

/// A few meshes whose bottom levels are built in one frame.
struct Build<'a> {
    gpu: &'a Gpu,
    geometry: &'a Geometry<'a>,
    first: usize,
    batch: &'a [AccelDesc],
}

impl Build<'_> {
    /// One pass per mesh. They need nothing of each other, but take turns in the same working memory.
    fn build(&self, executor: &mut Executor, report: &mut AccelerationReport) -> Result<Vec<Arc<Accel>>, ResidentError> {
        let sizes: Vec<AccelSizes> =
            self.batch.iter().map(|d| self.gpu.accel_sizes(d)).collect::<Result<_, _>>()?;
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

    /// Asks how small they can be, and copies each into that.
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
        let sizes = queries.clone(); // the frame lets go of its own before the device is done
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

/// Time of all passes on the device.
fn milliseconds(executed: &Executed) -> f64 {
    executed.sample.passes.iter().filter_map(|p| p.gpu_ns).sum::<u64>() as f64 * 1e-6
}

/// Structures of these sizes, side by side in one buffer.
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

fn build_top(
    gpu: &Gpu,
    executor: &mut Executor,
    scene: &Scene,
    bottom: &[Arc<Accel>],
    report: &mut AccelerationReport,
) -> Result<Arc<Accel>, ResidentError> {
    let count = scene.instances.len();
    if count >= AccelInstance::LIMIT as usize {
        return Err(ResidentError::Limit { what: "instances", count, limit: AccelInstance::LIMIT });
    }
    let table: Vec<_> = scene.instances.iter().zip(0..).map(|(i, index)| top_instance(scene, i, index, bottom)).collect();
    let bytes = (table.len() * size_of::<AccelInstance>()) as u64;
    let mut instances = Buffer::new(gpu, "top level instances", bytes, BufferMemory::Upload, BufferUse::Storage)?;
    instances.write(0, bytemuck::cast_slice(&table))?;
    let instances = Arc::new(instances);

    let geometry = AccelGeometry::Instances { instances: instances.address(), count: count as u32 };
    let desc = AccelDesc { geometry, fast_build: false, update: false, compact: false };
    let sizes = gpu.accel_sizes(&desc)?;
    let top = Arc::new(Accel::alone(gpu, "top level", sizes.bytes, true)?);
    report.top_bytes = top.bytes();
    let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
    let input = g.import_buffer("instances", BufferDesc::new(instances.bytes()), Access::CopyRead, imports.buffer(&instances));
    let target = g.import_accel::<crate::graph::Tlas>("tlas", Access::Build, imports.accel(&top, Address::default()));
    let built = g.pass("acceleration.top", Queue::Graphics, |p| {
        p.build_input(input.read());
        let (built, into) = p.rebuild(target);
        let scratch = p.scratch("scratch", BufferDesc::new(sizes.build_scratch));
        (built, move |c: &mut Record<'_>| c.build_accel(into, scratch, &desc))
    });
    g.output(built.read());
    let executed = executor.run(g, &imports)?;
    report.top_ms += milliseconds(&executed);
    Ok(top)
}

/// An instance as the driver wants it.
fn top_instance(scene: &Scene, placed: &crate::scene::Instance, index: u32, bottom: &[Arc<Accel>]) -> AccelInstance {
    let instance = super::tables::instance(scene, placed);
    let mut flags = 0;
    if instance.flags & INSTANCE_DOUBLE_SIDED != 0 {
        flags |= AccelInstance::DOUBLE_SIDED;
    }
    if instance.flags & INSTANCE_ALPHA_TEST != 0 {
        flags |= AccelInstance::NOT_OPAQUE;
    }
    AccelInstance {
        world_from_object: instance.world_from_object,
        index_and_mask: index | instance.mask << 24,
        group_and_flags: TRIANGLE_GROUP | flags,
        bottom: bottom[placed.mesh as usize].address().0,
    }
}
