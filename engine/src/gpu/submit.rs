//! Submission to up to three queues. A timeline semaphore per queue counts its submissions.
use super::device::lock;
use super::{CommandEncoder, Gpu, GpuError, SemaphoreValue};
use crate::graph::{Queue, Queues};
use ash::vk;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Submitted work. It is done when the queue's timeline reaches `value`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Submission {
    queue: Queue,
    value: u64,
}

/// One queue of the graph. Several may share one queue of the device.
pub(super) struct Lane {
    /// Shared by the lanes that use the same queue of the device.
    pub queue: Arc<Mutex<vk::Queue>>,
    pub family: u32,
    pub timeline: Timeline,
}

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

    /// Value that the newest submission signals.
    pub fn last(&self) -> u64 {
        self.last.load(Ordering::Acquire)
    }

    /// Value that the device has reached. For a lost device this is the maximum, since nothing runs on it any more.
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

    pub fn at(&self, value: u64) -> SemaphoreValue {
        SemaphoreValue { semaphore: self.semaphore, value }
    }

    /// # Safety
    /// The device is idle.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: by this function's contract.
        unsafe { device.destroy_semaphore(self.semaphore, None) };
    }
}

impl Gpu {
    /// Which queues the device has beside the graphics queue.
    pub fn queues(&self) -> Queues {
        let own = |queue: Queue| self.family(queue) != self.family(Queue::Graphics);
        Queues { async_compute: own(Queue::AsyncCompute), transfer: own(Queue::Transfer) }
    }

    /// Queue family of a queue; that of the graphics queue if the device has no other.
    pub fn family(&self, queue: Queue) -> u32 {
        self.0.lanes[queue.index()].family
    }

    /// Submits command buffers to a queue, to be executed in order after the submissions in `waits`.
    pub(crate) fn submit<'e>(
        &self,
        queue: Queue,
        encoders: impl IntoIterator<Item = &'e CommandEncoder>,
        waits: &[Submission],
    ) -> Result<Submission, GpuError> {
        let waits: Vec<_> = waits.iter().map(|w| self.signal_of(*w).submit_info()).collect();
        self.submit_with(queue, encoders, &waits, None)
    }

    /// The same after semaphores of the application.
    pub(crate) fn submit_after<'e>(
        &self,
        queue: Queue,
        encoders: impl IntoIterator<Item = &'e CommandEncoder>,
        waits: &[SemaphoreValue],
    ) -> Result<Submission, GpuError> {
        let waits: Vec<_> = waits.iter().map(|wait| wait.submit_info()).collect();
        self.submit_with(queue, encoders, &waits, None)
    }

    /// The semaphore value that the device reaches when `submission` is done.
    pub(crate) fn signal_of(&self, submission: Submission) -> SemaphoreValue {
        self.0.lanes[submission.queue.index()].timeline.at(submission.value)
    }

    /// Submits the copy of a picture to the display, on the graphics queue: it waits for the first semaphore and signals the second.
    pub(super) fn submit_for_display(
        &self,
        encoder: &CommandEncoder,
        wait: vk::SemaphoreSubmitInfo<'_>,
        signal: vk::SemaphoreSubmitInfo<'_>,
    ) -> Result<Submission, GpuError> {
        self.submit_with(Queue::Graphics, [encoder], &[wait], Some(signal))
    }

    fn submit_with<'e>(
        &self,
        queue: Queue,
        encoders: impl IntoIterator<Item = &'e CommandEncoder>,
        waits: &[vk::SemaphoreSubmitInfo<'_>],
        signal: Option<vk::SemaphoreSubmitInfo<'_>>,
    ) -> Result<Submission, GpuError> {
        let lane = &self.0.lanes[queue.index()];
        let commands: Vec<_> =
            encoders.into_iter().map(|e| vk::CommandBufferSubmitInfo::default().command_buffer(e.raw())).collect();
        let held = lock(&lane.queue);
        let value = lane.timeline.last() + 1;
        let signals: Vec<_> = signal.into_iter().chain([lane.timeline.at(value).submit_info()]).collect();
        let info = vk::SubmitInfo2::default()
            .command_buffer_infos(&commands)
            .wait_semaphore_infos(waits)
            .signal_semaphore_infos(&signals);
        // SAFETY: the queue is locked; the commands are finished and not pending.
        unsafe { self.raw().queue_submit2(*held, &[info], vk::Fence::null()) }
            .map_err(GpuError::call("vkQueueSubmit2"))?;
        lane.timeline.last.store(value, Ordering::Release);
        Ok(Submission { queue, value })
    }

    /// The graphics queue, which shows pictures as well.
    pub(super) fn graphics_queue(&self) -> &Mutex<vk::Queue> {
        &self.0.lanes[Queue::Graphics.index()].queue
    }

    /// Waits until the graphics queue is idle, the handing over of pictures included.
    pub(super) fn wait_for_presentation(&self) -> Result<(), GpuError> {
        let queue = lock(self.graphics_queue());
        // SAFETY: the queue is locked.
        unsafe { self.raw().queue_wait_idle(*queue) }.map_err(GpuError::call("vkQueueWaitIdle"))
    }

    /// Whether `submission` is done.
    pub(crate) fn is_done(&self, submission: Submission) -> bool {
        self.0.lanes[submission.queue.index()].timeline.done(self.raw()) >= submission.value
    }

    /// Waits until `submission` is done, then frees the resources that were dropped before it.
    pub(crate) fn wait(&self, submission: Submission) -> Result<(), GpuError> {
        self.0.lanes[submission.queue.index()].timeline.wait(self.raw(), submission.value)?;
        self.0.collect();
        Ok(())
    }
}
