//! Runs a planned frame: the only part of the graph that touches the device, and the only place that issues barriers.
//!
//! | file | does |
//! |---|---|
//! | `mod` | one frame from its declaration to its submission, and from there to its end |
//! | `in_flight` | a frame that was submitted, with all that the device needs until it is done |
//! | `cache` | plans of earlier declarations |
//! | `bind` | device objects of a plan's resources, and its barriers translated to Vulkan |
//! | `persistent` | device objects that outlive the frame: histories, kept buffers and kept images |
//! | `commands` | command buffers, recorded on several threads where that pays, and their submission |
//! | `time` | GPU times, and counts of rays, non-finite values and shader invocations |
//! | `poison` | writes NaN or infinity into outputs on purpose, for tests |
//! | `breadcrumbs` | which passes a lost device had begun and ended |

mod bind;
mod breadcrumbs;
mod cache;
mod commands;
mod in_flight;
mod persistent;
mod poison;
mod time;

use magpie_shaders::Address;
use std::{sync::Arc, time::Instant};

use super::{
    Extent,
    check::PoisonError,
    declaration::{Declaration, ImportKey},
    error::GraphErrors,
    history::SharedHistoryRegistry,
    pass::{FrameGraph, RecordFn},
    plan::Plan,
    record::{AccelObject, BufferRange, Physical},
    switches::Switches,
};
use crate::{
    gpu::{self, Gpu, GpuError, SemaphoreValue},
    measure::{FrameSample, Memory},
};

pub use breadcrumbs::QueueProgress;
pub use in_flight::InFlight;
use in_flight::{End, Instruments};

