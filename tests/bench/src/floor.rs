//! The baseline: the same passes in hand-written Vulkan, with ash and nothing else.
//!
//! It exploits knowledge of the whole frame: one command buffer that is recorded again every frame, one memory barrier between two passes,
//! and four resources in rotation for the passes' outputs.
#![allow(unsafe_code)]

use crate::{BenchError, Clock, Contestant, Frame, Variant, Work};
use ash::vk;
use magpie_shaders::bench::{BufferParams, ImageParams, SIDE};
use magpie_shaders::{Address, BENCH_BUFFER_COMP, BENCH_IMAGE_ARRAY_COMP, Shader, StorageImage};
use std::ffi::CStr;

const NAME: &str = "floor";
/// Resources in rotation. Pass `i` writes resource `i % 4` while those of passes `i - 1` and `i - 2` are read.
const PLACES: u32 = 4;

fn failed<E: std::fmt::Display>(what: &'static str) -> impl Fn(E) -> BenchError {
    BenchError::failed(NAME, what)
}

/// Hand-written Vulkan.
pub struct Floor {
    vulkan: Vulkan,
    work: Work,
    slots: Bound<vk::Buffer>,
    address: Address,
    images: Vec<Bound<vk::Image>>,
    views: Vec<vk::ImageView>,
    result: Bound<vk::Buffer>,
    mapped: *mut u32,
    set_layout: vk::DescriptorSetLayout,
    sets: vk::DescriptorPool,
    set: vk::DescriptorSet,
    /// One for each variant.
    programs: [Program; 2],
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
}

struct Vulkan {
    _entry: ash::Entry,
    instance: ash::Instance,
    device: ash::Device,
    memory: vk::PhysicalDeviceMemoryProperties,
    family: u32,
    queue: vk::Queue,
}

#[derive(Clone, Copy, Default)]
struct Program {
    layout: vk::PipelineLayout,
    pipeline: vk::Pipeline,
}

/// A buffer or an image with its own memory.
struct Bound<T> {
    raw: T,
    memory: vk::DeviceMemory,
}

