//! `vulkano-taskgraph` 0.35: its graph built once, and rebuilt every frame.
//!
//! The library has no transients: buffers and images are created once and reused every frame. The images are in one descriptor set that is
//! created once. Each task binds all that it needs, as tasks do not know of each other, and uses the unchecked functions, as the library
//! recommends.
#![allow(unsafe_code)]

use crate::{BenchError, Clock, Contestant, Frame, Variant, Work};
use magpie_shaders::bench::{BufferParams, ImageParams, SIDE};
use magpie_shaders::{Address, BENCH_BUFFER_COMP, BENCH_IMAGE_ARRAY_COMP, StorageImage};
use std::collections::BTreeMap;
use std::sync::Arc;
use vulkano::buffer::{Buffer, BufferCreateInfo, BufferUsage, Subbuffer};
use vulkano::descriptor_set::allocator::StandardDescriptorSetAllocator;
use vulkano::descriptor_set::layout::{
    DescriptorSetLayout, DescriptorSetLayoutBinding, DescriptorSetLayoutCreateInfo, DescriptorType,
};
use vulkano::descriptor_set::{DescriptorSet, WriteDescriptorSet};
use vulkano::device::{Device, DeviceCreateInfo, DeviceFeatures, Queue, QueueCreateInfo, QueueFlags};
use vulkano::format::Format;
use vulkano::image::view::ImageView;
use vulkano::image::{Image, ImageAspects, ImageCreateInfo, ImageLayout, ImageSubresourceLayers, ImageUsage};
use vulkano::instance::{Instance, InstanceCreateInfo};
use vulkano::memory::allocator::{AllocationCreateInfo, DeviceLayout, MemoryTypeFilter};
use vulkano::pipeline::compute::ComputePipelineCreateInfo;
use vulkano::pipeline::layout::{PipelineLayoutCreateInfo, PushConstantRange};
use vulkano::pipeline::{ComputePipeline, Pipeline, PipelineBindPoint, PipelineLayout, PipelineShaderStageCreateInfo};
use vulkano::shader::{ShaderModule, ShaderModuleCreateInfo, ShaderStages};
use vulkano::{Version, VulkanLibrary};
use vulkano_taskgraph::command_buffer::{
    BufferCopy, BufferImageCopy, CopyBufferInfo, CopyImageToBufferInfo, RecordingCommandBuffer,
};
use vulkano_taskgraph::graph::{CompileInfo, ExecutableTaskGraph, NodeId, ResourceMap, TaskGraph};
use vulkano_taskgraph::resource::{
    AccessTypes, Flight, HostAccessType, ImageLayoutType, Resources, ResourcesCreateInfo,
};
use vulkano_taskgraph::{Id, QueueFamilyType, Task, TaskContext, TaskResult};

const NAME: &str = "vulkano-taskgraph";

fn failed<E: std::fmt::Debug>(what: &'static str) -> impl Fn(E) -> BenchError {
    move |error| BenchError::failed(NAME, what)(format!("{error:?}"))
}

/// `vulkano-taskgraph`.
pub struct Taskgraph {
    queue: Arc<Queue>,
    resources: Arc<Resources>,
    flight: Id<Flight>,
    result: Id<Buffer>,
    mapped: Subbuffer<[u32]>,
    once: bool,
    work: Work,
    buffers: Vec<(Id<Buffer>, Address)>,
    images: Vec<Id<Image>>,
    world: World,
    graph: Option<ExecutableTaskGraph<World>>,
}

/// Resources that the tasks record with.
struct World {
    programs: [Arc<ComputePipeline>; 2],
    set: Option<Arc<DescriptorSet>>,
}

struct BufferPass(BufferParams);

impl Task for BufferPass {
    type World = World;

    unsafe fn execute(
        &self,
        commands: &mut RecordingCommandBuffer<'_>,
        _: &mut TaskContext<'_>,
        world: &World,
    ) -> TaskResult {
        let program = &world.programs[0];
        // SAFETY: the task declared what the addresses lead to; the layout has these push constants.
        unsafe {
            commands
                .bind_pipeline_compute_unchecked(program)
                .push_constants_unchecked(program.layout(), 0, bytemuck::bytes_of(&self.0))
                .dispatch_unchecked([1; 3]);
        }
        Ok(())
    }
}

