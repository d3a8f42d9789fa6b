//! Decides which devices are accepted, and says why others are refused.
use super::instance::Instance;
use super::rays::RaySupport;
use super::surface::WindowSurface;
use super::{GpuError, format};
use crate::graph::{Format, Queue};
use ash::{khr, vk};
use magpie_shaders::Rays;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ffi::CStr;

/// A Vulkan device, as `magpie devices` lists it.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceReport {
    /// Position in the loader's list, which `--device` accepts.
    pub index: usize,
    /// Name, as the driver gives it.
    pub name: String,
    /// Driver name and version.
    pub driver: String,
    /// `cpu`, `integrated`, `discrete`, `virtual` or `other`.
    pub kind: &'static str,
    /// Vulkan version, as `major.minor.patch`.
    pub api: String,
    /// Whether Magpie runs on it.
    pub accepted: bool,
    /// What it lacks, one sentence each; empty if it is accepted.
    pub refusals: Vec<String>,
    /// Ways to trace rays: always `software`, and `query` and `pipeline` if the driver has them.
    pub rays: Vec<&'static str>,
    /// Whether samplers filter 32-bit float images linearly. If not, shaders do.
    pub filters_float32: bool,
    /// Its queue families, in the order of their indices.
    pub queues: Vec<QueueFamilyReport>,
    /// Limits that Magpie depends on, by name; the unit is in the name.
    pub limits: BTreeMap<&'static str, u64>,
}

impl DeviceReport {
    /// Its name and all that it lacks, as one line.
    pub(super) fn refusal(&self) -> String {
        format!("{}: {}", self.name, self.refusals.join(", "))
    }
}

/// A queue family of a device.
#[derive(Clone, Debug, Serialize)]
pub struct QueueFamilyReport {
    /// Index of the family.
    pub family: u32,
    /// Number of queues in the family.
    pub count: u32,
    /// What the queues can do: `graphics`, `compute`, `transfer`.
    pub can: Vec<&'static str>,
    /// Valid bits of a timestamp; 0 means that it cannot be timed.
    pub timestamp_bits: u32,
}

/// Lists all Vulkan devices, with their features and the reasons why they are refused.
///
/// # Errors
/// [`GpuError::NoLoader`] and failed Vulkan calls.
pub fn devices() -> Result<Vec<DeviceReport>, GpuError> {
    let instance = Instance::new(false, None)?;
    let physical = enumerate(&instance.raw)?;
    Ok(physical.iter().enumerate().map(|(i, p)| report(&instance.raw, *p, i)).collect())
}

pub(super) fn enumerate(instance: &ash::Instance) -> Result<Vec<vk::PhysicalDevice>, GpuError> {
    // SAFETY: the instance is alive.
    unsafe { instance.enumerate_physical_devices() }.map_err(GpuError::call("vkEnumeratePhysicalDevices"))
}

/// The device that `wanted` selects by index or by a part of its name, or else the best accepted one. With a surface, devices that cannot show
/// pictures on it are refused.
pub(super) fn choose(
    instance: &Instance,
    wanted: Option<&str>,
    surface: Option<&WindowSurface>,
) -> Result<(vk::PhysicalDevice, DeviceReport), GpuError> {
    let physical = enumerate(&instance.raw)?;
    let with_surface = |(index, device): (usize, &vk::PhysicalDevice)| {
        let mut report = report(&instance.raw, *device, index);
        if surface.is_some_and(|surface| !shows_on(&instance.raw, *device, surface)) {
            report.refusals.push("it cannot show pictures in the window".to_owned());
            report.accepted = false;
        }
        report
    };
    let reports: Vec<_> = physical.iter().enumerate().map(with_surface).collect();
    let chosen = match wanted {
        Some(text) => {
            let named = reports.iter().find(|r| {
                let called = || !text.is_empty() && r.name.to_lowercase().contains(&text.to_lowercase());
                text.parse::<usize>().map_or_else(|_| called(), |index| r.index == index)
            });
            let Some(found) = named else {
                let known = reports.iter().map(|r| format!("{} = {}", r.index, r.name)).collect();
                return Err(GpuError::UnknownDevice { wanted: text.to_owned(), known });
            };
            if !found.accepted {
                return Err(GpuError::NoDevice { refusals: vec![found.refusal()] });
            }
            found
        }
        None => {
            let rank =
                |kind: &str| ["discrete", "integrated", "virtual", "cpu"].iter().position(|k| *k == kind).unwrap_or(4);
            let best = reports.iter().filter(|r| r.accepted).min_by_key(|r| (rank(r.kind), r.index));
            best.ok_or_else(|| GpuError::NoDevice { refusals: reports.iter().map(DeviceReport::refusal).collect() })?
        }
    };
    Ok((physical[chosen.index], chosen.clone()))
}