impl Vulkan {
    fn new(device_name: &str) -> Result<Self, BenchError> {
        // SAFETY: the loader stays in memory as long as `entry`, which is kept beside everything made from it.
        let entry = unsafe { ash::Entry::load() }.map_err(failed("Vulkan loader"))?;
        let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let info = vk::InstanceCreateInfo::default().application_info(&application);
        // SAFETY: `info` is complete.
        let instance = unsafe { entry.create_instance(&info, None) }.map_err(failed("vkCreateInstance"))?;
        // SAFETY: the instance is alive.
        let physical =
            unsafe { instance.enumerate_physical_devices() }.map_err(failed("vkEnumeratePhysicalDevices"))?;
        let named = |physical: &vk::PhysicalDevice| {
            // SAFETY: the device is one of this instance.
            let properties = unsafe { instance.get_physical_device_properties(*physical) };
            properties.device_name_as_c_str().is_ok_and(|name| name.to_string_lossy() == device_name)
        };
        let missing = BenchError::Failed { contestant: NAME, what: "device", message: format!("no {device_name}") };
        let physical = physical.into_iter().find(named).ok_or(missing)?;
        // SAFETY: the device is one of this instance.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let computes = |family: &vk::QueueFamilyProperties| family.queue_flags.contains(vk::QueueFlags::COMPUTE);
        let family = families.iter().position(computes).unwrap_or(0) as u32;
        // SAFETY: as above.
        let memory = unsafe { instance.get_physical_device_memory_properties(physical) };

        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let core = vk::PhysicalDeviceFeatures::default().shader_storage_image_array_dynamic_indexing(true);
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default()
            .buffer_device_address(true)
            .scalar_block_layout(true)
            .runtime_descriptor_array(true);
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&core)
            .push_next(&mut v12)
            .push_next(&mut v13);
        // SAFETY: `info` is complete; Magpie itself needs all these features of the same device.
        let device = unsafe { instance.create_device(physical, &info, None) }.map_err(failed("vkCreateDevice"))?;
        // SAFETY: one queue of this family was asked for.
        let queue = unsafe { device.get_device_queue(family, 0) };
        Ok(Self { _entry: entry, instance, device, memory, family, queue })
    }

    fn allocate(
        &self,
        needs: vk::MemoryRequirements,
        wanted: vk::MemoryPropertyFlags,
    ) -> Result<vk::DeviceMemory, BenchError> {
        let suits = |index: &u32| {
            needs.memory_type_bits & (1 << index) != 0
                && self.memory.memory_types[*index as usize].property_flags.contains(wanted)
        };
        let kind = (0..self.memory.memory_type_count).find(suits);
        let none = BenchError::Failed { contestant: NAME, what: "memory type", message: format!("{wanted:?}") };
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(kind.ok_or(none)?)
            .push_next(&mut flags);
        // SAFETY: `info` is complete and the feature for addresses is on.
        unsafe { self.device.allocate_memory(&info, None) }.map_err(failed("vkAllocateMemory"))
    }

    fn buffer(&self, bytes: u64, memory: vk::MemoryPropertyFlags) -> Result<Bound<vk::Buffer>, BenchError> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: `info` is complete.
        let raw = unsafe { self.device.create_buffer(&info, None) }.map_err(failed("vkCreateBuffer"))?;
        // SAFETY: the buffer was just made.
        let needs = unsafe { self.device.get_buffer_memory_requirements(raw) };
        let memory = self.allocate(needs, memory)?;
        // SAFETY: the memory was made for this buffer and holds nothing else.
        unsafe { self.device.bind_buffer_memory(raw, memory, 0) }.map_err(failed("vkBindBufferMemory"))?;
        Ok(Bound { raw, memory })
    }

    fn image(&self) -> Result<(Bound<vk::Image>, vk::ImageView), BenchError> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(vk::Format::R32_UINT)
            .extent(vk::Extent3D { width: SIDE, height: SIDE, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC);
        // SAFETY: `info` is complete.
        let raw = unsafe { self.device.create_image(&info, None) }.map_err(failed("vkCreateImage"))?;
        // SAFETY: the image was just made.
        let needs = unsafe { self.device.get_image_memory_requirements(raw) };
        let memory = self.allocate(needs, vk::MemoryPropertyFlags::DEVICE_LOCAL)?;
        // SAFETY: the memory was made for this image and holds nothing else.
        unsafe { self.device.bind_image_memory(raw, memory, 0) }.map_err(failed("vkBindImageMemory"))?;
        let info = vk::ImageViewCreateInfo::default()
            .image(raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(vk::Format::R32_UINT)
            .subresource_range(WHOLE);
        // SAFETY: the image has memory and the format of the view.
        let view = unsafe { self.device.create_image_view(&info, None) }.map_err(failed("vkCreateImageView"))?;
        Ok((Bound { raw, memory }, view))
    }

    fn program(
        &self,
        shader: &Shader,
        push_bytes: usize,
        sets: &[vk::DescriptorSetLayout],
    ) -> Result<Program, BenchError> {
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(shader.spirv);
        let ranges =
            [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(push_bytes as u32)];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(sets).push_constant_ranges(&ranges);
        // SAFETY: `info` is complete.
        let layout =
            unsafe { self.device.create_pipeline_layout(&info, None) }.map_err(failed("vkCreatePipelineLayout"))?;
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are a whole SPIR-V module.
        let module =
            unsafe { self.device.create_shader_module(&info, None) }.map_err(failed("vkCreateShaderModule"))?;
        const MAIN: &CStr = c"main";
        let stage =
            vk::PipelineShaderStageCreateInfo::default().stage(vk::ShaderStageFlags::COMPUTE).module(module).name(MAIN);
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout)];
        // SAFETY: the layout declares what the shader uses.
        let made = unsafe { self.device.create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
        // SAFETY: pipelines keep no reference to the module.
        unsafe { self.device.destroy_shader_module(module, None) };
        let pipelines = made.map_err(|(_, result)| failed("vkCreateComputePipelines")(result))?;
        Ok(Program { layout, pipeline: pipelines[0] })
    }
}