struct ImagePass(ImageParams);

impl Task for ImagePass {
    type World = World;

    unsafe fn execute(
        &self,
        commands: &mut RecordingCommandBuffer<'_>,
        _: &mut TaskContext<'_>,
        world: &World,
    ) -> TaskResult {
        let program = &world.programs[1];
        if let Some(set) = &world.set {
            // SAFETY: the set has the layout of the program and outlives the frame.
            unsafe {
                commands.as_raw().bind_descriptor_sets_unchecked(
                    PipelineBindPoint::Compute,
                    program.layout(),
                    0,
                    &[set.as_raw()],
                    &[],
                );
            }
        }
        // SAFETY: the task declared the images that the indices stand for; the layout has these push constants.
        unsafe {
            commands
                .bind_pipeline_compute_unchecked(program)
                .push_constants_unchecked(program.layout(), 0, bytemuck::bytes_of(&self.0))
                .dispatch_unchecked([1; 3]);
        }
        Ok(())
    }
}

struct CopyBuffer(Id<Buffer>, Id<Buffer>);

impl Task for CopyBuffer {
    type World = World;

    unsafe fn execute(
        &self,
        commands: &mut RecordingCommandBuffer<'_>,
        _: &mut TaskContext<'_>,
        _: &World,
    ) -> TaskResult {
        let regions = &[BufferCopy { size: Variant::Buffer.bytes(), ..Default::default() }];
        let info = CopyBufferInfo { src_buffer: self.0, dst_buffer: self.1, regions, ..Default::default() };
        // SAFETY: the task declared both; they are as large as the region.
        unsafe { commands.copy_buffer_unchecked(&info) };
        Ok(())
    }
}

struct CopyImage(Id<Image>, Id<Buffer>);

impl Task for CopyImage {
    type World = World;

    unsafe fn execute(
        &self,
        commands: &mut RecordingCommandBuffer<'_>,
        _: &mut TaskContext<'_>,
        _: &World,
    ) -> TaskResult {
        let image_subresource =
            ImageSubresourceLayers { aspects: ImageAspects::COLOR, mip_level: 0, array_layers: 0..1 };
        let image_extent = [SIDE, SIDE, 1];
        let regions = &[BufferImageCopy { image_subresource, image_extent, ..Default::default() }];
        let info = CopyImageToBufferInfo {
            src_image: self.0,
            src_image_layout: ImageLayoutType::General,
            dst_buffer: self.1,
            regions,
            ..Default::default()
        };
        // SAFETY: the task declared both; the buffer holds the region.
        unsafe { commands.copy_image_to_buffer_unchecked(&info) };
        Ok(())
    }
}

impl Taskgraph {
    /// On the device of this name; with the graph built once, or rebuilt every frame.
    ///
    /// # Errors
    /// [`BenchError::Failed`] with the library's message.
    pub fn new(device_name: &str, once: bool) -> Result<Self, BenchError> {
        let library = VulkanLibrary::new().map_err(failed("loader"))?;
        let info = InstanceCreateInfo { max_api_version: Some(Version::V1_3), ..Default::default() };
        let instance = Instance::new(library, info).map_err(failed("instance"))?;
        let mut physical = instance.enumerate_physical_devices().map_err(failed("devices"))?;
        let physical = physical.find(|p| p.properties().device_name == device_name);
        let missing = BenchError::Failed { contestant: NAME, what: "device", message: format!("no {device_name}") };
        let physical = physical.ok_or(missing)?;
        let families = physical.queue_family_properties();
        let wanted = QueueFlags::COMPUTE | QueueFlags::GRAPHICS;
        let family = families.iter().position(|f| f.queue_flags.contains(wanted)).unwrap_or(0) as u32;
        let info = DeviceCreateInfo {
            queue_create_infos: vec![QueueCreateInfo { queue_family_index: family, ..Default::default() }],
            enabled_features: DeviceFeatures {
                buffer_device_address: true,
                runtime_descriptor_array: true,
                scalar_block_layout: true,
                shader_storage_image_array_dynamic_indexing: true,
                synchronization2: true,
                ..DeviceFeatures::empty()
            },
            ..Default::default()
        };
        let (device, mut queues) = Device::new(physical, info).map_err(failed("device"))?;
        let queue = queues.next().ok_or_else(|| failed("device")("no queue"))?;
        let resources = Resources::new(&device, &ResourcesCreateInfo::default());
        let flight = resources.create_flight(1).map_err(failed("flight"))?;
        let usage = BufferUsage::TRANSFER_DST;
        let result = buffer(&resources, usage, MemoryTypeFilter::PREFER_HOST | MemoryTypeFilter::HOST_RANDOM_ACCESS)?;
        let mapped = resources.buffer(result).map_err(failed("result"))?.buffer().clone();
        let programs = programs(&device, 1)?;
        Ok(Self {
            queue,
            resources,
            flight,
            result,
            mapped: Subbuffer::new(mapped).reinterpret(),
            once,
            work: Work { variant: Variant::Buffer, passes: 0 },
            buffers: Vec::new(),
            images: Vec::new(),
            world: World { programs, set: None },
            graph: None,
        })
    }

