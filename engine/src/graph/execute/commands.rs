//! Command buffers of a frame and their submission.
//!
//! A batch is one command buffer, or several if it has so many passes that threads share the work. These are submitted in order,
//! and a barrier in one covers the commands of those before it, so the division is not visible to passes.

use std::{ops::Range, time::Instant};

use rayon::prelude::*;

use super::{
    super::{
        access::{Access, Domain, Queue},
        declaration::{Clear, Declaration},
        desc::Part,
        pass::RecordFn,
        plan::{Batch, Plan},
        record::{Physical, Record, Recorded},
    },
    bind::{Bound, is_storage},
    breadcrumbs::Breadcrumbs,
    nanoseconds,
    poison::PoisonWrite,
    time::Clock,
};
use crate::{
    gpu::{Attachment, CommandEncoder, Gpu, GpuError, PassSet, SemaphoreValue, Submission},
    measure::PassTime,
};

/// Command buffers, reused from frame to frame.
pub(super) struct Commands {
    gpu: Gpu,
    /// Free command buffers of each queue.
    encoders: [Vec<CommandEncoder>; Queue::ALL.len()],
    /// The closures that record the passes, by position.
    ordered: Vec<Option<RecordFn>>,
}

/// A frame to record.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub gpu: &'a Gpu,
    pub declaration: &'a Declaration,
    pub plan: &'a Plan,
    pub bound: &'a Bound,
    /// Counter memory for every pass.
    pub counters: &'a Clock,
    /// Values to write into outputs on purpose; empty outside tests.
    pub poison_writes: &'a [PoisonWrite],
    pub breadcrumbs: Option<&'a Breadcrumbs>,
    /// For tests: recording stops at the beginning of this position, as if the device were lost there.
    pub stop: Option<usize>,
    pub begun: Instant,
    /// Semaphores of the application that the frame waits for before it begins.
    pub waits: &'a [SemaphoreValue],
}

/// A frame that was submitted.
pub(super) struct Submitted {
    /// The last submission; the frame is done when it is.
    pub last: Submission,
    /// Times by position; empty if nothing is measured.
    pub passes: Vec<PassTime>,
    pub barriers: u32,
    pub submit_ns: u64,
    pub held: Held,
}

/// What the device uses until the frame is done.
pub(super) struct Held {
    encoders: Vec<(Queue, CommandEncoder)>,
    /// Descriptor sets of the passes.
    _sets: Vec<PassSet>,
}

/// One command buffer and the positions that it records.
struct Unit<'a> {
    encoder: CommandEncoder,
    queue: Queue,
    positions: Range<usize>,
    records: &'a mut [Option<RecordFn>],
    opens_frame: bool,
    closes_frame: bool,
    passes: Vec<PassTime>,
    sets: Vec<PassSet>,
}

impl Commands {
    pub fn new(gpu: &Gpu) -> Self {
        Self { gpu: gpu.clone(), encoders: Default::default(), ordered: Vec::new() }
    }

    /// Records and submits a frame.
    pub fn submit(
        &mut self,
        frame: Frame<'_>,
        records: &mut [Option<RecordFn>],
        clock: Option<&Clock>,
        passes_per_thread: Option<usize>,
    ) -> Result<Submitted, GpuError> {
        let plan = frame.plan;
        self.ordered.clear();
        self.ordered.extend(plan.order.iter().map(|&pass| records[pass as usize].take()));

        let mut ordered = std::mem::take(&mut self.ordered);
        let mut units = self.divide(plan, &mut ordered, passes_per_thread)?;
        let recorded = if units.len() > 1 && passes_per_thread.is_some_and(|n| plan.order.len() >= 2 * n) {
            units.par_iter_mut().try_for_each(|unit| unit.record(frame, clock))
        } else {
            units.iter_mut().try_for_each(|unit| unit.record(frame, clock))
        };
        let submit_start = Instant::now();
        let submitted = recorded.and_then(|()| self.submit_units(plan, frame.waits, &units));
        let submit_ns = nanoseconds(submit_start);
        let mut held = Held { encoders: Vec::with_capacity(units.len()), _sets: Vec::new() };
        let mut passes = Vec::new();
        if clock.is_some() {
            passes.reserve(plan.order.len());
        }
        for unit in units {
            passes.extend(unit.passes);
            held._sets.extend(unit.sets);
            held.encoders.push((unit.queue, unit.encoder));
        }
        self.ordered = ordered;
        match submitted {
            Ok(last) => Ok(Submitted { last, passes, barriers: frame.bound.barriers.count(), submit_ns, held }),
            Err(error) => {
                // Some of it may have been submitted. Whether waiting for that fails as well makes no difference.
                let _ = self.gpu.wait_idle();
                self.take_back(held);
                Err(error)
            }
        }
    }

