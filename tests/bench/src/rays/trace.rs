//! Traces precomputed ray tables with every backend of the device.
use super::{RayBenchError, World, WorldHandles};
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, RayKernel};
use magpie::graph::execute::{Executed, Executor, Imports};
use magpie::graph::{
    Access, BufferDesc, BufferToken, Domain, Extent, FrameGraph, PassBuilder, Queue, Record, TraceToken,
};
use magpie::ray::{Bounds, RaySort};
use magpie::scene::{Policy, SceneHandles, SharedScene};
use magpie_shaders::bench::{RayAnswer, TraceParams};
use magpie_shaders::rays::RayTask;
use magpie_shaders::{BENCH_ANY_RAY, BENCH_CLOSEST_RAY, Rays};
use std::sync::Arc;

/// Kind of ray query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// Closest hit.
    Closest,
    /// Any hit.
    Any,
}

/// Rays in a 2D table: threads trace them in tiles of eight by eight.
#[derive(Clone, Debug)]
pub struct RayTable {
    /// `extent.width * extent.height` rays, row by row.
    pub rays: Vec<RayTask>,
    /// Width and height of the table, rays.
    pub extent: Extent,
    /// Kind of query.
    pub question: Question,
}

impl RayTable {
    /// A table from unordered rays: as square as possible; those that do not fill a row are dropped.
    pub fn of(mut rays: Vec<RayTask>, question: Question) -> Self {
        let width = ((rays.len() as f64).sqrt() as usize).max(1);
        let height = rays.len() / width;
        rays.truncate(width * height);
        Self { rays, extent: Extent::new(width as u32, height as u32), question }
    }

    fn answer_bytes(&self) -> u64 {
        let one = match self.question {
            Question::Closest => size_of::<RayAnswer>(),
            Question::Any => size_of::<u32>(),
        };
        (self.rays.len() * one) as u64
    }
}

/// A table on the device, with a buffer for the answers.
pub struct DeviceTable {
    rays: Arc<Buffer>,
    answers: Arc<Buffer>,
    extent: Extent,
    question: Question,
    count: u64,
}

impl DeviceTable {
    /// Number of rays.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Kind of query.
    pub fn question(&self) -> Question {
        self.question
    }
}

/// Geometry to trace against.
#[derive(Clone, Copy)]
pub enum Target<'a> {
    /// A scene of the engine.
    Scene(&'a SharedScene),
    /// Bare geometry of a benchmark or test.
    World(&'a World),
}

impl Target<'_> {
    fn import(self, g: &mut FrameGraph, imports: &mut Imports) -> Result<Handles, RayBenchError> {
        Ok(match self {
            Self::Scene(scene) => {
                let declared = scene.borrow_mut().declare(g, imports, None, &Policy::default());
                Handles::Scene(declared.map_err(|source| RayBenchError::Scene { scene: "scene".to_owned(), source })?)
            }
            Self::World(world) => Handles::World(world.import(g, imports)),
        })
    }
}

/// The target's handles in a frame graph.
#[derive(Clone, Copy)]
enum Handles {
    Scene(SceneHandles),
    World(WorldHandles),
}

impl Handles {
    fn trace(self, p: &mut PassBuilder<'_>) -> TraceToken {
        match self {
            Self::Scene(scene) => scene.trace(p).tlas,
            Self::World(world) => world.trace(p),
        }
    }
}

/// Traces ray tables on one device.
pub struct Tracer {
    gpu: Gpu,
    /// Runs the tracer's frames, and updates of worlds.
    pub executor: Executor,
    kernels: Vec<(Rays, RayKernel, RayKernel)>,
    sort: RaySort,
}