/// Whether the device's graphics queue can show pictures on a surface.
fn shows_on(instance: &ash::Instance, device: vk::PhysicalDevice, surface: &WindowSurface) -> bool {
    // SAFETY: the handle comes from this instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    let has_swapchains = extensions(instance, device).iter().any(|e| e.as_bytes() == khr::swapchain::NAME.to_bytes());
    has_swapchains && graphics_family(&families).is_some_and(|family| surface.is_supported(device, family))
}

/// Names of a device's extensions.
pub(super) fn extensions(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<String> {
    // SAFETY: the handle comes from this instance.
    let list = unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default();
    list.iter().filter_map(|e| e.extension_name_as_c_str().ok()?.to_str().ok().map(str::to_owned)).collect()
}

/// Describes a device of the instance; `index` is its position in the loader's list.
pub(super) fn report(raw: &ash::Instance, device: vk::PhysicalDevice, index: usize) -> DeviceReport {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut sizes = vk::PhysicalDeviceMaintenance4Properties::default();
    let mut properties =
        vk::PhysicalDeviceProperties2::default().push_next(&mut driver).push_next(&mut subgroup).push_next(&mut sizes);
    // SAFETY: the handle comes from this instance; the structs are core in 1.2, 1.1 and 1.3 and skipped by older drivers.
    unsafe { raw.get_physical_device_properties2(device, &mut properties) };
    let properties = properties.properties;
    let limits = properties.limits;
    let text = |chars: &[std::ffi::c_char]| {
        let bytes: Vec<u8> = chars.iter().map(|c| *c as u8).collect();
        CStr::from_bytes_until_nul(&bytes).map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
    };
    let version = |v| format!("{}.{}.{}", vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v));
    // SAFETY: as above.
    let families = unsafe { raw.get_physical_device_queue_family_properties(device) };
    let queues: Vec<_> = families
        .iter()
        .zip(0..)
        .map(|(f, family)| {
            let named = [
                (vk::QueueFlags::GRAPHICS, "graphics"),
                (vk::QueueFlags::COMPUTE, "compute"),
                (vk::QueueFlags::TRANSFER, "transfer"),
            ];
            let can = named.iter().filter(|(flag, _)| f.queue_flags.contains(*flag)).map(|(_, name)| *name).collect();
            QueueFamilyReport { family, count: f.queue_count, can, timestamp_bits: f.timestamp_valid_bits }
        })
        .collect();
    let available = extensions(raw, device);
    let has = |name: &CStr| available.iter().any(|e| e.as_bytes() == name.to_bytes());
    let rays = RaySupport::of(raw, device, has).ways().into_iter().map(Rays::name).collect();
    let mut refusals = Vec::new();
    if properties.api_version < vk::API_VERSION_1_3 {
        refusals.push(format!("it has Vulkan {}, 1.3 is needed", version(properties.api_version)));
    } else {
        refusals.extend(missing_features(raw, device));
    }
    if !subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::ARITHMETIC) {
        refusals.push("subgroup arithmetic is missing".to_owned());
    }
    if limits.max_color_attachments < COLOUR_ATTACHMENTS {
        let found = limits.max_color_attachments;
        refusals.push(format!("it draws into {found} colour attachments at once, {COLOUR_ATTACHMENTS} are needed"));
    }
    if graphics_family(&families).is_none() {
        refusals.push("no queue family does graphics and compute with timestamps".to_owned());
    }
    for (wanted, uses) in NEEDED_FORMATS {
        // SAFETY: as above.
        let found = unsafe { raw.get_physical_device_format_properties(device, format::vulkan(*wanted)) };
        if !found.optimal_tiling_features.contains(*uses) {
            refusals.push(format!("{wanted:?} images lack {:?}", *uses & !found.optimal_tiling_features));
        }
    }
    // SAFETY: as above.
    let floats = unsafe { raw.get_physical_device_format_properties(device, format::vulkan(Format::Rgba32Float)) };
    let filters_float32 = floats.optimal_tiling_features.contains(format::FILTER);
    DeviceReport {
        index,
        name: properties.device_name_as_c_str().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_owned(),
        kind: match properties.device_type {
            vk::PhysicalDeviceType::CPU => "cpu",
            vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
            vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
            vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
            _ => "other",
        },
        api: version(properties.api_version),
        accepted: refusals.is_empty(),
        refusals,
        rays,
        filters_float32,
        queues,
        limits: BTreeMap::from([
            ("max_buffer_bytes", sizes.max_buffer_size),
            ("max_image_edge", limits.max_image_dimension2_d.into()),
            ("max_push_constant_bytes", limits.max_push_constants_size.into()),
            ("max_memory_allocations", limits.max_memory_allocation_count.into()),
            ("timestamp_period_ps", (f64::from(limits.timestamp_period) * 1000.0) as u64),
        ]),
    }
}

