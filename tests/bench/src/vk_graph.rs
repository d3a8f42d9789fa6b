//! `vk-graph` 0.14: its graph rebuilt every frame, and its prepared command stream.
//!
//! Buffers of the rebuilt graph are leased from the library's pool, as in its examples; the prepared stream holds its own. Images are in
//! one descriptor set that is created once, and the graph only gets their accesses: a set per pass would measure the driver. The prepared
//! stream of this version cannot bind a set, so it only takes part with buffers.

use crate::{BenchError, Clock, Contestant, Frame, Variant, Work};
use magpie_shaders::bench::{BufferParams, ImageParams, SIDE};
use magpie_shaders::{Address, BENCH_BUFFER_COMP, BENCH_IMAGE_ARRAY_COMP, StorageImage};
use std::sync::Arc;
use vk_graph::Graph;
use vk_graph::driver::ash::vk;
use vk_graph::driver::buffer::{Buffer, BufferInfo};
use vk_graph::driver::cmd_buf::CommandBufferInfo;
use vk_graph::driver::compute::{ComputePipeline, ComputePipelineInfo};
use vk_graph::driver::descriptor_set::{DescriptorSet, DescriptorSetInfo, DescriptorSetUpdateInfo};
use vk_graph::driver::device::Device;
use vk_graph::driver::fence::Fence;
use vk_graph::driver::image::{Image, ImageInfo};
use vk_graph::driver::instance::{Instance, InstanceInfo};
use vk_graph::driver::shader::Shader;
use vk_graph::driver::sync::AccessType;
use vk_graph::node::BufferNode;
use vk_graph::pool::hash::HashPool;
use vk_graph::pool::{Pool, PoolConfig};
use vk_graph::stream::{BufferArg, CommandStream, CommandStreamMut};
use vk_graph::submission::{QueueSubmitInfo, RecordSelection};

const NAME: &str = "vk-graph";
/// The first queue family supports compute on every device that Magpie accepts.
const FAMILY: u32 = 0;
/// Objects of the pool beside those of the passes.
const SPARE: usize = 16;

fn failed<E: std::fmt::Debug>(what: &'static str) -> impl Fn(E) -> BenchError {
    move |error| BenchError::failed(NAME, what)(format!("{error:?}"))
}

/// `vk-graph`.
pub struct VkGraph {
    device: Device,
    prepared: bool,
    work: Work,
    stream: Option<CommandStream<BufferArg>>,
    images: Vec<Arc<Image>>,
    set: Option<DescriptorSet>,
    programs: [ComputePipeline; 2],
    result: Arc<Buffer>,
    fence: Fence,
    pool: HashPool,
}

/// Adds the buffer passes and the copy. The library's graph and its command stream have the same methods, but no common trait.
macro_rules! add_buffer_passes {
    ($graph:expr, $bench:expr, $pool:expr, $result:expr) => {{
        let (graph, bench, pool) = ($graph, $bench, $pool);
        let mut before = [None, None];
        for number in 0..bench.work.passes {
            let lease = pool.resource(buffer_info()).map_err(failed("buffer"))?;
            let target = Address::new(lease.device_address());
            let node = graph.bind_resource(lease);
            let mut pass = graph.begin_cmd().bind_pipeline(&bench.programs[0]);
            let mut addresses = [Address::default(); 2];
            for (address, (node, at)) in addresses.iter_mut().zip(before.iter().flatten()) {
                pass.set_resource_access(*node, AccessType::ComputeShaderReadOther);
                *address = *at;
            }
            pass.set_resource_access(node, AccessType::ComputeShaderWrite);
            let [first, second] = addresses;
            let params = BufferParams { first, second, result: target, number };
            pass.record_cmd_mut(move |cmd| {
                cmd.push_constants(0, bytemuck::bytes_of(&params)).dispatch(1, 1, 1);
            });
            before = [Some((node, target)), before[0]];
        }
        if let Some((last, _)) = before[0] {
            graph.copy_buffer(last, $result);
        }
        Ok(())
    }};
}

