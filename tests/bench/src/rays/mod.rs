//! `magpie bench rays`: rays per second with every backend of the device, and the cost of acceleration structures.
//!
//! [`run`] measures the given scenes and three set-ups of its own, and makes a [`RayReport`]. `docs/bench.md` describes the method. Tests
//! use the parts too: a [`Tracer`] traces a [`RayTable`] through a scene or a [`World`].

mod agreement;
mod charts;
mod driver_tree;
mod make;
mod report;
mod scenes;
mod setups;
mod shapes;
mod software_tree;
mod trace;
mod world;

pub use agreement::{BackendAnswers, SAME_DISTANCE, agreement_of_any, agreement_of_closest};
pub use charts::charts;
pub use make::{Random, Surfaces, bounds, extent_of, primary, random, rotation};
pub use report::{Agreement, Case, DeviceLine, Quantity, Ratio, RayReport, Row};
pub use shapes::{rough_sphere, rounded_cube, sphere};
pub use trace::{DeviceTable, Question, RayTable, Target, Tracer};
pub use world::{Change, Placed, Shape, World, WorldOptions, WorldReport};

use driver_tree::DriverTree;
use magpie::gpu::{Gpu, GpuError};
use magpie::graph::execute::ExecuteError;
use magpie::ray::RayError;
use magpie::scene::{ResidentError, Scene};
use magpie_shaders::Rays;
use software_tree::SoftwareTree;
use world::WorldHandles;

/// Most rays per dispatch.
pub const MAX_RAYS: u32 = 1 << 25;
/// Fewest rays per dispatch.
pub const MIN_RAYS: u32 = 1 << 10;

/// Time limit of a backend for the measured dispatches of one table, nanoseconds; at least two are run.
const BUDGET_NS: u64 = 2_000_000_000;

/// Why a benchmark of rays could not be completed.
#[derive(Debug, thiserror::Error)]
pub enum RayBenchError {
    /// There is no usable device, it failed, or it lacks the backend.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A frame failed.
    #[error(transparent)]
    Graph(#[from] ExecuteError),
    /// A BVH could not be built.
    #[error(transparent)]
    Tree(#[from] RayError),
    /// A scene could not be uploaded.
    #[error("{scene}: {source}")]
    Scene {
        /// Name of the scene.
        scene: String,
        /// Its error.
        source: ResidentError,
    },
    /// The device has no timestamps.
    #[error("{pass}: the device has no timestamps, so nothing can be measured")]
    Untimed {
        /// Name of the pass.
        pass: &'static str,
    },
    /// A table was traced for another kind of query than its own.
    #[error("a table of {got:?} rays was asked for {wanted:?} hits")]
    Question {
        /// The query that was requested.
        wanted: Question,
        /// The query of the table.
        got: Question,
    },
    /// A tracer has no pipelines for a backend.
    #[error("the tracer was not made for {rays}")]
    Way {
        /// Name of the backend.
        rays: &'static str,
    },
    /// The number of instances changed, which is not supported.
    #[error("a world of {wanted} instances was given {got}")]
    Count {
        /// Number of instances of the world.
        wanted: usize,
        /// Number of instances given.
        got: usize,
    },
    /// Rays that should miss everything hit something.
    #[error("{case}: {hits} of the rays that were to miss everything met something by {rays}")]
    Met {
        /// The measured case.
        case: String,
        /// Name of the backend.
        rays: &'static str,
        /// Number of hits.
        hits: usize,
    },
}

/// Options of `magpie bench rays`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RayOptions {
    /// Backends to measure; the device must have them.
    pub ways: Vec<Rays>,
    /// Rays per dispatch, from [`MIN_RAYS`] to [`MAX_RAYS`]; `None` for a number that suits the device.
    pub size: Option<u32>,
    /// Use small sizes and few repeats.
    pub quick: bool,
    /// Commit of the build, for the report.
    pub commit: String,
}

/// Sizes and repeats.
#[derive(Clone, Copy, Debug)]
struct Effort {
    size: u32,
    /// Rays per dispatch of the set-ups.
    setup_size: u32,
    /// Measured dispatches per target of scenes.
    repeats: u32,
    /// The same for set-ups, of which there are many.
    setup_repeats: u32,
    /// Unmeasured dispatches before them.
    warm_up: u32,
    /// Measured builds.
    builds: u32,
    quick: bool,
}

impl Effort {
    fn new(kind: &str, options: &RayOptions) -> Self {
        let slow = kind == "cpu";
        let quick = options.quick;
        let size = match (slow, quick) {
            (true, true) => 1 << 13,
            (true, false) => 1 << 18,
            (false, true) => 1 << 20,
            (false, false) => 8_000_000,
        };
        let size = options.size.unwrap_or(size).clamp(MIN_RAYS, MAX_RAYS);
        let (repeats, setup_repeats, warm_up, builds) = match (slow, quick) {
            (true, true) => (3, 2, 1, 2),
            (true, false) => (7, 3, 1, 5),
            (false, true) => (5, 5, 3, 3),
            (false, false) => (40, 40, 20, 20),
        };
        // A CPU device would take an hour for a GPU's minute.
        let setup_size = if slow && !quick { (size / 8).max(MIN_RAYS) } else { size };
        Self { size, setup_size, repeats, setup_repeats, warm_up, builds, quick }
    }
}

/// A backend with a target, and its label.
#[derive(Clone, Copy)]
struct Contender<'a> {
    rays: Rays,
    target: Target<'a>,
    /// Suffix of the label, such as ", not compacted"; empty for the engine's default.
    note: &'static str,
}

