//! Works on a device that an application opened, together with what else the application does there.
use super::device::{Logical, lock};
use super::device_selection;
use super::instance::Instance;
use super::{DeviceSetup, Gpu, GpuError, GpuOptions};
use crate::graph::Queue;
use ash::vk;
use std::any::Any;
use std::sync::Arc;

/// What Magpie keeps until it is done with an object of the application, such as the value whose drop destroys that object.
pub type Owner = Arc<dyn Any + Send + Sync>;

/// A Vulkan device of an application, for [`Gpu::adopt`].
pub struct AppDevice<'a> {
    /// The functions of the loader.
    pub entry: &'a ash::Entry,
    /// The instance.
    pub instance: &'a ash::Instance,
    /// The version for which the instance was made (`VkApplicationInfo::apiVersion`): at least 1.3.
    pub instance_version: u32,
    /// Whether VK_EXT_debug_utils is enabled on the instance. Magpie then names its objects and passes; it is needed for
    /// [`GpuOptions::validation`].
    pub debug_utils: bool,
    /// The physical device.
    pub physical: vk::PhysicalDevice,
    /// The device.
    pub device: &'a ash::Device,
    /// What the device was made with.
    pub setup: &'a DeviceSetup,
    /// Kept until nothing of Magpie uses the device any more.
    pub owner: Option<Owner>,
}

/// A semaphore, and the value from which on it counts as signalled. The value of a binary semaphore has no meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SemaphoreValue {
    pub(super) semaphore: vk::Semaphore,
    pub(super) value: u64,
}

impl SemaphoreValue {
    /// A semaphore of the application, for a frame to wait for.
    ///
    /// # Safety
    /// The semaphore belongs to the device of the frame that waits, and lives until that frame is done. When the frame is submitted, so is the
    /// work that signals this value, or the host signals it without waiting for Magpie before. Nobody else waits for the same signal of a
    /// binary semaphore.
    #[must_use]
    pub unsafe fn new(semaphore: vk::Semaphore, value: u64) -> Self {
        Self { semaphore, value }
    }

    /// The semaphore.
    #[must_use]
    pub fn semaphore(self) -> vk::Semaphore {
        self.semaphore
    }

    /// The value.
    #[must_use]
    pub fn value(self) -> u64 {
        self.value
    }

    /// For a submission that waits for this value, or signals it, with all its commands.
    pub fn submit_info(self) -> vk::SemaphoreSubmitInfo<'static> {
        vk::SemaphoreSubmitInfo::default()
            .semaphore(self.semaphore)
            .value(self.value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
    }
}

impl Gpu {
    /// Works on a device that an application opened. Neither the device nor its instance is destroyed when the last clone is dropped; all that
    /// Magpie made there is.
    ///
    /// Of `options`, `device` has no meaning here. `validation` says that the validation layers are enabled on the instance. Magpie then
    /// listens to their messages, those that are due to the application included, and binds only what a pass declares, without which
    /// synchronization validation reports hazards that are none.
    ///
    /// # Safety
    /// - The handles of `app` are valid and belong together, and outlive every clone of the result and all that is made from them: that is, the
    ///   owner keeps them, or the caller does.
    /// - `app.setup` says of nothing that it is enabled which is not.
    /// - From now until the last clone is dropped, whoever else uses the queues that `app.setup` gives to Magpie does so inside of
    ///   [`Gpu::with_queue`]; waiting for the idleness of a queue or of the whole device counts as a use.
    ///
    /// # Errors
    /// [`GpuError::Unsuited`] with a sentence for each thing that the device lacks, and failed Vulkan calls.
    pub unsafe fn adopt(app: &AppDevice<'_>, options: &GpuOptions) -> Result<Self, GpuError> {
        let refused = |name: &str, lacks| Err(GpuError::Unsuited { what: format!("the device {name}"), lacks });
        // Without that version there is nothing to ask.
        if app.instance_version < vk::API_VERSION_1_3 {
            let version = app.instance_version;
            let (major, minor) = (vk::api_version_major(version), vk::api_version_minor(version));
            let lacks = vec![format!("its instance was made for Vulkan {major}.{minor}, 1.3 is needed")];
            return refused("of the application", lacks);
        }
        let known = device_selection::enumerate(app.instance)?;
        let Some(index) = known.iter().position(|physical| *physical == app.physical) else {
            return refused("of the application", vec!["it is not one of its instance".to_owned()]);
        };
        let report = device_selection::report(app.instance, app.physical, index);
        let mut lacks = report.refusals.clone();
        // SAFETY: the handle was found among those of the instance.
        let families = unsafe { app.instance.get_physical_device_queue_family_properties(app.physical) };
        lacks.extend(app.setup.lacks(&families));
        if options.validation && !app.debug_utils {
            lacks.push("VK_EXT_debug_utils is not enabled, without which validation messages go unheard".to_owned());
        }
        if !lacks.is_empty() {
            return refused(&report.name, lacks);
        }
        let instance = Instance::adopt(app.entry, app.instance, app.debug_utils, options.validation)?;
        let logical = Logical::adopt(app.device, instance, app.owner.clone());
        Self::on(logical, app.physical, report, app.setup, options)
    }

