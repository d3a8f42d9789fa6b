//! Magpie inside of an application that has a Vulkan device of its own. Magpie renders into an image of the application, and the
//! application copies it to a buffer with commands of its own. The device waits for what is not done yet, the host does not.
//!
//! `cargo run --release -p magpie-demo --example embed -- embedded_%d.png`
#![allow(unsafe_code, reason = "an application that calls Vulkan")]
use anyhow::Context;
use magpie::config::Config;
use magpie::gpu::ash::{self, ext, vk};
use magpie::gpu::{AppDevice, DeviceSetup, Gpu, GpuError, GpuOptions, Image, SemaphoreValue};
use magpie::graph::{Access, Queue};
use magpie::scene::{self, Scene};
use magpie_passes::{FrameRequest, FrameTicket, RenderError, RenderOptions, Renderer, Slots};
use std::ffi::{CStr, c_void};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// What the validation layers say.
pub type Messages = Arc<Mutex<Vec<String>>>;

/// The device of the application. Magpie keeps it until it is done with it.
pub struct Device {
    entry: ash::Entry,
    instance: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    _messages: Option<Messages>,
    physical: vk::PhysicalDevice,
    setup: DeviceSetup,
    raw: ash::Device,
}

impl Device {
    /// Opens the first device on which Magpie runs. `more` adds what the application itself wants of it. With `messages` the validation
    /// layers are on, and leave there what they say.
    pub fn open(messages: Option<Messages>, more: impl FnOnce(&mut DeviceSetup)) -> anyhow::Result<Arc<Self>> {
        let user_data = messages.as_ref().map_or(std::ptr::null_mut(), |list| Arc::as_ptr(list).cast_mut().cast());
        let mut listener = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(on_message))
            .user_data(user_data);
        let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
        let layers = [c"VK_LAYER_KHRONOS_validation".as_ptr()];
        let extensions = [ext::debug_utils::NAME.as_ptr(), ext::validation_features::NAME.as_ptr()];
        let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let mut info = vk::InstanceCreateInfo::default().application_info(&application);
        if messages.is_some() {
            info = info.enabled_layer_names(&layers).enabled_extension_names(&extensions);
            info = info.push_next(&mut listener).push_next(&mut features);
        }
        // SAFETY: the loader stays as long as the entry; all that the infos point to outlives the calls, and the list of messages the messenger.
        unsafe {
            let entry = ash::Entry::load()?;
            let instance = entry.create_instance(&info, None)?;
            let messenger = match &messages {
                Some(_) => {
                    let api = ext::debug_utils::Instance::new(&entry, &instance);
                    let messenger = api.create_debug_utils_messenger(&listener, None)?;
                    Some((api, messenger))
                }
                None => None,
            };
            let options = options(messages.is_some());
            let suits = |physical| Some((physical, DeviceSetup::of(&instance, physical, &options).ok()?));
            let known = instance.enumerate_physical_devices()?;
            let (physical, mut setup) = known.into_iter().find_map(suits).context("Magpie runs on no device here")?;
            more(&mut setup);
            let raw = setup.with_create_info(|info| instance.create_device(physical, &info, None))?;
            Ok(Arc::new(Self { entry, instance, messenger, _messages: messages, physical, setup, raw }))
        }
    }

    /// Magpie on this device.
    pub fn magpie(self: &Arc<Self>) -> Result<Gpu, GpuError> {
        let app = AppDevice {
            entry: &self.entry,
            instance: &self.instance,
            instance_version: vk::API_VERSION_1_3,
            debug_utils: self.messenger.is_some(),
            physical: self.physical,
            device: &self.raw,
            setup: &self.setup,
            owner: Some(self.clone()),
        };
        // SAFETY: all handles are those of `open`, and the owner keeps them; the device was made with `setup`; the queue is only used
        // inside of `Gpu::with_queue`.
        unsafe { Gpu::adopt(&app, &options(self.messenger.is_some())) }
    }

    /// Memory for an image or a buffer.
    unsafe fn memory(
        &self,
        needs: vk::MemoryRequirements,
        wanted: vk::MemoryPropertyFlags,
    ) -> anyhow::Result<vk::DeviceMemory> {
        // SAFETY: the device is alive, and the type is one of its own.
        unsafe {
            let types = self.instance.get_physical_device_memory_properties(self.physical);
            let suits = |(at, kind): &(u32, &vk::MemoryType)| {
                needs.memory_type_bits & (1 << at) != 0 && kind.property_flags.contains(wanted)
            };
            let (at, _) = (0..).zip(types.memory_types_as_slice()).find(suits).context("no such memory")?;
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(at);
            Ok(self.raw.allocate_memory(&info, None)?)
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: targets and Magpie keep the device, so that they are gone.
        unsafe {
            self.raw.destroy_device(None);
            if let Some((api, messenger)) = &self.messenger {
                api.destroy_debug_utils_messenger(*messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

fn options(validation: bool) -> GpuOptions {
    GpuOptions { validation, ..GpuOptions::default() }
}

unsafe extern "system" fn on_message(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer hands over valid data; `user` is the list of `Device::open`, which the device keeps.
    let (text, list) =
        unsafe { (CStr::from_ptr((*data).p_message).to_string_lossy(), &*user.cast::<Mutex<Vec<String>>>()) };
    if let Ok(mut list) = list.lock() {
        list.push(text.into_owned());
    }
    vk::FALSE
}

/// An image that Magpie renders into, and the application's own work with it: commands that copy it to a buffer.
pub struct Target {
    device: Arc<Device>,
    size: [u32; 2],
    image: vk::Image,
    buffer: vk::Buffer,
    memory: [vk::DeviceMemory; 2],
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    /// Counts the copies that are done.
    copied: vk::Semaphore,
    /// Copies that were submitted.
    copies: AtomicU64,
}

impl Target {
    /// An image of this size in pixels, a buffer with room for it, and the recorded copy.
    pub fn new(device: &Arc<Device>, gpu: &Gpu, size: [u32; 2]) -> anyhow::Result<Arc<Self>> {
        let raw = &device.raw;
        let bytes = u64::from(size[0]) * u64::from(size[1]) * 4;
        let buffer_info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_DST);
        let pool_info = vk::CommandPoolCreateInfo::default().queue_family_index(gpu.family(Queue::Graphics));
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let host = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        // SAFETY: all that the infos point to outlives the calls; image and buffer are bound once, to memory made for them.
        unsafe {
            let image = raw.create_image(&image_info(size), None)?;
            let buffer = raw.create_buffer(&buffer_info, None)?;
            let memory = [
                device.memory(raw.get_image_memory_requirements(image), vk::MemoryPropertyFlags::DEVICE_LOCAL)?,
                device.memory(raw.get_buffer_memory_requirements(buffer), host)?,
            ];
            raw.bind_image_memory(image, memory[0], 0)?;
            raw.bind_buffer_memory(buffer, memory[1], 0)?;
            let pool = raw.create_command_pool(&pool_info, None)?;
            let one = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = raw.allocate_command_buffers(&one)?[0];
            let copied = raw.create_semaphore(&vk::SemaphoreCreateInfo::default().push_next(&mut kind), None)?;
            let (device, copies) = (device.clone(), AtomicU64::new(0));
            let made = Self { device, size, image, buffer, memory, pool, commands, copied, copies };
            made.record()?;
            Ok(Arc::new(made))
        }
    }

    /// Records the copy. Magpie leaves the image in the layout from which it is copied, and the semaphore makes it visible.
    unsafe fn record(&self) -> Result<(), vk::Result> {
        let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let region = [vk::BufferImageCopy::default().image_subresource(layer).image_extent(extent(self.size))];
        let for_host = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::COPY)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::HOST)
            .dst_access_mask(vk::AccessFlags2::HOST_READ)];
        let (raw, layout) = (&self.device.raw, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
        // SAFETY: the commands are new; image and buffer have room for the region.
        unsafe {
            raw.begin_command_buffer(self.commands, &vk::CommandBufferBeginInfo::default())?;
            raw.cmd_copy_image_to_buffer(self.commands, self.image, layout, self.buffer, &region);
            raw.cmd_pipeline_barrier2(self.commands, &vk::DependencyInfo::default().memory_barriers(&for_host));
            raw.end_command_buffer(self.commands)
        }
    }

    /// The image as Magpie knows it.
    pub fn image(self: &Arc<Self>, gpu: &Gpu) -> Result<Arc<Image>, GpuError> {
        let (info, owner) = (image_info(self.size), Some(self.clone() as _));
        // SAFETY: the image was made with this info and has memory; the owner keeps it; frames and copies wait for each other.
        unsafe { Image::adopt(gpu, "target", self.image, &info, owner) }.map(Arc::new)
    }

    /// What the next frame that is rendered into the image waits for: the newest copy.
    pub fn free(&self) -> SemaphoreValue {
        // SAFETY: the semaphore lives as long as the target, which Magpie keeps; the copy was submitted.
        unsafe { SemaphoreValue::new(self.copied, self.copies.load(Ordering::Acquire)) }
    }

    /// Submits the copy, which the device begins when the frame is done. The host waits for the copy before, whose buffer it overwrites.
    pub fn copy(&self, gpu: &Gpu, frame: SemaphoreValue) -> Result<(), vk::Result> {
        self.wait()?;
        let value = self.copies.load(Ordering::Acquire) + 1;
        let (waits, commands) =
            ([frame.submit_info()], [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)]);
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.copied)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let info = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(&signals);
        // SAFETY: the queue is held; the commands are not pending, since the copy before is done.
        gpu.with_queue(Queue::Graphics, |queue| unsafe {
            self.device.raw.queue_submit2(queue, &[info], vk::Fence::null())
        })?;
        self.copies.store(value, Ordering::Release);
        Ok(())
    }

    fn wait(&self) -> Result<(), vk::Result> {
        let (semaphores, values) = ([self.copied], [self.copies.load(Ordering::Acquire)]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is alive.
        unsafe { self.device.raw.wait_semaphores(&info, u64::MAX) }
    }

    /// Waits for the newest copy and returns it: RGBA, 8 bits each.
    pub fn pixels(&self) -> Result<Vec<u8>, vk::Result> {
        self.wait()?;
        let bytes = (self.size[0] * self.size[1] * 4) as usize;
        // SAFETY: the memory is the host's to see, has room for so many bytes, and nothing writes there.
        unsafe {
            let start = self.device.raw.map_memory(self.memory[1], 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())?;
            let pixels = std::slice::from_raw_parts(start.cast::<u8>(), bytes).to_vec();
            self.device.raw.unmap_memory(self.memory[1]);
            Ok(pixels)
        }
    }
}

impl Drop for Target {
    fn drop(&mut self) {
        let _ = self.wait(); // if it fails, the device is lost
        let raw = &self.device.raw;
        // SAFETY: Magpie keeps the target as long as it uses the image, and the copy is done.
        unsafe {
            raw.destroy_semaphore(self.copied, None);
            raw.destroy_command_pool(self.pool, None);
            raw.destroy_buffer(self.buffer, None);
            raw.destroy_image(self.image, None);
            self.memory.iter().for_each(|memory| raw.free_memory(*memory, None));
        }
    }
}

fn extent([width, height]: [u32; 2]) -> vk::Extent3D {
    vk::Extent3D { width, height, depth: 1 }
}

/// The picture has the format of display values; Magpie copies it there, and the application from there.
fn image_info(size: [u32; 2]) -> vk::ImageCreateInfo<'static> {
    vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(vk::Format::R8G8B8A8_UNORM)
        .extent(extent(size))
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::TRANSFER_SRC)
}

