//! What a device is opened with: extensions, features and queues.
use super::device_selection::{self, family_for, graphics_family};
use super::rays::RaySupport;
use super::{GpuError, GpuOptions};
use crate::graph::Queue;
use ash::{amd, ext, khr, vk};
use std::ffi::{CStr, CString};
use std::ptr;

/// Extensions, features and queues with which a device is opened.
///
/// An application that opens the device itself takes [`DeviceSetup::of`], adds what it wants of the device beside, and opens it with
/// [`DeviceSetup::with_create_info`]. The same setup then tells [`Gpu::adopt`](super::Gpu::adopt) what is enabled, since Vulkan cannot be asked.
/// A device that was opened in another way is described by [`DeviceSetup::empty`] with what was enabled.
#[derive(Clone, Debug)]
pub struct DeviceSetup {
    /// Names of the device extensions.
    pub extensions: Vec<CString>,
    /// Features of Vulkan 1.0.
    pub core: vk::PhysicalDeviceFeatures,
    /// Features of Vulkan 1.2.
    pub v12: vk::PhysicalDeviceVulkan12Features<'static>,
    /// Features of Vulkan 1.3.
    pub v13: vk::PhysicalDeviceVulkan13Features<'static>,
    /// Features of VK_KHR_acceleration_structure.
    pub accel: vk::PhysicalDeviceAccelerationStructureFeaturesKHR<'static>,
    /// Features of VK_KHR_ray_query.
    pub ray_query: vk::PhysicalDeviceRayQueryFeaturesKHR<'static>,
    /// Features of VK_KHR_ray_tracing_pipeline.
    pub ray_pipeline: vk::PhysicalDeviceRayTracingPipelineFeaturesKHR<'static>,
    /// The queues, one entry per family.
    pub queues: Vec<QueueSetup>,
}

/// The queues of one family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueSetup {
    /// Index of the family.
    pub family: u32,
    /// Number of its queues that are made.
    pub count: u32,
    /// The one of them that Magpie submits to, from 0.
    pub index: u32,
}

const RAY_EXTENSIONS: [&CStr; 4] = [
    khr::acceleration_structure::NAME,
    khr::deferred_host_operations::NAME,
    khr::ray_query::NAME,
    khr::ray_tracing_pipeline::NAME,
];

impl DeviceSetup {
    /// What Magpie needs of a device, and what it uses where the device has it: one queue of each family that frames run on, and the ways to
    /// trace rays except those of [`GpuOptions::without_rays`].
    ///
    /// # Safety
    /// `instance` was made for Vulkan 1.3 or newer, and `physical` is one of its devices.
    ///
    /// # Errors
    /// [`GpuError::NoDevice`] with every reason why Magpie does not run on this device.
    pub unsafe fn of(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        let report = device_selection::report(instance, physical, 0);
        if !report.accepted {
            return Err(GpuError::NoDevice { refusals: vec![report.refusal()] });
        }
        Ok(Self::wanted(instance, physical, options))
    }

    /// The same of a device that is known to be accepted.
    pub(super) fn wanted(instance: &ash::Instance, physical: vk::PhysicalDevice, options: &GpuOptions) -> Self {
        let available = device_selection::extensions(instance, physical);
        let has = |name: &CStr| available.iter().any(|e| e.as_bytes() == name.to_bytes());
        // SAFETY: the handle comes from this instance.
        let (families, found) = unsafe {
            (
                instance.get_physical_device_queue_family_properties(physical),
                instance.get_physical_device_features(physical),
            )
        };
        let mut distinct: Vec<u32> = Queue::ALL.into_iter().filter_map(|queue| family_for(queue, &families)).collect();
        distinct.sort_unstable();
        distinct.dedup();
        let needed = device_selection::needed();
        let mut setup = Self { core: needed.core, v12: needed.v12, v13: needed.v13, ..Self::empty() };
        setup.queues = distinct.into_iter().map(|family| QueueSetup { family, count: 1, index: 0 }).collect();
        setup.core.sampler_anisotropy = found.sampler_anisotropy;
        setup.core.multi_draw_indirect = found.multi_draw_indirect;
        setup.core.draw_indirect_first_instance = found.draw_indirect_first_instance;
        setup.core.pipeline_statistics_query = found.pipeline_statistics_query;
        let welcome = [ext::calibrated_timestamps::NAME, amd::buffer_marker::NAME];
        welcome.into_iter().filter(|name| has(name)).for_each(|name| setup.enable(name));
        setup.enable_rays(RaySupport::of(instance, physical, has).without(&options.without_rays));
        setup
    }

