//! The effects of Magpie, one folder each, and the frame that they make.
//!
//! Read [`frame`](frame::frame) first: it is the whole frame on one screen. [`stages`] holds the contract of every slot, [`slots`] the
//! implementations that come with Magpie.

mod compose;
mod direct;
pub mod frame;
mod gbuffer;
mod gi;
mod post;
mod reflections;
pub mod renderer;
mod shadows;
mod sky;
pub mod slots;
pub mod stages;

pub use frame::Stages;
pub use renderer::{FrameRequest, FrameResult, ReadBack, RenderError, RenderOptions, Renderer};
pub use slots::Slots;
