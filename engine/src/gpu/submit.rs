//! Submission: one queue, one timeline semaphore that counts what was submitted.
use super::device::lock;
use super::{CommandEncoder, Gpu, GpuError};
use ash::vk;
use std::sync::atomic::{AtomicU64, Ordering};

/// Work that was handed to the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Submission(u64);

pub(super) struct Timeline {
    semaphore: vk::Semaphore,
    last: AtomicU64,
}

impl Timeline {
    pub fn new(device: &ash::Device) -> Result<Self, GpuError> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: all pointers outlive the call.
        let semaphore = unsafe { device.create_semaphore(&info, None) }.map_err(GpuError::call("vkCreateSemaphore"))?;
        Ok(Self { semaphore, last: AtomicU64::new(0) })
    }

    /// The value that the newest submission will signal.
    pub fn last(&self) -> u64 {
        self.last.load(Ordering::Acquire)
    }

    /// The value that the device has reached. A lost device has reached everything: nothing runs on it any more.
    pub fn done(&self, device: &ash::Device) -> u64 {
        // SAFETY: the semaphore is alive.
        unsafe { device.get_semaphore_counter_value(self.semaphore) }.unwrap_or(u64::MAX)
    }

    pub fn wait(&self, device: &ash::Device, value: u64) -> Result<(), GpuError> {
        let (semaphores, values) = ([self.semaphore], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: as above.
        unsafe { device.wait_semaphores(&info, u64::MAX) }.map_err(GpuError::call("vkWaitSemaphores"))
    }

    /// # Safety
    /// The device is idle.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: by this function's contract.
        unsafe { device.destroy_semaphore(self.semaphore, None) };
    }
}

impl Gpu {
    /// Hands finished commands to the device.
    pub(crate) fn submit(&self, encoder: &CommandEncoder) -> Result<Submission, GpuError> {
        let queue = lock(&self.0.queue);
        let value = self.0.timeline.last() + 1;
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(encoder.raw())];
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.0.timeline.semaphore)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let info = vk::SubmitInfo2::default().command_buffer_infos(&commands).signal_semaphore_infos(&signals);
        // SAFETY: the queue is locked; the commands are finished and not pending.
        unsafe { self.raw().queue_submit2(*queue, &[info], vk::Fence::null()) }
            .map_err(GpuError::call("vkQueueSubmit2"))?;
        self.0.timeline.last.store(value, Ordering::Release);
        Ok(Submission(value))
    }

    /// Waits until `submission` is done, then frees what waited for it.
    pub(crate) fn wait(&self, submission: Submission) -> Result<(), GpuError> {
        self.0.timeline.wait(self.raw(), submission.0)?;
        self.0.collect();
        Ok(())
    }
}