fn buffer_info() -> BufferInfo {
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER
        | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
        | vk::BufferUsageFlags::TRANSFER_SRC;
    BufferInfo::device_mem(Variant::Buffer.bytes(), usage)
}

impl VkGraph {
    /// On the device of this name; with the prepared stream, or with a graph rebuilt every frame.
    ///
    /// # Errors
    /// [`BenchError::Failed`] with the library's message.
    pub fn new(device_name: &str, prepared: bool) -> Result<Self, BenchError> {
        let instance = Instance::create(InstanceInfo::default()).map_err(failed("instance"))?;
        let physical = Instance::physical_devices(&instance).map_err(failed("devices"))?;
        let physical = physical.into_iter().find(|p| p.properties_v1_0.device_name == device_name);
        let missing = BenchError::Failed { contestant: NAME, what: "device", message: format!("no {device_name}") };
        let device = Device::try_from_physical_device(physical.ok_or(missing)?).map_err(failed("device"))?;
        let info = BufferInfo::host_mem(Variant::Buffer.bytes(), vk::BufferUsageFlags::TRANSFER_DST);
        Ok(Self {
            prepared,
            work: Work { variant: Variant::Buffer, passes: 0 },
            stream: None,
            images: Vec::new(),
            set: None,
            programs: programs(&device, 1)?,
            result: Arc::new(Buffer::create(&device, info).map_err(failed("buffer"))?),
            fence: Fence::create(&device, false).map_err(failed("fence"))?,
            pool: HashPool::new(&device),
            device,
        })
    }

    fn empty_pool(&self) -> HashPool {
        HashPool::with_capacity(&self.device, PoolConfig::with_capacity(self.work.passes as usize + SPARE))
    }

    fn add_to_graph(&self, graph: &mut Graph, pool: &mut HashPool, result: BufferNode) -> Result<(), BenchError> {
        add_buffer_passes!(graph, self, pool, result)
    }

    fn add_to_stream(
        &self,
        stream: &mut CommandStreamMut,
        pool: &mut HashPool,
        result: BufferArg,
    ) -> Result<(), BenchError> {
        add_buffer_passes!(stream, self, pool, result)
    }

    fn add_images_to_graph(&self, graph: &mut Graph, result: BufferNode) {
        let program = &self.programs[1];
        let mut before = [None, None];
        for (number, image) in self.images.iter().enumerate() {
            let (number, node) = (number as u32, graph.bind_resource(image));
            let mut pass = graph.begin_cmd().bind_pipeline(program);
            if let Some(set) = &self.set {
                pass.set_descriptor_set(set);
            }
            for node in before.iter().flatten() {
                pass.set_resource_access(*node, AccessType::ComputeShaderReadOther);
            }
            pass.set_resource_access(node, AccessType::ComputeShaderWrite);
            let [first, second] = [1, 2].map(|ago| bytemuck::cast::<u32, StorageImage>(number.saturating_sub(ago)));
            let params = ImageParams { first, second, result: bytemuck::cast(number), number };
            pass.record_cmd_mut(move |cmd| {
                cmd.push_constants(0, bytemuck::bytes_of(&params)).dispatch(1, 1, 1);
            });
            before = [Some(node), before[0]];
        }
        if let Some(last) = before[0] {
            graph.copy_image_to_buffer(last, result);
        }
    }
}

fn programs(device: &Device, images: u32) -> Result<[ComputePipeline; 2], BenchError> {
    let program = |shader: magpie_shaders::Shader| {
        let info = ComputePipelineInfo { bindless_descriptor_count: images };
        ComputePipeline::create(device, info, Shader::new_compute(shader.spirv)).map_err(failed("pipeline"))
    };
    Ok([program(BENCH_BUFFER_COMP)?, program(BENCH_IMAGE_ARRAY_COMP)?])
}

