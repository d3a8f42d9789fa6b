//! The window: its events, what is done by hand or by a file, and one frame after the other.

use std::{collections::VecDeque, sync::Arc, time::Instant};

use egui_winit::State;
use magpie::{
    config::{Catalogue, Config},
    graph::{Declaration, Extent, Plan},
    measure::{Recorder, Report, Run, SlotReport},
    pixels::Pixels,
    scene::{Camera, Scene},
};
use magpie_passes::FrameResult;
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::WindowEvent,
    event_loop::{ActiveEventLoop, ControlFlow},
    window::{Window, WindowId},
};

use super::{
    Outputs,
    action::{Action, Step},
    interface::{Interface, Model, Planned},
    is_interrupted,
    navigation::{Navigation, point_at},
    no_display,
    screen::{Drawing, Screen, Wanted},
    tour::{Recording, Replay},
    watch::Watch,
};
use crate::{
    args::{EnvironmentArguments, ViewArguments},
    exit::Failure,
    output::Output,
    picture, session,
};

/// Frames over which times are shown.
pub(super) const SHOWN: usize = 120;
/// Seconds between two evaluations of them.
const REFRESH: f64 = 0.25;
/// Distance that is turned about before anything was clicked, metres.
pub(super) const DISTANCE: f64 = 5.0;

/// The viewer.
pub(super) struct App<'a> {
    pub(super) arguments: &'a ViewArguments,
    pub(super) catalogue: Catalogue,
    pub(super) scene: Scene,
    pub(super) scene_name: String,
    pub(super) cameras: Vec<String>,
    pub(super) config: Config,
    /// The configuration that the picture is compared with.
    pub(super) other: Option<Config>,
    pub(super) navigation: Navigation,
    pub(super) interface: Interface,
    pub(super) environment: EnvironmentArguments,
    /// The configuration file that is followed.
    pub(super) watch: Option<Watch>,
    steps: VecDeque<Step>,
    /// `None` before the window opens.
    pub(super) open: Option<Open>,
    /// Why it ends, if not because it was closed.
    failure: Option<Failure>,
    /// Frames so far.
    frame: u32,
    /// Time of the scene, seconds.
    pub(super) time: f64,
    pub(super) plays: bool,
    last: Instant,
    pub(super) recorder: Recorder,
    /// All frames, for `--timings`.
    all: Option<Recorder>,
    pub(super) slots: Vec<SlotReport>,
    /// The newest finished frame as it was planned.
    planned: Option<(Arc<Declaration>, Arc<Plan>)>,
    report: Option<Report>,
    evaluated: Option<Instant>,
    pub(super) message: Option<String>,
    /// Seconds since the window opened, or so many steps of `--time-step`.
    pub(super) clock: f64,
    pub(super) recording: Option<Recording>,
    pub(super) replay: Option<Replay>,
    /// What is to be read back in the next frame, and where it goes.
    pub(super) wishes: Vec<Wish>,
    /// The same of frames in flight, by their numbers.
    awaited: VecDeque<(u32, Wish)>,
    last_window: Option<Pixels>,
}

/// The window, and all that needs it.
pub(super) struct Open {
    pub(super) screen: Screen,
    egui: State,
    context: egui::Context,
    pub(super) window: Arc<Window>,
}

/// An image that is waited for.
pub(super) enum Wish {
    /// The window, to a PNG.
    Window(Output),
    /// Radiance, to an EXR.
    Radiance(Output),
    /// The window as it is at the end.
    LastWindow,
    /// The depth of a place in the picture, and from where and in which shape of a picture it is seen.
    Depth { at: [f32; 2], seen: Option<(Camera, f64)> },
}

impl Wish {
    fn wanted(&self) -> Wanted {
        match self {
            Self::Window(_) | Self::LastWindow => Wanted::Window,
            Self::Radiance(_) => Wanted::Radiance,
            Self::Depth { .. } => Wanted::Depth,
        }
    }
}

impl<'a> App<'a> {
    pub(super) fn new(
        arguments: &'a ViewArguments,
        scene: Scene,
        camera: Camera,
        config: Config,
        steps: Vec<Step>,
    ) -> Self {
        Self {
            arguments,
            catalogue: session::catalogue(),
            scene_name: arguments.scene.display().to_string(),
            cameras: scene.cameras.iter().map(|camera| camera.name.clone()).collect(),
            scene,
            config,
            other: None,
            navigation: Navigation::new(&camera, DISTANCE),
            interface: Interface::new(!arguments.no_panels),
            environment: arguments.lighting.environment.clone(),
            watch: None,
            steps: steps.into(),
            open: None,
            failure: None,
            frame: 0,
            time: 0.0,
            plays: true,
            last: Instant::now(),
            recorder: Recorder::of_newest(SHOWN),
            all: arguments.timings.is_some().then(|| Recorder::new(0)),
            slots: Vec::new(),
            planned: None,
            report: None,
            evaluated: None,
            message: None,
            clock: 0.0,
            recording: None,
            replay: None,
            wishes: Vec::new(),
            awaited: VecDeque::new(),
            last_window: None,
        }
    }

