//! Executes a plan on a model of independent queues with a memory model after Vulkan's, and reports the first error.
//!
//! It uses none of the planner's code, only the plain data that goes in and comes out. The meaning of that data is implemented a second
//! time, as simply as possible.
//!
//! | file | checks |
//! |---|---|
//! | `checker` | consistency of the plan's lists: each pass once, batches wait for earlier ones only, queues support their passes |
//! | `checker/cull` | the passes that run are those that the frame needs |
//! | `checker/memory` | lifetimes, placement in heaps, statistics |
//! | `checker/run` | execution order, visibility, layouts, queue ownership, contents, aliased memory |
//! | `checker/access` | meaning of each access |

#[path = "checker/access.rs"]
mod access;
#[path = "checker/cull.rs"]
mod cull;
#[path = "checker/memory.rs"]
mod memory;
#[path = "checker/run.rs"]
mod run;

use magpie::graph::{
    Declaration, Domain, Part, Queue, Queues, Shape, Span, Switches, Use, Uses,
    plan::{Footprint, Plan, Sharing},
};

/// The request that a plan was made for.
pub struct PlanRequest<'a> {
    /// Optional steps of the planner.
    pub switches: Switches,
    /// Queues of the device.
    pub device: Queues,
    /// Memory requirements of resources.
    pub footprint: &'a dyn Fn(Shape, Uses, Sharing) -> Footprint,
    /// Page size that separates images from other resources in a heap (bufferImageGranularity), bytes.
    pub granularity: u64,
}

/// An error in a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanFault(pub String);

type Checked = Result<(), PlanFault>;

fn wrong<T>(text: String) -> Result<T, PlanFault> {
    Err(PlanFault(text))
}

/// Checks a plan; returns the first error.
pub fn check(d: &Declaration, plan: &Plan, request: &PlanRequest<'_>) -> Checked {
    check_lists(d, plan)?;
    check_switches(d, plan, request)?;
    cull::check(d, plan, request.switches.cull)?;
    run::check(d, plan, request)?;
    memory::check(d, plan, request)
}

/// Most bytes of transients, unpadded, that are alive at one position of an order.
pub fn peak(d: &Declaration, order: &[u32]) -> u64 {
    let lives = memory::lives(d, order);
    let alive = |at: u32| -> u64 {
        let here =
            lives.iter().enumerate().filter(|(_, l)| l.is_some_and(|(first, last)| (first..=last).contains(&at)));
        here.filter(|(r, _)| d.resources[*r].maker.is_some()).map(|(r, _)| memory::bytes(d.resources[r].shape)).sum()
    };
    (0..order.len() as u32).map(alive).max().unwrap_or(0)
}

fn inside(span: Span, length: usize) -> bool {
    span.start <= span.end && span.end as usize <= length
}

fn check_lists(d: &Declaration, plan: &Plan) -> Checked {
    let mut all: Vec<u32> = plan.order.iter().copied().chain(plan.culled.iter().map(|c| c.pass)).collect();
    all.sort_unstable();
    if !all.iter().copied().eq(0..d.passes.len() as u32) {
        return wrong(format!("passes are not each kept or left out once: {all:?}"));
    }
    let passes = plan.order.len();
    if plan.before.len() != passes || plan.after.len() != passes {
        return wrong(format!("{} and {} stops for {passes} passes", plan.before.len(), plan.after.len()));
    }
    let stops = plan.before.iter().chain(&plan.after).chain([&plan.end]);
    let mut placed = vec![false; plan.barriers.len()];
    for stop in stops {
        if !inside(*stop, plan.barriers.len()) {
            return wrong(format!("{stop:?} of {} barriers", plan.barriers.len()));
        }
        for at in stop.range() {
            if std::mem::replace(&mut placed[at], true) {
                return wrong(format!("barrier {at} stands in two places"));
            }
        }
    }
    if let Some(lost) = placed.iter().position(|p| !p) {
        return wrong(format!("barrier {lost} stands nowhere"));
    }

    let mut next = 0;
    for (index, batch) in plan.batches.iter().enumerate() {
        if batch.passes.start != next || batch.passes.is_empty() || !inside(batch.passes, passes) {
            return wrong(format!("batch {index} has passes {:?}, expected from {next}", batch.passes));
        }
        next = batch.passes.end;
        if !inside(batch.waits, plan.waits.len()) {
            return wrong(format!("batch {index} has waits {:?} of {}", batch.waits, plan.waits.len()));
        }
        for &wait in &plan.waits[batch.waits.range()] {
            // Waiting for a batch that is submitted later would deadlock on a device with one queue.
            if wait as usize >= index {
                return wrong(format!("batch {index} waits for batch {wait}, which is not handed over before it"));
            }
            if plan.batches[wait as usize].queue == batch.queue {
                return wrong(format!("batch {index} waits for batch {wait} of its own queue"));
            }
        }
    }
    if next as usize != passes {
        return wrong(format!("{next} of {passes} passes are in batches"));
    }
    Ok(())
}

