//! An opened device, and everything that lives as long as it does.
use super::bindless::Bindless;
use super::buffer::Buffer;
use super::device_selection::{self, DeviceReport};
use super::instance::Instance;
use super::pipeline::{Pipelines, pipeline_layout};
use super::pipeline_cache;
use super::placeholder;
use super::ray_pipeline::RayTables;
use super::rays::{RayCalls, RaySupport, with_rays_or_without};
use super::submit::{Lane, Timeline};
use super::surface::{Handles, WindowSurface};
use super::{DeviceSetup, GpuError, Owner};
use crate::graph::Queue;
use ash::{amd, ext, khr, vk};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use magpie_shaders::Rays;
use std::collections::HashMap;
use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Options for opening a device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Index, or part of the name; `None` takes the best accepted device.
    pub device: Option<String>,
    /// Enable the validation layers with synchronization validation. Up to version 1.3.239 at least, they may crash if a device
    /// is opened or closed while another thread uses one (Vulkan-ValidationLayers, issue 4391).
    pub validation: bool,
    /// Ways to trace rays that are not enabled even if the driver has them.
    pub without_rays: Vec<Rays>,
    /// Do not filter 32-bit float images with samplers, even if the device can; shaders then filter them.
    pub without_float_filter: bool,
}

/// An opened device. Clones share it.
#[derive(Clone)]
pub struct Gpu(pub(super) Arc<Inner>);

pub(super) struct Inner {
    pub allocator: ManuallyDrop<Mutex<Allocator>>,
    /// Bytes that were asked of the allocator and not given back. Its own report counts the gaps before aligned memory as well.
    allocated: AtomicU64,
    pub bindless: Bindless,
    pub pipelines: Arc<Pipelines>,
    pub pipeline_layout: vk::PipelineLayout,
    /// One per [`Queue`]. The timeline of the first one orders the freeing of resources.
    pub lanes: [Lane; Queue::ALL.len()],
    /// The queue families in use, each once, ascending.
    pub families: Vec<u32>,
    /// Bit mask of the memory types for buffers.
    pub buffer_types: u32,
    /// Properties of each memory type.
    pub memory_types: Vec<vk::MemoryPropertyFlags>,
    /// Least distance between images and buffers in the same memory, bytes (`bufferImageGranularity`).
    pub granularity: u64,
    garbage: Mutex<Vec<(u64, Garbage)>>,
    /// Buffers of [`Gpu::shared_buffer`] by name.
    shared_buffers: Mutex<HashMap<&'static str, Weak<Buffer>>>,
    /// The placeholder images at index 0 of the bindless set.
    placeholders: Mutex<Vec<Garbage>>,
    cache: vk::PipelineCache,
    cache_file: Option<std::path::PathBuf>,
    /// Whether one call can issue several indirect draws.
    pub multi_draw_indirect: bool,
    pub timestamp_period: f64,
    /// Number of valid bits in the timestamps of every queue; more cannot be compared between queues.
    pub timestamp_bits: u32,
    pub pipeline_statistics: bool,
    pub calibrated: Option<ext::calibrated_timestamps::Device>,
    /// VK_AMD_buffer_marker, which writes words to a buffer as the device executes commands.
    pub markers: Option<amd::buffer_marker::Device>,
    pub labels: Option<ext::debug_utils::Device>,
    pub ray_support: RaySupport,
    pub ray_calls: Option<RayCalls>,
    pub ray_tables: RayTables,
    pub raw: ash::Device,
    physical: vk::PhysicalDevice,
    report: DeviceReport,
    validation: bool,
    without_float_filter: bool,
    pub logical: Logical,
}

/// The logical device and its instance. Dropped last, and also if opening fails half-way.
pub(super) struct Logical {
    raw: ash::Device,
    pub instance: Instance,
    /// Whether it is destroyed when this is dropped.
    is_own: bool,
    /// Dropped after what was made from the instance.
    _owner: Option<Owner>,
}

impl Logical {
    /// A device of an application, which is not destroyed here.
    pub fn adopt(raw: &ash::Device, instance: Instance, owner: Option<Owner>) -> Self {
        Self { raw: raw.clone(), instance, is_own: false, _owner: owner }
    }
}

impl Drop for Logical {
    fn drop(&mut self) {
        if self.is_own {
            // SAFETY: everything made from the device was destroyed before.
            unsafe { self.raw.destroy_device(None) };
        }
    }
}

/// Objects to be freed once the device has finished using them.
pub(super) enum Garbage {
    Buffer(vk::Buffer, Allocation),
    Image {
        image: vk::Image,
        views: Vec<vk::ImageView>,
        sampled: Vec<u32>,
        storage: Vec<u32>,
        /// `None` if it is in a heap, which owns the memory.
        memory: Option<Allocation>,
        /// Kept for the views of an image of the application, whose handle is then null here.
        owner: Option<Owner>,
    },
    PlacedBuffer(vk::Buffer),
    Accel(vk::AccelerationStructureKHR),
    Memory(Allocation),
    Pipeline(vk::Pipeline),
}