    /// After the window was closed: waits for the device, and writes what was asked for.
    pub(super) fn end(mut self, outputs: &Outputs) -> Result<Vec<String>, Failure> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        if let Some(open) = &mut self.open {
            let results = open.screen.finish(0)?;
            results.into_iter().try_for_each(|result| self.take(result))?;
        }
        if let (Some(output), Some(window)) = (&outputs.screenshot, &self.last_window) {
            output.write(|file| picture::write_png(file, window))?;
        }
        if let (Some(output), Some(all)) = (&outputs.timings, &self.all)
            && let Some(run) = self.run()
        {
            let report = Report { slots: self.slots.clone(), ..all.report(run).map_err(Failure::running)? };
            let is_csv = output.ending() == "csv";
            output.write_text(&if is_csv { report.to_csv() } else { report.to_json().map_err(Failure::running)? })?;
        }
        let Some(Open { screen, egui, context, window }) = self.open.take() else { return Ok(Vec::new()) };
        drop((egui, context));
        let findings = screen.close();
        drop(window);
        findings
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<Open, Failure> {
        let size = self.arguments.size;
        let attributes = Window::default_attributes()
            .with_title(format!("Magpie: {}", self.scene_name))
            .with_inner_size(PhysicalSize::new(size.width, size.height));
        let window = Arc::new(event_loop.create_window(attributes).map_err(no_display)?);
        let screen = Screen::open(&window, &self.scene, &self.config, self.arguments)?;
        let context = egui::Context::default();
        let most = screen.gpu().report().limits.get("max_image_edge").map(|edge| *edge as usize);
        let scale = Some(window.scale_factor() as f32);
        let egui = State::new(context.clone(), egui::ViewportId::ROOT, &window, scale, window.theme(), most);
        match self.arguments.frame.config.as_deref().map(Watch::new).transpose() {
            Ok(watch) => self.watch = watch,
            Err(failure) => self.message = Some(failure.message()),
        }
        self.last = Instant::now();
        Ok(Open { screen, egui, context, window })
    }

    /// One turn: what is to be done, the interface, the frame.
    fn turn(&mut self, event_loop: &ActiveEventLoop) -> Result<(), Failure> {
        let mut actions = Vec::new();
        while let Some(step) = self.steps.pop_front_if(|step| step.frame <= self.frame) {
            actions.push(step.action);
        }
        let edited = self.watch.as_ref().filter(|watch| watch.has_changed()).map(|watch| watch.path().to_owned());
        actions.extend(edited.map(Action::Config));
        self.act(actions, event_loop)?;
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        self.evaluate();

        let Some(open) = &mut self.open else { return Ok(()) };
        let mut actions = Vec::new();
        let size = open.window.inner_size();
        let window = Extent::new(size.width, size.height);
        if size.width > 0 && size.height > 0 {
            let raw = open.egui.take_egui_input(&open.window);
            let model = Model {
                catalogue: &self.catalogue,
                config: &self.config,
                slots: &self.slots,
                frames: self.recorder.frames(),
                planned: self.planned.as_ref().map(|(declaration, plan)| Planned { declaration, plan }),
                report: self.report.as_ref(),
                scene: &self.scene_name,
                cameras: &self.cameras,
                device: &open.screen.gpu().report().name,
                plays: self.plays,
                compares: self.other.is_some(),
                records: self.recording.is_some(),
                message: self.message.as_deref(),
            };
            let (interface, navigation) = (&mut self.interface, &mut self.navigation);
            let mut place = None;
            let step = self.arguments.time_step.map_or(seconds, f64::from);
            let output = open.context.run_ui(raw, |ui| {
                actions.clear();
                place = Some(interface.show(ui, &model, navigation, step, &mut actions));
            });
            if let Some(replay) = &self.replay {
                let (camera, has_ended) = replay.camera(self.clock)?;
                self.navigation = Navigation::new(&camera, self.navigation.distance());
                self.replay = self.replay.take().filter(|_| !has_ended);
            }
            if let Some(recording) = &mut self.recording {
                recording.add(self.clock, self.navigation.camera(), self.navigation.distance());
            }
            open.egui.handle_platform_output(&open.window, output.platform_output);
            let scale = output.pixels_per_point;
            let side = |points: f32| ((points * scale).round() as u32).max(1);
            let picture =
                place.map_or(window, |place| Extent::new(side(place.rect.width()), side(place.rect.height())));
            let primitives = open.context.tessellate(output.shapes, scale);
            let is_last = self.arguments.frames == Some(self.frame + 1);
            if is_last && self.arguments.screenshot.is_some() {
                self.wishes.push(Wish::LastWindow);
            }
            let aspect = f64::from(picture.width) / f64::from(picture.height);
            for wish in &mut self.wishes {
                if let Wish::Depth { seen, .. } = wish {
                    *seen = Some((self.navigation.camera().clone(), aspect));
                }
            }
            let mut wanted: Vec<Wanted> = self.wishes.iter().map(Wish::wanted).collect();
            wanted.sort_unstable_by_key(|wanted| wanted.name());
            wanted.dedup();
            let (number, _) = open.screen.draw(Drawing {
                camera: self.navigation.camera(),
                time: self.time,
                window,
                picture,
                interface: &primitives,
                textures: output.textures_delta,
                pixels_per_point: scale,
                wanted: &wanted,
            })?;
            self.awaited.extend(self.wishes.drain(..).map(|wish| (number, wish)));
            let most = self.arguments.frames_in_flight as usize - 1;
            let results = open.screen.finish(if is_last { 0 } else { most })?;
            results.into_iter().try_for_each(|result| self.take(result))?;
        }
        let step = self.arguments.time_step.map_or(seconds, f64::from);
        self.clock += step;
        self.time += if self.plays { step } else { 0.0 };
        self.act(actions, event_loop)?;
        self.frame += 1;
        if self.arguments.frames.is_some_and(|frames| self.frame >= frames) {
            event_loop.exit();
        }
        Ok(())
    }

