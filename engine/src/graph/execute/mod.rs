//! Runs a planned frame: the only part of the graph that touches the device, and the only place that issues barriers.
//!
//! | file | does |
//! |---|---|
//! | `mod` | one frame from its declaration to its end |
//! | `cache` | plans of declarations seen before |
//! | `bind` | objects behind the resources of a plan, and its barriers in the device's words |
//! | `keep` | what outlives the frame: histories and kept buffers |
//! | `commands` | command buffers, on several threads where that pays, and their submission |
//! | `spoil` | spoils outputs on purpose, for tests |
//! | `time` | GPU times, ray counts |

mod bind;
mod cache;
mod commands;
mod keep;
mod spoil;
mod time;

use std::{sync::Arc, time::Instant};

use super::{
    check::PoisonError,
    declaration::{Declaration, ImportKey},
    error::GraphErrors,
    history::Book,
    pass::{FrameGraph, RecordFn},
    plan::Plan,
    record::{BufferRange, Physical},
    switches::Switches,
    Extent,
};
use crate::{
    gpu::{self, Gpu, GpuError},
    measure::{FrameSample, Memory},
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
    /// What a test wants to spoil cannot be spoilt.
    #[error(transparent)]
    Poison(#[from] PoisonError),
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
    /// Take GPU times and ray counts of every pass, and CPU times of its recording.
    pub measure: bool,
    /// Passes per thread from which on recording goes to several threads; `None` for never.
    pub passes_per_thread: Option<usize>,
}

impl Default for ExecuteOptions {
    fn default() -> Self {
        Self { switches: Switches::default(), measure: true, passes_per_thread: Some(512) }
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
        let (mut declaration, records) =
            self.spare.take().unwrap_or_else(|| (Declaration::new(full), Vec::new()));
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
        assert!(own || !graph.has_history(), "a frame with histories must come from `begin` of the executor that runs it");
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

        let spoils = spoil::Spoil::all(&self.gpu, &poisons, &declaration, &plan)?;

        // Record batch by batch, hand over, wait.
        let record_start = Instant::now();
        self.clock.prepare(plan.order.len() as u32)?;
        let mut ran = self.commands.run(
            commands::Frame {
                gpu: &self.gpu,
                declaration: &declaration,
                plan: &plan,
                bound: entry.bound()?,
                counters: &self.clock,
                spoils: &spoils,
                begun: start,
            },
            &mut records,
            self.options.measure.then_some(&self.clock),
            self.options.passes_per_thread,
        )?;
        let record_ns = nanoseconds(record_start) - ran.submit_ns;
        self.gpu.wait(ran.last)?;

        // Times, and what the next frame begins with.
        let mut sample = FrameSample {
            plan_ns,
            record_ns,
            submit_ns: ran.submit_ns,
            culled: plan.culled.len() as u32,
            barriers: ran.barriers,
            queues: plan.queues.count() as u32,
            ..Default::default()
        };
        if self.options.measure {
            self.clock.read(start, &mut ran.passes, &mut sample)?;
            sample.passes = ran.passes;
        }
        if own {
            self.kept.end(&self.book, &declaration, &plan);
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
