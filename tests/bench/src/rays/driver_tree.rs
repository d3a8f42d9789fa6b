//! Hardware acceleration structures of a [`World`](super::World), built by graph passes.
use super::trace::{pass_ns, write};
use super::world::rows;
use super::{Change, Placed, RayBenchError, WorldOptions, WorldReport};
use magpie::gpu::{
    Accel, AccelDesc, AccelGeometry, AccelInstance, AccelSizes, Buffer, BufferMemory, BufferUse, CompactedSizes, Gpu,
    TRIANGLE_GROUP,
};
use magpie::graph::execute::{Executor, Imports};
use magpie::graph::{Access, Blas, BufferDesc, Domain, Extent, Handle, Queue, Record, Tlas, WriteHandle};
use magpie_shaders::Address;
use magpie_shaders::scene as shared;
use std::sync::Arc;

/// Bottom-level and top-level acceleration structures.
pub(super) struct DriverTree {
    bottom: Vec<Arc<Accel>>,
    top: Arc<Accel>,
    top_desc: AccelDesc,
    top_sizes: AccelSizes,
    instances: Arc<Buffer>,
}

impl DriverTree {
    /// `meshes`: each with its number of vertices.
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        geometry: &Arc<Buffer>,
        meshes: &[(shared::Mesh, u32)],
        placed: &[Placed],
        options: WorldOptions,
        report: &mut WorldReport,
    ) -> Result<Self, RayBenchError> {
        let mut bottom = Vec::with_capacity(meshes.len());
        for &(mesh, vertices) in meshes {
            let accel_geometry = AccelGeometry::Triangles {
                positions: mesh.positions,
                vertices,
                indices: mesh.indices,
                triangles: mesh.primitive_count,
            };
            let desc = AccelDesc {
                geometry: accel_geometry,
                fast_build: options.fast_build,
                update: false,
                compact: options.compaction,
            };
            let sizes = gpu.accel_sizes(&desc)?;
            let accel = Arc::new(Accel::alone(gpu, "bench bottom level", sizes.bytes, false)?);
            report.bottom_ns += build_bottom(executor, geometry, &accel, desc, sizes)?;
            report.uncompacted_bytes += accel.bytes();
            report.scratch_bytes = report.scratch_bytes.max(sizes.build_scratch);
            let kept = if options.compaction {
                let (kept, taken) = compact(gpu, executor, &accel)?;
                report.compact_ns += taken;
                kept
            } else {
                accel
            };
            report.bottom_bytes += kept.bytes();
            bottom.push(kept);
        }

        let bytes = (placed.len() * size_of::<AccelInstance>()) as u64;
        let instances = Buffer::new(gpu, "bench instances", bytes, BufferMemory::Device, BufferUse::Storage)?;
        let instances = Arc::new(instances);
        let count = placed.len() as u32;
        let top_geometry = AccelGeometry::Instances { instances: instances.address(), count };
        let top_desc = AccelDesc { geometry: top_geometry, fast_build: false, update: options.refit, compact: false };
        let top_sizes = gpu.accel_sizes(&top_desc)?;
        let top = Arc::new(Accel::alone(gpu, "bench top level", top_sizes.bytes, true)?);
        report.top_bytes = top.bytes();
        let mut tree = Self { bottom, top, top_desc, top_sizes, instances };
        report.top_ns = tree.follow(gpu, executor, placed, Change::Rebuild)?.unwrap_or_default();
        Ok(tree)
    }

    /// Device address of the top level.
    pub fn top(&self) -> Address {
        self.top.address()
    }

    pub fn top_accel(&self) -> &Arc<Accel> {
        &self.top
    }

    /// Updates the top level; returns nanoseconds on the device.
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        executor: &mut Executor,
        placed: &[Placed],
        change: Change,
    ) -> Result<Option<u64>, RayBenchError> {
        if change == Change::Refit && !self.top_desc.update {
            return Ok(None);
        }
        let table: Vec<_> = placed.iter().zip(0..).map(|(p, index)| self.instance(p, index)).collect();
        write(gpu, executor, &self.instances, bytemuck::cast_slice(&table))?;
        let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
        let desc = BufferDesc::new(self.instances.bytes());
        let input = g.import_buffer("instances", desc, Access::CopyWrite, imports.buffer(&self.instances));
        let key = imports.accel(&self.top, Address::default());
        let target: WriteHandle<Tlas> = g.import_accel("tlas", Access::Build, key);
        let (desc, sizes) = (self.top_desc, self.top_sizes);
        let built = g.pass("bench.top", Queue::Graphics, |p| {
            p.build_input(input.read());
            let refit = change == Change::Refit;
            let (built, into) = if refit { p.refit(target) } else { p.rebuild(target) };
            let bytes = if refit { sizes.refit_scratch } else { sizes.build_scratch };
            let scratch = p.scratch("scratch", BufferDesc::new(bytes));
            (
                built,
                move |c: &mut Record<'_>| {
                    if refit { c.refit_accel(into, scratch, &desc) } else { c.build_accel(into, scratch, &desc) }
                },
            )
        });
        g.output(built.read());
        let executed = executor.run(g, &imports)?;
        gpu.check_validation()?;
        pass_ns(&executed, "bench.top").map(Some)
    }

    /// An instance in the driver's format.
    fn instance(&self, placed: &Placed, index: u32) -> AccelInstance {
        let double_sided = if placed.double_sided { AccelInstance::DOUBLE_SIDED } else { 0 };
        let bottom = self.bottom.get(placed.shape as usize).map(|b| b.address().0).unwrap_or_default();
        AccelInstance {
            world_from_object: rows(&placed.world_from_object),
            index_and_mask: index | placed.mask << 24,
            group_and_flags: TRIANGLE_GROUP | double_sided,
            bottom,
        }
    }
}

