//! What an effect needs: `use magpie::prelude::*;`.
pub use crate::frame::View;
pub use crate::gpu::{Gpu, RayKernel};
pub use crate::graph::{
    Buffer, BufferDesc, Extent, Format, FrameGraph, Handle, Image, ImageDesc, Queue, Record, Size, Tlas, WriteHandle,
};
pub use crate::slot::Effect;
pub use magpie_shaders::Rays;
