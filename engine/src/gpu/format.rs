//! Translates formats of the graph to Vulkan.
use super::bindless::place;
use super::{Gpu, GpuError};
use crate::graph::Format;
use crate::scene::{Sampler, Wrap};
use ash::vk;
use magpie_shaders::SamplerId;
use magpie_shaders::filter::{FETCHED, REPEATS_U, REPEATS_V};

impl Gpu {
    /// Whether samplers can filter images of this format linearly. Vulkan does not guarantee this for 32-bit floats.
    pub fn filters(&self, format: Format) -> bool {
        let left_out = self.without_float_filter() && format.bytes_per_pixel() / format.channels() == 4;
        !left_out && self.format_features(vulkan(format)).contains(FILTER)
    }

    /// How shaders filter an image of this format bilinearly at mip 0, for `sample_bilinear` of `lib/bindless.glsl`: with a
    /// sampler if the device supports it, otherwise with four fetches, which give the same result up to rounding. Fetches cannot
    /// mirror, so a mirrored image is clamped to its edge instead.
    ///
    /// # Errors
    /// As [`Gpu::sampler`].
    pub fn bilinear(&self, format: Format, wrap: [Wrap; 2]) -> Result<SamplerId, GpuError> {
        if self.filters(format) {
            return self.sampler(Sampler { wrap, linear_mips: false, mips: false, ..Sampler::default() });
        }
        let repeats = |axis: usize, bit| if wrap[axis] == Wrap::Repeat { bit } else { 0 };
        Ok(place(FETCHED + repeats(0, REPEATS_U) + repeats(1, REPEATS_V)))
    }
}

/// Linear filtering by samplers.
pub(super) const FILTER: vk::FormatFeatureFlags = vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR;

pub(super) fn vulkan(format: Format) -> vk::Format {
    match format {
        Format::R8Unorm => vk::Format::R8_UNORM,
        Format::Rg8Unorm => vk::Format::R8G8_UNORM,
        Format::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
        Format::Rgba8Srgb => vk::Format::R8G8B8A8_SRGB,
        Format::Rg16Snorm => vk::Format::R16G16_SNORM,
        Format::A2Rgb10Unorm => vk::Format::A2R10G10B10_UNORM_PACK32,
        Format::Rgba16Snorm => vk::Format::R16G16B16A16_SNORM,
        Format::R16Unorm => vk::Format::R16_UNORM,
        Format::Rg16Unorm => vk::Format::R16G16_UNORM,
        Format::Rgba16Unorm => vk::Format::R16G16B16A16_UNORM,
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

/// The aspect of an image of this format.
pub(super) fn aspect(format: Format) -> vk::ImageAspectFlags {
    if format.is_depth() { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR }
}