    /// Releases the buffers and images of the previous work; no frame is in flight.
    fn release(&mut self) -> Result<(), BenchError> {
        self.graph = None;
        self.world.set = None;
        for (id, _) in self.buffers.drain(..) {
            // SAFETY: no graph uses it any more.
            unsafe { self.resources.remove_buffer(id) }.map_err(failed("buffer"))?;
        }
        for id in self.images.drain(..) {
            // SAFETY: no graph uses it any more.
            unsafe { self.resources.remove_image(id) }.map_err(failed("image"))?;
        }
        Ok(())
    }

    fn declare(&self) -> Result<TaskGraph<World>, BenchError> {
        let most = self.work.passes + 2;
        let mut graph = TaskGraph::new(&self.resources, most, most);
        graph.add_host_buffer_access(self.result, HostAccessType::Read);
        let mut last = None;
        match self.work.variant {
            Variant::Buffer => {
                for (number, (buffer, result)) in self.buffers.iter().enumerate() {
                    let before = [1, 2].map(|ago| number.checked_sub(ago).map(|at| self.buffers[at]));
                    let [first, second] = before.map(|b| b.map(|(_, address)| address).unwrap_or_default());
                    let params = BufferParams { first, second, result: *result, number: number as u32 };
                    let mut node = graph.create_task_node("pass", QueueFamilyType::Compute, BufferPass(params));
                    for (read, _) in before.iter().flatten() {
                        node.buffer_access(*read, AccessTypes::COMPUTE_SHADER_STORAGE_READ);
                    }
                    node.buffer_access(*buffer, AccessTypes::COMPUTE_SHADER_STORAGE_WRITE);
                    let id = node.build();
                    link(&mut graph, &mut last, id)?;
                }
                if let Some((from, _)) = self.buffers.last() {
                    let task = CopyBuffer(*from, self.result);
                    let mut node = graph.create_task_node("copy", QueueFamilyType::Transfer, task);
                    node.buffer_access(*from, AccessTypes::COPY_TRANSFER_READ);
                    node.buffer_access(self.result, AccessTypes::COPY_TRANSFER_WRITE);
                    let id = node.build();
                    link(&mut graph, &mut last, id)?;
                }
            }
            Variant::Image => {
                for (number, image) in self.images.iter().enumerate() {
                    let before = [1, 2].map(|ago| number.checked_sub(ago));
                    let [first, second] = before.map(|b| bytemuck::cast(b.unwrap_or_default() as u32));
                    let number = number as u32;
                    let params = ImageParams { first, second, result: bytemuck::cast(number), number };
                    let mut node = graph.create_task_node("pass", QueueFamilyType::Compute, ImagePass(params));
                    for read in before.iter().flatten() {
                        let access = AccessTypes::COMPUTE_SHADER_STORAGE_READ;
                        node.image_access(self.images[*read], access, ImageLayoutType::General);
                    }
                    node.image_access(*image, AccessTypes::COMPUTE_SHADER_STORAGE_WRITE, ImageLayoutType::General);
                    let id = node.build();
                    link(&mut graph, &mut last, id)?;
                }
                if let Some(from) = self.images.last() {
                    let task = CopyImage(*from, self.result);
                    let mut node = graph.create_task_node("copy", QueueFamilyType::Transfer, task);
                    node.image_access(*from, AccessTypes::COPY_TRANSFER_READ, ImageLayoutType::General);
                    node.buffer_access(self.result, AccessTypes::COPY_TRANSFER_WRITE);
                    let id = node.build();
                    link(&mut graph, &mut last, id)?;
                }
            }
        }
        Ok(graph)
    }

