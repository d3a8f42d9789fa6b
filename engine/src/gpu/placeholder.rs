//! The placeholder images at index 0 of the bindless set, for indices that were not set: one black pixel to read, and one to write.
use super::device::Garbage;
use super::{CommandEncoder, Gpu, GpuError, Image, ImageUse};
use crate::graph::{Extent, Format, Queue};
use ash::vk;

/// Creates both. They must be the first images of the device, and live as long as it does.
pub(super) fn images(gpu: &Gpu) -> Result<Vec<Garbage>, GpuError> {
    let [sampled, storage] =
        [ImageUse { sampled: true, ..Default::default() }, ImageUse { storage: true, ..Default::default() }];
    let make = |usage| Image::new(gpu, "placeholder", Format::Rgba32Float, Extent::new(1, 1), 1, usage);
    let (read, written) = (make(sampled)?, make(storage)?);
    let mut encoder = CommandEncoder::new(gpu, Queue::Graphics)?;
    encoder.begin()?;
    encoder.clear_new(&read, vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL);
    encoder.clear_new(&written, vk::ImageLayout::GENERAL);
    encoder.finish()?;
    gpu.submit(Queue::Graphics, [&encoder], &[])?;
    gpu.wait_idle()?;
    Ok([read, written].map(Image::into_parts).into())
}

impl CommandEncoder {
    /// Fills a new image with zeros and moves it to its permanent layout.
    fn clear_new(&mut self, image: &Image, layout: vk::ImageLayout) {
        let target = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        self.settle(image, vk::ImageLayout::UNDEFINED, target);
        self.clear_image(image);
        self.settle(image, target, layout);
    }
}