const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

impl Floor {
    /// On the device of this name.
    ///
    /// # Errors
    /// [`BenchError::Failed`] with the Vulkan call.
    pub fn new(device_name: &str) -> Result<Self, BenchError> {
        let vulkan = Vulkan::new(device_name)?;
        let device = &vulkan.device;
        let bytes = Variant::Buffer.bytes();
        let slots = vulkan.buffer(bytes * u64::from(PLACES), vk::MemoryPropertyFlags::DEVICE_LOCAL)?;
        let info = vk::BufferDeviceAddressInfo::default().buffer(slots.raw);
        // SAFETY: the buffer has memory and was made for addresses.
        let address = Address::new(unsafe { device.get_buffer_device_address(&info) });
        let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let result = vulkan.buffer(bytes, visible)?;
        // SAFETY: the memory is visible to the host, not mapped yet, and stays mapped until it is freed.
        let mapped = unsafe { device.map_memory(result.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) };
        let mapped = mapped.map_err(failed("vkMapMemory"))?.cast::<u32>();

        let (mut images, mut views) = (Vec::new(), Vec::new());
        for _ in 0..PLACES {
            let (image, view) = vulkan.image()?;
            images.push(image);
            views.push(view);
        }
        let bindings = [vk::DescriptorSetLayoutBinding::default()
            .descriptor_type(vk::DescriptorType::STORAGE_IMAGE)
            .descriptor_count(PLACES)
            .stage_flags(vk::ShaderStageFlags::COMPUTE)];
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: `info` is complete.
        let set_layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(failed("vkCreateDescriptorSetLayout"))?;
        let sizes = [vk::DescriptorPoolSize::default().ty(vk::DescriptorType::STORAGE_IMAGE).descriptor_count(PLACES)];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: `info` is complete.
        let sets = unsafe { device.create_descriptor_pool(&info, None) }.map_err(failed("vkCreateDescriptorPool"))?;
        let layouts = [set_layout];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(sets).set_layouts(&layouts);
        // SAFETY: the pool was made for one such set.
        let set = unsafe { device.allocate_descriptor_sets(&info) }.map_err(failed("vkAllocateDescriptorSets"))?[0];
        let infos: Vec<_> = views
            .iter()
            .map(|view| vk::DescriptorImageInfo::default().image_view(*view).image_layout(vk::ImageLayout::GENERAL))
            .collect();
        let write = vk::WriteDescriptorSet::default()
            .dst_set(set)
            .descriptor_type(vk::DescriptorType::STORAGE_IMAGE)
            .image_info(&infos);
        // SAFETY: the set is new, so no command uses it.
        unsafe { device.update_descriptor_sets(&[write], &[]) };

        let programs = [
            vulkan.program(&BENCH_BUFFER_COMP, size_of::<BufferParams>(), &[])?,
            vulkan.program(&BENCH_IMAGE_ARRAY_COMP, size_of::<ImageParams>(), &layouts)?,
        ];
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(vulkan.family);
        // SAFETY: the family is that of the device's queue.
        let pool = unsafe { device.create_command_pool(&info, None) }.map_err(failed("vkCreateCommandPool"))?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        // SAFETY: the pool was just made.
        let commands =
            unsafe { device.allocate_command_buffers(&info) }.map_err(failed("vkAllocateCommandBuffers"))?[0];
        // SAFETY: nothing is asked of a new fence.
        let fence = unsafe { device.create_fence(&vk::FenceCreateInfo::default(), None) };
        let fence = fence.map_err(failed("vkCreateFence"))?;
        let work = Work { variant: Variant::Buffer, passes: 0 };
        let floor = Self {
            vulkan,
            work,
            slots,
            address,
            images,
            views,
            result,
            mapped,
            set_layout,
            sets,
            set,
            programs,
            pool,
            commands,
            fence,
        };
        floor.settle_images()?;
        Ok(floor)
    }