    /// A device of which nothing is enabled and that has no queue.
    #[must_use]
    pub fn empty() -> Self {
        Self {
            extensions: Vec::new(),
            core: vk::PhysicalDeviceFeatures::default(),
            v12: vk::PhysicalDeviceVulkan12Features::default(),
            v13: vk::PhysicalDeviceVulkan13Features::default(),
            accel: vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default(),
            ray_query: vk::PhysicalDeviceRayQueryFeaturesKHR::default(),
            ray_pipeline: vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default(),
            queues: Vec::new(),
        }
    }

    /// Adds an extension, unless it is there.
    pub fn enable(&mut self, extension: &CStr) {
        if !self.has(extension) {
            self.extensions.push(extension.to_owned());
        }
    }

    /// Whether an extension is enabled.
    #[must_use]
    pub fn has(&self, extension: &CStr) -> bool {
        self.extensions.iter().any(|name| name.as_c_str() == extension)
    }

    fn enable_rays(&mut self, support: RaySupport) {
        support.extensions().into_iter().for_each(|name| self.enable(name));
        self.accel = self.accel.acceleration_structure(support.accel);
        self.ray_query = self.ray_query.ray_query(support.query);
        self.ray_pipeline = self
            .ray_pipeline
            .ray_tracing_pipeline(support.pipeline)
            .ray_tracing_pipeline_trace_rays_indirect(support.indirect);
    }

    /// The same without ray tracing by the driver.
    pub(super) fn without_rays(&self) -> Self {
        let mut setup = self.clone();
        setup.extensions.retain(|name| !RAY_EXTENSIONS.contains(&name.as_c_str()));
        setup.enable_rays(RaySupport::default());
        setup
    }

    /// The ray tracing that is enabled.
    pub(super) fn rays(&self, instance: &ash::Instance, physical: vk::PhysicalDevice) -> RaySupport {
        let mut support = RaySupport::of(instance, physical, |name| self.has(name));
        let is_on = |feature: vk::Bool32| feature == vk::TRUE && self.accel.acceleration_structure == vk::TRUE;
        support.query &= is_on(self.ray_query.ray_query);
        support.pipeline &= is_on(self.ray_pipeline.ray_tracing_pipeline);
        support.indirect &= support.pipeline && is_on(self.ray_pipeline.ray_tracing_pipeline_trace_rays_indirect);
        support.accel = support.query || support.pipeline;
        support
    }

    /// Calls `create` with the `VkDeviceCreateInfo` of this setup. `create` may chain further structures to it, except those that the setup
    /// has and those that Vulkan forbids beside `VkPhysicalDeviceVulkan12Features` and `VkPhysicalDeviceVulkan13Features`.
    pub fn with_create_info<T>(&self, create: impl FnOnce(vk::DeviceCreateInfo<'_>) -> T) -> T {
        let names: Vec<_> = self.extensions.iter().map(|name| name.as_ptr()).collect();
        let most = self.queues.iter().map(|queues| queues.count).max().unwrap_or(0);
        let priorities = vec![1.0; most as usize];
        let queue_info = |queues: &QueueSetup| {
            vk::DeviceQueueCreateInfo::default()
                .queue_family_index(queues.family)
                .queue_priorities(&priorities[..queues.count as usize])
        };
        let queues: Vec<_> = self.queues.iter().map(queue_info).collect();
        // Whatever the caller's copies were chained to is left out.
        let (mut v12, mut v13, mut accel, mut query, mut pipeline) =
            (self.v12, self.v13, self.accel, self.ray_query, self.ray_pipeline);
        (v12.p_next, v13.p_next) = (ptr::null_mut(), ptr::null_mut());
        (accel.p_next, query.p_next, pipeline.p_next) = (ptr::null_mut(), ptr::null_mut(), ptr::null_mut());
        let mut info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&names)
            .enabled_features(&self.core)
            .push_next(&mut v12)
            .push_next(&mut v13);
        if accel.acceleration_structure == vk::TRUE {
            info = info.push_next(&mut accel);
        }
        if query.ray_query == vk::TRUE {
            info = info.push_next(&mut query);
        }
        if pipeline.ray_tracing_pipeline == vk::TRUE {
            info = info.push_next(&mut pipeline);
        }
        create(info)
    }

    /// The queue families of a device, where those of which no queue is made can do nothing.
    pub(super) fn made(&self, families: &[vk::QueueFamilyProperties]) -> Vec<vk::QueueFamilyProperties> {
        let is_made = |family: u32| self.queues.iter().any(|queues| queues.family == family && queues.count > 0);
        let known = |(family, properties): (u32, &vk::QueueFamilyProperties)| {
            if is_made(family) { *properties } else { vk::QueueFamilyProperties::default() }
        };
        (0..).zip(families).map(known).collect()
    }

    /// Index of the queue of a family that Magpie submits to.
    pub(super) fn queue_index(&self, family: u32) -> u32 {
        self.queues.iter().find(|queues| queues.family == family).map_or(0, |queues| queues.index)
    }

