//! GPU times of passes, and the counts that their shaders make: rays, non-finite values, invocations.

use std::time::Instant;

use super::super::plan::{Batch, Plan};
use super::super::record::{MOST_COUNTS, OWN_COUNTERS};
use crate::{
    gpu::{self, BufferMemory, BufferUse, CommandEncoder, Gpu, GpuError, Statistics, Timestamps},
    measure::{self, FrameSample, PassTime},
};
use magpie_shaders::Address;

const FIRST_PASSES: u32 = 64;
/// Bytes of counters per pass, 4 each: closest-hit rays, any-hit rays, non-finite values, rays on the screen, then what the pass has names for.
const COUNTER_BYTES: u64 = OWN_COUNTERS + 4 * MOST_COUNTS as u64;

/// Timestamps and counters of one frame.
pub(super) struct Clock {
    gpu: Gpu,
    timestamps: Timestamps,
    /// [`COUNTER_BYTES`] per pass: the buffer in which shaders count, and the one that the host reads.
    counters: [gpu::Buffer; 2],
    /// Invocation counters; `None` unless the frame wants them and the device has them.
    statistics: Option<Statistics>,
    /// Passes of the frame.
    passes: u32,
}

impl Clock {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: gpu.clone(),
            timestamps: Timestamps::new(gpu, stamps(FIRST_PASSES))?,
            counters: counters(gpu, FIRST_PASSES)?,
            statistics: None,
            passes: 0,
        })
    }

    /// Makes room for the passes of a frame and resets the queries. `statistics` asks for invocation counters.
    pub fn prepare(&mut self, passes: u32, statistics: bool) -> Result<(), GpuError> {
        if self.timestamps.capacity() < stamps(passes) {
            let room = passes.next_power_of_two();
            self.timestamps = Timestamps::new(&self.gpu, stamps(room))?;
            self.counters = counters(&self.gpu, room)?;
        }
        self.passes = passes;
        self.timestamps.reset();
        match &self.statistics {
            _ if !statistics => self.statistics = None,
            Some(held) if held.capacity() >= passes => held.reset(),
            _ => self.statistics = Statistics::new(&self.gpu, passes.next_power_of_two().max(FIRST_PASSES))?,
        }
        Ok(())
    }

    /// Address of the counters of the pass at a position.
    pub fn counters(&self, position: u32) -> Address {
        self.counters[0].address().offset(u64::from(position) * COUNTER_BYTES)
    }

    pub fn open_frame(&self, encoder: &mut CommandEncoder) {
        encoder.clear_buffer(&self.counters[0]);
        encoder.full_barrier();
        encoder.timestamp(&self.timestamps, 0);
    }

    pub fn open_pass(&self, encoder: &mut CommandEncoder, position: u32) {
        encoder.timestamp(&self.timestamps, 1 + 2 * position);
    }

    pub fn close_pass(&self, encoder: &mut CommandEncoder, position: u32) {
        encoder.timestamp(&self.timestamps, 2 + 2 * position);
    }

    /// Counts invocations until [`Self::end_counting`]. Vulkan requires both calls inside the same rendering scope, or both outside.
    pub fn begin_counting(&self, encoder: &mut CommandEncoder, position: u32) {
        if let Some(statistics) = &self.statistics {
            encoder.begin_statistics(statistics, position);
        }
    }

    pub fn end_counting(&self, encoder: &mut CommandEncoder) {
        encoder.end_statistics();
    }

    /// Copies timestamps and counters to the host. Everything before must be finished and visible, and every pass recorded.
    pub fn close_frame(&self, encoder: &mut CommandEncoder) {
        let [counters, counted] = &self.counters;
        encoder.copy_buffer(counters, 0, counted, 0, counters.bytes());
        encoder.copy_timestamps(&self.timestamps, stamps(self.passes));
        encoder.full_barrier();
    }

    /// Fills in the times and counts of a finished frame. `begun`: from when times are counted.
    pub fn read(&self, begun: Instant, plan: &Plan, sample: &mut FrameSample) -> Result<(), GpuError> {
        let passes = &mut sample.passes;
        let stamps = self.timestamps.read(stamps(passes.len() as u32));
        let counters = self.counters[1].contents();
        for (position, time) in passes.iter_mut().enumerate() {
            let (begin, end) = (stamps[1 + 2 * position], stamps[2 + 2 * position]);
            time.gpu_ns = Some(end.saturating_sub(begin));
            time.gpu_start_ns = Some(begin.saturating_sub(stamps[0]));
            let word = |at: usize| {
                let first = position * COUNTER_BYTES as usize + at;
                let bytes = counters.get(first..first + 4);
                bytes.and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes)
            };
            (time.rays_closest, time.rays_any) = (word(0).into(), word(4).into());
            (time.not_finite, time.rays_screen) = (word(8).into(), word(12).into());
            for (at, (_, count)) in time.counts.iter_mut().enumerate() {
                *count = word(OWN_COUNTERS as usize + 4 * at).into();
            }
        }
        if let Some(statistics) = &self.statistics {
            for (pass, position) in sample.passes.iter_mut().zip(0..) {
                pass.statistics = counts(statistics, pass, position)?;
            }
        }
        let waits = |b: &Batch| {
            let first = b.passes.start;
            plan.waits[b.waits.range()].iter().map(move |&w| (plan.batches[w as usize].passes.end - 1, first))
        };
        sample.waits = plan.batches.iter().flat_map(waits).collect();
        // With several queues, the last pass in the order need not be the last to end.
        let last = stamps.iter().copied().max().unwrap_or(stamps[0]);
        sample.gpu_ns = Some(last.saturating_sub(stamps[0]));
        sample.gpu_begin_ns = self.gpu.calibrate().and_then(|(device_now, now)| {
            let ago = device_now.checked_sub(stamps[0])?;
            ((now - begun).as_nanos() as u64).checked_sub(ago)
        });
        Ok(())
    }
}

/// Invocation counts of a pass; `None` if it only copies.
fn counts(from: &Statistics, pass: &PassTime, position: u32) -> Result<Option<measure::Statistics>, GpuError> {
    let mut counts = measure::Statistics::default();
    if pass.draws > 0 {
        [counts.input_vertices, counts.vertex_invocations, counts.clipping_primitives, counts.fragment_invocations] =
            from.drawn(position)?;
    } else if pass.dispatches > 0 {
        counts.compute_invocations = from.dispatched(position)?;
    } else {
        return Ok(None);
    }
    Ok(Some(counts))
}

/// Number of timestamps of a frame: one at its beginning, two per pass.
fn stamps(passes: u32) -> u32 {
    1 + 2 * passes
}

fn counters(gpu: &Gpu, passes: u32) -> Result<[gpu::Buffer; 2], GpuError> {
    let bytes = u64::from(passes) * COUNTER_BYTES;
    let make = |name, memory| gpu::Buffer::new(gpu, name, bytes, memory, BufferUse::Storage);
    Ok([make("counters", BufferMemory::Device)?, make("counts", BufferMemory::ReadBack)?])
}
