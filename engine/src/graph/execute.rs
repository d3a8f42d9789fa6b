//! Runs a planned frame: the only part of the graph that touches the device, and the only place that issues barriers.

use std::{collections::HashMap, sync::Arc, time::Instant};

use magpie_shaders::Address;

use super::{
    access::{Access, Domain, Uses},
    declaration::{Clear, Declaration, ImportKey, Origin, PassDecl, Shape},
    desc::{Extent, Format},
    error::GraphErrors,
    pass::FrameGraph,
    plan::{Barrier, Plan, plan},
    record::{Physical, Record, Recorded},
};
use crate::{
    gpu::{
        self, Attachment, BufferBarrier, BufferMemory, BufferUse, CommandEncoder, Gpu, GpuError, ImageBarrier,
        ImageUse, PassSet, Scope, Timestamps,
    },
    measure::{FrameSample, PassTime},
};

/// Why a frame did not run.
#[derive(Debug, thiserror::Error)]
pub enum ExecuteError {
    /// The declaration has mistakes.
    #[error(transparent)]
    Declaration(#[from] GraphErrors),
    /// The device refused.
    #[error("pass {pass}: {source}")]
    Pass {
        /// The pass, or the resource that was being made.
        pass: String,
        /// What it said.
        source: GpuError,
    },
    /// The device refused outside of any pass.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// The objects behind imported resources.
#[derive(Default)]
pub struct Imports(Vec<Physical>);

impl Imports {
    /// Adds an image; the key is for [`FrameGraph::import_image`].
    pub fn image(&mut self, image: &Arc<gpu::Image>) -> ImportKey {
        self.add(Physical::Image(image.clone()))
    }

    /// Adds a buffer; the key is for [`FrameGraph::import_buffer`] or [`FrameGraph::import_tlas`].
    pub fn buffer(&mut self, buffer: &Arc<gpu::Buffer>) -> ImportKey {
        self.add(Physical::Buffer(buffer.clone()))
    }

    fn add(&mut self, object: Physical) -> ImportKey {
        self.0.push(object);
        ImportKey(self.0.len() as u32 - 1)
    }
}

/// A frame that ran.
pub struct Executed {
    /// What was declared.
    pub declaration: Declaration,
    /// How it ran.
    pub plan: Plan,
    /// Times and counts. Declaring is the caller's to time.
    pub sample: FrameSample,
    /// Bytes of memory behind the transients.
    pub transient_bytes: u64,
}

/// Images and buffers for transients, kept from frame to frame: each resource of a frame gets its own.
#[derive(Default)]
struct Pool {
    images: HashMap<(Format, Extent, u32, ImageUse), Vec<Arc<gpu::Image>>>,
    buffers: HashMap<(u64, BufferUse), Vec<Arc<gpu::Buffer>>>,
}

/// Runs frames one after another on the graphics queue.
///
/// A call returns once the device is done, so that its times are those of this very frame and nothing is in flight when
/// resources change.
pub struct Executor {
    gpu: Gpu,
    pool: Pool,
    encoder: CommandEncoder,
    timestamps: Timestamps,
    /// Two words per pass, closest-hit and any-hit rays: where shaders count, and where the host reads.
    rays: [gpu::Buffer; 2],
    begun: Instant,
}

const FIRST_PASSES: u32 = 64;
const RAY_BYTES: usize = 8;

impl Executor {
    /// An executor without any memory yet.
    ///
    /// # Errors
    /// Failing calls.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: gpu.clone(),
            pool: Pool::default(),
            encoder: CommandEncoder::new(gpu)?,
            timestamps: Timestamps::new(gpu, stamps(FIRST_PASSES))?,
            rays: ray_counters(gpu, FIRST_PASSES)?,
            begun: Instant::now(),
        })
    }

    /// Plans and runs a frame, and waits for it.
    ///
    /// # Errors
    /// Mistakes in the declaration, exhausted memory and a lost device, with the pass or resource.
    pub fn run(&mut self, graph: FrameGraph, imports: &Imports) -> Result<Executed, ExecuteError> {
        let start = Instant::now();
        let mut frame = graph.finish()?;
        let declaration = frame.declaration;
        let plan = plan(&declaration);
        let plan_ns = nanoseconds(start);

        // Objects for every resource, counters and timestamps for every pass.
        let physical = self.make_physical(&declaration, &plan, imports)?;
        let passes = plan.order.len() as u32;
        if self.timestamps.capacity() < stamps(passes) {
            self.timestamps = Timestamps::new(&self.gpu, stamps(passes))?;
            self.rays = ray_counters(&self.gpu, passes)?;
        }
        self.timestamps.reset();

        // Record in the order of the plan.
        let record_start = Instant::now();
        self.encoder.begin()?;
        let [counters, counted] = &self.rays;
        self.encoder.clear_buffer(counters);
        self.encoder.full_barrier();
        self.encoder.timestamp(&self.timestamps, 0);
        let (mut times, mut sets) = (Vec::with_capacity(plan.order.len()), Vec::new());
        for (position, &index) in plan.order.iter().enumerate() {
            let pass = &declaration.passes[index as usize];
            let cpu_start = Instant::now();
            issue(&mut self.encoder, &physical, &plan.barriers[position]);
            let rays = counters.address().offset((position * RAY_BYTES) as u64);
            self.encoder.begin_label(&pass.name);
            self.encoder.timestamp(&self.timestamps, 1 + 2 * position as u32);
            if self.gpu.validates() {
                let sampled = images_used(&physical, pass, |access| access == Access::Sample);
                let stored = images_used(&physical, pass, is_storage);
                let set = PassSet::new(&self.gpu, &sampled, &stored)?;
                self.encoder.bind_pass_set(&set);
                sets.push(set); // lives until the device is done, at the end of this function
            }
            let record = frame.records[index as usize].take();
            let recorded = record_pass(&mut self.encoder, &declaration, &physical, pass, index, rays, record);
            self.encoder.timestamp(&self.timestamps, 2 + 2 * position as u32);
            self.encoder.end_label();
            times.push(PassTime {
                name: pass.name.clone(),
                stage: pass.stage.clone(),
                queue: "graphics",
                cpu_ns: nanoseconds(cpu_start),
                cpu_start_ns: Some((cpu_start - start).as_nanos() as u64),
                draws: recorded.draws,
                dispatches: recorded.dispatches,
                ..Default::default()
            });
        }
        issue(&mut self.encoder, &physical, &plan.barriers[plan.order.len()]);
        // Whatever comes next, the host or another frame, sees everything: frames do not overlap.
        self.encoder.full_barrier();
        self.encoder.copy_buffer(counters, 0, counted, 0, counters.bytes());
        self.encoder.full_barrier();
        self.encoder.finish()?;
        let record_ns = nanoseconds(record_start);

        let submission = self.gpu.submit(&self.encoder)?;
        self.gpu.wait(submission)?;
        let (first_stamp, gpu_ns) = self.read_times(&mut times)?;
        let sample = FrameSample {
            start_ns: Some((start - self.begun).as_nanos() as u64),
            gpu_begin_ns: self.gpu.calibrate().and_then(|(device_now, now)| {
                let ago = device_now.checked_sub(first_stamp)?;
                ((now - self.begun).as_nanos() as u64).checked_sub(ago)
            }),
            gpu_ns: Some(gpu_ns),
            cpu_ns: nanoseconds(start),
            plan_ns,
            record_ns,
            passes: times,
            culled: plan.culled.len() as u32,
            barriers: plan.barriers.iter().map(Vec::len).sum::<usize>() as u32,
            ..Default::default()
        };
        let transient_bytes = self.pool.bytes();
        Ok(Executed { declaration, plan, sample, transient_bytes })
    }

    /// Fills in the GPU times and ray counts; returns the first timestamp and the time of the whole frame.
    fn read_times(&self, times: &mut [PassTime]) -> Result<(u64, u64), GpuError> {
        let stamps = self.timestamps.read(stamps(times.len() as u32))?;
        let counters = self.rays[1].contents();
        for (position, time) in times.iter_mut().enumerate() {
            let (begin, end) = (stamps[1 + 2 * position], stamps[2 + 2 * position]);
            time.gpu_ns = Some(end.saturating_sub(begin));
            time.gpu_start_ns = Some(begin.saturating_sub(stamps[0]));
            let word = |at: usize| {
                let bytes = counters.get(position * RAY_BYTES + at..position * RAY_BYTES + at + 4);
                bytes.and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes)
            };
            (time.rays_closest, time.rays_any) = (word(0).into(), word(4).into());
        }
        let last = stamps.last().copied().unwrap_or(stamps[0]);
        Ok((stamps[0], last.saturating_sub(stamps[0])))
    }

    fn make_physical(
        &mut self,
        declaration: &Declaration,
        plan: &Plan,
        imports: &Imports,
    ) -> Result<Vec<Physical>, ExecuteError> {
        let mut physical = vec![Physical::Unused; declaration.resources.len()];
        for (slot, resource) in physical.iter_mut().zip(&declaration.resources) {
            if let Origin::Imported { key, .. } = resource.origin {
                let object = imports.0.get(key.0 as usize);
                *slot = object.cloned().unwrap_or(Physical::Unused);
            }
        }
        let (mut images_taken, mut buffers_taken) = (HashMap::new(), HashMap::new());
        for transient in &plan.transients {
            let resource = &declaration.resources[transient.resource as usize];
            let failed = |source| ExecuteError::Pass { pass: resource.name.clone(), source };
            physical[transient.resource as usize] = match resource.shape {
                Shape::Image { format, extent, mips } => {
                    let usage = image_use(transient.uses);
                    let key = (format, extent, mips, usage);
                    let taken: &mut usize = images_taken.entry(key).or_default();
                    let known = self.pool.images.entry(key).or_default();
                    if *taken == known.len() {
                        let image = gpu::Image::new(&self.gpu, &resource.name, format, extent, mips, usage);
                        known.push(Arc::new(image.map_err(failed)?));
                    }
                    *taken += 1;
                    Physical::Image(known[*taken - 1].clone())
                }
                Shape::Buffer { bytes } => {
                    let key = (bytes, buffer_use(transient.uses));
                    let taken: &mut usize = buffers_taken.entry(key).or_default();
                    let known = self.pool.buffers.entry(key).or_default();
                    if *taken == known.len() {
                        let buffer = gpu::Buffer::new(&self.gpu, &resource.name, bytes, BufferMemory::Device, key.1);
                        known.push(Arc::new(buffer.map_err(failed)?));
                    }
                    *taken += 1;
                    Physical::Buffer(known[*taken - 1].clone())
                }
                Shape::Tlas => Physical::Unused,
            };
        }
        // What this frame did not take is of a size or kind no longer asked for.
        self.pool.images.retain(|key, list| {
            list.truncate(images_taken.get(key).copied().unwrap_or(0));
            !list.is_empty()
        });
        self.pool.buffers.retain(|key, list| {
            list.truncate(buffers_taken.get(key).copied().unwrap_or(0));
            !list.is_empty()
        });
        Ok(physical)
    }
}

