//! A window with a scene in it.
//!
//! `cargo run --release -p magpie-demo --example minimal -- scene.glb`
use magpie::gpu::{Gpu, GpuOptions, Surface};
use magpie::{config::Config, scene};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use std::{error::Error, path::Path, sync::Arc};
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::window::{Window, WindowId};
use winit::{application::ApplicationHandler, event::WindowEvent};

struct Viewer {
    scene: scene::Scene,
    open: Option<(Renderer, Surface, Arc<Window>)>,
}

impl Viewer {
    fn open(&mut self, on: &ActiveEventLoop) -> Result<(), Box<dyn Error>> {
        let window = Arc::new(on.create_window(Window::default_attributes().with_title("Magpie"))?);
        let (gpu, surface) = Gpu::with_surface(&GpuOptions::default(), window.clone())?;
        let options = RenderOptions { rays: gpu.choose_rays().rays, ..RenderOptions::default() };
        let renderer = Renderer::new(&gpu, &self.scene, &Slots::default(), &Config::default(), options)?;
        self.open = Some((renderer, surface, window));
        Ok(())
    }

    fn draw(&mut self) -> Result<(), Box<dyn Error>> {
        let Some((renderer, surface, window)) = &mut self.open else { return Ok(()) };
        renderer.resize(window.inner_size().width, window.inner_size().height);
        let request = FrameRequest { camera: &self.scene.cameras[0], time: 0.0, view: None, read_back: false };
        renderer.show(request, surface)?;
        window.request_redraw();
        Ok(())
    }
}

impl ApplicationHandler for Viewer {
    fn resumed(&mut self, on: &ActiveEventLoop) {
        self.open(on).unwrap_or_else(|error| stop(on, &*error));
    }

    fn window_event(&mut self, on: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => on.exit(),
            WindowEvent::RedrawRequested => self.draw().unwrap_or_else(|error| stop(on, &*error)),
            _ => {}
        }
    }
}

fn stop(on: &ActiveEventLoop, error: &dyn Error) {
    eprintln!("error: {error}");
    on.exit();
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("wanted a scene: a path to a .gltf or .glb file")?;
    let mut scene = scene::load(Path::new(&path))?;
    scene::supply_missing(&mut scene); // a camera, a sun and a sky, where the file has none
    EventLoop::new()?.run_app(&mut Viewer { scene, open: None })?;
    Ok(())
}