/// Submits a frame that ends in the image, once the device is done with what the application does there.
pub fn render(
    renderer: &mut Renderer,
    scene: &Scene,
    time: f64,
    image: &Arc<Image>,
    free: SemaphoreValue,
) -> Result<Option<FrameTicket>, RenderError> {
    let request = FrameRequest { camera: &scene.cameras[0], time, view: None, read_back: false };
    renderer.submit_with(request, &mut |g, imports, picture| {
        imports.wait_for(free);
        picture.copy_into(g, imports, "target", image, Access::CopyRead)
    })
}

/// Renders an animation by turns into two images, and hands each picture to `show` while the device works on the next.
pub fn animate(
    device: &Arc<Device>,
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    times: &[f64],
    mut show: impl FnMut(usize, Vec<u8>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let options = RenderOptions { width: size[0], height: size[1], ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &Config::default(), options)?;
    let targets = [Target::new(device, gpu, size)?, Target::new(device, gpu, size)?];
    let images = [targets[0].image(gpu)?, targets[1].image(gpu)?];
    for (frame, time) in times.iter().enumerate() {
        let target = &targets[frame % 2];
        let ticket = render(&mut renderer, scene, *time, &images[frame % 2], target.free())?.context("no pixels")?;
        if frame >= 2 {
            show(frame - 2, target.pixels()?)?;
        }
        target.copy(gpu, ticket.done())?;
    }
    for frame in times.len().saturating_sub(2)..times.len() {
        show(frame, targets[frame % 2].pixels()?)?;
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "embedded_%d.png".to_owned());
    let mut scene = scene::builtin("carousel").context("no such scene")?;
    scene::supply_missing(&mut scene);
    let device = Device::open(None, |_| ())?; // extensions and features of the application's own are added here
    let gpu = device.magpie()?;
    let size = [320, 180];
    animate(&device, &gpu, &scene, size, &[0.0, 0.5, 1.0], |frame, pixels| {
        let file = file.replace("%d", &frame.to_string());
        image::save_buffer(&file, &pixels, size[0], size[1], image::ColorType::Rgba8)?;
        println!("{file}");
        Ok(())
    })
}
