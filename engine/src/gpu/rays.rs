//! What a device can do with rays beside running compute shaders, and how that is asked for.
use super::Gpu;
use super::instance::Instance;
use ash::{khr, vk};
use magpie_shaders::Rays;
use std::ffi::CStr;

/// Ray tracing by the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct RaySupport {
    /// Acceleration structures, which both ways need.
    pub accel: bool,
    /// Ray queries in compute shaders.
    pub query: bool,
    /// Ray-tracing pipelines.
    pub pipeline: bool,
    /// Their launch size can come from a buffer.
    pub indirect: bool,
    /// Bytes of a shader group's handle.
    pub handle_bytes: u32,
    /// Alignment of a handle in a table, bytes.
    pub handle_align: u32,
    /// Alignment of a table's begin, bytes.
    pub base_align: u32,
    /// Alignment of a build's working memory, bytes.
    pub scratch_align: u32,
}

impl RaySupport {
    /// What a device with these extensions has.
    pub fn of(instance: &Instance, device: vk::PhysicalDevice, extensions: &[String]) -> Self {
        let has = |name: &CStr| extensions.iter().any(|e| e.as_bytes() == name.to_bytes());
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
        unsafe { instance.raw.get_physical_device_features2(device, &mut features) };
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
        unsafe { instance.raw.get_physical_device_properties2(device, &mut properties) };
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

    /// What is left without some ways.
    pub fn without(mut self, ways: &[Rays]) -> Self {
        self.query &= !ways.contains(&Rays::Query);
        self.pipeline &= !ways.contains(&Rays::Pipeline);
        self.indirect &= self.pipeline;
        self.accel = self.query || self.pipeline;
        self
    }

    /// Every way that it gives.
    pub fn ways(self) -> Vec<Rays> {
        let has = |rays: &Rays| match rays {
            Rays::Software => true,
            Rays::Query => self.query,
            Rays::Pipeline => self.pipeline,
        };
        Rays::ALL.into_iter().filter(has).collect()
    }

    /// The extensions to ask for.
    pub fn extensions(self) -> Vec<&'static CStr> {
        let wanted = [
            (self.accel, khr::acceleration_structure::NAME),
            (self.accel, khr::deferred_host_operations::NAME),
            (self.query, khr::ray_query::NAME),
            (self.pipeline, khr::ray_tracing_pipeline::NAME),
        ];
        wanted.into_iter().filter(|(has, _)| *has).map(|(_, name)| name).collect()
    }

    /// What every buffer can be used for beside the rest.
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

/// The features of a [`RaySupport`], to be asked for when the device is opened.
#[derive(Default)]
pub(super) struct RayFeatures {
    accel: vk::PhysicalDeviceAccelerationStructureFeaturesKHR<'static>,
    query: vk::PhysicalDeviceRayQueryFeaturesKHR<'static>,
    pipeline: vk::PhysicalDeviceRayTracingPipelineFeaturesKHR<'static>,
}

impl RayFeatures {
    pub fn new(support: RaySupport) -> Self {
        Self {
            accel: vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(support.accel),
            query: vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(support.query),
            pipeline: vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default()
                .ray_tracing_pipeline(support.pipeline)
                .ray_tracing_pipeline_trace_rays_indirect(support.indirect),
        }
    }

    /// Adds what the support has to the request for a device.
    pub fn ask<'a>(&'a mut self, support: RaySupport, mut info: vk::DeviceCreateInfo<'a>) -> vk::DeviceCreateInfo<'a> {
        if support.accel {
            info = info.push_next(&mut self.accel);
        }
        if support.query {
            info = info.push_next(&mut self.query);
        }
        if support.pipeline {
            info = info.push_next(&mut self.pipeline);
        }
        info
    }
}

/// The calls of the extensions that were turned on.
pub(super) struct RayCalls {
    pub accel: khr::acceleration_structure::Device,
    pub pipeline: Option<khr::ray_tracing_pipeline::Device>,
}

impl RayCalls {
    /// `None` where the driver traces no rays.
    pub fn new(instance: &ash::Instance, device: &ash::Device, support: RaySupport) -> Option<Self> {
        support.accel.then(|| Self {
            accel: khr::acceleration_structure::Device::new(instance, device),
            pipeline: support.pipeline.then(|| khr::ray_tracing_pipeline::Device::new(instance, device)),
        })
    }
}

/// Opens a device with what it has for rays. A driver that fails then is told of no rays: it is better than none.
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

/// Why a way to trace was chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RayChoice {
    /// The way.
    pub rays: Rays,
    /// One sentence for the log.
    pub reason: String,
}

impl Gpu {
    /// Every way to trace that was turned on; software always is.
    pub fn rays(&self) -> Vec<Rays> {
        self.0.ray_support.ways()
    }

    /// The way that is taken when none is asked for. On processors Magpie's own walk: there a driver's is software as well, and
    /// measured slower (docs/rays.md). Else ray queries, whose hits cost no shader call, or the pipeline where only that exists.
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
        let mut told = None;
        let open = |support: RaySupport| {
            asked.push(support.ways());
            if support.accel { Err("initialisation failed") } else { Ok("device") }
        };
        let opened = with_rays_or_without(BOTH, open, |error| told = Some(*error));
        assert_eq!(opened, Ok(("device", RaySupport::default())));
        assert_eq!(told, Some("initialisation failed"));
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