/// Locks a mutex even if it is poisoned: every critical section leaves its data valid.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gpu {
    /// Opens a device according to `options`.
    ///
    /// # Errors
    /// [`GpuError::NoLoader`], [`GpuError::NoDevice`] with every reason, [`GpuError::UnknownDevice`], [`GpuError::MissingLayer`],
    /// and failed Vulkan calls.
    pub fn new(options: &GpuOptions) -> Result<Self, GpuError> {
        Ok(Self::open(options, None)?.0)
    }

    /// Opens a device, and the surface of a window if one is given.
    pub(super) fn open(
        options: &GpuOptions,
        window: Option<Handles>,
    ) -> Result<(Self, Option<WindowSurface>), GpuError> {
        let instance = Instance::new(options.validation, window.map(|handles| handles.display))?;
        let surface = window.map(|handles| WindowSurface::new(&instance, handles)).transpose()?;
        let (physical, report) = device_selection::choose(&instance, options.device.as_deref(), surface.as_ref())?;
        let mut setup = DeviceSetup::wanted(&instance.raw, physical, options);
        if surface.is_some() {
            setup.enable(khr::swapchain::NAME);
        }
        let create = |support: RaySupport| {
            let setup = if support.accel { setup.clone() } else { setup.without_rays() };
            let raw = setup.with_create_info(|info| {
                // SAFETY: features and extensions were checked when the device was chosen.
                unsafe { instance.raw.create_device(physical, &info, None) }
            });
            Ok::<_, GpuError>((raw.map_err(GpuError::call("vkCreateDevice"))?, setup))
        };
        let ((raw, setup), _) = with_rays_or_without(setup.rays(&instance.raw, physical), create, |error| {
            log::warn!("{}: {error} with ray tracing turned on; going on without", report.name);
        })?;
        let logical = Logical { raw, instance, is_own: true, _owner: None };
        Ok((Self::on(logical, physical, report, &setup, options)?, surface))
    }

    /// Makes all that lives as long as a device, which was made with this setup.
    pub(super) fn on(
        logical: Logical,
        physical: vk::PhysicalDevice,
        mut report: DeviceReport,
        setup: &DeviceSetup,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        let (raw, instance) = (logical.raw.clone(), &logical.instance);
        // SAFETY: the handle comes from this instance.
        let (families, properties) = unsafe {
            (
                setup.made(&instance.raw.get_physical_device_queue_family_properties(physical)),
                instance.raw.get_physical_device_properties(physical),
            )
        };
        let family = device_selection::graphics_family(&families)
            .ok_or_else(|| GpuError::NoDevice { refusals: report.refusals.clone() })?;
        let support = setup.rays(&instance.raw, physical).without(&options.without_rays);
        report.rays = support.ways().into_iter().map(Rays::name).collect();
        let lane_families = Queue::ALL.map(|queue| device_selection::family_for(queue, &families).unwrap_or(family));
        let bits_of = |f: u32| families[f as usize].timestamp_valid_bits;
        let timestamp_bits = lane_families.into_iter().map(bits_of).min().unwrap_or(0);
        let mut distinct = lane_families.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        // SAFETY: the device was made with these queues.
        let queue_of = |family: &u32| unsafe { raw.get_device_queue(*family, setup.queue_index(*family)) };
        let held: Vec<_> = distinct.iter().map(|family| Arc::new(Mutex::new(queue_of(family)))).collect();
        // SAFETY: the handle comes from this instance.
        let memory = unsafe { instance.raw.get_physical_device_memory_properties(physical) };
        let memory_types = memory.memory_types_as_slice().iter().map(|t| t.property_flags).collect();

        // Create the allocator, the descriptor set and the pipeline layout.
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: physical,
            debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
            buffer_device_address: true,
            allocation_sizes: gpu_allocator::AllocationSizes::default(),
        })
        .map_err(|e| GpuError::Call { call: "Allocator::new", code: e.to_string() })?;
        let anisotropy =
            if setup.core.sampler_anisotropy == vk::TRUE { properties.limits.max_sampler_anisotropy } else { 0.0 };
        let bindless = Bindless::new(&raw, anisotropy)?;
        let (cache, cache_file) = pipeline_cache::open(&raw, &properties)?;
        let pipeline_layout = pipeline_layout(&raw, bindless.layout)?;
        let lane = |at: usize| {
            let queue = held[distinct.partition_point(|f| *f < lane_families[at])].clone();
            Ok::<_, GpuError>(Lane { queue, family: lane_families[at], timeline: Timeline::new(&raw)? })
        };
        let lanes = [lane(0)?, lane(1)?, lane(2)?];
        let calibrated = setup
            .has(ext::calibrated_timestamps::NAME)
            .then(|| ext::calibrated_timestamps::Device::new(&instance.raw, &raw));
        let markers = setup.has(amd::buffer_marker::NAME).then(|| amd::buffer_marker::Device::new(&instance.raw, &raw));
        let labels = instance.debug_utils.then(|| ext::debug_utils::Device::new(&instance.raw, &raw));
        log::info!("device: {} ({})", report.name, report.driver);
        let gpu = Self(Arc::new(Inner {
            allocator: ManuallyDrop::new(Mutex::new(allocator)),
            allocated: AtomicU64::new(0),
            bindless,
            pipelines: Arc::default(),
            pipeline_layout,
            lanes,
            families: distinct,
            buffer_types: super::buffer::memory_types(&raw, support),
            ray_calls: RayCalls::new(&logical.instance.raw, &raw, support),
            ray_support: support,
            ray_tables: RayTables::default(),
            memory_types,
            granularity: properties.limits.buffer_image_granularity.max(1),
            garbage: Mutex::default(),
            shared_buffers: Mutex::default(),
            placeholders: Mutex::default(),
            cache,
            cache_file,
            multi_draw_indirect: setup.core.multi_draw_indirect == vk::TRUE,
            timestamp_period: f64::from(properties.limits.timestamp_period),
            timestamp_bits,
            pipeline_statistics: setup.core.pipeline_statistics_query == vk::TRUE,
            calibrated,
            markers,
            labels,
            raw,
            physical,
            report,
            validation: options.validation,
            without_float_filter: options.without_float_filter,
            logical,
        }));
        let placeholders = placeholder::images(&gpu)?;
        *lock(&gpu.0.placeholders) = placeholders;
        Ok(gpu)
    }

    /// Properties of the device.
    pub fn report(&self) -> &DeviceReport {
        &self.0.report
    }

    pub(super) fn without_float_filter(&self) -> bool {
        self.0.without_float_filter
    }

    /// Whether the validation layers are on.
    pub fn validates(&self) -> bool {
        self.0.validation
    }

    /// Checks that validation messages can be reported at all, for callers that rely on them.
    ///
    /// # Errors
    /// [`GpuError::NotValidated`] if the validation layers are off.
    pub fn need_validation(&self) -> Result<(), GpuError> {
        let device = self.report().name.clone();
        if self.validates() { Ok(()) } else { Err(GpuError::NotValidated { device }) }
    }

    /// Takes the validation messages since the last call.
    ///
    /// # Errors
    /// [`GpuError::Validation`] if there are any.
    pub fn check_validation(&self) -> Result<(), GpuError> {
        let messages = self.0.logical.instance.messages.take();
        if messages.is_empty() { Ok(()) } else { Err(GpuError::Validation { messages }) }
    }

    /// Waits until all submitted frames and uploads are done, then frees the resources that were dropped before.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`], and other failed Vulkan calls.
    pub fn wait_idle(&self) -> Result<(), GpuError> {
        for lane in &self.0.lanes {
            lane.timeline.wait(&self.0.raw, lane.timeline.last())?;
        }
        self.0.collect();
        Ok(())
    }

    /// Bytes of device memory in use, and number of images in the bindless set. Tests use it to find leaks.
    pub fn in_use(&self) -> (u64, u32) {
        (self.0.allocated.load(Ordering::Relaxed), self.0.bindless.in_use())
    }

    /// Device memory for one object or heap.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(super) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Allocation, GpuError> {
        let scheme = AllocationScheme::GpuAllocatorManaged;
        let desc = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme: scheme };
        let allocation = lock(&self.0.allocator).allocate(&desc).map_err(|e| {
            log::error!("{name}: {e}");
            GpuError::OutOfMemory { what: name.to_owned(), bytes: requirements.size }
        })?;
        self.0.allocated.fetch_add(allocation.size(), Ordering::Relaxed);
        Ok(allocation)
    }

    /// A buffer that all who ask for this name share. The first one makes it; it is freed when the last one drops it.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn shared_buffer<E>(
        &self,
        name: &'static str,
        make: impl FnOnce() -> Result<Arc<Buffer>, E>,
    ) -> Result<Arc<Buffer>, E> {
        let mut shared = lock(&self.0.shared_buffers);
        if let Some(known) = shared.get(name).and_then(Weak::upgrade) {
            return Ok(known);
        }
        let made = make()?;
        shared.insert(name, Arc::downgrade(&made));
        Ok(made)
    }

    pub(super) fn raw(&self) -> &ash::Device {
        &self.0.raw
    }

    pub(super) fn physical(&self) -> vk::PhysicalDevice {
        self.0.physical
    }

    /// Functions for swapchains, on a device that was opened with a surface.
    pub(super) fn swapchain_calls(&self) -> khr::swapchain::Device {
        khr::swapchain::Device::new(&self.0.logical.instance.raw, &self.0.raw)
    }

    /// Features of a format in optimal tiling.
    pub(super) fn format_features(&self, format: vk::Format) -> vk::FormatFeatureFlags {
        let instance = &self.0.logical.instance.raw;
        // SAFETY: the physical device belongs to the instance, which lives as long as the device.
        unsafe { instance.get_physical_device_format_properties(self.0.physical, format) }.optimal_tiling_features
    }

    pub(super) fn cache(&self) -> vk::PipelineCache {
        self.0.cache
    }
}

