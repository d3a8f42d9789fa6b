//! Ray tracing support of a device, and how it is enabled.
use super::Gpu;
use ash::{khr, vk};
use magpie_shaders::Rays;
use std::ffi::CStr;

/// Ray tracing features and limits of the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct RaySupport {
    /// Acceleration structures, which ray queries and ray-tracing pipelines need.
    pub accel: bool,
    /// Ray queries in compute shaders.
    pub query: bool,
    /// Ray-tracing pipelines.
    pub pipeline: bool,
    /// Indirect launches of ray-tracing pipelines.
    pub indirect: bool,
    /// Size of a shader group handle, bytes.
    pub handle_bytes: u32,
    /// Alignment of a handle in a shader binding table, bytes.
    pub handle_align: u32,
    /// Alignment of the start of a region in a shader binding table, bytes.
    pub base_align: u32,
    /// Alignment of the scratch memory of a build, bytes.
    pub scratch_align: u32,
}

impl RaySupport {
    /// The support of a device where it has extensions.
    pub fn of(instance: &ash::Instance, device: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) -> Self {
        if !has(khr::acceleration_structure::NAME) || !has(khr::deferred_host_operations::NAME) {
            return Self::default();
        }
        let mut accel = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
        let mut query = vk::PhysicalDeviceRayQueryFeaturesKHR::default();
        let mut pipeline = vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut accel);
        let (has_query, has_pipeline) = (has(khr::ray_query::NAME), has(khr::ray_tracing_pipeline::NAME));
        if has_query {
            features = features.push_next(&mut query);
        }
        if has_pipeline {
            features = features.push_next(&mut pipeline);
        }
        // SAFETY: the handle comes from this instance, and the device has the extensions of these structs.
        unsafe { instance.get_physical_device_features2(device, &mut features) };
        if accel.acceleration_structure != vk::TRUE {
            return Self::default();
        }
        let mut structures = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut pipelines = vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut structures);
        if has_pipeline {
            properties = properties.push_next(&mut pipelines);
        }
        // SAFETY: as above.
        unsafe { instance.get_physical_device_properties2(device, &mut properties) };
        let query = has_query && query.ray_query == vk::TRUE;
        let traces = has_pipeline && pipeline.ray_tracing_pipeline == vk::TRUE;
        Self {
            accel: query || traces,
            query,
            pipeline: traces,
            indirect: traces && pipeline.ray_tracing_pipeline_trace_rays_indirect == vk::TRUE,
            handle_bytes: pipelines.shader_group_handle_size,
            handle_align: pipelines.shader_group_handle_alignment.max(1),
            base_align: pipelines.shader_group_base_alignment.max(1),
            scratch_align: structures.min_acceleration_structure_scratch_offset_alignment.max(1),
        }
    }

    /// The support without some ways to trace.
    pub fn without(mut self, ways: &[Rays]) -> Self {
        self.query &= !ways.contains(&Rays::Query);
        self.pipeline &= !ways.contains(&Rays::Pipeline);
        self.indirect &= self.pipeline;
        self.accel = self.query || self.pipeline;
        self
    }

    /// The ways to trace that it supports; software always.
    pub fn ways(self) -> Vec<Rays> {
        let has = |rays: &Rays| match rays {
            Rays::Software => true,
            Rays::Query => self.query,
            Rays::Pipeline => self.pipeline,
        };
        Rays::ALL.into_iter().filter(has).collect()
    }

    /// The device extensions to enable.
    pub fn extensions(self) -> Vec<&'static CStr> {
        let wanted = [
            (self.accel, khr::acceleration_structure::NAME),
            (self.accel, khr::deferred_host_operations::NAME),
            (self.query, khr::ray_query::NAME),
            (self.pipeline, khr::ray_tracing_pipeline::NAME),
        ];
        wanted.into_iter().filter(|(has, _)| *has).map(|(_, name)| name).collect()
    }

    /// Additional usage of every buffer.
    pub fn buffer_usage(self) -> vk::BufferUsageFlags {
        let mut usage = vk::BufferUsageFlags::empty();
        if self.accel {
            usage |= vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR
                | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR;
        }
        if self.pipeline {
            usage |= vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR;
        }
        usage
    }
}

