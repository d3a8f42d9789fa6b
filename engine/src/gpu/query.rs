//! Query pools: timestamps and shader invocations.
use super::{Buffer, BufferMemory, BufferUse, CommandEncoder, Gpu, GpuError};
use ash::vk;
use std::time::Instant;

/// Query pool for the timestamps of one frame, and a buffer from which the host reads them. To ask the pool itself makes some drivers wait for all
/// that was submitted.
pub(crate) struct Timestamps {
    gpu: Gpu,
    pool: vk::QueryPool,
    ticks: Buffer,
    capacity: u32,
}

impl Timestamps {
    /// A pool of `capacity` timestamps, all reset.
    pub fn new(gpu: &Gpu, capacity: u32) -> Result<Self, GpuError> {
        let bytes = u64::from(capacity) * TICK_BYTES;
        let ticks = Buffer::new(gpu, "timestamps", bytes, BufferMemory::ReadBack, BufferUse::Storage)?;
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(capacity);
        // SAFETY: `info` is complete.
        let pool = unsafe { gpu.raw().create_query_pool(&info, None) }.map_err(GpuError::call("vkCreateQueryPool"))?;
        let made = Self { gpu: gpu.clone(), pool, ticks, capacity };
        made.reset();
        Ok(made)
    }

    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Resets all queries. The device must have finished the frame that wrote them.
    pub fn reset(&self) {
        // SAFETY: hostQueryReset is on; the caller waited for the frame that used the pool.
        unsafe { self.gpu.raw().reset_query_pool(self.pool, 0, self.capacity) };
    }

    /// The first `count` timestamps in nanoseconds, relative to the device's own zero. The frame must be done, and have copied as many.
    pub fn read(&self, count: u32) -> Vec<u64> {
        let (words, _) = self.ticks.contents().as_chunks::<{ TICK_BYTES as usize }>();
        let ticks: Vec<u64> = words.iter().take(count as usize).map(|word| u64::from_ne_bytes(*word)).collect();
        let Some(&first) = ticks.first() else { return ticks };
        let (begin, bits) = (self.gpu.nanoseconds(first), self.gpu.0.timestamp_bits);
        ticks.into_iter().map(|t| begin + self.gpu.nanoseconds(ticks_since(first, t, bits))).collect()
    }
}

/// Bytes of a timestamp.
const TICK_BYTES: u64 = 8;

/// Ticks from `first` to `now` on a counter with `bits` valid bits, which may wrap around in between. A time shortly before
/// `first`, which another queue may report, counts as 0.
fn ticks_since(first: u64, now: u64, bits: u32) -> u64 {
    let valid = u64::MAX >> (64 - bits.clamp(1, 64));
    let since = now.wrapping_sub(first) & valid;
    if since > valid / 2 { 0 } else { since }
}

impl CommandEncoder {
    /// Writes timestamp `index` once everything before it is done.
    ///
    /// llvmpipe stores a timestamp with its binned raster work, which it executes at the next flush, while it runs dispatches at
    /// once. Without a flush, a following dispatch would finish before the timestamp is taken. An empty barrier flushes as well,
    /// without hiding a missing barrier from the validation layers.
    pub fn timestamp(&mut self, pool: &Timestamps, index: u32) {
        let (device, stage) = (pool.gpu.raw(), vk::PipelineStageFlags2::ALL_COMMANDS);
        // SAFETY: the pool was reset before this frame and `index` is below its capacity.
        unsafe { device.cmd_write_timestamp2(self.raw(), stage, pool.pool, index) };
        if pool.gpu.report().driver.starts_with("llvmpipe") {
            self.flush();
        }
    }

    /// Copies the first `count` timestamps to where the host reads them. All must have been written before.
    pub fn copy_timestamps(&mut self, from: &Timestamps, count: u32) {
        let (device, target) = (from.gpu.raw(), from.ticks.raw);
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: `count` is at most the capacity, for which the buffer has room.
        unsafe { device.cmd_copy_query_pool_results(self.raw(), from.pool, 0, count, target, 0, TICK_BYTES, flags) };
    }

    /// Counts shader invocations until [`Self::end_statistics`]. Both calls must be inside the same rendering scope, or both outside.
    pub fn begin_statistics(&mut self, statistics: &Statistics, index: u32) {
        let Statistics { draws, dispatches, .. } = *statistics;
        self.counting = Some(Counting { draws, dispatches, index, active: None });
    }

    /// Ends the counting that [`Self::begin_statistics`] started.
    pub fn end_statistics(&mut self) {
        if let Some(Counting { index, active: Some(pool), .. }) = self.counting.take() {
            // SAFETY: the command buffer is recording, and the query is active.
            unsafe { self.gpu().raw().cmd_end_query(self.raw(), pool, index) };
        }
    }

    /// Begins the query right before the first draw or dispatch, when its pipeline is bound: Mesa's lavapipe 25 looks at the
    /// compute pipeline when the query begins, and crashes if there is none.
    pub(super) fn count(&mut self, work: Work) {
        let commands = self.raw();
        if let Some(counting @ Counting { active: None, .. }) = &mut self.counting {
            let pool = if work == Work::Draw { counting.draws } else { counting.dispatches };
            counting.active = Some(pool);
            let (index, flags) = (counting.index, vk::QueryControlFlags::empty());
            // SAFETY: the pool was reset before this frame, `index` is below its capacity, and a queue that can do such work can
            // count it.
            unsafe { self.gpu().raw().cmd_begin_query(commands, pool, index, flags) };
        }
    }
}

/// Kind of work that is counted.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Work {
    Draw,
    Dispatch,
}