    /// Calls `f` with a queue that frames are submitted to, and lets nobody else submit to it meanwhile. `f` must not call Magpie. Where the device
    /// has no own queue of that kind, it is the graphics queue.
    pub fn with_queue<T>(&self, queue: Queue, f: impl FnOnce(vk::Queue) -> T) -> T {
        f(*lock(&self.0.lanes[queue.index()].queue))
    }
}

#[cfg(test)]
mod tests {
    use super::super::submit::Timeline;
    use super::*;
    use crate::gpu::{Buffer, BufferMemory, BufferUse};
    use crate::graph::execute::{ExecuteOptions, Executor, Imports};
    use crate::graph::{Access, BufferDesc, Extent, Record, Switches};
    use std::thread::sleep;
    use std::time::Duration;

    /// A device, or `None` if `MAGPIE_NO_GPU` is set.
    fn gpu() -> Option<Gpu> {
        let is_wanted = std::env::var_os("MAGPIE_NO_GPU").is_none();
        is_wanted.then(|| Gpu::new(&GpuOptions::default()).unwrap())
    }

    fn reached(gpu: &Gpu, SemaphoreValue { semaphore, value }: SemaphoreValue) -> bool {
        // SAFETY: the semaphore is alive.
        unsafe { gpu.raw().get_semaphore_counter_value(semaphore) }.unwrap() >= value
    }

    /// Runs a frame that waits, with a pass on each of so many queues.
    fn waits(gpu: &Gpu, queues: u8) {
        let timeline = Timeline::new(gpu.raw()).unwrap();
        let switches = Switches { queues: Some(queues), ..Switches::default() };
        let mut executor = Executor::with(gpu, ExecuteOptions { switches, ..ExecuteOptions::default() }).unwrap();
        let (mut g, mut imports) = (executor.begin(Extent::new(8, 8)), Imports::default());
        for queue in [Queue::Graphics, Queue::Transfer] {
            let buffer =
                |name| Arc::new(Buffer::new(gpu, name, 16, BufferMemory::ReadBack, BufferUse::Storage).unwrap());
            let [from, to] = ["from", "to"].map(|name| (name, buffer(name)));
            let from = g.import_buffer(from.0, BufferDesc::new(16), Access::CopyRead, imports.buffer(&from.1));
            let to = g.import_buffer(to.0, BufferDesc::new(16), Access::HostRead, imports.buffer(&to.1));
            g.pass(&format!("copy.{queue:?}"), queue, |p| {
                let source = p.copy_from(from.read());
                let (_, target) = p.copy_to(to);
                ((), move |c: &mut Record<'_>| c.copy_buffer(source, 0, target, 0, 16))
            });
        }
        imports.wait_for(timeline.at(7));
        let frame = executor.submit(g, &imports).unwrap();
        let done = frame.done();
        sleep(Duration::from_millis(100));
        assert!(!frame.is_done() && !reached(gpu, done), "the frame did not wait");
        let info = vk::SemaphoreSignalInfo::default().semaphore(timeline.at(7).semaphore).value(7);
        // SAFETY: the semaphore is alive, and its value is lower.
        unsafe { gpu.raw().signal_semaphore(&info) }.unwrap();
        executor.finish(frame).unwrap();
        assert!(reached(gpu, done), "the frame is done, and its semaphore is not signalled");
        gpu.wait_idle().unwrap();
        // SAFETY: the device is idle.
        unsafe { timeline.destroy(gpu.raw()) };
    }

    #[test]
    fn a_frame_begins_once_the_semaphore_is_signalled() {
        let Some(gpu) = gpu() else { return };
        waits(&gpu, 1);
        waits(&gpu, 3);
    }

    #[test]
    fn nobody_submits_while_a_queue_is_held() {
        let Some(gpu) = gpu() else { return };
        let lane = &gpu.0.lanes[Queue::Graphics.index()].queue;
        gpu.with_queue(Queue::Graphics, |_| assert!(lane.try_lock().is_err(), "the queue is free"));
        assert!(lane.try_lock().is_ok(), "the queue is still held");
    }

    #[test]
    fn an_instance_of_an_older_version_is_refused() {
        let Some(gpu) = gpu() else { return };
        let (instance, setup) = (&gpu.0.logical.instance, DeviceSetup::empty());
        let app = AppDevice {
            entry: instance.entry(),
            instance: &instance.raw,
            instance_version: vk::API_VERSION_1_2,
            debug_utils: false,
            physical: gpu.physical(),
            device: gpu.raw(),
            setup: &setup,
            owner: None,
        };
        let lacks = |app: &AppDevice<'_>, validation: bool| {
            // SAFETY: the handles are those of `gpu`, which lives as long as this test, and nothing is claimed to be enabled.
            match unsafe { Gpu::adopt(app, &GpuOptions { validation, ..GpuOptions::default() }) } {
                Err(GpuError::Unsuited { lacks, .. }) => lacks,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(lacks(&app, false), ["its instance was made for Vulkan 1.2, 1.3 is needed"]);
        let stranger = AppDevice { instance_version: vk::API_VERSION_1_3, physical: vk::PhysicalDevice::null(), ..app };
        assert_eq!(lacks(&stranger, false), ["it is not one of its instance"]);
        let unheard = AppDevice { physical: gpu.physical(), ..stranger };
        let (without, with) = (lacks(&unheard, false), lacks(&unheard, true));
        assert!(with.len() == without.len() + 1 && with.iter().any(|s| s.contains("VK_EXT_debug_utils")), "{with:?}");
    }
}
