//! The effects of Magpie, one folder each, and the frame that they form.
//!
//! Read [`frame`](frame::frame) first: it declares the whole frame in one function. [`contracts`] defines the inputs and outputs of every
//! slot, and [`slots`] lists the slots.
//!
//! ```no_run
//! use magpie::{config::Config, gpu::GpuOptions, prelude::*};
//! use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
//! use std::path::Path;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = Gpu::new(&GpuOptions::default())?;
//! let slots = Slots::default(); // register effects of your own here
//! let mut config = Config::default();
//! config.set("post.exposure=0.5")?;
//! let mut scene = magpie::scene::load(Path::new("scene.gltf"))?;
//! magpie::scene::supply_missing(&mut scene); // a camera, a sun and a sky, where the file has none
//! let options = RenderOptions { width: 1280, height: 720, seed: 0, check: false, ..RenderOptions::default() };
//! let mut renderer = Renderer::new(&gpu, &scene, &slots, &config, options)?;
//! let frame = renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true })?;
//! if let Some(frame) = frame {
//!     println!("{:?}", frame.sample.passes); // times, draws, rays of every pass
//! } // None while the size is zero
//! # Ok(())
//! # }
//! ```

mod acceleration;
mod ao;
mod compose;
pub mod contracts;
mod direct;
pub mod frame;
mod gbuffer;
mod gi;
mod in_flight;
mod inspection;
pub mod metrics;
mod outputs;
pub mod parts;
mod picture;
pub mod plan;
mod post;
mod precision;
mod ray_kernels;
mod rays;
mod read_back;
pub mod reference;
mod reflections;
pub mod renderer;
mod sampling;
mod shadows;
mod sky;
mod sky_light;
pub mod slots;
mod specular_signal;

pub use in_flight::FrameTicket;
pub use picture::{AddPasses, Picture};
pub use plan::{FramePlan, PlanError, plan_frame};
pub use renderer::{FrameRequest, FrameResult, MOST_IN_FLIGHT, ReadBack, RenderError, RenderOptions, Renderer};
pub use slots::Frame;
pub use slots::Slots;
