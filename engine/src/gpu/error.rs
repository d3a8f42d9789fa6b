//! Errors of the GPU layer.
use super::Blend;
use crate::graph::Format;
use ash::vk;

/// An error of the GPU layer.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The Vulkan loader could not be opened.
    #[error("no Vulkan loader on this machine ({reason}); `cargo xtask setup` installs one")]
    NoLoader {
        /// Message of the loader.
        reason: String,
    },
    /// No device meets the minimum requirements.
    #[error("no usable Vulkan device: {}", if .refusals.is_empty() { "the loader lists none".to_owned() } else { .refusals.join("; ") })]
    NoDevice {
        /// One entry per device: its name and why it is refused.
        refusals: Vec<String>,
    },
    /// `--device` matches no device.
    #[error("no Vulkan device is called {wanted:?}; known: {}", .known.join(", "))]
    UnknownDevice {
        /// The index or name that was asked for.
        wanted: String,
        /// Index and name of each device.
        known: Vec<String>,
    },
    /// An application's device or image does not have what Magpie needs of it.
    #[error("{what} cannot be used: {}", .lacks.join("; "))]
    Unsuited {
        /// The object, as `the device NAME`.
        what: String,
        /// What it lacks, one sentence each.
        lacks: Vec<String>,
    },
    /// There is no window to show pictures in, or no device can show them there.
    #[error("no display to show a window on: {reason}")]
    NoDisplay {
        /// What is missing.
        reason: String,
    },
    /// The validation layer was asked for and is not installed.
    #[error("the layer {name} is not installed; on Debian and Ubuntu it is in the package vulkan-validationlayers")]
    MissingLayer {
        /// Name of the layer.
        name: &'static str,
    },
    /// An extension that an operation needs is missing.
    #[error("the extension {name} is missing: {needed_for}")]
    MissingExtension {
        /// Name of the extension.
        name: &'static str,
        /// What cannot be done without it, as a sentence.
        needed_for: &'static str,
    },
    /// The device does not support the way to trace rays that was asked for.
    #[error("{device} cannot trace rays by {wanted}; it can by {}", .known.join(", "))]
    Rays {
        /// Name of the device.
        device: String,
        /// The way that was asked for.
        wanted: &'static str,
        /// The ways that it supports.
        known: Vec<&'static str>,
    },
    /// The device was lost.
    #[error("the device was lost during {during}")]
    DeviceLost {
        /// The Vulkan call that reported it.
        during: &'static str,
    },
    /// Memory allocation failed.
    #[error("out of memory for {what}{}", if *.bytes > 0 { format!(" ({bytes} bytes)") } else { String::new() })]
    OutOfMemory {
        /// Name of the resource, or of the call that failed.
        what: String,
        /// Size in bytes; 0 if it is not known.
        bytes: u64,
    },
    /// A size is above a limit of the device.
    #[error("{what}: {wanted} is over the device's limit of {limit}")]
    Limit {
        /// What the limit applies to.
        what: String,
        /// The value that was needed.
        wanted: u64,
        /// The device's limit.
        limit: u64,
    },
    /// The push constants that a pass records do not have the size of its shader's block.
    #[error(
        "pass {pass}: {kernel} reads {wanted} bytes of push constants, but the pass gives it {given}: the struct in Rust and the block in \
         GLSL must have the same fields"
    )]
    PushConstants {
        /// Name of the pass.
        pass: String,
        /// Name of the pipeline, which is usually that of its shader.
        kernel: String,
        /// Size that the shader declares, or the largest size that is allowed, bytes.
        wanted: u32,
        /// Size that the pass gave, bytes.
        given: u32,
    },
    /// A graphics pipeline blends into a format that cannot be blended.
    #[error("pipeline {pipeline} blends ({blend}) into {format:?}, which {reason}")]
    Blend {
        /// Name of the pipeline.
        pipeline: String,
        /// How it blends.
        blend: Blend,
        /// The format of the colour attachment.
        format: Format,
        /// Why it cannot be blended.
        reason: &'static str,
    },
    /// Invalid SPIR-V, or SPIR-V without a declaration that is needed.
    #[error("shader {name}: {reason}")]
    Shader {
        /// Name of the shader.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Validation messages are needed, but the device was opened without the validation layers.
    #[error(
        "check was asked for, but {device} was opened without the validation layers: open it with GpuOptions {{ validation: true, .. }}, or \
         leave check off"
    )]
    NotValidated {
        /// Name of the device.
        device: String,
    },
    /// The validation layers reported messages.
    #[error("{} message(s) from the validation layers, the first: {}", .messages.len(), .messages.first().map_or("", String::as_str))]
    Validation {
        /// The messages, in the order in which they came.
        messages: Vec<String>,
    },
    /// Any other call that failed.
    #[error("{call} failed: {code}")]
    Call {
        /// Name of the function.
        call: &'static str,
        /// Its result code or message.
        code: String,
    },
}

impl GpuError {
    /// Converts the result of a failed Vulkan call. Device loss and lack of memory have their own variants.
    pub(super) fn call(call: &'static str) -> impl Fn(vk::Result) -> Self {
        move |result| match result {
            vk::Result::ERROR_DEVICE_LOST => Self::DeviceLost { during: call },
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                Self::OutOfMemory { what: call.to_owned(), bytes: 0 }
            }
            other => Self::Call { call, code: format!("{other:?}") },
        }
    }
}