    fn compile(&self, graph: TaskGraph<World>) -> Result<ExecutableTaskGraph<World>, BenchError> {
        let info = CompileInfo { queues: &[&self.queue], flight_id: self.flight, ..Default::default() };
        // SAFETY: the only queue does everything that the tasks declare.
        unsafe { graph.compile(&info) }.map_err(|error| failed("compile")(error.kind))
    }

    fn execute(&self, graph: &ExecutableTaskGraph<World>) -> Result<(), BenchError> {
        let map = ResourceMap::new(graph).map_err(failed("resource map"))?;
        // SAFETY: no other graph of these resources runs, and each frame is waited for.
        unsafe { graph.execute(map, &self.world, || ()) }.map_err(failed("execute"))
    }

    fn words(&self) -> Result<*mut [u32], BenchError> {
        let pointer = self.mapped.mapped_slice().map_err(failed("mapped memory"))?;
        let words = pointer.as_ptr().cast::<u32>();
        Ok(std::ptr::slice_from_raw_parts_mut(words, Variant::Buffer.words()))
    }
}

/// Makes each task depend on the one before.
fn link(graph: &mut TaskGraph<World>, last: &mut Option<NodeId>, next: NodeId) -> Result<(), BenchError> {
    match last.replace(next) {
        Some(before) => graph.add_edge(before, next).map_err(failed("edge")),
        None => Ok(()),
    }
}

fn buffer(resources: &Resources, usage: BufferUsage, memory: MemoryTypeFilter) -> Result<Id<Buffer>, BenchError> {
    let layout = DeviceLayout::from_size_alignment(Variant::Buffer.bytes(), 4);
    let layout = layout.ok_or_else(|| failed("buffer")("layout"))?;
    let info = BufferCreateInfo { usage, ..Default::default() };
    let allocation = AllocationCreateInfo { memory_type_filter: memory, ..Default::default() };
    resources.create_buffer(info, allocation, layout).map_err(failed("buffer"))
}

fn programs(device: &Arc<Device>, images: u32) -> Result<[Arc<ComputePipeline>; 2], BenchError> {
    let program = |shader: magpie_shaders::Shader, push: usize, sets| {
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(shader.spirv);
        // SAFETY: the words are a whole SPIR-V module for this device.
        let module = unsafe { ShaderModule::new(device.clone(), ShaderModuleCreateInfo::new(&words)) };
        let entry = module.map_err(failed("shader"))?.entry_point("main");
        let stage = PipelineShaderStageCreateInfo::new(entry.ok_or_else(|| failed("shader")("no main"))?);
        let stages = ShaderStages::COMPUTE;
        let info = PipelineLayoutCreateInfo {
            set_layouts: sets,
            push_constant_ranges: vec![PushConstantRange { stages, offset: 0, size: push as u32 }],
            ..Default::default()
        };
        let layout = PipelineLayout::new(device.clone(), info).map_err(failed("pipeline layout"))?;
        let info = ComputePipelineCreateInfo::stage_layout(stage, layout);
        ComputePipeline::new(device.clone(), None, info).map_err(failed("pipeline"))
    };
    let binding = DescriptorSetLayoutBinding {
        descriptor_count: images,
        stages: ShaderStages::COMPUTE,
        ..DescriptorSetLayoutBinding::descriptor_type(DescriptorType::StorageImage)
    };
    let info = DescriptorSetLayoutCreateInfo { bindings: BTreeMap::from([(0, binding)]), ..Default::default() };
    let set = DescriptorSetLayout::new(device.clone(), info).map_err(failed("descriptor set layout"))?;
    Ok([
        program(BENCH_BUFFER_COMP, size_of::<BufferParams>(), vec![])?,
        program(BENCH_IMAGE_ARRAY_COMP, size_of::<ImageParams>(), vec![set])?,
    ])
}

