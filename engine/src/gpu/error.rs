//! What can go wrong on the device, by name.
use ash::vk;

/// A failure of the GPU layer.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The Vulkan loader could not be opened.
    #[error("no Vulkan loader on this machine ({reason}); `cargo xtask setup` installs one")]
    NoLoader {
        /// The loader's own message.
        reason: String,
    },
    /// No device meets the floor.
    #[error("no usable Vulkan device: {}", if .refusals.is_empty() { "the loader lists none".to_owned() } else { .refusals.join("; ") })]
    NoDevice {
        /// One entry per device: its name and why it is refused.
        refusals: Vec<String>,
    },
    /// `--device` names no device.
    #[error("no Vulkan device is called {wanted:?}; known: {}", .known.join(", "))]
    UnknownDevice {
        /// What was asked for.
        wanted: String,
        /// Index and name of each device.
        known: Vec<String>,
    },
    /// The validation layer was asked for and is not installed.
    #[error("the layer {name} is not installed; on Debian and Ubuntu it is in the package vulkan-validationlayers")]
    MissingLayer {
        /// The layer.
        name: &'static str,
    },
    /// An extension that a request needs.
    #[error("the extension {name} is missing: {needed_for}")]
    MissingExtension {
        /// The extension.
        name: &'static str,
        /// What cannot be done without it.
        needed_for: &'static str,
    },
    /// The device cannot trace rays in the way that was asked for.
    #[error("{device} cannot trace rays by {wanted}; it can by {}", .known.join(", "))]
    Rays {
        /// The device.
        device: String,
        /// What was asked for.
        wanted: &'static str,
        /// What it can do.
        known: Vec<&'static str>,
    },
    /// The device stopped answering.
    #[error("the device was lost during {during}")]
    DeviceLost {
        /// The call that reported it.
        during: &'static str,
    },
    /// Memory ran out.
    #[error("out of memory for {what}{}", if *.bytes > 0 { format!(" ({bytes} bytes)") } else { String::new() })]
    OutOfMemory {
        /// The resource, or the call that failed.
        what: String,
        /// Its size; 0 when it is not known.
        bytes: u64,
    },
    /// A size is beyond a limit of the device.
    #[error("{what}: {wanted} is over the device's limit of {limit}")]
    Limit {
        /// Which limit.
        what: String,
        /// What was asked for.
        wanted: u64,
        /// What the device can do.
        limit: u64,
    },
    /// A pass records push constants that are not as large as the block of its shader.
    #[error(
        "pass {pass}: {kernel} reads {wanted} bytes of push constants, but the pass gives it {given}: the struct in Rust and the block in \
         GLSL must have the same fields"
    )]
    PushConstants {
        /// The pass.
        pass: String,
        /// The pipeline: in most cases the name of its shader.
        kernel: String,
        /// Bytes that the shader's block takes, or the most that there can be.
        wanted: u32,
        /// Bytes that the pass gave.
        given: u32,
    },
    /// SPIR-V that is not SPIR-V, or lacks what is needed.
    #[error("shader {name}: {reason}")]
    Shader {
        /// The shader's name.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// Messages of the validation layers were asked for, but the device was opened without them.
    #[error(
        "check was asked for, but {device} was opened without the validation layers: open it with GpuOptions {{ validation: true, .. }}, or \
         leave check off"
    )]
    NotValidated {
        /// The device.
        device: String,
    },
    /// The validation layers complained.
    #[error("{} message(s) from the validation layers, the first: {}", .messages.len(), .messages.first().map_or("", String::as_str))]
    Validation {
        /// Their messages.
        messages: Vec<String>,
    },
    /// Any other failing call.
    #[error("{call} failed: {code}")]
    Call {
        /// The Vulkan function.
        call: &'static str,
        /// Its result.
        code: String,
    },
}

impl GpuError {
    /// Names a failed Vulkan call; lost devices and exhausted memory get their own variants.
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