impl Pool {
    fn bytes(&self) -> u64 {
        let images: u64 = self.images.values().flatten().map(|i| i.bytes()).sum();
        let buffers: u64 = self.buffers.values().flatten().map(|b| b.bytes()).sum();
        images + buffers
    }
}

/// Timestamps of a frame: one at its begin, two per pass.
fn stamps(passes: u32) -> u32 {
    1 + 2 * passes
}

fn ray_counters(gpu: &Gpu, passes: u32) -> Result<[gpu::Buffer; 2], GpuError> {
    let bytes = u64::from(passes) * RAY_BYTES as u64;
    let make = |name, memory| gpu::Buffer::new(gpu, name, bytes, memory, BufferUse::Storage);
    Ok([make("ray counters", BufferMemory::Device)?, make("ray counts", BufferMemory::ReadBack)?])
}
fn nanoseconds(since: Instant) -> u64 {
    since.elapsed().as_nanos() as u64
}

fn image_use(uses: Uses) -> ImageUse {
    let mut usage = ImageUse::default();
    for (access, _) in uses.iter() {
        usage.sampled |= access == Access::Sample;
        usage.attachment |= access.is_attachment();
        usage.storage |= is_storage(access);
    }
    usage
}

fn buffer_use(uses: Uses) -> BufferUse {
    let has = |wanted| uses.iter().any(|(access, _)| access == wanted);
    match (has(Access::Index), has(Access::Indirect)) {
        (true, _) => BufferUse::Index,
        (_, true) => BufferUse::Indirect,
        _ => BufferUse::Storage,
    }
}