impl Contestant for VkGraph {
    fn name(&self) -> &'static str {
        if self.prepared { "vk-graph prepared" } else { "vk-graph rebuilt" }
    }

    fn about(&self) -> &'static str {
        if self.prepared {
            "its prepared command stream, inserted into a new graph every frame; resources made once; buffers only, as it binds no descriptor sets"
        } else {
            "built, scheduled and recorded anew every frame; buffers leased from its pool every frame, images made once"
        }
    }

    fn refuses(&self, work: Work) -> Option<String> {
        let cannot = self.prepared && work.variant == Variant::Image;
        cannot.then(|| "its command stream can bind no descriptor set".to_owned())
    }

    fn prepare(&mut self, work: Work) -> Result<(), BenchError> {
        self.work = work;
        (self.stream, self.set) = (None, None);
        self.images.clear();
        self.pool = self.empty_pool();
        if work.variant == Variant::Image {
            let usage = vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC;
            let info = ImageInfo::image_2d(SIDE, SIDE, vk::Format::R32_UINT, usage);
            for _ in 0..work.passes {
                self.images.push(Arc::new(Image::create(&self.device, info).map_err(failed("image"))?));
            }
            self.programs = programs(&self.device, work.passes)?;
            let updates = self.images.iter().enumerate();
            let updates = updates.map(|(at, image)| DescriptorSetUpdateInfo::image((0, [at as u32]), image));
            let info = DescriptorSetInfo::builder().set(0).build();
            let set = DescriptorSet::alloc_and_update(&self.programs[1], info, updates);
            self.set = Some(set.map_err(failed("descriptor set"))?);
        }
        if self.prepared {
            let mut pool = self.empty_pool();
            let mut added = Ok(());
            let draft = CommandStream::finalize(|stream| {
                let result = stream.arg(self.result.info);
                added = self.add_to_stream(stream, &mut pool, result);
                result
            });
            added?;
            self.stream = Some(draft.prepare(&mut self.pool).map_err(failed("prepare"))?);
        }
        Ok(())
    }

    fn frame(&mut self, clock: &mut Clock) -> Result<Frame, BenchError> {
        let in_use = || failed("result")("still in use");
        Arc::get_mut(&mut self.result).ok_or_else(in_use)?.mapped_slice_mut().fill(0);
        clock.start();
        let mut graph = Graph::default();
        let result = graph.bind_resource(&self.result);
        match (&self.stream, self.work.variant) {
            (Some(stream), _) => {
                graph.insert_cmd_stream(stream).with_arg(stream.args, result).finish();
            }
            (None, Variant::Buffer) => {
                let mut pool = std::mem::replace(&mut self.pool, HashPool::with_capacity(&self.device, 0));
                let added = self.add_to_graph(&mut graph, &mut pool, result);
                self.pool = pool;
                added?;
            }
            (None, Variant::Image) => self.add_images_to_graph(&mut graph, result),
        }
        clock.lap("declare");
        let commands = self.pool.resource(CommandBufferInfo::new(FAMILY)).map_err(failed("command buffer"))?;
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        commands.begin(&once).map_err(failed("begin"))?;
        let recording = graph.finalize().record(&mut self.pool, commands, RecordSelection::All);
        let recording = recording.map_err(failed("record"))?;
        recording.cmd_buf.end().map_err(failed("end"))?;
        let mut recorded = recording.finish().map_err(failed("finish"))?;
        clock.lap("plan+record");
        recorded.queue_submit(&mut self.fence, 0, QueueSubmitInfo::QUEUE_SUBMIT).map_err(failed("submit"))?;
        clock.lap("submit");
        clock.stop();
        self.fence.wait().map_err(failed("wait"))?;
        clock.retire(|| drop(recorded));
        self.fence.reset().map_err(failed("reset"))?;
        Ok(Frame { barriers: None })
    }

    fn result(&self) -> Result<Vec<u32>, BenchError> {
        let bytes = &self.result.mapped_slice()[..self.work.variant.bytes() as usize];
        Ok(bytemuck::pod_collect_to_vec(bytes))
    }
}