/// A run in progress.
struct Run<'a> {
    tracer: Tracer,
    report: RayReport,
    effort: Effort,
    progress: &'a mut dyn FnMut(&str),
}

impl Run<'_> {
    /// Measures the rates of all contenders in turn. With `check` also compares their hits with the first one's.
    fn race(
        &mut self,
        case: &Case,
        contenders: &[Contender<'_>],
        table: &RayTable,
        repeats: u32,
    ) -> Result<(), RayBenchError> {
        if table.rays.is_empty() {
            self.report.left_out.push(format!("{} {}: no rays", case.subject, case.variant));
            return Ok(());
        }
        let table = self.tracer.upload(table)?;
        let count = table.count();
        let mut rates: Vec<Vec<f64>> = vec![Vec::new(); contenders.len()];
        let mut left = vec![repeats; contenders.len()];
        for turn in 0..self.effort.warm_up + repeats {
            for ((contender, rates), left) in contenders.iter().zip(&mut rates).zip(&mut left) {
                if turn >= self.effort.warm_up {
                    if *left == 0 {
                        continue;
                    }
                    *left -= 1;
                }
                let taken = self.tracer.time(contender.rays, contender.target, &table)?;
                if turn >= self.effort.warm_up {
                    rates.push(count as f64 * 1e3 / taken.max(1) as f64);
                } else {
                    // Slow contenders get fewer dispatches.
                    *left = ((BUDGET_NS / taken.max(1)) as u32).clamp(2, repeats);
                }
            }
        }
        for (contender, rates) in contenders.iter().zip(rates) {
            let case = Case { variant: format!("{}{}", case.variant, contender.note), ..case.clone() };
            self.report.add(&case, contender.rays.name(), Quantity::Rate, rates, count);
        }
        self.check(case, contenders, &table)
    }

    /// Compares the hits of all contenders with the first one's.
    fn check(&mut self, case: &Case, contenders: &[Contender<'_>], table: &DeviceTable) -> Result<(), RayBenchError> {
        let name = |c: &Contender<'_>| format!("{}{}", c.rays, c.note);
        let Some((first, others)) = contenders.split_first() else { return Ok(()) };
        if table.question() == Question::Any {
            let wanted = self.tracer.any(first.rays, first.target, table)?;
            for other in others {
                let got = self.tracer.any(other.rays, other.target, table)?;
                let (wanted, got) = (BackendAnswers::new(name(first), &wanted), BackendAnswers::new(name(other), &got));
                self.report.agreement.push(agreement_of_any(case, wanted, got));
            }
        } else {
            let wanted = self.tracer.closest(first.rays, first.target, table)?;
            for other in others {
                let got = self.tracer.closest(other.rays, other.target, table)?;
                let (wanted, got) = (BackendAnswers::new(name(first), &wanted), BackendAnswers::new(name(other), &got));
                self.report.agreement.push(agreement_of_closest(case, wanted, got));
            }
        }
        Ok(())
    }
}

/// Measures the scenes, then the three set-ups.
///
/// `progress` is called with a description of each step.
///
/// # Errors
/// [`RayBenchError`]: a device that failed or has no timestamps, or a scene that does not fit.
pub fn run(
    gpu: &Gpu,
    scenes: &[Scene],
    options: &RayOptions,
    mut progress: impl FnMut(&str),
) -> Result<RayReport, RayBenchError> {
    let effort = Effort::new(gpu.report().kind, options);
    let tracer = Tracer::new(gpu, &options.ways)?;
    let report = RayReport::new(gpu.report(), &options.commit, options.quick, effort.size, &options.ways);
    let mut run = Run { tracer, report, effort, progress: &mut progress };
    for scene in scenes {
        run.scene(scene)?;
    }
    run.triangles()?;
    run.instances()?;
    run.moving()?;
    run.report.compare();
    Ok(run.report)
}