    /// Takes back the command buffers of a frame that is done.
    pub fn take_back(&mut self, held: Held) {
        for (queue, encoder) in held.encoders {
            self.encoders[queue.index()].push(encoder);
        }
    }

    /// Divides a frame into command buffers, in submission order. With several queues, the frame begins and ends with a command
    /// buffer of its own: all queues wait for the first, and the last waits for all queues.
    fn divide<'a>(
        &mut self,
        plan: &Plan,
        mut records: &'a mut [Option<RecordFn>],
        passes_per_thread: Option<usize>,
    ) -> Result<Vec<Unit<'a>>, GpuError> {
        let several_queues = plan.batches.iter().any(|b| b.queue != Queue::Graphics);
        let mut units = Vec::with_capacity(plan.batches.len() + 2);
        if several_queues || plan.batches.is_empty() {
            units.push(self.unit(Queue::Graphics, 0..0, &mut [])?);
        }
        let per_unit = match passes_per_thread {
            Some(least) if plan.order.len() >= 2 * least => {
                least.max(plan.order.len().div_ceil(rayon::current_num_threads()))
            }
            _ => usize::MAX,
        };
        for batch in &plan.batches {
            let mut positions = batch.passes.range();
            while !positions.is_empty() {
                let taken = positions.len().min(per_unit);
                let (own, rest) = records.split_at_mut(taken);
                records = rest;
                units.push(self.unit(batch.queue, positions.start..positions.start + taken, own)?);
                positions.start += taken;
            }
        }
        if several_queues {
            units.push(self.unit(Queue::Graphics, 0..0, &mut [])?);
        }
        if let Some(first) = units.first_mut() {
            first.opens_frame = true;
        }
        if let Some(last) = units.last_mut() {
            last.closes_frame = true;
        }
        Ok(units)
    }

    fn unit<'a>(
        &mut self,
        queue: Queue,
        positions: Range<usize>,
        records: &'a mut [Option<RecordFn>],
    ) -> Result<Unit<'a>, GpuError> {
        let free = self.encoders[queue.index()].pop();
        let encoder = free.map_or_else(|| CommandEncoder::new(&self.gpu, queue), Ok)?;
        let (passes, sets) = (Vec::new(), Vec::new());
        Ok(Unit { encoder, queue, positions, records, opens_frame: false, closes_frame: false, passes, sets })
    }

    fn submit_units(&self, plan: &Plan, before: &[SemaphoreValue], units: &[Unit<'_>]) -> Result<Submission, GpuError> {
        let several_queues = plan.batches.iter().any(|b| b.queue != Queue::Graphics);
        if !several_queues {
            return self.gpu.submit_after(Queue::Graphics, units.iter().map(|u| &u.encoder), before);
        }
        // The first unit opens the frame and the last closes it; the others belong to batches.
        let [first, middle @ .., last] = units else {
            return Err(GpuError::Call { call: "submit", code: format!("{} command buffers", units.len()) });
        };
        let opened = self.gpu.submit_after(Queue::Graphics, [&first.encoder], before)?;
        let mut newest: [Option<Submission>; Queue::ALL.len()] = [None; Queue::ALL.len()];
        let mut submissions: Vec<Submission> = Vec::with_capacity(plan.batches.len());
        let mut next = 0;
        for batch in &plan.batches {
            let own = middle[next..].iter().take_while(|u| u.positions.start < batch.passes.range().end).count();
            let encoders = middle[next..next + own].iter().map(|u| &u.encoder);
            next += own;
            let waits = self.waits(plan, batch, &submissions, newest[batch.queue.index()].is_none().then_some(opened));
            let submission = self.gpu.submit(batch.queue, encoders, &waits)?;
            submissions.push(submission);
            newest[batch.queue.index()] = Some(submission);
        }
        let others = Queue::ALL.iter().filter(|q| **q != Queue::Graphics);
        let waits: Vec<Submission> = others.filter_map(|q| newest[q.index()]).collect();
        self.gpu.submit(Queue::Graphics, [&last.encoder], &waits)
    }

    /// The submissions that a batch waits for. The first batch of each queue also waits for the command buffer that opens the frame.
    fn waits(
        &self,
        plan: &Plan,
        batch: &Batch,
        submissions: &[Submission],
        opened: Option<Submission>,
    ) -> Vec<Submission> {
        let planned = plan.waits[batch.waits.range()].iter().map(|&w| submissions[w as usize]);
        let opening = opened.filter(|_| batch.queue != Queue::Graphics);
        let mut waits: Vec<Submission> = planned.collect();
        // A wait for a later submission of the graphics queue covers the opening one too.
        let covered =
            plan.waits[batch.waits.range()].iter().any(|&w| plan.batches[w as usize].queue == Queue::Graphics);
        waits.extend(opening.filter(|_| !covered));
        waits
    }
}

