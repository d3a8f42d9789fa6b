//! Frames in a window: the renderer, the overlay with the interface, and the surface that both are shown on.

use std::{
    collections::VecDeque,
    sync::Arc,
    time::{Duration, Instant},
};

use egui::{ClippedPrimitive, TexturesDelta};
use magpie::{
    config::Config,
    gpu::{Gpu, GpuError, GpuOptions, Image, ImageUse, PipelineSet, PresentMode, Surface},
    graph::{Extent, Format},
    pixels::Pixels,
    prelude::Rays,
    scene::{Camera, Scene},
    slot::Build,
};
use magpie_passes::{
    FrameRequest, FrameResult, FrameTicket, RenderOptions, Renderer, Slots,
    parts::{inspect::Inspection, overlay::Overlay},
};
use winit::window::Window;

use super::meshes;
use crate::{
    args::ViewArguments,
    exit::Failure,
    session::{choose_rays, failure},
};

/// A window with a renderer behind it.
pub(super) struct Screen {
    renderer: Renderer,
    overlay: Overlay,
    /// What the overlay draws into, in the size of the window.
    target: Option<Arc<Image>>,
    in_flight: VecDeque<FrameTicket>,
    /// Another configuration of the same scene.
    other: Option<Other>,
    surface: Surface,
    gpu: Gpu,
    options: RenderOptions,
}

/// A second renderer, whose picture the first one's overlay shows beside its own.
struct Other {
    renderer: Renderer,
    /// Brings the picture to `target`.
    overlay: Overlay,
    target: Option<Arc<Image>>,
}

/// An image that is wanted on the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// The window with its panels.
    Window,
    /// Linear radiance of the picture.
    Radiance,
    /// Display values of the picture.
    Display,
    /// Depth of the picture.
    Depth,
}

impl Wanted {
    /// Name among the copied images of a frame.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Window => "window",
            Self::Radiance => "radiance",
            Self::Display => "display",
            Self::Depth => "depth",
        }
    }
}

/// One frame.
pub(super) struct Drawing<'a> {
    pub camera: &'a Camera,
    /// Time of the scene, seconds.
    pub time: f64,
    /// Size of the window, pixels.
    pub window: Extent,
    /// Size of the picture in it, pixels.
    pub picture: Extent,
    pub interface: &'a [ClippedPrimitive],
    pub textures: TexturesDelta,
    pub pixels_per_point: f32,
    /// What is copied to the host.
    pub wanted: &'a [Wanted],
    /// What is shown in place of the picture, if the frame makes it.
    pub inspection: Option<&'a Inspection>,
}

/// What became of a frame.
pub(super) struct Drawn {
    /// Its number.
    pub frame: u32,
    /// CPU time in which the interface became a pass of it.
    pub overlay_time: Duration,
}

impl Screen {
    /// Opens a device for the window, and brings the scene to it.
    pub(super) fn open(
        window: &Arc<Window>,
        scene: &Scene,
        config: &Config,
        arguments: &ViewArguments,
    ) -> Result<Self, Failure> {
        let options = GpuOptions {
            device: arguments.device.device.clone(),
            validation: arguments.check,
            ..GpuOptions::default()
        };
        let (gpu, surface) = Gpu::with_surface(&options, window.clone())?;
        let rays: Rays = choose_rays(&gpu, arguments.device.rays)?;
        let &ViewArguments { seed, check, frames_in_flight, .. } = arguments;
        let options = RenderOptions { width: 0, height: 0, seed, check, rays, frames_in_flight };
        Ok(Self {
            renderer: Renderer::new(&gpu, scene, &Slots::default(), config, options).map_err(failure)?,
            overlay: Overlay::new(&gpu, &Build::new(&gpu, rays))?,
            target: None,
            in_flight: VecDeque::new(),
            other: None,
            surface,
            gpu,
            options,
        })
    }

    /// The device.
    pub(super) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// How rays are traced.
    pub(super) fn rays(&self) -> Rays {
        self.options.rays
    }