/// Functions of the ray tracing extensions that are enabled.
pub(super) struct RayCalls {
    pub accel: khr::acceleration_structure::Device,
    pub pipeline: Option<khr::ray_tracing_pipeline::Device>,
}

impl RayCalls {
    /// `None` if the driver has no ray tracing.
    pub fn new(instance: &ash::Instance, device: &ash::Device, support: RaySupport) -> Option<Self> {
        support.accel.then(|| Self {
            accel: khr::acceleration_structure::Device::new(instance, device),
            pipeline: support.pipeline.then(|| khr::ray_tracing_pipeline::Device::new(instance, device)),
        })
    }
}

/// Opens a device with ray tracing; if the driver fails, opens it again without.
pub(super) fn with_rays_or_without<T, E>(
    support: RaySupport,
    mut open: impl FnMut(RaySupport) -> Result<T, E>,
    failed: impl FnOnce(&E),
) -> Result<(T, RaySupport), E> {
    match open(support) {
        Err(error) if support.accel => {
            failed(&error);
            Ok((open(RaySupport::default())?, RaySupport::default()))
        }
        opened => Ok((opened?, support)),
    }
}

/// A way to trace rays, and why it was chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RayChoice {
    /// The way that was chosen.
    pub rays: Rays,
    /// The reason, as one sentence for the log.
    pub reason: String,
}

impl Gpu {
    /// The ways to trace that are enabled; software always is.
    pub fn rays(&self) -> Vec<Rays> {
        self.0.ray_support.ways()
    }

    /// The default way to trace. On CPU devices it is Magpie's software traversal, which is faster there than the driver's
    /// (`docs/rays.md`). Otherwise it is ray queries, whose hits need no shader calls, or ray-tracing pipelines if those are all there is.
    pub fn choose_rays(&self) -> RayChoice {
        let (ways, report) = (self.rays(), self.report());
        let (rays, why) = if report.kind == "cpu" {
            (Rays::Software, "on a processor Magpie's own walk is faster than the driver's")
        } else if ways.contains(&Rays::Query) {
            (Rays::Query, "the device has ray queries")
        } else if ways.contains(&Rays::Pipeline) {
            (Rays::Pipeline, "the device has ray-tracing pipelines and no ray queries")
        } else {
            (Rays::Software, "the device traces no rays itself")
        };
        let names: Vec<_> = ways.iter().map(|w| w.name()).collect();
        RayChoice { rays, reason: format!("rays: {rays}, since {why} ({} has {})", report.name, names.join(", ")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: RaySupport = RaySupport {
        accel: true,
        query: true,
        pipeline: true,
        indirect: true,
        handle_bytes: 32,
        handle_align: 32,
        base_align: 64,
        scratch_align: 128,
    };

    #[test]
    fn a_driver_that_fails_with_rays_is_opened_without() {
        let mut asked = Vec::new();
        let mut reported = None;
        let open = |support: RaySupport| {
            asked.push(support.ways());
            if support.accel { Err("initialisation failed") } else { Ok("device") }
        };
        let opened = with_rays_or_without(BOTH, open, |error| reported = Some(*error));
        assert_eq!(opened, Ok(("device", RaySupport::default())));
        assert_eq!(reported, Some("initialisation failed"));
        assert_eq!(asked, [Rays::ALL.to_vec(), vec![Rays::Software]]);
    }

    #[test]
    fn a_driver_that_fails_without_rays_as_well_is_tried_no_further() {
        let mut tries = 0;
        let open = |_: RaySupport| -> Result<(), _> {
            tries += 1;
            Err(tries)
        };
        assert_eq!(with_rays_or_without(BOTH, open, |_| ()), Err(2));
        let never = |_: &i32| panic!("there were no rays to go without");
        assert_eq!(with_rays_or_without(RaySupport::default(), |_| Err::<(), _>(1), never), Err(1));
    }

    #[test]
    fn structures_go_with_the_last_way_that_needs_them() {
        assert_eq!(BOTH.without(&[Rays::Query]).ways(), [Rays::Software, Rays::Pipeline]);
        let neither = BOTH.without(&[Rays::Query, Rays::Pipeline]);
        assert!(!neither.accel && !neither.indirect && neither.extensions().is_empty());
        assert_eq!(neither.ways(), [Rays::Software]);
    }
}