impl Contestant for Taskgraph {
    fn name(&self) -> &'static str {
        if self.once { "taskgraph built once" } else { "taskgraph rebuilt" }
    }

    fn about(&self) -> &'static str {
        if self.once {
            "vulkano-taskgraph: graph and edges made once by hand, executed every frame; resources made once"
        } else {
            "vulkano-taskgraph: graph and edges made by hand and compiled anew every frame; resources made once"
        }
    }

    fn prepare(&mut self, work: Work) -> Result<(), BenchError> {
        self.release()?;
        self.work = work;
        let device = self.queue.device().clone();
        match work.variant {
            Variant::Buffer => {
                let usage =
                    BufferUsage::STORAGE_BUFFER | BufferUsage::SHADER_DEVICE_ADDRESS | BufferUsage::TRANSFER_SRC;
                for _ in 0..work.passes {
                    let id = buffer(&self.resources, usage, MemoryTypeFilter::PREFER_DEVICE)?;
                    let made = self.resources.buffer(id).map_err(failed("buffer"))?.buffer().clone();
                    let address = made.device_address().map_err(failed("buffer address"))?;
                    self.buffers.push((id, Address::new(address.get())));
                }
            }
            Variant::Image => {
                let mut views = Vec::new();
                for _ in 0..work.passes {
                    let info = ImageCreateInfo {
                        format: Format::R32_UINT,
                        extent: [SIDE, SIDE, 1],
                        usage: ImageUsage::STORAGE | ImageUsage::TRANSFER_SRC,
                        ..Default::default()
                    };
                    let image = self.resources.create_image(info, AllocationCreateInfo::default());
                    let id = image.map_err(failed("image"))?;
                    let made = self.resources.image(id).map_err(failed("image"))?.image().clone();
                    views.push(ImageView::new_default(made).map_err(failed("image view"))?);
                    self.images.push(id);
                }
                self.world.programs = programs(&device, work.passes)?;
                let layout = self.world.programs[1].layout().set_layouts()[0].clone();
                let allocator = Arc::new(StandardDescriptorSetAllocator::new(device, Default::default()));
                let write = WriteDescriptorSet::image_view_with_layout_array(
                    0,
                    0,
                    views.into_iter().map(|image_view| vulkano::descriptor_set::DescriptorImageViewInfo {
                        image_view,
                        image_layout: ImageLayout::General,
                    }),
                );
                let set = DescriptorSet::new(allocator, layout, [write], []);
                self.world.set = Some(set.map_err(failed("descriptor set"))?);
            }
        }
        if self.once {
            self.graph = Some(self.compile(self.declare()?)?);
        }
        Ok(())
    }

    fn frame(&mut self, clock: &mut Clock) -> Result<Frame, BenchError> {
        // SAFETY: so many words are mapped, and the device does not use them between two frames.
        unsafe { &mut *self.words()? }.fill(0);
        clock.start();
        let rebuilt = if self.once {
            None
        } else {
            let graph = self.declare()?;
            clock.lap("declare");
            let graph = self.compile(graph)?;
            clock.lap("plan");
            Some(graph)
        };
        if let Some(graph) = self.graph.as_ref().or(rebuilt.as_ref()) {
            self.execute(graph)?;
        }
        clock.lap("record+submit");
        clock.stop();
        self.resources.flight(self.flight).map_err(failed("flight"))?.wait(None).map_err(failed("wait"))?;
        if rebuilt.is_some() {
            clock.retire(|| drop(rebuilt));
        }
        Ok(Frame { barriers: None })
    }

    fn result(&self) -> Result<Vec<u32>, BenchError> {
        // SAFETY: so many words are mapped, and the device is done with them.
        let words = unsafe { &*self.words()? };
        Ok(words[..self.work.variant.words()].to_vec())
    }
}