    /// How pictures go to the display.
    pub(super) fn mode(&self) -> PresentMode {
        self.surface.mode()
    }

    pub(super) fn set_mode(&mut self, mode: PresentMode) {
        self.surface.set_mode(mode);
    }

    /// The ways that the display offers.
    pub(super) fn modes(&self) -> Result<Vec<PresentMode>, Failure> {
        Ok(self.surface.modes()?)
    }

    /// For tests: the next frame behaves as if the device were lost in this pass.
    pub(super) fn lose_device_in(&mut self, pass: &str) {
        self.renderer.lose_device_in(pass);
    }

    /// Gives the interface a picture to show.
    pub(super) fn set_picture(&mut self, id: egui::TextureId, picture: &Pixels) -> Result<(), Failure> {
        meshes::set_picture(&mut self.overlay, id, picture)
    }

    /// Shows another scene with another configuration. Returns the results of frames that were in flight.
    pub(super) fn open_scene(&mut self, scene: &Scene, config: &Config) -> Result<Vec<FrameResult>, Failure> {
        let renderer = Renderer::new(&self.gpu, scene, &Slots::default(), config, self.options).map_err(failure)?;
        let results = self.finish(0)?;
        (self.renderer, self.other) = (renderer, None);
        Ok(results)
    }

    /// Renders the scene with a second configuration as well, or no longer.
    pub(super) fn compare(&mut self, scene: &Scene, config: Option<&Config>) -> Result<(), Failure> {
        let open = |config: &Config| {
            let renderer = Renderer::new(&self.gpu, scene, &Slots::default(), config, self.options).map_err(failure)?;
            let overlay = Overlay::new(&self.gpu, &Build::new(&self.gpu, self.options.rays))?;
            Ok::<_, Failure>(Other { renderer, overlay, target: None })
        };
        self.other = config.map(open).transpose()?;
        Ok(())
    }

    /// Exchanges the two renderers with all that they keep. Returns the results of frames in flight.
    pub(super) fn swap(&mut self) -> Result<Vec<FrameResult>, Failure> {
        let results = self.finish(0)?;
        if let Some(other) = &mut self.other {
            std::mem::swap(&mut self.renderer, &mut other.renderer);
            other.renderer.inspect(None).map_err(failure)?;
        }
        Ok(results)
    }

    /// The pipelines that a configuration may need beyond those of the present one.
    pub(super) fn pipelines_of(&self, config: &Config) -> Result<PipelineSet, Failure> {
        self.renderer.pipelines_of(config).map_err(failure)
    }

    /// Sets the configuration from the next frame on. After a failure the old one runs on.
    pub(super) fn configure(&mut self, config: &Config) -> Result<(), Failure> {
        self.renderer.configure(config).map_err(failure)
    }

    /// Declares that the next frame is seen from somewhere else.
    pub(super) fn cut(&mut self) {
        self.renderer.cut();
        if let Some(other) = &mut self.other {
            other.renderer.cut();
        }
    }

