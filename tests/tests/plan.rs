//! Plans of random frames, verified by an independent checker that shares no code with the planner; and the checker, tested with plans that
//! contain a planted mistake. No GPU. `PROPTEST_CASES` sets the number of frames, `MAGPIE_SEED` the seed.
#![allow(clippy::unwrap_used)] // helpers of tests may panic

#[path = "plan/checker.rs"]
mod checker;
#[path = "plan/mistakes.rs"]
mod mistakes;
#[path = "plan/random.rs"]
mod random;

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeMap, HashSet},
    env,
    time::Instant,
};

use magpie::graph::{
    Access, BufferDesc, Declaration, Domain, Extent, Format, FrameGraph, HistoryScope, ImageDesc, ImportKey, Layout,
    Origin, Part, Queue, Queues, Record, Shape, Switches, Use, Uses, dump, plan,
    plan::{Barrier, Footprint, Footprints, Plan, Sharing},
};
use proptest::{
    prelude::*,
    test_runner::{RngAlgorithm, TestError, TestRng, TestRunner},
};

use checker::{PlanRequest, check, peak};
use mistakes::{MISTAKES, Mistake};
use random::{Script, scripts};

/// A random frame, and how to plan it.
#[derive(Clone, Debug)]
struct Case {
    script: Script,
    setup: Setup,
}

/// How to plan a frame.
#[derive(Clone, Copy, Debug)]
struct Setup {
    switches: Switches,
    device: Queues,
    /// Memory requirements of resources.
    prints: Prints,
}

/// Footprints of an imaginary device: some kinds of resources are padded, some need dedicated memory.
#[derive(Clone, Copy, Debug)]
struct Prints(u8);