    /// Transitions the images to the layout that they keep.
    fn settle_images(&self) -> Result<(), BenchError> {
        let barriers: Vec<_> = self
            .images
            .iter()
            .map(|image| {
                vk::ImageMemoryBarrier2::default()
                    .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                    .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
                    .new_layout(vk::ImageLayout::GENERAL)
                    .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .image(image.raw)
                    .subresource_range(WHOLE)
            })
            .collect();
        self.begin()?;
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the command buffer is being recorded; the images are new.
        unsafe { self.vulkan.device.cmd_pipeline_barrier2(self.commands, &info) };
        self.end()?;
        self.submit()?;
        self.wait()
    }

    fn begin(&self) -> Result<(), BenchError> {
        let device = &self.vulkan.device;
        // SAFETY: the device is done with the pool's only command buffer.
        unsafe { device.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
            .map_err(failed("vkResetCommandPool"))?;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the pool was just reset.
        unsafe { device.begin_command_buffer(self.commands, &info) }.map_err(failed("vkBeginCommandBuffer"))
    }

    fn end(&self) -> Result<(), BenchError> {
        // SAFETY: the command buffer is being recorded.
        unsafe { self.vulkan.device.end_command_buffer(self.commands) }.map_err(failed("vkEndCommandBuffer"))
    }

    fn submit(&self) -> Result<(), BenchError> {
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let infos = [vk::SubmitInfo2::default().command_buffer_infos(&commands)];
        // SAFETY: the command buffer was recorded, the fence is not signalled, and both are waited for before they change.
        unsafe { self.vulkan.device.queue_submit2(self.vulkan.queue, &infos, self.fence) }
            .map_err(failed("vkQueueSubmit2"))
    }

    fn wait(&self) -> Result<(), BenchError> {
        let fences = [self.fence];
        // SAFETY: the fence is the device's, and was given to a submission.
        unsafe { self.vulkan.device.wait_for_fences(&fences, true, u64::MAX) }.map_err(failed("vkWaitForFences"))?;
        // SAFETY: the submission is done.
        unsafe { self.vulkan.device.reset_fences(&fences) }.map_err(failed("vkResetFences"))
    }

    fn record(&self) -> Result<(), BenchError> {
        let (device, commands) = (&self.vulkan.device, self.commands);
        let Program { layout, pipeline } = self.programs[usize::from(self.work.variant == Variant::Image)];
        self.begin()?;
        // SAFETY: the command buffer is being recorded.
        unsafe { device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline) };
        if self.work.variant == Variant::Image {
            // SAFETY: the set has the layout of this pipeline.
            unsafe {
                device.cmd_bind_descriptor_sets(commands, vk::PipelineBindPoint::COMPUTE, layout, 0, &[self.set], &[]);
            }
        }
        for number in 0..self.work.passes {
            let slots = [number + PLACES - 1, number + PLACES - 2, number].map(|slot| slot % PLACES);
            match self.work.variant {
                Variant::Buffer => {
                    let bytes = self.work.variant.bytes();
                    let [first, second, result] = slots.map(|slot| self.address.offset(u64::from(slot) * bytes));
                    self.pass(layout, bytemuck::bytes_of(&BufferParams { first, second, result, number }));
                }
                Variant::Image => {
                    let [first, second, result] = slots.map(bytemuck::cast::<u32, StorageImage>);
                    self.pass(layout, bytemuck::bytes_of(&ImageParams { first, second, result, number }));
                }
            }
        }
        self.copy_last();
        self.end()
    }