/// Whether a queue supports a pass.
fn can_run(queue: Queue, domain: Domain) -> bool {
    match (queue, domain) {
        (Queue::Graphics, _)
        | (Queue::AsyncCompute, Domain::Compute | Domain::Copy)
        | (Queue::Transfer, Domain::Copy) => true,
        (Queue::AsyncCompute, Domain::Raster) | (Queue::Transfer, Domain::Raster | Domain::Compute) => false,
    }
}

fn check_switches(d: &Declaration, plan: &Plan, request: &PlanRequest<'_>) -> Checked {
    let switches = request.switches;
    let (mut compute, mut transfer) = (request.device.async_compute, request.device.transfer);
    if let Some(count) = switches.queues {
        (compute, transfer) = (count > 1, count > 2);
    }
    if switches.serial || !switches.asynchronous {
        (compute, transfer) = (false, false);
    }
    let queues = Queues { async_compute: compute, transfer };
    if plan.queues != queues || plan.serial != switches.serial {
        return wrong(format!("planned for {:?} (serial: {}), asked for {queues:?}", plan.queues, plan.serial));
    }
    for batch in &plan.batches {
        for &pass in &plan.order[batch.passes.range()] {
            let decl = &d.passes[pass as usize];
            let there = match decl.queue {
                Queue::Graphics => true,
                Queue::AsyncCompute => compute,
                Queue::Transfer => transfer,
            };
            let queue = if there && can_run(decl.queue, decl.domain) { decl.queue } else { Queue::Graphics };
            if batch.queue != queue {
                return wrong(format!("pass {pass} runs on {:?}, not on {queue:?}", batch.queue));
            }
        }
    }
    let one_queue = !compute && !transfer;
    if one_queue && (switches.serial || !switches.reorder) && !plan.order.is_sorted() {
        return wrong(format!("the order {:?} is not the declared one", plan.order));
    }
    Ok(())
}

/// The pass that writes each version of a resource, and the part it writes.
struct Versions<'a> {
    /// By resource and version.
    writers: Vec<Vec<Option<(u32, &'a Use)>>>,
    kept: Vec<bool>,
    d: &'a Declaration,
}

impl<'a> Versions<'a> {
    fn new(d: &'a Declaration, plan: &Plan) -> Self {
        let mut writers: Vec<Vec<_>> = d.resources.iter().map(|r| vec![None; r.versions as usize]).collect();
        for (pass, decl) in d.passes.iter().enumerate() {
            for u in &d.uses[decl.uses.range()] {
                if let Some(version) = u.writes {
                    writers[u.resource as usize][version as usize] = Some((pass as u32, u));
                }
            }
        }
        let mut kept = vec![false; d.passes.len()];
        plan.order.iter().for_each(|&p| kept[p as usize] = true);
        Self { writers, kept, d }
    }

    fn writer(&self, resource: u32, version: u32) -> Option<u32> {
        self.writers[resource as usize][version as usize].map(|(pass, _)| pass)
    }

    /// Whether a weak pass made this version from existing contents.
    fn is_mere_change(&self, resource: u32, version: u32) -> bool {
        let first = u32::from(access::comes_empty(&self.d.resources[resource as usize]));
        let weak = |pass: u32| self.d.passes[pass as usize].weak;
        version > first && self.writer(resource, version).is_some_and(weak)
    }

    /// The version that a cell holds when `version` is read: the newest up to it that a pass which runs wrote there. `Ok(None)`: it was
    /// never written.
    fn held(&self, resource: u32, version: u32, cell: (u32, u32), strict: bool) -> Result<Option<u32>, PlanFault> {
        for v in (0..=version).rev() {
            let Some((pass, u)) = self.writers[resource as usize][v as usize] else {
                // The initial contents of an import.
                return Ok((!access::comes_empty(&self.d.resources[resource as usize])).then_some(v));
            };
            if !covers(u.part, cell) {
                continue;
            }
            if self.kept[pass as usize] {
                return Ok(Some(v));
            }
            if strict && !self.is_mere_change(resource, v) {
                return wrong(format!("version {v} of resource {resource} is wanted, and pass {pass} is left out"));
            }
        }
        Ok(None)
    }
}

/// Whether a part contains this mip and layer.
fn covers(part: Part, (mip, layer): (u32, u32)) -> bool {
    let has = |first: u16, count: u16, at: u32| (u32::from(first)..u32::from(first) + u32::from(count)).contains(&at);
    has(part.mip, part.mips, mip) && has(part.layer, part.layers, layer)
}
