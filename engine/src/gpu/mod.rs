//! The GPU layer: the only user of `ash` and the only place with `unsafe`.
//!
//! [`Gpu`] is an opened device. Images and buffers are freed after they are dropped and the device has finished using them. Every image
//! has an index in one bindless descriptor set, and every buffer a device address; pipelines are referred to by small [`Kernel`] ids.
#![allow(unsafe_code)]

mod accel;
mod access;
mod adopt;
mod bindless;
mod blend;
mod buffer;
mod device;
mod device_selection;
mod device_setup;
mod encoder;
mod error;
mod format;
mod heap;
mod image;
mod instance;
mod marker;
mod pass_set;
mod pipeline;
mod pipeline_cache;
mod placeholder;
mod query;
mod ray_pipeline;
mod rays;
mod reflect;
mod reload;
mod rendering;
mod staging;
mod submit;
mod surface;

pub use accel::{Accel, AccelDesc, AccelGeometry, AccelInstance, AccelSizes, CompactedSizes};
pub use adopt::{AppDevice, Owner, SemaphoreValue};
/// The Vulkan bindings whose types describe what an application and Magpie share.
pub use ash;
pub use blend::Blend;
pub use buffer::{Buffer, BufferMemory, BufferUse};
pub use device::{Gpu, GpuOptions};
pub use device_selection::{DeviceReport, QueueFamilyReport, devices};
pub use device_setup::{DeviceSetup, QueueSetup};
pub use encoder::Cull;
pub(crate) use encoder::{
    BufferAt, CommandEncoder, DrawRange, DrawsAt, ImageBarrier, ImageRegion, MemoryBarrier, Transition,
};
pub use error::GpuError;
pub(crate) use heap::Heap;
pub(crate) use image::ImageInfo;
pub use image::{Image, ImageUse};
pub(crate) use marker::Moment;
pub(crate) use pass_set::PassSet;
pub use pipeline::{Kernel, Pipelines, RasterDesc, RasterKernel};
pub(crate) use pipeline::{PUSH_BYTES, PushBlock};
pub(crate) use query::{Statistics, Timestamps};
pub(crate) use ray_pipeline::RAY_PUSH_BYTES;
pub use ray_pipeline::{RayKernel, RayPipeline, SPHERE_GROUP, TRIANGLE_GROUP};
pub use rays::RayChoice;
pub(crate) use reload::Indexed;
pub use reload::{PipelineSet, Reload};
pub(crate) use rendering::Attachment;
pub use staging::Staging;
pub(crate) use submit::Submission;
pub use surface::{PresentMode, Presented, Surface};