impl Prints {
    fn of(self, shape: Shape) -> Footprint {
        let own = |share: u64| (shape.bytes() + u64::from(self.0)).is_multiple_of(share);
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

    fn check(self, d: &Declaration, plan: &Plan) -> Result<(), checker::PlanFault> {
        let footprint = |shape: Shape, _: Uses, _: Sharing| self.prints.of(shape);
        let granularity = self.prints.granularity();
        check(
            d,
            plan,
            &PlanRequest { switches: self.switches, device: self.device, footprint: &footprint, granularity },
        )
    }
}

fn setups() -> impl Strategy<Value = Setup> {
    // All switches on more often than by chance.
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

/// Number of random frames per run.
fn count(usual: u32) -> u32 {
    env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// Runs a property over random cases, which are deterministic for a seed. A failing case is shrunk.
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

/// Counts occurrences, so that a property cannot pass for lack of relevant cases.
#[derive(Default)]
struct Tally(BTreeMap<&'static str, usize>);

impl Tally {
    fn add(&mut self, what: &'static str, count: usize) {
        *self.0.entry(what).or_default() += count;
    }

    fn look(&mut self, d: &Declaration, plan: &Plan) {
        let parts = |r: u32| d.resources[r as usize].shape.parts();
        let uses = || plan.order.iter().flat_map(|&p| d.uses_of(p));
        let on = |queue: Queue| plan.batches.iter().filter(|b| b.queue == queue).count();
        let shared = |sharing: Sharing| plan.transients.iter().filter(|t| t.sharing == sharing).count();
        let used = |access: Access| uses().filter(|u| u.access == access).count();
        let imported = |u: &&Use, suits: fn(ImportKey) -> bool| match d.resources[u.resource as usize].origin {
            Origin::Imported { key, .. } => suits(key),
            Origin::Transient => false,
        };
        let barriers = |suits: fn(&Barrier) -> bool| plan.barriers.iter().filter(|b| suits(b)).count();
        self.add("passes kept", plan.order.len());
        self.add("passes culled", plan.culled.len());
        self.add("weak passes kept", plan.order.iter().filter(|&&p| d.passes[p as usize].weak).count());
        self.add(
            "uses of images in part",
            uses().filter(|u| parts(u.resource) != (u.part.mips.into(), u.part.layers.into())).count(),
        );
        self.add("builds", used(Access::Build));
        self.add("refits", used(Access::Refit));
        self.add("build inputs", used(Access::BuildInput));
        self.add("traces", used(Access::Trace));
        self.add("reads of a history", uses().filter(|u| imported(u, |k| matches!(k, ImportKey::Previous(_)))).count());
        self.add("writes of a history", uses().filter(|u| imported(u, |k| matches!(k, ImportKey::Next(_)))).count());
        self.add("uses of kept buffers", uses().filter(|u| imported(u, |k| matches!(k, ImportKey::Kept(_)))).count());
        self.add("barriers", plan.barriers.len());
        self.add("barriers from several uses", barriers(|b| b.from.iter().count() > 1));
        self.add(
            "barriers on one mip or layer",
            plan.barriers.iter().filter(|b| parts(b.resource) != (b.part.mips.into(), b.part.layers.into())).count(),
        );
        self.add("barriers for other queues", barriers(|b| b.to.is_any()));
        self.add("barriers at the end", plan.end.len());
        self.add("changes of owner", barriers(|b| b.handover.is_some()) / 2);
        self.add("batches for compute", on(Queue::AsyncCompute));
        self.add("batches for copies", on(Queue::Transfer));
        self.add("waits for other queues", plan.waits.len());
        self.add("transients", plan.transients.len());
        self.add("handed over", shared(Sharing::HandedOver));
        self.add("shared at once", shared(Sharing::Concurrent));
        self.add("memory taken over", plan.successions.len());
        self.add("attachments not stored", plan.unstored.len());
        self.add(
            "orders that are not the declared one",
            usize::from(plan.batches.len() == 1 && !plan.order.is_sorted()),
        );
    }
}

fn sound(setup: Setup, d: &Declaration, plan: &Plan) -> Result<(), TestCaseError> {
    let words = |c: checker::PlanFault| TestCaseError::fail(format!("{}\n{setup:?}\n{}", c.0, describe(d, plan)));
    setup.check(d, plan).map_err(words)
}

#[test]
fn plans_of_random_frames_are_sound() {
    let (start, cases) = (Instant::now(), count(10_000));
    let tally = RefCell::new(Tally::default());
    let combinations = RefCell::new(HashSet::new());
    let strategy = (scripts(20), prop::collection::vec(setups(), 4));
    over(cases, &strategy, |(script, setups)| {
        let d = script.declare().finish().unwrap().declaration;
        for setup in setups {
            let plan = setup.plan(&d);
            sound(setup, &d, &plan)?;
            tally.borrow_mut().look(&d, &plan);
            combinations.borrow_mut().insert(setup.switches);
        }
        Ok(())
    });
    println!("{cases} random frames, each planned 4 times, in {:.1} s:", start.elapsed().as_secs_f64());
    for (what, times) in &tally.borrow().0 {
        println!("{times:9} {what}");
    }
    if cases >= 1000 {
        assert_eq!(
            combinations.borrow().len(),
            256,
            "64 combinations of switches, for 1, 2, 3 queues and the device's"
        );
        let rare = |(_, times): &(&&str, &usize)| **times < cases as usize / 50;
        let tally = tally.borrow();
        assert_eq!(tally.0.iter().find(rare), None, "hardly ever seen");
    }
}

/// A frame that is small enough to plan in all possible ways.
#[test]
fn every_combination_of_switches_and_queues_is_sound() {
    let tried = Cell::new(0);
    over(count(10_000).div_ceil(100), &scripts(16), |script| {
        let d = script.declare().finish().unwrap().declaration;
        for (bits, queues) in (0..64).flat_map(|bits| (1..=3).map(move |queues| (bits, queues))) {
            let switches = Switches { queues: Some(queues), ..Switches::combination(bits) };
            let setup = Setup { switches, device: Queues::default(), prints: Prints(bits) };
            sound(setup, &d, &setup.plan(&d))?;
            tried.set(tried.get() + 1);
        }
        Ok(())
    });
    println!("{} plans", tried.get());
}

#[test]
fn another_order_never_takes_more_memory() {
    let (better, same) = (Cell::new(0), Cell::new(0));
    over(count(10_000) / 5, &(scripts(20), any::<bool>()), |(script, cull)| {
        let d = script.declare().finish().unwrap().declaration;
        let peak_with = |reorder: bool| {
            let switches = Switches { reorder, cull, ..Switches::default() };
            peak(&d, &plan(&d, &switches, Queues::default(), &mut Prints(0)).order)
        };
        let (chosen, declared) = (peak_with(true), peak_with(false));
        let counter = if chosen < declared { &better } else { &same };
        counter.set(counter.get() + 1);
        prop_assert!(chosen <= declared, "{chosen} bytes, {declared} in the declared order");
        Ok(())
    });
    println!("{} frames take less memory in another order, {} as much", better.get(), same.get());
    assert!(better.get() > 0);
}

#[test]
fn planning_and_dumping_are_functions() {
    over(count(10_000) / 20, &cases(), |case| {
        let (a, b) = (case.script.declare().finish().unwrap(), case.script.declare().finish().unwrap());
        let (a, b) = (a.declaration, b.declaration);
        prop_assert_eq!(&a, &b);
        let (plan_a, plan_b) = (case.setup.plan(&a), case.setup.plan(&b));
        prop_assert_eq!(&plan_a, &plan_b);
        prop_assert_eq!(dump::text(&a, &plan_a), dump::text(&b, &plan_b));
        prop_assert_eq!(dump::dot(&a, &plan_a), dump::dot(&b, &plan_b));
        prop_assert_eq!(dump::json(&a, &plan_a), dump::json(&b, &plan_b));
        Ok(())
    });
}

/// Prints, for each kind of mistake, how many were planted and found.
fn report(title: &str, found: &[(usize, usize)]) {
    println!("{title}");
    for (mistake, (planted, found)) in MISTAKES.iter().zip(found) {
        let why = if planted == found { "" } else { mistake.harmless.unwrap_or("NO REASON") };
        println!("  {found:6} of {planted:6} found: {}  {why}", mistake.name);
    }
}

/// Plants a mistake and returns whether the checker found it; `None` if the plan is unchanged.
fn try_out(mistake: &Mistake, setup: Setup, d: &Declaration, good: &Plan, place: mistakes::Place) -> Option<bool> {
    let mut bad = good.clone();
    (mistake.plant)(d, &mut bad, place, &|d| setup.plan(d));
    (bad != *good).then(|| setup.check(d, &bad).is_err())
}

#[test]
fn the_checker_finds_planted_mistakes() {
    let start = Instant::now();
    let found = RefCell::new(vec![(0, 0); MISTAKES.len()]);
    let strategy = (cases(), any::<usize>());
    over(count(10_000) / 5, &strategy, |(case, pick)| {
        let d = case.script.declare().finish().unwrap().declaration;
        let good = case.setup.plan(&d);
        for (mistake, tally) in MISTAKES.iter().zip(found.borrow_mut().iter_mut()) {
            let places = (mistake.places)(&d, &good);
            let Some(&place) = places.get(pick % places.len().max(1)) else { continue };
            let Some(is_found) = try_out(mistake, case.setup, &d, &good, place) else { continue };
            *tally = (tally.0 + 1, tally.1 + usize::from(is_found));
            if !is_found && mistake.harmless.is_none() {
                let mut bad = good.clone();
                (mistake.plant)(&d, &mut bad, place, &|d| case.setup.plan(d));
                let plans = format!("{}\nspoilt:\n{}", describe(&d, &good), describe(&d, &bad));
                return Err(TestCaseError::fail(format!("overlooked: {} at {place:?}\n{plans}", mistake.name)));
            }
        }
        Ok(())
    });
    let found = found.into_inner();
    report(&format!("in random frames, one place of each kind ({:.1} s)", start.elapsed().as_secs_f64()), &found);
    for (mistake, (_, found)) in MISTAKES.iter().zip(found) {
        assert!(found > 0, "{} is never found", mistake.name);
    }
}

/// Every place for every kind of mistake in one frame, so that the property above cannot pass for lack of cases.
#[test]
fn every_mistake_in_a_frame_made_by_hand_is_found() {
    let d = mistakes::frame().finish().unwrap().declaration;
    let mut found = vec![(0, 0); MISTAKES.len()];
    for queues in [1, 2, 3] {
        let switches = Switches { queues: Some(queues), ..Switches::default() };
        let setup = Setup { switches, device: Queues::default(), prints: Prints(0) };
        let good = setup.plan(&d);
        assert_eq!(setup.check(&d, &good), Ok(()));
        for (mistake, tally) in MISTAKES.iter().zip(&mut found) {
            for place in (mistake.places)(&d, &good) {
                let Some(is_found) = try_out(mistake, setup, &d, &good, place) else { continue };
                *tally = (tally.0 + 1, tally.1 + usize::from(is_found));
                let may_be = mistake.harmless.is_some();
                assert!(
                    is_found || may_be,
                    "{} at {place:?} on {queues} queues\n{}",
                    mistake.name,
                    describe(&d, &good)
                );
            }
        }
    }
    report("in the frame made by hand, every place", &found);
    for (mistake, (_, found)) in MISTAKES.iter().zip(found) {
        assert!(found > 0, "{} is never found", mistake.name);
    }
}

// Regression tests: errors that the checker found in the planner, each as the smallest frame that shows it.

/// Plans a frame and asserts that the checker accepts it.
fn accepted(g: FrameGraph) -> (Declaration, Plan) {
    let d = g.finish().unwrap().declaration;
    let setup = Setup { switches: Switches::default(), device: Queues::default(), prints: Prints(0) };
    let plan = setup.plan(&d);
    setup.check(&d, &plan).unwrap_or_else(|c| panic!("{}\n{}", c.0, describe(&d, &plan)));
    (d, plan)
}

const SMALL: Extent = Extent { width: 8, height: 8 };

#[test]
fn a_copied_buffer_has_no_layout() {
    let mut g = FrameGraph::new(SMALL);
    let source = g.import_buffer("source", BufferDesc::new(64), Access::BufferWrite, ImportKey::Caller(0));
    let target = g.import_buffer("target", BufferDesc::new(64), Access::HostRead, ImportKey::Caller(1));
    let _ = g.pass("copy", Queue::Graphics, |p| {
        p.copy_from(source.read());
        (p.copy_to(target).0, |_: &mut Record<'_>| {})
    });
    let (_, plan) = accepted(g);
    assert!(plan.barriers.iter().all(|b| (b.layout_from, b.layout_to) == (Layout::Undefined, Layout::Undefined)));
}

#[test]
fn an_attachment_with_one_mip_that_is_read_is_stored() {
    let mut g = FrameGraph::new(SMALL);
    let desc = ImageDesc { mips: 2, ..ImageDesc::full(Format::Rgba8Unorm) };
    let drawn = g.pass("draw", Queue::Graphics, |p| (p.color("drawn", desc, [0.0; 4]).0, |_: &mut Record<'_>| {}));
    let read = g.pass("read", Queue::Graphics, |p| {
        p.sample_part(drawn.read(), Part::mip(0));
        (p.create("read", ImageDesc::full(Format::R8Unorm)).0, |_: &mut Record<'_>| {})
    });
    g.output(read.read());
    assert_eq!(accepted(g).1.unstored, Vec::<u32>::new());
}

#[test]
fn a_write_waits_for_readers_before_the_frame_beside_those_in_it() {
    let mut g = FrameGraph::new(SMALL);
    let table = g.import_buffer("table", BufferDesc::new(64), Access::BufferRead, ImportKey::Caller(0));
    let found = g.import_buffer("found", BufferDesc::new(64), Access::HostRead, ImportKey::Caller(1));
    let _ = g.pass("read", Queue::Graphics, |p| {
        p.read(table.read());
        (p.write_buffer(found).0, |_: &mut Record<'_>| {})
    });
    let _ = g.pass("write", Queue::Graphics, |p| (p.write_buffer(table).0, |_: &mut Record<'_>| {}));
    let (_, plan) = accepted(g);
    let from = plan.barriers[plan.before[1].range()][0].from;
    assert!(from.contains((Access::BufferRead, Domain::Raster)), "who read it before the frame is unknown: {from}");
}

#[test]
fn a_history_that_is_made_in_part_is_made_as_a_whole() {
    let mut g = FrameGraph::new(SMALL);
    let light = g.history(&HistoryScope::new(), "light", ImageDesc::full(Format::Rgba16Float));
    let next = g.pass("first", Queue::Graphics, |p| (p.write(light.next).0, |_: &mut Record<'_>| {}));
    g.output(next.read());
    let _ = g.pass("second", Queue::Graphics, |p| (p.write(next).0, |_: &mut Record<'_>| {}));
    assert_eq!(accepted(g).1.order, [0, 1], "the next frame takes what `first` left alone for all there is");
}
