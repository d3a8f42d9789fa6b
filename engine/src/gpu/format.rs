//! Formats of the graph as Vulkan formats.
use super::Gpu;
use crate::graph::Format;
use ash::vk;

impl Gpu {
    /// Whether samplers can blend the texels of images of this format.
    pub fn filters(&self, format: Format) -> bool {
        self.format_features(vulkan(format)).contains(vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR)
    }
}

pub(super) fn vulkan(format: Format) -> vk::Format {
    match format {
        Format::R8Unorm => vk::Format::R8_UNORM,
        Format::Rg8Unorm => vk::Format::R8G8_UNORM,
        Format::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
        Format::Rgba8Srgb => vk::Format::R8G8B8A8_SRGB,
        Format::Rgba16Snorm => vk::Format::R16G16B16A16_SNORM,
        Format::R16Float => vk::Format::R16_SFLOAT,
        Format::Rg16Float => vk::Format::R16G16_SFLOAT,
        Format::Rgba16Float => vk::Format::R16G16B16A16_SFLOAT,
        Format::R32Float => vk::Format::R32_SFLOAT,
        Format::Rg32Float => vk::Format::R32G32_SFLOAT,
        Format::Rgba32Float => vk::Format::R32G32B32A32_SFLOAT,
        Format::R32Uint => vk::Format::R32_UINT,
        Format::Rg32Uint => vk::Format::R32G32_UINT,
        Format::D32Float => vk::Format::D32_SFLOAT,
    }
}

/// Which part of an image of this format holds its values.
pub(super) fn aspect(format: Format) -> vk::ImageAspectFlags {
    if format.is_depth() { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR }
}