    /// Keeps what a finished frame has brought.
    pub(super) fn take(&mut self, mut result: FrameResult) -> Result<(), Failure> {
        while let Some((_, wish)) = self.awaited.pop_front_if(|(frame, _)| *frame <= result.frame) {
            let name = wish.wanted().name();
            let Some((_, pixels)) = result.copied.iter().find(|(copied, _)| copied == name) else { continue };
            match wish {
                Wish::Window(output) => output.write(|file| picture::write_png(file, pixels))?,
                Wish::Radiance(output) => output.write(|file| picture::write_exr(file, pixels))?,
                Wish::LastWindow => self.last_window = Some(pixels.clone()),
                Wish::Depth { at, seen } => {
                    let point = seen.and_then(|(camera, aspect)| point_at(pixels, at, &camera, aspect));
                    point.into_iter().for_each(|point| self.navigation.look_at(point));
                }
            }
        }
        self.slots = result.what_runs();
        self.planned = Some((result.declaration.clone(), result.plan.clone()));
        if let Some(all) = &mut self.all {
            all.push(result.sample.clone());
        }
        self.recorder.push(std::mem::take(&mut result.sample));
        Ok(())
    }

    /// Evaluates times now and then: numbers that change in every frame cannot be read.
    fn evaluate(&mut self) {
        let is_due = self.evaluated.is_none_or(|then| then.elapsed().as_secs_f64() >= REFRESH);
        if is_due
            && let Some(run) = self.run()
            && let Ok(report) = self.recorder.report(run)
        {
            self.report = Some(Report { slots: self.slots.clone(), ..report });
            self.evaluated = Some(Instant::now());
        }
    }

    pub(super) fn run(&self) -> Option<Run> {
        let open = self.open.as_ref()?;
        let report = open.screen.gpu().report();
        let size = open.window.inner_size();
        Some(Run {
            magpie: env!("CARGO_PKG_VERSION").to_owned(),
            commit: env!("MAGPIE_COMMIT").to_owned(),
            device: magpie::measure::Device {
                name: report.name.clone(),
                driver: report.driver.clone(),
                kind: report.kind.to_owned(),
            },
            rays: open.screen.rays().name().to_owned(),
            scene: self.scene_name.clone(),
            size: [size.width, size.height],
            config: self.config.clone(),
        })
    }

    fn fail(&mut self, failure: Failure, event_loop: &ActiveEventLoop) {
        self.failure.get_or_insert(failure);
        event_loop.exit();
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        event_loop.set_control_flow(ControlFlow::Poll);
        if self.open.is_none() {
            match self.open(event_loop) {
                Ok(open) => self.open = Some(open),
                Err(failure) => self.fail(failure, event_loop),
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        let _ = open.egui.on_window_event(&open.window, &event);
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::DroppedFile(path) => {
                let done = Action::of_dropped(&path).and_then(|action| self.act(vec![action], event_loop));
                match done {
                    Ok(()) => {}
                    Err(failure @ Failure::Input(_)) => self.message = Some(failure.message()),
                    Err(failure) => self.fail(failure, event_loop),
                }
            }
            WindowEvent::RedrawRequested => {
                if let Err(failure) = self.turn(event_loop) {
                    self.fail(failure, event_loop);
                }
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        if is_interrupted() {
            self.fail(Failure::Interrupted, event_loop);
        }
        if let Some(open) = &self.open {
            open.window.request_redraw();
        }
    }
}
