//! Runs a planned frame: the only part of the graph that touches the device, and the only place that issues barriers.
//!
//! | file | does |
//! |---|---|
//! | `mod` | one frame from its declaration to its end |
//! | `cache` | plans of declarations seen before |
//! | `bind` | objects behind the resources of a plan, and its barriers in the device's words |
//! | `keep` | what outlives the frame: histories and kept buffers |
//! | `commands` | command buffers, on several threads where that pays, and their submission |
//! | `time` | GPU times, counts of rays, of values that are not finite, and of invocations |
//! | `spoil` | spoils outputs on purpose, for tests |
//! | `crumbs` | how far a lost device came |

mod bind;
mod cache;
mod commands;
mod crumbs;
mod keep;
mod spoil;
mod time;

use magpie_shaders::Address;
use std::{sync::Arc, time::Instant};

use super::{
    Extent,
    check::PoisonError,
    declaration::{Declaration, ImportKey},
    error::GraphErrors,
    history::Book,
    pass::{FrameGraph, RecordFn},
    plan::Plan,
    record::{AccelObject, BufferRange, Physical},
    switches::Switches,
};
use crate::{
    gpu::{self, Gpu, GpuError},
    measure::{FrameSample, Memory},
};

pub use crumbs::Trail;

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
    /// What a test wants to spoil cannot be spoilt.
    #[error(transparent)]
    Poison(#[from] PoisonError),
    /// The device stopped answering while it ran the frame.
    #[error("the device was lost during {during}; {}", crumbs::describe(.trails))]
    Lost {
        /// The call that reported it.
        during: &'static str,
        /// How far each queue of the frame came; empty where no breadcrumbs were laid.
        trails: Vec<Trail>,
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

    /// Adds an acceleration structure of the driver's; the key is for [`FrameGraph::import_accel`] or
    /// [`FrameGraph::import_tlas`]. `root`: the scene's tables, which shaders know a top level by; of a bottom level none.
    pub fn accel(&mut self, accel: &Arc<gpu::Accel>, root: Address) -> ImportKey {
        let (buffer, offset) = accel.place();
        let memory = BufferRange { buffer: buffer.clone(), offset, bytes: accel.bytes() };
        self.add(Physical::Accel(AccelObject { memory, driver: Some(accel.clone()), root }))
    }

    /// Adds a tree that Magpie's own walk reads, in a buffer; the key is as for [`Imports::accel`].
    pub fn tree(&mut self, buffer: &Arc<gpu::Buffer>, root: Address) -> ImportKey {
        self.add(Physical::Accel(AccelObject { memory: BufferRange::whole(buffer.clone()), driver: None, root }))
    }

    /// Adds a buffer; the key is for [`FrameGraph::import_buffer`].
    pub fn buffer(&mut self, buffer: &Arc<gpu::Buffer>) -> ImportKey {
        self.add(Physical::Buffer(BufferRange::whole(buffer.clone())))
    }

    /// Whether it is an image that was made to be sampled.
    pub fn is_sampled(&self, key: ImportKey) -> bool {
        let ImportKey::Caller(at) = key else { return false };
        matches!(self.0.get(at as usize), Some(Physical::Image(image)) if image.sampled().is_some())
    }

    /// Forgets all, but keeps the memory of the list.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    fn add(&mut self, object: Physical) -> ImportKey {
        self.0.push(object);
        ImportKey::Caller(self.0.len() as u32 - 1)
    }
}