/// Number of colour attachments of the G-buffer pass.
const COLOUR_ATTACHMENTS: u32 = 8;

/// Features that the frame needs of each format, beyond those that Vulkan guarantees.
const NEEDED_FORMATS: &[(Format, vk::FormatFeatureFlags)] = &[
    (Format::Rg16Snorm, ATTACHMENT),
    (Format::Rgba16Snorm, ATTACHMENT),
    (Format::Rgba16Float, ATTACHMENT),
    (Format::Rg16Float, ATTACHMENT),
    (Format::Rg32Uint, ATTACHMENT),
    (Format::Rgba8Srgb, ATTACHMENT),
    (Format::Rg8Unorm, ATTACHMENT),
    (Format::D32Float, DEPTH),
    (Format::Rgba32Float, STORAGE),
    (Format::R16Float, STORAGE),
    (Format::R16Unorm, STORAGE),
    (Format::Rg16Unorm, STORAGE),
    (Format::Rgba16Unorm, STORAGE),
    (Format::R8Unorm, STORAGE),
    (Format::Rgba8Unorm, STORAGE),
];
const ATTACHMENT: vk::FormatFeatureFlags = vk::FormatFeatureFlags::from_raw(
    vk::FormatFeatureFlags::COLOR_ATTACHMENT.as_raw() | vk::FormatFeatureFlags::SAMPLED_IMAGE.as_raw(),
);
const DEPTH: vk::FormatFeatureFlags = vk::FormatFeatureFlags::from_raw(
    vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT.as_raw() | vk::FormatFeatureFlags::SAMPLED_IMAGE.as_raw(),
);
const STORAGE: vk::FormatFeatureFlags = vk::FormatFeatureFlags::from_raw(
    vk::FormatFeatureFlags::STORAGE_IMAGE.as_raw() | vk::FormatFeatureFlags::SAMPLED_IMAGE.as_raw(),
);

/// The first family with graphics, compute and timestamps.
pub(super) fn graphics_family(families: &[vk::QueueFamilyProperties]) -> Option<u32> {
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().zip(0..).find(|(f, _)| f.queue_flags.contains(wanted) && f.timestamp_valid_bits > 0).map(|(_, i)| i)
}