    /// Submits a frame, and hands the one that it makes to the display.
    pub(super) fn draw(&mut self, drawing: Drawing<'_>) -> Result<Drawn, Failure> {
        let Drawing { camera, time, window, picture, interface, mut textures, pixels_per_point, wanted, inspection } =
            drawing;
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                meshes::set_texture(&mut self.overlay, id, delta)?;
            }
        }
        self.options = RenderOptions { width: picture.width, height: picture.height, ..self.options };
        self.renderer.resize(picture.width, picture.height);
        self.renderer.inspect(inspection.cloned()).map_err(failure)?;
        let request = FrameRequest { camera, time, view: None, read_back: false };
        let beside = match &mut self.other {
            Some(other) => other.draw(&self.gpu, request, picture)?,
            None => None,
        };
        let (gpu, overlay, target, surface) = (&self.gpu, &mut self.overlay, &mut self.target, &mut self.surface);
        let mut overlay_time = Duration::ZERO;
        let submitted = self.renderer.submit_with(request, &mut |g, imports, made| {
            let begun = Instant::now();
            let meshes =
                meshes::meshes(interface, pixels_per_point, made.inspected.unwrap_or(made.display), beside.as_ref());
            let format = surface.set_bits(if g.desc(made.display).format == Format::Rgba16Unorm { 10 } else { 8 });
            let target = target_of(gpu, target, window, format)?;
            let shown = overlay.add(g, imports, &meshes, &target)?;
            overlay_time = begun.elapsed();
            for wanted in wanted {
                let image = match wanted {
                    Wanted::Window => shown,
                    Wanted::Radiance => made.radiance,
                    Wanted::Display => made.display,
                    Wanted::Depth => made.depth,
                };
                made.read_back(g, imports, wanted.name(), image);
            }
            Ok(())
        });
        let none = || Failure::bad("a picture without pixels cannot be drawn");
        let ticket = submitted.map_err(failure)?.ok_or_else(none)?;
        let frame = ticket.frame();
        self.in_flight.push_back(ticket);
        for id in textures.free.drain() {
            if let egui::TextureId::Managed(number) = id {
                self.overlay.remove_texture(number);
            }
        }
        if let Some(target) = &self.target {
            self.surface.present(target, window)?;
        }
        Ok(Drawn { frame, overlay_time })
    }

    /// Waits until no more than so many frames are in flight, and returns the results of the others.
    pub(super) fn finish(&mut self, most: usize) -> Result<Vec<FrameResult>, Failure> {
        let mut results = Vec::new();
        while self.in_flight.len() > most {
            let Some(oldest) = self.in_flight.pop_front() else { break };
            results.push(self.renderer.finish(oldest).map_err(failure)?);
        }
        Ok(results)
    }

    /// Ends it, and returns what `--check` has found: messages of the validation layers, and where values arose that are not finite.
    pub(super) fn close(mut self) -> Result<Vec<String>, Failure> {
        self.finish(0)?;
        let mut findings: Vec<String> =
            self.renderer.finding_tracker().reports().iter().map(ToString::to_string).collect();
        let Self { renderer, overlay, target, other, surface, gpu, .. } = self;
        drop((renderer, overlay, target, other, surface));
        gpu.wait_idle()?;
        match gpu.check_validation() {
            Ok(()) => {}
            Err(GpuError::Validation { messages }) => findings.extend(messages),
            Err(error) => return Err(error.into()),
        }
        Ok(findings)
    }
}

impl Other {
    /// Submits a frame whose picture is left in the image that it returns.
    fn draw(&mut self, gpu: &Gpu, request: FrameRequest<'_>, picture: Extent) -> Result<Option<Arc<Image>>, Failure> {
        self.renderer.resize(picture.width, picture.height);
        let (overlay, target) = (&mut self.overlay, &mut self.target);
        let submitted = self.renderer.submit_with(request, &mut |g, imports, made| {
            let is_deep = g.desc(made.display).format == Format::Rgba16Unorm;
            let target = target_of(gpu, target, picture, Overlay::FORMATS[usize::from(is_deep)])?;
            overlay.add(g, imports, &[meshes::whole(made.display, picture)], &target)?;
            Ok(())
        });
        drop(submitted.map_err(failure)?);
        Ok(self.target.clone())
    }
}

/// An image of this size and format to draw into: the one that is there, if it suits.
fn target_of(gpu: &Gpu, kept: &mut Option<Arc<Image>>, extent: Extent, format: Format) -> Result<Arc<Image>, GpuError> {
    let suits = |target: &&Arc<Image>| target.extent() == extent && target.format() == format;
    if let Some(target) = kept.as_ref().filter(suits) {
        return Ok(target.clone());
    }
    let usage = ImageUse { sampled: true, attachment: true, ..ImageUse::default() };
    let target = Arc::new(Image::new(gpu, "window", format, extent, 1, usage)?);
    *kept = Some(target.clone());
    Ok(target)
}