/// How frames are run.
#[derive(Clone, Copy, Debug)]
pub struct ExecuteOptions {
    /// Steps of the graph that are taken.
    pub switches: Switches,
    /// Take GPU times and counts of every pass, and CPU times of its recording. Without it nobody learns of values that are not
    /// finite, so that what is kept for long is not made anew after one.
    pub measure: bool,
    /// Count what the shaders of every pass did, where the device can; only while measuring. It costs time.
    pub statistics: bool,
    /// Lay breadcrumbs on every device, so that [`ExecuteError::Lost`] names passes. Where the device has VK_AMD_buffer_marker that
    /// costs nothing and is always done while measuring; elsewhere passes run one after another, and a missing barrier between
    /// them may go unseen.
    pub breadcrumbs: bool,
    /// Passes per thread from which on recording goes to several threads; `None` for never.
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

/// A frame that ran.
pub struct Executed {
    /// What was declared.
    pub declaration: Arc<Declaration>,
    /// How it ran.
    pub plan: Arc<Plan>,
    /// Times and counts. Declaring is the caller's to time.
    pub sample: FrameSample,
}

/// Runs frames one after another.
///
/// A call returns once the device is done, so that its times are those of this very frame and nothing is in flight when
/// resources change.
pub struct Executor {
    gpu: Gpu,
    options: ExecuteOptions,
    /// What outlives frames, by name; the frame that is declared shares it.
    book: Arc<Book>,
    kept: keep::Kept,
    cache: cache::Cache,
    pool: bind::Pool,
    commands: commands::Commands,
    clock: time::Clock,
    crumbs: crumbs::Crumbs,
    /// The pass in which the next frame stops, for tests.
    stop: Option<String>,
    /// Lists of the last frame, for the next.
    spare: Option<(Declaration, Vec<Option<RecordFn>>)>,
}

impl Executor {
    /// An executor without any memory yet.
    ///
    /// # Errors
    /// Failing calls.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, ExecuteOptions::default())
    }

