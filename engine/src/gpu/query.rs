//! GPU time: pairs of timestamps in one query pool.
use super::{Gpu, GpuError};
use ash::vk;
use std::time::Instant;

/// A pool of timestamps for one frame in flight.
pub(crate) struct Timestamps {
    gpu: Gpu,
    pub(super) pool: vk::QueryPool,
    capacity: u32,
}

impl Timestamps {
    /// A pool of `capacity` timestamps, all reset.
    pub fn new(gpu: &Gpu, capacity: u32) -> Result<Self, GpuError> {
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(capacity);
        // SAFETY: `info` is complete.
        let pool = unsafe { gpu.raw().create_query_pool(&info, None) }.map_err(GpuError::call("vkCreateQueryPool"))?;
        let made = Self { gpu: gpu.clone(), pool, capacity };
        made.reset();
        Ok(made)
    }

    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Makes every timestamp writable again. The device must be done with the frame that wrote them.
    pub fn reset(&self) {
        // SAFETY: hostQueryReset is on; the caller waited for the frame that used the pool.
        unsafe { self.gpu.raw().reset_query_pool(self.pool, 0, self.capacity) };
    }

    /// The first `count` timestamps in nanoseconds, relative to the device's own zero.
    pub fn read(&self, count: u32) -> Result<Vec<u64>, GpuError> {
        let mut ticks = vec![0_u64; count.min(self.capacity) as usize];
        if ticks.is_empty() {
            return Ok(ticks);
        }
        // SAFETY: the frame that wrote them is done; the slice holds as many as are asked for.
        unsafe { self.gpu.raw().get_query_pool_results(self.pool, 0, &mut ticks, vk::QueryResultFlags::TYPE_64) }
            .map_err(GpuError::call("vkGetQueryPoolResults"))?;
        // Relative to the first: a counter with few bits may have wrapped in between.
        let first = ticks[0];
        let begin = self.gpu.nanoseconds(first);
        Ok(ticks.into_iter().map(|t| begin + self.gpu.nanoseconds(t.wrapping_sub(first))).collect())
    }
}

impl Drop for Timestamps {
    fn drop(&mut self) {
        // SAFETY: its owner waits for the device before it drops a frame.
        unsafe { self.gpu.raw().destroy_query_pool(self.pool, None) };
    }
}

impl Gpu {
    /// Device ticks as nanoseconds. Bits beyond the family's valid ones are noise.
    fn nanoseconds(&self, ticks: u64) -> u64 {
        let bits = self.0.timestamp_bits;
        let valid = if bits >= 64 { ticks } else { ticks & ((1 << bits) - 1) };
        (valid as f64 * self.0.timestamp_period) as u64
    }

    /// The device's clock, nanoseconds, and the host's at the same moment. `None` where the device cannot be asked.
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