impl Unit<'_> {
    fn record(&mut self, frame: Frame<'_>, clock: Option<&Clock>) -> Result<(), GpuError> {
        let Frame { plan, bound, .. } = frame;
        self.encoder.begin()?;
        if let Some(clock) = clock.filter(|_| self.opens_frame) {
            clock.open_frame(&mut self.encoder);
        }
        if clock.is_some() {
            self.passes.reserve(self.positions.len());
        }
        let thread = rayon::current_thread_index().map_or(0, |index| index as u32 + 1);
        for position in self.positions.clone() {
            if frame.stop.is_some_and(|stop| position >= stop) {
                if let Some(breadcrumbs) = frame.breadcrumbs.filter(|_| frame.stop == Some(position)) {
                    breadcrumbs.open_pass(&mut self.encoder, position);
                }
                break;
            }
            let cpu_start = clock.map(|_| Instant::now());
            let (memory, images) = bound.barriers.before(position);
            if plan.serial {
                self.encoder.full_barrier();
            }
            if !memory.is_empty() || !images.is_empty() {
                self.encoder.barriers(memory, images);
            }
            let recorded = self.pass(frame, position, clock)?;
            let (memory, images) = bound.barriers.after(position);
            if !memory.is_empty() || !images.is_empty() {
                self.encoder.barriers(memory, images);
            }
            if let Some(cpu_start) = cpu_start {
                let pass = plan.order[position];
                self.passes.push(PassTime {
                    name: frame.declaration.pass_name(pass).to_owned(),
                    stage: frame.declaration.stage(pass).to_owned(),
                    queue: self.queue.name(),
                    thread,
                    cpu_ns: nanoseconds(cpu_start),
                    cpu_start_ns: Some((cpu_start - frame.begun).as_nanos() as u64),
                    draws: recorded.draws,
                    dispatches: recorded.dispatches,
                    bytes: frame.declaration.traffic(pass),
                    counts: recorded.counts.iter().map(|name| (*name, 0)).collect(),
                    ..Default::default()
                });
            }
        }
        if self.closes_frame {
            let (memory, images) = if frame.stop.is_none() { bound.barriers.end() } else { (&[][..], &[][..]) };
            if !memory.is_empty() || !images.is_empty() {
                self.encoder.barriers(memory, images);
            }
            // Makes everything visible to the host and to the next frame: on the device frames do not overlap.
            self.encoder.full_barrier();
            if let Some(clock) = clock.filter(|_| frame.stop.is_none()) {
                clock.close_frame(&mut self.encoder);
            }
        }
        self.encoder.finish()
    }

    /// Records one pass, inside dynamic rendering if it has attachments.
    fn pass(&mut self, frame: Frame<'_>, position: usize, clock: Option<&Clock>) -> Result<Recorded, GpuError> {
        let Frame { gpu, declaration, plan, bound, .. } = frame;
        let pass = plan.order[position];
        let name = declaration.pass_name(pass);
        let encoder = &mut self.encoder;
        // Labels are for debuggers and profilers; frames without measurement or validation skip them.
        let labelled = clock.is_some() || gpu.validates();
        if labelled {
            encoder.begin_label(name);
        }
        if let Some(breadcrumbs) = frame.breadcrumbs {
            breadcrumbs.open_pass(encoder, position);
        }
        if let Some(clock) = clock {
            clock.open_pass(encoder, position as u32);
        }
        if gpu.validates() {
            let set = pass_set(frame, pass)?;
            encoder.bind_pass_set(&set);
            self.sets.push(set);
        }
        let raster = declaration.passes[pass as usize].domain == Domain::Raster;
        if raster {
            begin_rendering(encoder, frame, pass);
        }
        if let Some(clock) = clock {
            clock.begin_counting(encoder, position as u32);
        }
        let counters = frame.counters.counters(position as u32);
        let physical = &bound.physical;
        let mut scope = Record { encoder, physical, pass, name, counters, recorded: Recorded::default(), fault: None };
        if let Some(record) = self.records[position - self.positions.start].take() {
            record(&mut scope);
        }
        if let Some(fault) = scope.fault {
            return Err(fault);
        }
        let recorded = scope.recorded;
        if let Some(clock) = clock {
            clock.end_counting(&mut self.encoder);
        }
        if raster {
            self.encoder.end_rendering();
        }
        for poison_write in frame.poison_writes.iter().filter(|s| s.pass() == pass) {
            poison_write.record(&mut self.encoder, &bound.physical);
        }
        if let Some(clock) = clock {
            clock.close_pass(&mut self.encoder, position as u32);
        }
        if let Some(breadcrumbs) = frame.breadcrumbs {
            breadcrumbs.close_pass(&mut self.encoder, position);
        }
        if labelled {
            self.encoder.end_label();
        }
        Ok(recorded)
    }
}