/// The family for a queue. Beside graphics, the first family that supports the queue's work and no more general work.
pub(super) fn family_for(queue: Queue, families: &[vk::QueueFamilyProperties]) -> Option<u32> {
    let (must, must_not) = match queue {
        Queue::Graphics => return graphics_family(families),
        Queue::AsyncCompute => (vk::QueueFlags::COMPUTE, vk::QueueFlags::GRAPHICS),
        Queue::Transfer => (vk::QueueFlags::TRANSFER, vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE),
    };
    let suits = |f: &vk::QueueFamilyProperties| {
        // Copies on a transfer queue must be able to reach every pixel.
        let whole = queue != Queue::Transfer || f.min_image_transfer_granularity.width == 1;
        f.queue_flags.contains(must) && !f.queue_flags.intersects(must_not) && f.timestamp_valid_bits > 0 && whole
    };
    families.iter().zip(0..).find(|(f, _)| suits(f)).map(|(_, i)| i)
}

/// The required features, as they are enabled when the device is opened.
pub(super) struct Features {
    pub core: vk::PhysicalDeviceFeatures,
    pub v12: vk::PhysicalDeviceVulkan12Features<'static>,
    pub v13: vk::PhysicalDeviceVulkan13Features<'static>,
}

/// All features that the frame needs.
pub(super) fn needed() -> Features {
    Features {
        core: vk::PhysicalDeviceFeatures::default()
            .shader_storage_image_read_without_format(true)
            .shader_storage_image_write_without_format(true)
            .shader_sampled_image_array_dynamic_indexing(true)
            .shader_storage_image_array_dynamic_indexing(true)
            .fragment_stores_and_atomics(true)
            .vertex_pipeline_stores_and_atomics(true)
            .full_draw_index_uint32(true)
            .geometry_shader(true), // for the primitive id in fragment shaders
        v12: vk::PhysicalDeviceVulkan12Features::default()
            .descriptor_indexing(true)
            .runtime_descriptor_array(true)
            .descriptor_binding_partially_bound(true)
            .descriptor_binding_variable_descriptor_count(true)
            .descriptor_binding_update_unused_while_pending(true)
            .descriptor_binding_sampled_image_update_after_bind(true)
            .descriptor_binding_storage_image_update_after_bind(true)
            .shader_sampled_image_array_non_uniform_indexing(true)
            .buffer_device_address(true)
            .timeline_semaphore(true)
            .scalar_block_layout(true)
            .host_query_reset(true),
        v13: vk::PhysicalDeviceVulkan13Features::default()
            .dynamic_rendering(true)
            .synchronization2(true)
            .maintenance4(true)
            .shader_demote_to_helper_invocation(true),
    }
}

/// The required features that the device lacks, one sentence each.
fn missing_features(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<String> {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut found = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
    // SAFETY: the device speaks Vulkan 1.3, in which all three structs are core.
    unsafe { instance.get_physical_device_features2(device, &mut found) };
    let found = Features { core: found.features, v12, v13 };
    found.missing().into_iter().map(|name| format!("the feature {name} is missing")).collect()
}

impl Features {
    /// Names of the required features that are not among these.
    pub fn missing(&self) -> Vec<&'static str> {
        let wanted = needed();
        let mut missing = Vec::new();
        macro_rules! compare {
            ($group:ident: $($field:ident)*) => {
                $(if wanted.$group.$field == vk::TRUE && self.$group.$field != vk::TRUE {
                    missing.push(stringify!($field));
                })*
            };
        }
        compare!(core: shader_storage_image_read_without_format shader_storage_image_write_without_format
            shader_sampled_image_array_dynamic_indexing shader_storage_image_array_dynamic_indexing
            fragment_stores_and_atomics vertex_pipeline_stores_and_atomics full_draw_index_uint32 geometry_shader);
        compare!(v12: descriptor_indexing runtime_descriptor_array descriptor_binding_partially_bound
            descriptor_binding_variable_descriptor_count
            descriptor_binding_update_unused_while_pending descriptor_binding_sampled_image_update_after_bind
            descriptor_binding_storage_image_update_after_bind shader_sampled_image_array_non_uniform_indexing
            buffer_device_address timeline_semaphore scalar_block_layout host_query_reset);
        compare!(v13: dynamic_rendering synchronization2 maintenance4 shader_demote_to_helper_invocation);
        missing
    }
}