fn scope(uses: Uses) -> Scope {
    if uses.is_any() {
        return Scope::EVERYTHING;
    }
    uses.iter().map(|(access, domain)| Scope::of(access, domain)).fold(Scope::default(), std::ops::BitOr::bitor)
}

fn issue(encoder: &mut CommandEncoder, physical: &[Physical], batch: &[Barrier]) {
    let (mut images, mut buffers) = (Vec::new(), Vec::new());
    for barrier in batch {
        let (from, to) = (scope(barrier.from), Scope::of(barrier.to.0, barrier.to.1));
        match &physical[barrier.resource as usize] {
            Physical::Image(image) => {
                let (layout_from, layout_to) = (barrier.layout_from, barrier.layout_to);
                images.push(ImageBarrier { image, from, to, layout_from, layout_to });
            }
            Physical::Buffer(buffer) => buffers.push(BufferBarrier { buffer, from, to }),
            Physical::Unused => {}
        }
    }
    if !images.is_empty() || !buffers.is_empty() {
        encoder.barriers(&images, &buffers);
    }
}

fn is_storage(access: Access) -> bool {
    matches!(access, Access::StorageRead | Access::StorageWrite | Access::StorageReadWrite)
}

fn images_used<'a>(physical: &'a [Physical], pass: &PassDecl, how: impl Fn(Access) -> bool) -> Vec<&'a gpu::Image> {
    let objects = pass.uses.iter().filter(|u| how(u.access)).map(|u| &physical[u.resource as usize]);
    objects
        .filter_map(|object| match object {
            Physical::Image(image) => Some(&**image),
            Physical::Buffer(_) | Physical::Unused => None,
        })
        .collect()
}

