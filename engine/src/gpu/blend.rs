//! How what is drawn goes over what a colour attachment holds.
use super::{Gpu, GpuError, format};
use crate::graph::Format;
use ash::vk;
use std::fmt;

/// How a fragment's colour *s* with alpha *a* is put over the colour *d* of a colour attachment. Values are linear, also in sRGB formats;
/// fragments blend in the order of the draws, and within a draw in the order of its triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Blend {
    /// *s* replaces *d*: no blending.
    #[default]
    Opaque,
    /// Alpha blending of straight alpha, the operator *over* of Porter and Duff: *a s* + (1 - *a*) *d*. The attachment's alpha becomes that
    /// of both together.
    Over,
    /// The same where the colour is multiplied by its alpha already: *s* + (1 - *a*) *d*.
    PremultipliedOver,
    /// Sum of all four channels: *s* + *d*. Alpha does not weight the colour.
    Additive,
    /// Product of all four channels: *s d*.
    Multiply,
}

impl Blend {
    /// Name for messages, such as `premultiplied over`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Opaque => "opaque",
            Self::Over => "over",
            Self::PremultipliedOver => "premultiplied over",
            Self::Additive => "additive",
            Self::Multiply => "multiply",
        }
    }

    /// The state of an attachment whose four channels are written.
    pub(super) fn vulkan(self) -> vk::PipelineColorBlendAttachmentState {
        use vk::BlendFactor as F;
        // What s and d are multiplied by: colour, then alpha.
        let ([s, d], [s_alpha, d_alpha]) = match self {
            Self::Opaque => ([F::ONE, F::ZERO], [F::ONE, F::ZERO]),
            Self::Over => ([F::SRC_ALPHA, F::ONE_MINUS_SRC_ALPHA], [F::ONE, F::ONE_MINUS_SRC_ALPHA]),
            Self::PremultipliedOver => ([F::ONE, F::ONE_MINUS_SRC_ALPHA], [F::ONE, F::ONE_MINUS_SRC_ALPHA]),
            Self::Additive => ([F::ONE, F::ONE], [F::ONE, F::ONE]),
            Self::Multiply => ([F::DST_COLOR, F::ZERO], [F::DST_ALPHA, F::ZERO]),
        };
        vk::PipelineColorBlendAttachmentState::default()
            .blend_enable(self != Self::Opaque)
            .src_color_blend_factor(s)
            .dst_color_blend_factor(d)
            .color_blend_op(vk::BlendOp::ADD)
            .src_alpha_blend_factor(s_alpha)
            .dst_alpha_blend_factor(d_alpha)
            .alpha_blend_op(vk::BlendOp::ADD)
            .color_write_mask(vk::ColorComponentFlags::RGBA)
    }

    /// Refuses formats that hold integers, on any device.
    pub(super) fn check_formats(self, pipeline: &str, colours: &[Format]) -> Result<(), GpuError> {
        match colours.iter().find(|f| f.is_uint()) {
            Some(format) if self != Self::Opaque => Err(self.error(pipeline, *format, "holds integers")),
            _ => Ok(()),
        }
    }

    fn error(self, pipeline: &str, format: Format, reason: &'static str) -> GpuError {
        GpuError::Blend { pipeline: pipeline.to_owned(), blend: self, format, reason }
    }
}

impl fmt::Display for Blend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Gpu {
    /// Whether pipelines can blend into colour attachments of this format. Vulkan does not guarantee this for 32-bit floats and signed
    /// 16-bit channels.
    pub fn blends(&self, format: Format) -> bool {
        self.format_features(format::vulkan(format)).contains(vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND)
    }

    /// Refuses formats that this device cannot blend.
    pub(super) fn check_blend(&self, pipeline: &str, blend: Blend, colours: &[Format]) -> Result<(), GpuError> {
        match colours.iter().find(|f| blend != Blend::Opaque && !self.blends(**f)) {
            Some(format) => Err(blend.error(pipeline, *format, "this device cannot blend")),
            None => Ok(()),
        }
    }
}