/// Why a frame did not run.
#[derive(Debug, thiserror::Error)]
pub enum ExecuteError {
    /// The declaration has mistakes.
    #[error(transparent)]
    Declaration(#[from] GraphErrors),
    /// Recording a pass or creating a resource failed.
    #[error("pass {pass}: {source}")]
    Pass {
        /// Name of the pass, or full name of the resource.
        pass: String,
        /// What failed.
        source: GpuError,
    },
    /// An output that a test wants to poison cannot be poisoned.
    #[error(transparent)]
    Poison(#[from] PoisonError),
    /// The device was lost while it ran the frame.
    #[error("the device was lost during {during}; {}", breadcrumbs::describe(.progress))]
    Lost {
        /// The Vulkan call that reported it.
        during: &'static str,
        /// How far each queue came in the frame; empty without breadcrumbs.
        progress: Vec<QueueProgress>,
    },
    /// A failure outside any pass.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// The device objects behind a frame's imported resources, and what the frame waits for.
#[derive(Clone, Default)]
pub struct Imports {
    objects: Vec<Physical>,
    waits: Vec<SemaphoreValue>,
}

impl Imports {
    /// Adds an image; the key is for [`FrameGraph::import_image`].
    pub fn image(&mut self, image: &Arc<gpu::Image>) -> ImportKey {
        self.add(Physical::Image(image.clone()))
    }

    /// Adds an acceleration structure built by the driver; the key is for [`FrameGraph::import_accel`] or [`FrameGraph::import_tlas`].
    /// `root` is the address of the scene's tables, which shaders need beside a top level; null for a bottom level.
    pub fn accel(&mut self, accel: &Arc<gpu::Accel>, root: Address) -> ImportKey {
        let (buffer, offset) = accel.place();
        let memory = BufferRange { buffer: buffer.clone(), offset, bytes: accel.bytes() };
        self.add(Physical::Accel(AccelObject { memory, driver: Some(accel.clone()), root }))
    }

    /// Adds a BVH for tracing in software, in a buffer; the key is as for [`Imports::accel`].
    pub fn tree(&mut self, buffer: &Arc<gpu::Buffer>, root: Address) -> ImportKey {
        self.add(Physical::Accel(AccelObject { memory: BufferRange::whole(buffer.clone()), driver: None, root }))
    }

    /// Adds a buffer; the key is for [`FrameGraph::import_buffer`].
    pub fn buffer(&mut self, buffer: &Arc<gpu::Buffer>) -> ImportKey {
        self.add(Physical::Buffer(BufferRange::whole(buffer.clone())))
    }

    /// The device begins the frame once this semaphore of the application is signalled. A frame that fails before it is submitted does not wait.
    pub fn wait_for(&mut self, semaphore: SemaphoreValue) {
        self.waits.push(semaphore);
    }

    /// Whether it is an image with sampled usage.
    pub fn is_sampled(&self, key: ImportKey) -> bool {
        let ImportKey::Caller(at) = key else { return false };
        matches!(self.objects.get(at as usize), Some(Physical::Image(image)) if image.sampled().is_some())
    }

    /// Removes all objects and semaphores, and keeps the capacity of the lists.
    pub fn clear(&mut self) {
        self.objects.clear();
        self.waits.clear();
    }

    fn add(&mut self, object: Physical) -> ImportKey {
        self.objects.push(object);
        ImportKey::Caller(self.objects.len() as u32 - 1)
    }
}

/// Options of an [`Executor`].
#[derive(Clone, Copy, Debug)]
pub struct ExecuteOptions {
    /// Which steps of the plan are taken.
    pub switches: Switches,
    /// Measure GPU times and counts of every pass, and the CPU time of its recording. Without this, non-finite values are not
    /// counted, so kept images that met one are not redrawn.
    pub measure: bool,
    /// Count shader invocations of every pass, where the device can and `measure` is on. This costs time.
    pub statistics: bool,
    /// Write breadcrumbs on every device, so that [`ExecuteError::Lost`] names passes. With VK_AMD_buffer_marker they cost nothing and are
    /// always on while measuring. Otherwise passes run one after another, which may hide a missing barrier between them.
    pub breadcrumbs: bool,
    /// Least number of passes per thread for recording on several threads; `None` records on one thread.
    pub passes_per_thread: Option<usize>,
}

impl Default for ExecuteOptions {
    fn default() -> Self {
        Self {
            switches: Switches::default(),
            measure: true,
            statistics: false,
            breadcrumbs: false,
            passes_per_thread: Some(512),
        }
    }
}

/// The result of a frame that ran.
pub struct Executed {
    /// The declaration of the frame.
    pub declaration: Arc<Declaration>,
    /// The plan that ran.
    pub plan: Arc<Plan>,
    /// Times and counts. The time to declare the frame is not in them, since the caller declares it.
    pub sample: FrameSample,
    /// How far each queue came; empty without breadcrumbs.
    pub progress: Vec<QueueProgress>,
}

/// Runs frames, which the device executes one after another.
///
/// [`Executor::run`] returns once the device has finished. Between [`Executor::submit`] and [`Executor::finish`] the caller may declare and
/// submit further frames while the device works. Each ends with a barrier before all that comes after it on the device, so transients and
/// histories exist once, however many frames are in flight. What the host writes or reads exists once for each of them.
pub struct Executor {
    gpu: Gpu,
    options: ExecuteOptions,
    /// The histories and kept buffers; the frame that is being declared shares them.
    histories: Arc<SharedHistoryRegistry>,
    persistent: persistent::PersistentResources,
    cache: cache::Cache,
    pool: bind::Pool,
    commands: commands::Commands,
    /// Those that no frame in flight uses.
    instruments: Vec<Instruments>,
    /// From when times are counted.
    begun: Instant,
    /// For tests: the pass in which the next frame stops.
    stop: Option<String>,
    /// Lists of the last frame, reused by the next.
    spare: Option<(Declaration, Vec<Option<RecordFn>>)>,
}

impl Executor {
    /// An executor with default options.
    ///
    /// # Errors
    /// Creating its query pools or buffers failed.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, ExecuteOptions::default())
    }

    /// An executor with the given options.
    ///
    /// # Errors
    /// Creating its query pools or buffers failed.
    pub fn with(gpu: &Gpu, options: ExecuteOptions) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: gpu.clone(),
            options,
            histories: Arc::default(),
            persistent: persistent::PersistentResources::default(),
            cache: cache::Cache::default(),
            pool: bind::Pool::new(gpu),
            commands: commands::Commands::new(gpu),
            instruments: vec![Instruments::new(gpu)?],
            begun: Instant::now(),
            stop: None,
            spare: None,
        })
    }

    /// The current options.
    pub fn options(&self) -> ExecuteOptions {
        self.options
    }

    /// Sets the options of the next frames.
    pub fn set_options(&mut self, options: ExecuteOptions) {
        self.options = options;
    }

    /// Begins the declaration of a frame of `full` pixels. Its histories continue from the last frame that ran.
    pub fn begin(&mut self, full: Extent) -> FrameGraph {
        let (mut declaration, records) = self.spare.take().unwrap_or_else(|| (Declaration::new(full), Vec::new()));
        declaration.clear(full);
        FrameGraph::on(declaration, records, self.histories.clone())
    }

    /// Declares a camera cut: the next frame does not use what histories hold. Call it before that frame is declared.
    pub fn cut(&mut self) {
        self.histories.lock().cut();
    }

    /// Discards all histories, kept buffers and kept images.
    pub fn restart(&mut self) {
        self.histories.lock().clear();
    }

    /// For tests: the next frame behaves as if the device were lost in this pass.
    #[doc(hidden)]
    pub fn lose_device_in(&mut self, pass: &str) {
        self.stop = Some(pass.to_owned());
    }

    fn writes_breadcrumbs(&self) -> bool {
        let Self { options, gpu, .. } = self;
        options.breadcrumbs || (options.measure && gpu.has_markers())
    }

    /// Plans and runs a frame, and waits for it.
    ///
    /// # Errors
    /// Mistakes in the declaration, out of memory, and device loss, with the pass or resource.
    pub fn run(&mut self, graph: FrameGraph, imports: &Imports) -> Result<Executed, ExecuteError> {
        let frame = self.submit(graph, imports)?;
        let mut ran = self.finish(frame)?;
        ran.sample.wait_start_ns = None;
        Ok(ran)
    }

    /// Plans, records and submits a frame, and returns while the device works on it. It keeps the imports until it is done.
    ///
    /// # Errors
    /// As of [`Self::run`].
    pub fn submit(&mut self, graph: FrameGraph, imports: &Imports) -> Result<InFlight, ExecuteError> {
        let submitted = self.try_submit(graph, imports);
        if submitted.is_err() {
            // The frame may have failed at any point, so the contents of the histories are unknown.
            self.histories.lock().cut();
        }
        submitted
    }

    /// Waits for a frame and returns what was measured. Frames may be finished in any order, but not between [`Self::begin`] and [`Self::submit`] of
    /// another; the device executes them in the order of submission.
    ///
    /// # Errors
    /// Device loss, with the pass where that is known.
    pub fn finish(&mut self, frame: InFlight) -> Result<Executed, ExecuteError> {
        let finished = self.try_finish(frame);
        if finished.is_err() {
            // All that frames since then have kept may come from it.
            self.histories.lock().clear();
        }
        finished
    }

    fn try_submit(&mut self, mut graph: FrameGraph, imports: &Imports) -> Result<InFlight, ExecuteError> {
        let start = Instant::now();
        // Frames for uploads and tests are declared without this executor. They have no histories and leave those of this executor alone.
        let own = Arc::ptr_eq(&graph.histories, &self.histories);
        assert!(
            own || !graph.has_history(),
            "a frame with histories must come from `begin` of the executor that runs it"
        );
        let poisons = std::mem::take(&mut graph.poisons);
        let device = bind::Device::new(&self.gpu, &mut self.pool);
        let (mut entry, mut records, spare) = self.cache.plan(graph, self.options.switches, device)?;
        let plan_ns = nanoseconds(start);

        // Bind every resource.
        let (declaration, plan) = (entry.declaration.clone(), entry.plan.clone());
        if own {
            self.persistent.prepare(&self.gpu, &self.histories)?;
        }
        self.pool.bind(&self.gpu, &mut entry, imports, &self.persistent)?;
        let mut instruments = self.instruments.pop().map_or_else(|| Instruments::new(&self.gpu), Ok)?;
        let passes = plan.order.len() as u32;
        instruments.clock.prepare(passes, self.options.measure && self.options.statistics)?;
        let writes_breadcrumbs = self.writes_breadcrumbs();
        if writes_breadcrumbs {
            instruments.breadcrumbs.prepare(passes)?;
        }
        let stop = self.stop.take().and_then(|name| plan.order.iter().position(|&p| declaration.pass_name(p) == name));
        let bind_ns = nanoseconds(start) - plan_ns;

        let poison_writes = poison::PoisonWrite::all(&self.gpu, &poisons, &declaration, &plan)?;

        // Record the batches and submit them.
        let record_start = Instant::now();
        let submitted = self.commands.submit(
            commands::Frame {
                gpu: &self.gpu,
                declaration: &declaration,
                plan: &plan,
                bound: entry.bound()?,
                counters: &instruments.clock,
                poison_writes: &poison_writes,
                breadcrumbs: writes_breadcrumbs.then_some(&instruments.breadcrumbs),
                stop,
                begun: start,
                waits: &imports.waits,
            },
            &mut records,
            self.options.measure.then_some(&instruments.clock),
            self.options.passes_per_thread,
        );
        let recorded_ns = nanoseconds(record_start);
        let progress = || instruments.progress(writes_breadcrumbs, &declaration, &plan);
        let commands::Submitted { last, passes, barriers, submit_ns, held } =
            submitted.map_err(|error| lost(error, progress))?;

        // Prepare the state for the next frame.
        if stop.is_some() {
            self.histories.lock().cut();
        } else if own {
            self.persistent.end_frame(&self.histories, &declaration, &plan);
        }
        let memory = Memory {
            transient_bytes: self.pool.bytes(),
            transient_lower_bound: plan.memory.lower_bound,
            transient_unaliased: plan.memory.unaliased,
            history_bytes: self.persistent.bytes(),
            ..Default::default()
        };
        self.pool.end_frame();
        self.cache.put_back(entry, self.options.switches, &self.pool);
        records.clear();
        self.spare = spare.map(|lists| (lists, records));
        let sample = FrameSample {
            start_ns: self.options.measure.then(|| (start - self.begun).as_nanos() as u64),
            plan_ns,
            bind_ns,
            record_ns: recorded_ns.saturating_sub(submit_ns),
            submit_ns,
            cpu_ns: nanoseconds(start),
            culled: plan.culled.len() as u32,
            barriers,
            queues: plan.queues.count() as u32,
            passes,
            memory,
            ..Default::default()
        };
        Ok(InFlight {
            end: End { gpu: self.gpu.clone(), last },
            declaration,
            plan,
            sample,
            instruments,
            held,
            _imports: imports.clone(),
            own,
            measured: self.options.measure,
            writes_breadcrumbs,
            stopped: stop.is_some(),
        })
    }

    fn try_finish(&mut self, frame: InFlight) -> Result<Executed, ExecuteError> {
        let start = Instant::now();
        let waited = frame.end.wait();
        let InFlight { declaration, plan, mut sample, instruments, held, own, measured, .. } = frame;
        self.commands.take_back(held);
        let progress = instruments.progress(frame.writes_breadcrumbs, &declaration, &plan);
        let stopped = || if frame.stopped { Err(GpuError::DeviceLost { during: "a stop for tests" }) } else { Ok(()) };
        let waited = waited.and_then(|()| stopped());
        if let Err(error) = waited {
            self.instruments.push(instruments);
            return Err(lost(error, || progress));
        }
        sample.wait_ns = nanoseconds(start);
        if measured {
            sample.wait_start_ns = Some((start - self.begun).as_nanos() as u64);
            instruments.clock.read(self.begun, &plan, &mut sample)?;
        }
        self.instruments.push(instruments);
        if own {
            persistent::PersistentResources::invalidate_non_finite(&self.histories, &declaration, &sample.passes);
        }
        sample.cpu_ns += nanoseconds(start);
        Ok(Executed { declaration, plan, sample, progress })
    }
}

/// The error of a frame, with how far it came if the device was lost.
fn lost(error: GpuError, progress: impl FnOnce() -> Vec<QueueProgress>) -> ExecuteError {
    match error {
        GpuError::DeviceLost { during } => ExecuteError::Lost { during, progress: progress() },
        other => other.into(),
    }
}

fn nanoseconds(since: Instant) -> u64 {
    since.elapsed().as_nanos() as u64
}