fn build_bottom(
    executor: &mut Executor,
    geometry: &Arc<Buffer>,
    accel: &Arc<Accel>,
    desc: AccelDesc,
    sizes: AccelSizes,
) -> Result<u64, RayBenchError> {
    let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
    let input =
        g.import_buffer("geometry", BufferDesc::new(geometry.bytes()), Access::CopyWrite, imports.buffer(geometry));
    let key = imports.accel(accel, Address::default());
    let target: WriteHandle<Blas> = g.import_accel("bottom", Access::Build, key);
    let built = g.pass("bench.bottom", Queue::Graphics, |p| {
        p.build_input(input.read());
        let (built, into) = p.rebuild(target);
        let scratch = p.scratch("scratch", BufferDesc::new(sizes.build_scratch));
        (built, move |c: &mut Record<'_>| c.build_accel(into, scratch, &desc))
    });
    g.output(built.read());
    pass_ns(&executor.run(g, &imports)?, "bench.bottom")
}

/// A compacted copy, and nanoseconds on the device.
fn compact(gpu: &Gpu, executor: &mut Executor, accel: &Arc<Accel>) -> Result<(Arc<Accel>, u64), RayBenchError> {
    let sizes = Arc::new(CompactedSizes::new(gpu, 1)?);
    let answer = Arc::new(Buffer::new(gpu, "compacted size", 8, BufferMemory::ReadBack, BufferUse::Storage)?);
    let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
    let key = imports.accel(accel, Address::default());
    let source: Handle<Blas> = g.import_accel("bottom", Access::Build, key).read();
    let target = g.import_buffer("size", BufferDesc::new(8), Access::HostRead, imports.buffer(&answer));
    let queries = sizes.clone(); // the frame drops its own handle before the device is done
    let asked = g.pass("bench.measure", Queue::Graphics, |p| {
        let source = p.build_input(source);
        let (asked, to) = p.copy_to(target);
        (asked, move |c: &mut Record<'_>| c.compacted_sizes(&[source], &queries, to))
    });
    g.leave(asked.read(), Access::HostRead, Domain::Copy);
    executor.run(g, &imports)?;
    let bytes: Vec<u64> = bytemuck::pod_collect_to_vec(&answer.contents()[..8]);

    let kept = Arc::new(Accel::alone(gpu, "bench bottom level", bytes[0], false)?);
    let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
    let key = imports.accel(accel, Address::default());
    let source: Handle<Blas> = g.import_accel("bottom", Access::Build, key).read();
    let key = imports.accel(&kept, Address::default());
    let target: WriteHandle<Blas> = g.import_accel("compacted", Access::Build, key);
    let made = g.pass("bench.compact", Queue::Graphics, |p| {
        let from = p.build_input(source);
        let (made, into) = p.rebuild(target);
        (made, move |c: &mut Record<'_>| c.compact_accel(from, into))
    });
    g.output(made.read());
    let taken = pass_ns(&executor.run(g, &imports)?, "bench.compact")?;
    Ok((kept, taken))
}