/// The descriptors that a pass declared, for validation.
fn pass_set(frame: Frame<'_>, pass: u32) -> Result<PassSet, GpuError> {
    let (mut sampled, mut stored) = (Vec::new(), Vec::new());
    for u in frame.declaration.uses_of(pass) {
        let Physical::Image(image) = &frame.bound.physical[u.resource as usize] else { continue };
        if u.access == Access::Sample {
            sampled.extend(image.sampled_part(u.part));
        } else if is_storage(u.access) {
            stored.extend(image.storage_part(u.part));
        }
    }
    PassSet::new(frame.gpu, &sampled, &stored)
}

fn begin_rendering(encoder: &mut CommandEncoder, frame: Frame<'_>, pass: u32) {
    let declaration = frame.declaration;
    let (mut colours, mut depth, mut extent) = (Vec::new(), None, declaration.full);
    for index in declaration.passes[pass as usize].uses.range() {
        let u = &declaration.uses[index];
        let Physical::Image(image) = &frame.bound.physical[u.resource as usize] else { continue };
        if !u.access.is_attachment() {
            continue;
        }
        // An attachment declared with all its parts is rendered to mip 0 of layer 0.
        let part = Part { mips: 1, layers: 1, ..u.part };
        extent = image.extent().mip(part.mip.into());
        let clear = declaration.clear_of(index as u32).map(|c| match c {
            Clear::Color(colour) => colour,
            Clear::Depth(depth) => [depth, 0.0, 0.0, 0.0],
        });
        let store = frame.plan.unstored.binary_search(&(index as u32)).is_err();
        let attachment = Attachment { image, part, clear, store, read_only: u.access == Access::DepthTest };
        if u.access.is_depth() {
            depth = Some(attachment);
        } else {
            colours.push(attachment);
        }
    }
    encoder.begin_rendering(extent, &colours, depth.as_ref());
}
