//! Plans of random frames against a slow checker that shares no code with the planner, and the checker against plans with a
//! mistake planted in them. No GPU. `PROPTEST_CASES` sets the number of frames, `MAGPIE_SEED` what they are made from.
#![allow(clippy::unwrap_used)] // helpers of tests may fail as tests do

#[path = "plan/checker.rs"]
mod checker;
#[path = "plan/random.rs"]
mod random;

use std::{cell::RefCell, env, time::Instant};

use magpie::graph::{
    Declaration, Queues, Shape, Switches, Uses, dump, plan,
    plan::{Footprint, Footprints, Plan, Sharing},
};
use proptest::{
    prelude::*,
    test_runner::{RngAlgorithm, TestError, TestRng, TestRunner},
};

use checker::{Asked, check};
use random::{Script, scripts};

/// A random frame, and how it is planned.
#[derive(Clone, Debug)]
struct Case {
    script: Script,
    setup: Setup,
}

/// How a frame is planned.
#[derive(Clone, Copy, Debug)]
struct Setup {
    switches: Switches,
    device: Queues,
    /// What objects take of memory.
    prints: Prints,
}

/// Footprints of a device that does not exist: objects of some kinds are padded, some have a memory of their own.
#[derive(Clone, Copy, Debug)]
struct Prints(u8);

impl Prints {
    fn of(self, shape: Shape) -> Footprint {
        let own = |share: u64| (shape.bytes() + u64::from(self.0)) % share == 0;
        let (align, kind) = match shape {
            Shape::Image { .. } => (if own(3) { 1024 } else { 64 }, u8::from(self.0 & 2 != 0 && own(2)) * 5),
            Shape::Buffer { .. } => (if own(3) { 256 } else { 4 }, 0),
            Shape::Accel { .. } => (256, 0),
        };
        let pad = if self.0 & 4 == 0 { align } else { 1 };
        Footprint { bytes: shape.bytes().next_multiple_of(pad), align, kind }
    }
}

impl Footprints for Prints {
    fn footprint(&mut self, shape: Shape, _: Uses, _: Sharing) -> Footprint {
        self.of(shape)
    }

    fn granularity(&self) -> u64 {
        [1, 1, 128, 1024][usize::from(self.0) % 4]
    }
}

impl Setup {
    fn plan(self, d: &Declaration) -> Plan {
        plan(d, &self.switches, self.device, &mut { self.prints })
    }

    fn check(self, d: &Declaration, plan: &Plan) -> Result<(), checker::Complaint> {
        let footprint = |shape: Shape, _: Uses, _: Sharing| self.prints.of(shape);
        let granularity = self.prints.granularity();
        check(d, plan, &Asked { switches: self.switches, device: self.device, footprint: &footprint, granularity })
    }
}

fn setups() -> impl Strategy<Value = Setup> {
    // More often than by chance everything is on.
    let bits = prop_oneof![2 => Just(0), 3 => 0_u8..64];
    (bits, 0_u8..4, any::<[bool; 2]>(), any::<u8>()).prop_map(|(bits, queues, device, prints)| {
        let queues = (queues > 0).then_some(queues);
        let switches = Switches { queues, ..Switches::combination(bits) };
        let device = Queues { async_compute: device[0], transfer: device[1] };
        Setup { switches, device, prints: Prints(prints) }
    })
}

fn cases() -> impl Strategy<Value = Case> {
    (scripts(16), setups()).prop_map(|(script, setup)| Case { script, setup })
}

/// Frames per run.
fn count(usual: u32) -> u32 {
    env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// Runs a property over random cases that are the same each time, unless another seed is asked for. One that fails is made small.
fn over<S: Strategy>(cases: u32, strategy: &S, property: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let seed = env::var("MAGPIE_SEED").ok().and_then(|n| n.parse().ok()).unwrap_or(0_u64);
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &bytes));
    match runner.run(strategy, property) {
        Ok(()) => {}
        Err(TestError::Fail(reason, value)) => panic!("seed {seed}: {reason}\n{value:#?}"),
        Err(TestError::Abort(reason)) => panic!("seed {seed}: {reason}"),
    }
}

fn describe(d: &Declaration, plan: &Plan) -> String {
    let uses = d.uses.iter().enumerate().map(|(i, u)| format!("use {i}: {u:?}\n")).collect::<String>();
    let batches = plan.batches.iter().map(|b| format!("{b:?}, waits for {:?}\n", &plan.waits[b.waits.range()]));
    let stops = plan.before.iter().zip(&plan.after).map(|(before, after)| format!("{before:?} {after:?}\n"));
    let barriers = plan.barriers.iter().map(|b| format!("{b:?}\n"));
    let transients = plan.transients.iter().map(|t| format!("{t:?}\n"));
    let plan_words: String = batches.chain(stops).chain(barriers).chain(transients).collect();
    format!("{}\n{uses}{plan_words}{:?}\n{:?}", dump::text(d, plan), plan.unstored, plan.successions)
}

#[test]
fn plans_of_random_frames_are_sound() {
    let start = Instant::now();
    let cases = count(10_000);
    over(cases, &self::cases(), |case| {
        let frame = case.script.declare().finish().unwrap();
        let plan = case.setup.plan(&frame.declaration);
        case.setup.check(&frame.declaration, &plan).map_err(|complaint| {
            TestCaseError::fail(format!("{}\n{}", complaint.0, describe(&frame.declaration, &plan)))
        })
    });
    println!("{cases} random frames in {:.1} s", start.elapsed().as_secs_f64());
    let _ = RefCell::new(0);
}