    /// An executor that runs frames in some way.
    ///
    /// # Errors
    /// Failing calls.
    pub fn with(gpu: &Gpu, options: ExecuteOptions) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: gpu.clone(),
            options,
            book: Arc::default(),
            kept: keep::Kept::default(),
            cache: cache::Cache::default(),
            pool: bind::Pool::new(gpu),
            commands: commands::Commands::new(gpu),
            clock: time::Clock::new(gpu)?,
            crumbs: crumbs::Crumbs::new(gpu),
            stop: None,
            spare: None,
        })
    }

    /// How frames are run.
    pub fn options(&self) -> ExecuteOptions {
        self.options
    }

    /// Changes how frames are run, from the next on.
    pub fn set_options(&mut self, options: ExecuteOptions) {
        self.options = options;
    }

    /// A frame of so many pixels, to be declared. Histories go on from the frame that ran last.
    pub fn begin(&mut self, full: Extent) -> FrameGraph {
        let (mut declaration, records) = self.spare.take().unwrap_or_else(|| (Declaration::new(full), Vec::new()));
        declaration.clear(full);
        FrameGraph::on(declaration, records, self.book.clone())
    }

    /// The camera jumped: what histories hold is of no use to the next frame. Call it before that frame is declared.
    pub fn cut(&mut self) {
        self.book.open().cut();
    }

    /// Forgets everything that outlives frames.
    pub fn restart(&mut self) {
        self.book.open().clear();
    }

    /// For tests: the next frame goes as if the device were lost in this pass.
    #[doc(hidden)]
    pub fn lose_device_in(&mut self, pass: &str) {
        self.stop = Some(pass.to_owned());
    }

    /// How far each queue came in the frame that ran last; empty where no breadcrumbs were laid.
    pub fn trails(&self, ran: &Executed) -> Vec<Trail> {
        self.trails_of(&ran.declaration, &ran.plan)
    }

    fn trails_of(&self, declaration: &Declaration, plan: &Plan) -> Vec<Trail> {
        if self.lays_crumbs() { self.crumbs.trails(declaration, plan) } else { Vec::new() }
    }

    fn lays_crumbs(&self) -> bool {
        let Self { options, gpu, .. } = self;
        options.breadcrumbs || (options.measure && gpu.has_markers())
    }

    /// Plans and runs a frame, and waits for it.
    ///
    /// # Errors
    /// Mistakes in the declaration, exhausted memory and a lost device, with the pass or resource.
    pub fn run(&mut self, graph: FrameGraph, imports: &Imports) -> Result<Executed, ExecuteError> {
        let ran = self.try_run(graph, imports);
        if ran.is_err() {
            // What histories hold now is unknown: the frame may have ended anywhere.
            self.book.open().cut();
        }
        ran
    }

    fn try_run(&mut self, mut graph: FrameGraph, imports: &Imports) -> Result<Executed, ExecuteError> {
        let start = Instant::now();
        // Uploads and tests bring frames of their own, without any history; those of this executor stay as they are.
        let own = Arc::ptr_eq(&graph.book, &self.book);
        assert!(
            own || !graph.has_history(),
            "a frame with histories must come from `begin` of the executor that runs it"
        );
        let poisons = std::mem::take(&mut graph.poisons);
        let device = bind::Device::new(&self.gpu, &mut self.pool);
        let (mut entry, mut records, spare) = self.cache.plan(graph, self.options.switches, device)?;
        let plan_ns = nanoseconds(start);

        // Objects for every resource.
        let (declaration, plan) = (entry.declaration.clone(), entry.plan.clone());
        if own {
            self.kept.prepare(&self.gpu, &self.book)?;
        }
        self.pool.bind(&self.gpu, &mut entry, imports, &self.kept)?;
        let passes = plan.order.len() as u32;
        self.clock.prepare(passes, self.options.measure && self.options.statistics)?;
        let lays_crumbs = self.lays_crumbs();
        if lays_crumbs {
            self.crumbs.prepare(passes)?;
        }
        let stop = self.stop.take().and_then(|name| plan.order.iter().position(|&p| declaration.pass_name(p) == name));
        let bind_ns = nanoseconds(start) - plan_ns;

        let spoils = spoil::Spoil::all(&self.gpu, &poisons, &declaration, &plan)?;

        // Record batch by batch, hand over, wait.
        let record_start = Instant::now();
        let ran = self.commands.run(
            commands::Frame {
                gpu: &self.gpu,
                declaration: &declaration,
                plan: &plan,
                bound: entry.bound()?,
                counters: &self.clock,
                spoils: &spoils,
                crumbs: lays_crumbs.then_some(&self.crumbs),
                stop,
                begun: start,
            },
            &mut records,
            self.options.measure.then_some(&self.clock),
            self.options.passes_per_thread,
        );
        let recorded_ns = nanoseconds(record_start);
        let waited = ran.and_then(|ran| self.gpu.wait(ran.last).map(|()| ran)).and_then(|ran| match stop {
            Some(_) => Err(GpuError::DeviceLost { during: "a stop for tests" }),
            None => Ok(ran),
        });
        let mut ran = waited.map_err(|error| match error {
            GpuError::DeviceLost { during } => {
                ExecuteError::Lost { during, trails: self.trails_of(&declaration, &plan) }
            }
            other => other.into(),
        })?;
        let record_ns = recorded_ns.saturating_sub(ran.submit_ns);
        let wait_ns = nanoseconds(record_start) - recorded_ns;

        // Times, and what the next frame begins with.
        let mut sample = FrameSample {
            plan_ns,
            bind_ns,
            record_ns,
            submit_ns: ran.submit_ns,
            wait_ns,
            culled: plan.culled.len() as u32,
            barriers: ran.barriers,
            queues: plan.queues.count() as u32,
            ..Default::default()
        };
        if self.options.measure {
            self.clock.read(start, &plan, &mut ran.passes, &mut sample)?;
            sample.passes = ran.passes;
        }
        if own {
            self.kept.end(&self.book, &declaration, &plan);
            self.kept.distrust(&self.book, &declaration, &plan, &sample.passes);
        }
        sample.memory = Memory {
            transient_bytes: self.pool.bytes(),
            transient_lower_bound: plan.memory.lower_bound,
            transient_unaliased: plan.memory.unaliased,
            history_bytes: self.kept.bytes(),
            ..Default::default()
        };
        self.pool.end_frame();
        self.cache.put_back(entry, self.options.switches, &self.pool);
        records.clear();
        self.spare = spare.map(|lists| (lists, records));
        sample.cpu_ns = nanoseconds(start);
        Ok(Executed { declaration, plan, sample })
    }
}

fn nanoseconds(since: Instant) -> u64 {
    since.elapsed().as_nanos() as u64
}