/// Records one pass, inside of its attachments if it has any.
fn record_pass(
    encoder: &mut CommandEncoder,
    declaration: &Declaration,
    physical: &[Physical],
    pass: &PassDecl,
    index: u32,
    rays: Address,
    record: Option<super::pass::RecordFn>,
) -> Recorded {
    let raster = pass.domain == Domain::Raster;
    if raster {
        begin_rendering(encoder, declaration, physical, pass);
    }
    let mut scope = Record { encoder, physical, pass: index, name: &pass.name, rays, recorded: Recorded::default() };
    if let Some(record) = record {
        record(&mut scope);
    }
    let recorded = scope.recorded;
    if raster {
        encoder.end_rendering();
    }
    recorded
}

fn begin_rendering(encoder: &mut CommandEncoder, declaration: &Declaration, physical: &[Physical], pass: &PassDecl) {
    let (mut colours, mut depth, mut extent) = (Vec::new(), None, declaration.full);
    for u in pass.uses.iter().filter(|u| u.access.is_attachment()) {
        let Physical::Image(image) = &physical[u.resource as usize] else { continue };
        extent = image.extent();
        let clear = u.clear.map(|c| match c {
            Clear::Color(colour) => colour,
            Clear::Depth(depth) => [depth, 0.0, 0.0, 0.0],
        });
        let attachment = Attachment { image, clear };
        if u.access.is_depth() {
            depth = Some(attachment);
        } else {
            colours.push(attachment);
        }
    }
    encoder.begin_rendering(extent, &colours, depth.as_ref());
}
