//! Frames to PNG without a window: once around a scene, with two frames in flight.
//!
//! `cargo run --release -p magpie-demo --example headless_turntable -- builtin:carousel turn_%04d.png 24`
use anyhow::Context;
use glam::DVec3;
use magpie::config::Config;
use magpie::gpu::{Gpu, GpuOptions};
use magpie::graph::Extent;
use magpie::scene::{self, CameraPath, Scene, SceneFacts, supply_missing};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use std::collections::VecDeque;

/// Seconds from frame to frame.
const STEP: f64 = 1.0 / 24.0;

/// Renders `frames` pictures of this size from a circle around the middle of the scene, and hands each to `show`.
pub fn turntable(
    gpu: &Gpu,
    scene: &Scene,
    [width, height]: [u32; 2],
    frames: u32,
    mut show: impl FnMut(FrameResult) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let options = RenderOptions { width, height, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &Config::default(), options)?;
    let camera = &scene.cameras[0];
    let bounds = SceneFacts::new(scene).bounds.unwrap_or_default();
    let centre = 0.5 * (DVec3::from(bounds[0]) + DVec3::from(bounds[1]));
    let path = CameraPath::turntable(camera, centre, f64::from(frames) * STEP)?;
    let mut in_flight = VecDeque::new();
    for frame in 0..frames {
        let time = f64::from(frame) * STEP;
        let request = FrameRequest { camera: &path.camera(time)?, time, view: None, read_back: true };
        in_flight.extend(renderer.submit(request)?);
        // The device works on this frame while the one before is written.
        if in_flight.len() > 1
            && let Some(ticket) = in_flight.pop_front()
        {
            show(renderer.finish(ticket)?)?;
        }
    }
    in_flight.into_iter().try_for_each(|ticket| show(renderer.finish(ticket)?))
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, out, frames] = &arguments[..] else {
        anyhow::bail!("usage: headless_turntable builtin:NAME|FILE.glb OUT_%04d.png FRAMES");
    };
    let mut scene = match name.strip_prefix("builtin:") {
        Some(builtin) => scene::builtin(builtin).context("no such scene")?,
        None => scene::load(name.as_ref())?,
    };
    supply_missing(&mut scene);
    let gpu = Gpu::new(&GpuOptions::default())?;
    turntable(&gpu, &scene, [640, 360], frames.parse()?, |result| {
        let picture = result.images.and_then(|images| images.display).context("no picture")?;
        let file = out.replace("%04d", &format!("{:04}", result.frame));
        let Extent { width, height } = picture.extent;
        Ok(image::RgbaImage::from_raw(width, height, picture.presentable()).context("too few bytes")?.save(file)?)
    })
}