/// A request to count.
pub(super) struct Counting {
    draws: vk::QueryPool,
    dispatches: vk::QueryPool,
    index: u32,
    /// The pool of the running query.
    active: Option<vk::QueryPool>,
}

/// Query pools for the shader invocations of one frame. Draws and dispatches have pools of their own, because a compute queue
/// does not support the counters of draws.
pub(crate) struct Statistics {
    gpu: Gpu,
    draws: vk::QueryPool,
    dispatches: vk::QueryPool,
    capacity: u32,
}

impl Gpu {
    /// Whether the device can count shader invocations (pipelineStatisticsQuery).
    pub fn has_statistics(&self) -> bool {
        self.0.pipeline_statistics
    }
}

impl Statistics {
    /// Pools for `capacity` passes, all reset; `None` if the device cannot count.
    pub fn new(gpu: &Gpu, capacity: u32) -> Result<Option<Self>, GpuError> {
        if !gpu.has_statistics() {
            return Ok(None);
        }
        let none = vk::QueryPool::null();
        let mut made = Self { gpu: gpu.clone(), draws: none, dispatches: none, capacity };
        made.draws = made.make(
            vk::QueryPipelineStatisticFlags::INPUT_ASSEMBLY_VERTICES
                | vk::QueryPipelineStatisticFlags::VERTEX_SHADER_INVOCATIONS
                | vk::QueryPipelineStatisticFlags::CLIPPING_PRIMITIVES
                | vk::QueryPipelineStatisticFlags::FRAGMENT_SHADER_INVOCATIONS,
        )?;
        made.dispatches = made.make(vk::QueryPipelineStatisticFlags::COMPUTE_SHADER_INVOCATIONS)?;
        made.reset();
        Ok(Some(made))
    }

    fn make(&self, counters: vk::QueryPipelineStatisticFlags) -> Result<vk::QueryPool, GpuError> {
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::PIPELINE_STATISTICS)
            .query_count(self.capacity)
            .pipeline_statistics(counters);
        // SAFETY: `info` is complete, and the feature is on.
        unsafe { self.gpu.raw().create_query_pool(&info, None) }.map_err(GpuError::call("vkCreateQueryPool"))
    }

    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Resets all queries. The device must have finished the frame that wrote them.
    pub fn reset(&self) {
        for pool in [self.draws, self.dispatches] {
            // SAFETY: hostQueryReset is on; the caller waited for the frame that used the pools.
            unsafe { self.gpu.raw().reset_query_pool(pool, 0, self.capacity) };
        }
    }

    /// Input vertices, vertex shader invocations, triangles after clipping, and fragment shader invocations of a pass that drew.
    /// The pass must be done.
    pub fn drawn(&self, index: u32) -> Result<[u64; 4], GpuError> {
        self.read(self.draws, index)
    }

    /// Compute shader invocations of a pass that dispatched. The pass must be done.
    pub fn dispatched(&self, index: u32) -> Result<u64, GpuError> {
        self.read::<1>(self.dispatches, index).map(|[count]| count)
    }

    fn read<const COUNTERS: usize>(&self, pool: vk::QueryPool, index: u32) -> Result<[u64; COUNTERS], GpuError> {
        let mut counts = [[0_u64; COUNTERS]];
        let flags = vk::QueryResultFlags::TYPE_64;
        // SAFETY: the frame that wrote them is done; there are as many numbers as the pool has counters, in the order of their bits.
        unsafe { self.gpu.raw().get_query_pool_results(pool, index, &mut counts, flags) }
            .map_err(GpuError::call("vkGetQueryPoolResults"))?;
        Ok(counts[0])
    }
}

impl Drop for Statistics {
    fn drop(&mut self) {
        for pool in [self.draws, self.dispatches] {
            // SAFETY: its owner waits for the device before it drops a frame; a null pool is skipped.
            unsafe { self.gpu.raw().destroy_query_pool(pool, None) };
        }
    }
}

impl Drop for Timestamps {
    fn drop(&mut self) {
        // SAFETY: its owner waits for the device before it drops a frame.
        unsafe { self.gpu.raw().destroy_query_pool(self.pool, None) };
    }
}

impl Gpu {
    /// Device ticks in nanoseconds. Bits above the valid ones are ignored.
    fn nanoseconds(&self, ticks: u64) -> u64 {
        let bits = self.0.timestamp_bits;
        let valid = if bits >= 64 { ticks } else { ticks & ((1 << bits) - 1) };
        (valid as f64 * self.0.timestamp_period) as u64
    }

    /// The device's clock in nanoseconds, and the host's at the same time. `None` without VK_EXT_calibrated_timestamps.
    pub(crate) fn calibrate(&self) -> Option<(u64, Instant)> {
        let api = self.0.calibrated.as_ref()?;
        let domain = [vk::CalibratedTimestampInfoEXT::default().time_domain(vk::TimeDomainEXT::DEVICE)];
        let before = Instant::now();
        // SAFETY: the extension is on, and every device that has it knows its own clock.
        let (moments, _) = unsafe { api.get_calibrated_timestamps(&domain) }.ok()?;
        let middle = before + before.elapsed() / 2;
        Some((self.nanoseconds(moments[0]), middle))
    }
}

#[cfg(test)]
mod tests {
    use super::ticks_since;

    #[test]
    fn ticks_wrap_and_never_go_back() {
        assert_eq!(ticks_since(10, 25, 64), 15);
        assert_eq!(ticks_since(u64::MAX - 1, 3, 64), 5);
        assert_eq!(ticks_since(0xffff_fffe, 0x5_0000_0001, 32), 3); // bits above the valid ones are ignored
        assert_eq!(ticks_since(100, 98, 64), 0);
        assert_eq!(ticks_since(1, 0xffff_ffff, 32), 0);
    }
}
