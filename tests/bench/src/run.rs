//! Runs the contestants in turn.

use crate::contestant::check;
use crate::report::{Entry, LeftOut, Report, Row};
use crate::{BenchError, Clock, Contestant, Floor, Magpie, Variant, Work, allocations};
use magpie::gpu::Gpu;

/// Most passes in a frame.
pub const MAX_PASSES: u32 = 100_000;
/// Most measured frames per contestant and size.
pub const MAX_REPEAT: u32 = 100_000;
/// Numbers of passes of a quick run.
pub const QUICK_PASSES: [u32; 2] = [10, 100];

const PASSES: [u32; 4] = [10, 100, 1_000, 10_000];
/// Unmeasured frames, beside the first, which also allocates memory.
const WARM_UP: u32 = 3;
const QUICK_REPEAT: u32 = 5;
/// Total passes per size and contestant that the number of frames is derived from, and the limits of that number.
const PASSES_IN_ALL: u32 = 50_000;
const MIN_FRAMES: u32 = 15;
const MAX_FRAMES: u32 = 300;

/// Options of `magpie bench graph`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Numbers of passes, each from 1 to [`MAX_PASSES`].
    pub passes: Vec<u32>,
    /// Measured frames per contestant and size; `None` for a number that suits the size.
    pub repeat: Option<u32>,
}

impl Default for Options {
    fn default() -> Self {
        Self { passes: PASSES.to_vec(), repeat: None }
    }
}

impl Options {
    /// Options for a run of a few seconds.
    pub fn quick() -> Self {
        Self { passes: QUICK_PASSES.to_vec(), repeat: Some(QUICK_REPEAT) }
    }

    fn frames(&self, passes: u32) -> u32 {
        self.repeat.unwrap_or((PASSES_IN_ALL / passes.max(1)).clamp(MIN_FRAMES, MAX_FRAMES))
    }
}

/// All contestants of this build, on the device of `gpu`.
fn contestants(gpu: &Gpu) -> Result<Vec<Box<dyn Contestant>>, BenchError> {
    let name = &gpu.report().name;
    let mut all: Vec<Box<dyn Contestant>> =
        vec![Box::new(Floor::new(name)?), Box::new(Magpie::new(gpu, false)?), Box::new(Magpie::new(gpu, true)?)];
    #[cfg(feature = "peers")]
    for kept in [false, true] {
        all.push(Box::new(crate::VkGraph::new(name, kept)?));
        all.push(Box::new(crate::Taskgraph::new(name, kept)?));
    }
    all.shrink_to_fit();
    Ok(all)
}

/// Measures every contestant on both variants, and checks every frame's result.
///
/// `progress` is called with a description of each step.
///
/// # Errors
/// [`BenchError`]: a device that failed, or a wrong result.
pub fn run(gpu: &Gpu, options: &Options, mut progress: impl FnMut(&str)) -> Result<Report, BenchError> {
    let mut contestants = contestants(gpu)?;
    let (mut rows, mut left_out) = (Vec::new(), Vec::new());
    for variant in Variant::ALL {
        for &passes in &options.passes {
            let work = Work { variant, passes };
            progress(&format!("{passes} passes over {}s", variant.name()));
            let mut taking_part = Vec::new();
            for contestant in &mut contestants {
                match ready(contestant.as_mut(), work)? {
                    None => taking_part.push(contestant),
                    Some(why) => {
                        left_out.push(LeftOut { variant: variant.name(), passes, contestant: contestant.name(), why });
                    }
                }
            }
            rows.extend(turns(&mut taking_part, work, options.frames(passes))?);
        }
    }
    let about = contestants.iter().map(|c| Entry { name: c.name(), about: c.about() }).collect();
    Ok(Report::new(gpu.report(), about, rows, left_out))
}

/// Prepares a contestant and runs its first frame; returns the reason if it cannot do the work.
fn ready(contestant: &mut dyn Contestant, work: Work) -> Result<Option<String>, BenchError> {
    if let Some(why) = contestant.refuses(work) {
        return Ok(Some(why));
    }
    match contestant.prepare(work).and_then(|()| contestant.frame(&mut Clock::default())) {
        Ok(_) => Ok(None),
        Err(error) if error.is_limit() => Ok(Some(error.to_string())),
        Err(error) => Err(error),
    }
}

/// Runs one frame of each contestant in turn, until each has run `frames`.
fn turns(contestants: &mut [&mut Box<dyn Contestant>], work: Work, frames: u32) -> Result<Vec<Row>, BenchError> {
    let expected = work.expected();
    let mut samples: Vec<Vec<Clock>> = contestants.iter().map(|_| Vec::new()).collect();
    for turn in 0..WARM_UP + frames {
        for (contestant, samples) in contestants.iter_mut().zip(&mut samples) {
            let mut clock = Clock::default();
            contestant.frame(&mut clock)?;
            check(contestant.as_ref(), work, &expected)?;
            if turn >= WARM_UP {
                samples.push(clock);
            }
        }
    }
    // Counting allocations takes time, so it has a frame of its own.
    let mut rows = Vec::new();
    for (contestant, samples) in contestants.iter_mut().zip(&samples) {
        let before = allocations();
        let frame = contestant.frame(&mut Clock::counting())?;
        let allocated = allocations() - before;
        check(contestant.as_ref(), work, &expected)?;
        rows.extend(Row::new(contestant.name(), work, samples, frame, allocated));
    }
    Ok(rows)
}