impl Tracer {
    /// Creates the pipelines for these backends.
    ///
    /// # Errors
    /// [`RayBenchError::Gpu`], for example if the device lacks a backend.
    pub fn new(gpu: &Gpu, ways: &[Rays]) -> Result<Self, RayBenchError> {
        let kernels = |&way: &Rays| {
            Ok::<_, RayBenchError>((
                way,
                gpu.ray_kernel(&BENCH_CLOSEST_RAY, way)?,
                gpu.ray_kernel(&BENCH_ANY_RAY, way)?,
            ))
        };
        Ok(Self {
            gpu: gpu.clone(),
            executor: Executor::new(gpu)?,
            sort: RaySort::new(gpu)?,
            kernels: ways.iter().map(kernels).collect::<Result<_, _>>()?,
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The backends with pipelines.
    pub fn ways(&self) -> Vec<Rays> {
        self.kernels.iter().map(|(way, ..)| *way).collect()
    }

    /// Uploads rays.
    ///
    /// # Errors
    /// Exhausted memory, a lost device.
    pub fn upload(&mut self, table: &RayTable) -> Result<DeviceTable, RayBenchError> {
        let rays = upload(&self.gpu, &mut self.executor, "bench rays", bytemuck::cast_slice(&table.rays))?;
        let answers =
            Buffer::new(&self.gpu, "bench answers", table.answer_bytes(), BufferMemory::Device, BufferUse::Storage)?;
        let (extent, question, count) = (table.extent, table.question, table.rays.len() as u64);
        Ok(DeviceTable { rays, answers: Arc::new(answers), extent, question, count })
    }

    /// Traces all rays of a table once; returns nanoseconds on the device.
    ///
    /// # Errors
    /// A lost device, or one without timestamps.
    pub fn time(&mut self, rays: Rays, target: Target<'_>, table: &DeviceTable) -> Result<u64, RayBenchError> {
        let executed = self.run(rays, target, table, None, None)?;
        pass_ns(&executed, "bench.trace")
    }

    /// Sorts all rays of a table, whose origins lie in `bounds`, and traces them; returns nanoseconds of sorting and of tracing.
    ///
    /// # Errors
    /// As [`Tracer::time`].
    pub fn time_sorted(
        &mut self,
        rays: Rays,
        target: Target<'_>,
        table: &DeviceTable,
        bounds: &Bounds,
    ) -> Result<(u64, u64), RayBenchError> {
        let executed = self.run(rays, target, table, Some(bounds), None)?;
        let steps = ["rays.sort_clear", "rays.sort_count", "rays.sort_scan", "rays.sort_place"];
        let mut sort = 0;
        for step in steps {
            sort += pass_ns(&executed, step)?;
        }
        Ok((sort, pass_ns(&executed, "bench.trace")?))
    }

    /// The closest hits of a table's rays, traced in sorted order.
    ///
    /// # Errors
    /// As [`Tracer::closest`].
    pub fn closest_sorted(
        &mut self,
        rays: Rays,
        target: Target<'_>,
        table: &DeviceTable,
        bounds: &Bounds,
    ) -> Result<Vec<RayAnswer>, RayBenchError> {
        self.demand(table, Question::Closest)?;
        Ok(bytemuck::pod_collect_to_vec(&self.read(rays, target, table, Some(bounds))?))
    }

    /// The closest hits of a table's rays.
    ///
    /// # Errors
    /// A lost device; [`RayBenchError::Question`] for an any-hit table.
    pub fn closest(
        &mut self,
        rays: Rays,
        target: Target<'_>,
        table: &DeviceTable,
    ) -> Result<Vec<RayAnswer>, RayBenchError> {
        self.demand(table, Question::Closest)?;
        Ok(bytemuck::pod_collect_to_vec(&self.read(rays, target, table, None)?))
    }

    /// Whether each ray of an any-hit table hits anything.
    ///
    /// # Errors
    /// As [`Tracer::closest`].
    pub fn any(&mut self, rays: Rays, target: Target<'_>, table: &DeviceTable) -> Result<Vec<bool>, RayBenchError> {
        self.demand(table, Question::Any)?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&self.read(rays, target, table, None)?);
        Ok(words.into_iter().map(|word| word != 0).collect())
    }

    fn demand(&self, table: &DeviceTable, wanted: Question) -> Result<(), RayBenchError> {
        let got = table.question;
        if got == wanted { Ok(()) } else { Err(RayBenchError::Question { wanted, got }) }
    }

    fn read(
        &mut self,
        rays: Rays,
        target: Target<'_>,
        table: &DeviceTable,
        sorted: Option<&Bounds>,
    ) -> Result<Vec<u8>, RayBenchError> {
        let bytes = table.answers.bytes();
        let host = Buffer::new(&self.gpu, "answers on the host", bytes, BufferMemory::ReadBack, BufferUse::Storage)?;
        let host = Arc::new(host);
        self.run(rays, target, table, sorted, Some(&host))?;
        Ok(host.contents()[..bytes as usize].to_vec())
    }

    fn run(
        &mut self,
        rays: Rays,
        target: Target<'_>,
        table: &DeviceTable,
        sorted: Option<&Bounds>,
        host: Option<&Arc<Buffer>>,
    ) -> Result<Executed, RayBenchError> {
        let missing = RayBenchError::Way { rays: rays.name() };
        let &(_, closest, any) = self.kernels.iter().find(|(way, ..)| *way == rays).ok_or(missing)?;
        let kernel = if table.question == Question::Closest { closest } else { any };
        let (mut g, mut imports) = (self.executor.begin(table.extent), Imports::default());
        let handles = target.import(&mut g, &mut imports)?;
        let extent = table.extent;
        let mut buffer = |name, buffer: &Arc<Buffer>, last, g: &mut FrameGraph| {
            g.import_buffer(name, BufferDesc::new(buffer.bytes()), last, imports.buffer(buffer))
        };
        let tasks = buffer("rays", &table.rays, Access::CopyWrite, &mut g).read();
        let answers = buffer("answers", &table.answers, Access::BufferWrite, &mut g);
        let order = sorted.map(|bounds| self.sort.add(&mut g, tasks, table.count as u32, bounds));
        let answers = g.pass("bench.trace", Queue::Graphics, |p| {
            let (tlas, tasks) = (handles.trace(p), p.read(tasks));
            let order = order.map(|order| p.read(order));
            let (answers, to): (_, BufferToken) = p.write_buffer(answers);
            (answers, move |c: &mut Record<'_>| {
                let (width, height) = (extent.width, extent.height);
                let order = order.map_or_else(Default::default, |order| c.id(order));
                let (scene, rays, answers) = (c.id(tlas), c.id(tasks), c.id(to));
                let params = TraceParams { scene, rays, answers, order, width, height };
                c.trace(kernel, tlas, &params, extent);
            })
        });
        let answers = answers.read();
        g.output(answers);
        if let Some(host) = host {
            let target = buffer("host", host, Access::HostRead, &mut g);
            let bytes = host.bytes();
            let copied = g.pass("bench.copy", Queue::Transfer, |p| {
                let from = p.copy_from(answers);
                let (target, to) = p.copy_to(target);
                (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
            });
            g.leave(copied.read(), Access::HostRead, Domain::Copy);
        }
        let executed = self.executor.run(g, &imports)?;
        self.gpu.check_validation()?;
        Ok(executed)
    }
}

/// GPU time of a pass, nanoseconds.
pub(super) fn pass_ns(executed: &Executed, name: &'static str) -> Result<u64, RayBenchError> {
    let pass = executed.sample.passes.iter().find(|p| p.name == name);
    pass.and_then(|p| p.gpu_ns).ok_or(RayBenchError::Untimed { pass: name })
}

/// Creates a device-local buffer with these bytes.
pub(super) fn upload(
    gpu: &Gpu,
    executor: &mut Executor,
    name: &str,
    bytes: &[u8],
) -> Result<Arc<Buffer>, RayBenchError> {
    let target = Buffer::new(gpu, name, bytes.len() as u64, BufferMemory::Device, BufferUse::Storage)?;
    let target = Arc::new(target);
    write(gpu, executor, &target, bytes)?;
    Ok(target)
}

/// Overwrites the first bytes of a buffer.
pub(super) fn write(
    gpu: &Gpu,
    executor: &mut Executor,
    target: &Arc<Buffer>,
    bytes: &[u8],
) -> Result<(), RayBenchError> {
    let length = bytes.len() as u64;
    if length == 0 {
        return Ok(());
    }
    let mut staging = Buffer::new(gpu, "staging", length, BufferMemory::Upload, BufferUse::Storage)?;
    staging.write(0, bytes)?;
    let staging = Arc::new(staging);
    let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
    let from = g.import_buffer("staging", BufferDesc::new(length), Access::CopyRead, imports.buffer(&staging));
    let key = imports.buffer(target);
    let to = g.import_buffer(target.name(), BufferDesc::new(target.bytes()), Access::CopyWrite, key);
    let written = g.pass("bench.upload", Queue::Transfer, |p| {
        let from = p.copy_from(from.read());
        let (to, into) = p.copy_to(to);
        (to, move |c: &mut Record<'_>| c.copy_buffer(from, 0, into, 0, length))
    });
    g.output(written.read());
    executor.run(g, &imports)?;
    Ok(())
}