    /// What it lacks for Magpie on a device with these queue families, one sentence each.
    pub(super) fn lacks(&self, families: &[vk::QueueFamilyProperties]) -> Vec<String> {
        let features = device_selection::Features { core: self.core, v12: self.v12, v13: self.v13 };
        let not_enabled = |name: &str| format!("the feature {name} is not enabled");
        let mut lacks: Vec<String> = features.missing().into_iter().map(not_enabled).collect();
        for QueueSetup { family, count, index } in &self.queues {
            match families.get(*family as usize).map(|properties| properties.queue_count) {
                None => lacks.push(format!("there is no queue family {family}")),
                Some(has) if *count > has => {
                    lacks.push(format!("queue family {family} has {has} queues, not {count}"));
                }
                Some(_) if index >= count => {
                    lacks.push(format!("queue {index} of family {family} is not among the {count} that are made"));
                }
                Some(_) => {}
            }
        }
        if graphics_family(&self.made(families)).is_none() {
            lacks.push("no queue is made of a family with graphics, compute and timestamps".to_owned());
        }
        lacks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn families() -> [vk::QueueFamilyProperties; 2] {
        let family = |flags, count| vk::QueueFamilyProperties {
            queue_flags: flags,
            queue_count: count,
            timestamp_valid_bits: 64,
            ..Default::default()
        };
        [
            family(vk::QueueFlags::TRANSFER, 2),
            family(vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER, 1),
        ]
    }

    /// A setup that has all that is needed.
    fn full() -> DeviceSetup {
        let needed = device_selection::needed();
        let queues = vec![QueueSetup { family: 1, count: 1, index: 0 }];
        DeviceSetup { core: needed.core, v12: needed.v12, v13: needed.v13, queues, ..DeviceSetup::empty() }
    }

    #[test]
    fn each_thing_that_is_not_enabled_is_a_sentence() {
        assert_eq!(full().lacks(&families()), [""; 0]);
        let mut setup = full();
        setup.core.geometry_shader = vk::FALSE;
        setup.v12.timeline_semaphore = vk::FALSE;
        setup.v13.synchronization2 = vk::FALSE;
        let wanted = ["geometry_shader", "timeline_semaphore", "synchronization2"];
        assert_eq!(setup.lacks(&families()), wanted.map(|name| format!("the feature {name} is not enabled")));
        // Of an empty setup, every feature that is needed, and the queue.
        let lacks = DeviceSetup::empty().lacks(&families());
        assert!(lacks.len() > 20 && lacks.last().is_some_and(|last| last.starts_with("no queue is made")), "{lacks:?}");
    }

    #[test]
    fn queues_that_are_not_made_are_found() {
        let with = |queues: &[(u32, u32, u32)]| {
            let queues = queues.iter().map(|&(family, count, index)| QueueSetup { family, count, index }).collect();
            DeviceSetup { queues, ..full() }.lacks(&families())
        };
        assert_eq!(with(&[(1, 1, 0), (0, 2, 1)]), [""; 0]);
        assert_eq!(with(&[(1, 1, 1)]), ["queue 1 of family 1 is not among the 1 that are made"]);
        assert_eq!(with(&[(1, 2, 0)]), ["queue family 1 has 1 queues, not 2"]);
        assert_eq!(with(&[(1, 1, 0), (2, 1, 0)]), ["there is no queue family 2"]);
        assert_eq!(with(&[(0, 1, 0)]), ["no queue is made of a family with graphics, compute and timestamps"]);
    }

    #[test]
    fn the_info_has_what_the_setup_has() {
        let mut setup = full();
        setup.enable(c"VK_EXT_of_the_application");
        setup.enable(c"VK_EXT_of_the_application");
        setup.queues[0].count = 3;
        setup.with_create_info(|info| {
            assert_eq!((info.enabled_extension_count, info.queue_create_info_count), (1, 1));
            // SAFETY: the info points to one queue description, which lives as long as this call.
            let queues = unsafe { *info.p_queue_create_infos };
            assert_eq!((queues.queue_family_index, queues.queue_count), (1, 3));
        });
    }

    #[test]
    fn rays_can_be_left_out() {
        let all = RaySupport { accel: true, query: true, pipeline: true, indirect: true, ..RaySupport::default() };
        let mut setup = full();
        setup.enable(khr::swapchain::NAME);
        setup.enable_rays(all);
        assert_eq!(setup.extensions.len(), 5);
        let without = setup.without_rays();
        assert_eq!(without.extensions, [khr::swapchain::NAME.to_owned()]);
        assert_eq!(without.accel.acceleration_structure, vk::FALSE);
        assert_eq!(without.ray_pipeline.ray_tracing_pipeline, vk::FALSE);
    }
}
