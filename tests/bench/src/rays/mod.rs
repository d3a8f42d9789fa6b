//! `magpie bench rays`: how fast rays are traced in every way that the device has, and what its acceleration structures cost.
//!
//! [`run`] measures the scenes that it is given and three set-ups of its own, and makes a [`RayReport`]. `docs/bench.md` says what is
//! measured and how. The parts are of use to tests as well: a [`Tracer`] traces a [`RayTable`] through a scene or a [`World`].

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

pub use agreement::{SAME_DISTANCE, agreement_of_any, agreement_of_closest};
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

/// Most rays of a dispatch.
pub const MAX_RAYS: u32 = 1 << 25;
/// Least rays of a dispatch.
pub const MIN_RAYS: u32 = 1 << 10;

/// Time that one way may take for the measured dispatches of one table, nanoseconds; it has two in any case.
const BUDGET_NS: u64 = 2_000_000_000;

/// Why a benchmark of rays did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum RayBenchError {
    /// No device, or it failed, or it cannot trace so.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A frame did not run.
    #[error(transparent)]
    Graph(#[from] ExecuteError),
    /// A tree could not be built.
    #[error(transparent)]
    Tree(#[from] RayError),
    /// A scene could not be brought to the device.
    #[error("{scene}: {source}")]
    Scene {
        /// Its name.
        scene: String,
        /// Why.
        source: ResidentError,
    },
    /// The device takes no times.
    #[error("{pass}: the device has no timestamps, so nothing can be measured")]
    Untimed {
        /// The pass that was to be timed.
        pass: &'static str,
    },
    /// A table was asked what it does not answer.
    #[error("a table of {got:?} rays was asked for {wanted:?} hits")]
    Question {
        /// What was asked.
        wanted: Question,
        /// What the table is made for.
        got: Question,
    },
    /// A tracer was made for other ways.
    #[error("the tracer was not made for {rays}")]
    Way {
        /// The way that was asked for.
        rays: &'static str,
    },
    /// Instances came or went.
    #[error("a world of {wanted} instances was given {got}")]
    Count {
        /// How many there are.
        wanted: usize,
        /// How many were given.
        got: usize,
    },
    /// Rays that were to miss everything did not.
    #[error("{case}: {hits} of the rays that were to miss everything met something by {rays}")]
    Met {
        /// What was traced.
        case: String,
        /// In which way.
        rays: &'static str,
        /// How many.
        hits: usize,
    },
}

/// What is measured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RayOptions {
    /// Ways to trace; the device must have them.
    pub ways: Vec<Rays>,
    /// Rays of a dispatch, from [`MIN_RAYS`] to [`MAX_RAYS`]; `None` for a number that suits the device.
    pub size: Option<u32>,
    /// Small sizes, few repeats.
    pub quick: bool,
    /// Commit that the program was built from, for the report.
    pub commit: String,
}

/// How often, and how much.
#[derive(Clone, Copy, Debug)]
struct Effort {
    size: u32,
    /// Rays of a dispatch on the set-ups.
    setup_size: u32,
    /// Measured dispatches of each target on scenes.
    repeats: u32,
    /// On the set-ups, of which there are many.
    setup_repeats: u32,
    /// Dispatches before them.
    warm_up: u32,
    /// Builds.
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
        // A processor would take an hour for what is a minute of a GPU's time.
        let setup_size = if slow && !quick { (size / 8).max(MIN_RAYS) } else { size };
        Self { size, setup_size, repeats, setup_repeats, warm_up, builds, quick }
    }
}

/// One way to trace one target; what it is called beside the kind of ray.
#[derive(Clone, Copy)]
struct Contender<'a> {
    rays: Rays,
    target: Target<'a>,
    /// As in ", not compacted"; empty for what the engine does by itself.
    note: &'static str,
}

/// A run.
struct Run<'a> {
    tracer: Tracer,
    report: RayReport,
    effort: Effort,
    progress: &'a mut dyn FnMut(&str),
}

impl Run<'_> {
    /// Rates of all contenders, which take turns. With `check`, also whether they met the same as the first of them.
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
                    // Whoever is slow has fewer turns.
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

    /// Whether all contenders meet the same as the first.
    fn check(&mut self, case: &Case, contenders: &[Contender<'_>], table: &DeviceTable) -> Result<(), RayBenchError> {
        let name = |c: &Contender<'_>| format!("{}{}", c.rays, c.note);
        let Some((first, others)) = contenders.split_first() else { return Ok(()) };
        if table.question() == Question::Any {
            let wanted = self.tracer.any(first.rays, first.target, table)?;
            for other in others {
                let got = self.tracer.any(other.rays, other.target, table)?;
                self.report.agreement.push(agreement_of_any(case, (name(first), &wanted), (name(other), &got)));
            }
        } else {
            let wanted = self.tracer.closest(first.rays, first.target, table)?;
            for other in others {
                let got = self.tracer.closest(other.rays, other.target, table)?;
                self.report.agreement.push(agreement_of_closest(case, (name(first), &wanted), (name(other), &got)));
            }
        }
        Ok(())
    }
}

/// Measures the scenes, then the three set-ups.
///
/// `progress` is told what comes next.
///
/// # Errors
/// [`RayBenchError`]: a device that failed or has no timestamps, or a scene that it cannot hold.
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