    /// One pass and the barrier after it.
    fn pass(&self, layout: vk::PipelineLayout, params: &[u8]) {
        let (device, commands) = (&self.vulkan.device, self.commands);
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
            .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER | vk::PipelineStageFlags2::COPY)
            .dst_access_mask(
                vk::AccessFlags2::SHADER_STORAGE_READ
                    | vk::AccessFlags2::SHADER_STORAGE_WRITE
                    | vk::AccessFlags2::TRANSFER_READ,
            )];
        let info = vk::DependencyInfo::default().memory_barriers(&barrier);
        // SAFETY: the command buffer is being recorded; pipeline and set are bound, and `params` has the size in the layout.
        unsafe {
            device.cmd_push_constants(commands, layout, vk::ShaderStageFlags::COMPUTE, 0, params);
            device.cmd_dispatch(commands, 1, 1, 1);
            device.cmd_pipeline_barrier2(commands, &info);
        }
    }

    /// Copies the last pass's output to CPU-visible memory.
    fn copy_last(&self) {
        let (device, commands) = (&self.vulkan.device, self.commands);
        let slot = (self.work.passes + PLACES - 1) % PLACES;
        let bytes = self.work.variant.bytes();
        match self.work.variant {
            Variant::Buffer => {
                let region = [vk::BufferCopy::default().src_offset(u64::from(slot) * bytes).size(bytes)];
                // SAFETY: the command buffer is being recorded; both ranges lie inside of their buffers.
                unsafe { device.cmd_copy_buffer(commands, self.slots.raw, self.result.raw, &region) };
            }
            Variant::Image => {
                let layers =
                    vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
                let region = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(vk::Extent3D {
                    width: SIDE,
                    height: SIDE,
                    depth: 1,
                })];
                let image = self.images[slot as usize].raw;
                // SAFETY: the command buffer is being recorded; the image is in this layout, and the buffer large enough.
                unsafe {
                    device.cmd_copy_image_to_buffer(
                        commands,
                        image,
                        vk::ImageLayout::GENERAL,
                        self.result.raw,
                        &region,
                    );
                }
            }
        }
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::COPY)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::HOST)
            .dst_access_mask(vk::AccessFlags2::HOST_READ)];
        let info = vk::DependencyInfo::default().memory_barriers(&barrier);
        // SAFETY: the command buffer is being recorded.
        unsafe { device.cmd_pipeline_barrier2(commands, &info) };
    }
}

impl Contestant for Floor {
    fn name(&self) -> &'static str {
        NAME
    }

    fn about(&self) -> &'static str {
        "ash by hand: the command buffer recorded anew every frame, everything else made once; one memory barrier per pass"
    }

    fn prepare(&mut self, work: Work) -> Result<(), BenchError> {
        self.work = work;
        Ok(())
    }

    fn frame(&mut self, clock: &mut Clock) -> Result<Frame, BenchError> {
        // SAFETY: so many words are mapped, and the device does not use them between two frames.
        unsafe { self.mapped.write_bytes(0, Variant::Buffer.words()) };
        clock.start();
        self.record()?;
        clock.lap("record");
        self.submit()?;
        clock.lap("submit");
        clock.stop();
        self.wait()?;
        Ok(Frame { barriers: Some(self.work.passes + 1) })
    }

    fn result(&self) -> Result<Vec<u32>, BenchError> {
        // SAFETY: so many words are mapped and initialised, and the device is done with them.
        Ok(unsafe { std::slice::from_raw_parts(self.mapped, self.work.variant.words()) }.to_vec())
    }
}

impl Drop for Floor {
    fn drop(&mut self) {
        let device = &self.vulkan.device;
        // SAFETY: every frame was waited for, or failed; then waiting for the device is all that can be done. Everything was made
        // from this device and instance and is used no more.
        unsafe {
            let _ = device.device_wait_idle();
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
            for program in self.programs {
                device.destroy_pipeline(program.pipeline, None);
                device.destroy_pipeline_layout(program.layout, None);
            }
            device.destroy_descriptor_pool(self.sets, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
            for (image, view) in self.images.iter().zip(&self.views) {
                device.destroy_image_view(*view, None);
                device.destroy_image(image.raw, None);
                device.free_memory(image.memory, None);
            }
            for buffer in [&self.slots, &self.result] {
                device.destroy_buffer(buffer.raw, None);
                device.free_memory(buffer.memory, None);
            }
            device.destroy_device(None);
            self.vulkan.instance.destroy_instance(None);
        }
    }
}