impl Inner {
    /// Functions of the ray tracing extensions.
    pub fn ray_calls(&self) -> Result<&RayCalls, GpuError> {
        let name = "VK_KHR_acceleration_structure";
        self.ray_calls.as_ref().ok_or(GpuError::MissingExtension { name, needed_for: "the driver traces no rays" })
    }

    /// Timeline of the graphics queue, on which every frame and every upload ends.
    pub fn timeline(&self) -> &Timeline {
        &self.lanes[Queue::Graphics.index()].timeline
    }

    /// Frees `what` once everything submitted so far is done.
    pub fn discard(&self, what: Garbage) {
        lock(&self.garbage).push((self.timeline().last(), what));
    }

    /// Frees the resources that the device has finished using.
    pub fn collect(&self) {
        let done = self.timeline().done(&self.raw);
        let mut free = Vec::new();
        lock(&self.garbage).retain_mut(|(value, what)| {
            let keep = *value > done;
            if !keep {
                free.push(std::mem::replace(what, Garbage::Buffer(vk::Buffer::null(), Allocation::default())));
            }
            keep
        });
        for what in free {
            self.free(what);
        }
    }

    fn free(&self, what: Garbage) {
        let memory = match what {
            Garbage::Buffer(buffer, memory) => {
                // SAFETY: the timeline shows that the device is done with it, and its owner was dropped.
                unsafe { self.raw.destroy_buffer(buffer, None) };
                Some(memory)
            }
            Garbage::PlacedBuffer(buffer) => {
                // SAFETY: as above.
                unsafe { self.raw.destroy_buffer(buffer, None) };
                None
            }
            Garbage::Accel(accel) => {
                if let Some(calls) = &self.ray_calls {
                    // SAFETY: as above.
                    unsafe { calls.accel.destroy_acceleration_structure(accel, None) };
                }
                None
            }
            Garbage::Memory(memory) => Some(memory),
            Garbage::Pipeline(pipeline) => {
                // SAFETY: as above.
                unsafe { self.raw.destroy_pipeline(pipeline, None) };
                None
            }
            Garbage::Image { image, views, sampled, storage, memory, owner } => {
                self.bindless.release(&self.raw, &sampled, &storage);
                // SAFETY: as above.
                unsafe {
                    for view in views {
                        self.raw.destroy_image_view(view, None);
                    }
                    self.raw.destroy_image(image, None);
                }
                drop(owner);
                memory
            }
        };
        let Some(memory) = memory else { return };
        self.allocated.fetch_sub(memory.size(), Ordering::Relaxed);
        if let Err(e) = lock(&self.allocator).free(memory) {
            log::warn!("memory could not be freed: {e}");
        }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // The last clone is gone, so nothing records or submits any more. Other queues of the device are not Magpie's to wait for. If it
        // fails, the device is lost and runs nothing.
        for lane in &self.lanes {
            let _ = lane.timeline.wait(&self.raw, lane.timeline.last());
        }
        for (_, what) in std::mem::take(&mut *lock(&self.garbage)) {
            self.free(what);
        }
        for what in std::mem::take(&mut *lock(&self.placeholders)) {
            self.free(what);
        }
        for (buffer, memory) in self.ray_tables.take() {
            self.free(Garbage::Buffer(buffer, memory));
        }
        if let Some(file) = &self.cache_file {
            pipeline_cache::save(&self.raw, self.cache, file);
        }
        // SAFETY: children go before the device; the allocator is dropped once, here.
        unsafe {
            self.pipelines.destroy(&self.raw);
            self.raw.destroy_pipeline_layout(self.pipeline_layout, None);
            self.bindless.destroy(&self.raw);
            self.lanes.iter().for_each(|lane| lane.timeline.destroy(&self.raw));
            self.raw.destroy_pipeline_cache(self.cache, None);
            ManuallyDrop::drop(&mut self.allocator);
        }
    }
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Gpu({}, {:?})", self.0.report.name, self.0.physical)
    }
}
