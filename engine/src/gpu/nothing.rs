//! What stands at place 0 of the bindless set, for indices that nobody set: one black pixel to be read, and one to be written, that
//! nobody else uses.
use super::device::Garbage;
use super::{CommandEncoder, Gpu, GpuError, Image, ImageUse};
use crate::graph::{Extent, Format, Part, Queue};
use ash::vk;

/// Makes both, which must be the first images of the device. They live as long as it does.
pub(super) fn images(gpu: &Gpu) -> Result<Vec<Garbage>, GpuError> {
    let [sampled, storage] =
        [ImageUse { sampled: true, ..Default::default() }, ImageUse { storage: true, ..Default::default() }];
    let make = |usage| Image::new(gpu, "nothing", Format::Rgba32Float, Extent::new(1, 1), 1, usage);
    let (read, written) = (make(sampled)?, make(storage)?);
    let mut encoder = CommandEncoder::new(gpu, Queue::Graphics)?;
    encoder.begin()?;
    encoder.blacken(&read, vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL);
    encoder.blacken(&written, vk::ImageLayout::GENERAL);
    encoder.finish()?;
    gpu.submit(Queue::Graphics, [&encoder], &[])?;
    gpu.wait_idle()?;
    Ok([read, written].map(Image::into_parts).into())
}

impl CommandEncoder {
    /// Fills a new image with zeros and brings it to the layout in which it stays.
    fn blacken(&mut self, image: &Image, layout: vk::ImageLayout) {
        let range = image.range(Part::ALL.of(1, 1));
        let barrier = |from, to| {
            vk::ImageMemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
                .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
                .old_layout(from)
                .new_layout(to)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .image(image.raw)
                .subresource_range(range)
        };
        let target = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        let (before, after) = ([barrier(vk::ImageLayout::UNDEFINED, target)], [barrier(target, layout)]);
        let before = vk::DependencyInfo::default().image_memory_barriers(&before);
        let after = vk::DependencyInfo::default().image_memory_barriers(&after);
        let (commands, gpu) = (self.raw(), self.gpu().clone());
        // SAFETY: the command buffer is recording, outside of rendering; the image is alive, and a target of copies.
        unsafe { gpu.raw().cmd_pipeline_barrier2(commands, &before) };
        self.clear_image(image);
        // SAFETY: as above.
        unsafe { gpu.raw().cmd_pipeline_barrier2(commands, &after) };
    }
}
