//! The window: its events, what is done by hand or by a file, and one frame after the other.

use std::{
    collections::VecDeque,
    sync::{Arc, mpsc::Receiver},
    time::Instant,
};

use egui_winit::State;
use magpie::{
    config::{Catalogue, Config},
    gpu::PresentMode,
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
    background::Background,
    costs::Costs,
    input_events::{Input, Pointer},
    interface::{Interface, Model, Planned},
    is_interrupted,
    navigation::{Navigation, point_at},
    no_display,
    remembered::Remembered,
    screen::{Drawing, Screen, Wanted},
    shaders::ShaderWatch,
    tour::{Recording, Replay},
    truth::{Asked, Measured, Truth},
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
/// Size of the first window, pixels.
const FIRST_SIZE: crate::args::Extent = crate::args::Extent { width: 1280, height: 720 };
/// Seconds between two evaluations of them.
const REFRESH: f64 = 0.5;
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
    /// The files of the scene.
    pub(super) assets: Vec<Watch>,
    /// When one of them was last written, unless the scene was loaded since.
    pub(super) assets_changed: Option<Instant>,
    pub(super) shaders: Option<ShaderWatch>,
    pub(super) background: Background,
    steps: VecDeque<Step>,
    /// Actions that come from outside.
    pub(super) commands: Option<Receiver<Result<Action, Failure>>>,
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
    pub(super) planned: Option<(Arc<Declaration>, Arc<Plan>)>,
    report: Option<Report>,
    evaluated: Option<Instant>,
    pub(super) message: Option<String>,
    pub(super) costs: Costs,
    pub(super) remembered: Remembered,
    /// Events of the actions before this frame.
    pub(super) inputs: Vec<Input>,
    pointer: Pointer,
    /// What the display offers.
    pub(super) modes: Vec<PresentMode>,
    /// Frames that were measured with the present configuration.
    pub(super) steady: usize,
    /// The reference, while it is shown.
    pub(super) truth: Option<Truth>,
    /// What was measured against it, the newest first.
    pub(super) measured: Vec<Measured>,
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
    pub(super) context: egui::Context,
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
    /// Radiance, to be compared with the reference.
    TruthRadiance,
    /// Display values, for the same.
    TruthDisplay(Box<Asked>),
    /// The depth of a place in the picture, and from where and in which shape of a picture it is seen.
    Depth { at: [f32; 2], seen: Option<(Camera, f64)> },
}

impl Wish {
    fn wanted(&self) -> Wanted {
        match self {
            Self::Window(_) | Self::LastWindow => Wanted::Window,
            Self::Radiance(_) | Self::TruthRadiance => Wanted::Radiance,
            Self::TruthDisplay(_) => Wanted::Display,
            Self::Depth { .. } => Wanted::Depth,
        }
    }
}

impl<'a> App<'a> {
    pub(super) fn new(
        arguments: &'a ViewArguments,
        scene: Scene,
        camera: &Camera,
        config: Config,
        steps: Vec<Step>,
        remembered: Remembered,
    ) -> Self {
        let scene_name = arguments.scene.display().to_string();
        let last = remembered.camera(&scene_name).filter(|_| arguments.frame.camera.is_none());
        Self {
            arguments,
            catalogue: session::catalogue(),
            scene_name,
            cameras: scene.cameras.iter().map(|camera| camera.name.clone()).collect(),
            scene,
            config,
            other: None,
            navigation: last.map_or_else(
                || Navigation::new(camera, DISTANCE),
                |(camera, distance)| Navigation::new(&camera, distance),
            ),
            interface: Interface::new(!arguments.no_panels, remembered.panels),
            environment: arguments.lighting.environment.clone(),
            watch: None,
            assets: Vec::new(),
            assets_changed: None,
            shaders: None,
            background: Background::default(),
            steps: steps.into(),
            commands: None,
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
            costs: Costs::default(),
            remembered,
            inputs: Vec::new(),
            pointer: Pointer::default(),
            modes: Vec::new(),
            steady: 0,
            truth: None,
            measured: Vec::new(),
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
        std::mem::take(&mut self.background).end();
        (self.shaders, self.truth) = (None, None);
        if let Some(failure) = self.failure.take() {
            if let Failure::Interrupted = failure {
                self.remember()?;
            }
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
        self.remember()?;
        if let Some((_, plan)) = &self.planned {
            log::info!("{}", self.costs.line(plan.order.len()));
        }
        let Some(Open { screen, egui, context, window }) = self.open.take() else { return Ok(Vec::new()) };
        drop((egui, context));
        let findings = screen.close();
        drop(window);
        findings
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<Open, Failure> {
        let last = self.remembered.window.map(|[width, height]| crate::args::Extent { width, height });
        let size = self.arguments.size.or(last).unwrap_or(FIRST_SIZE);
        let attributes = Window::default_attributes()
            .with_title(format!("Magpie: {}", self.scene_name))
            .with_inner_size(PhysicalSize::new(size.width, size.height));
        let window = Arc::new(event_loop.create_window(attributes).map_err(no_display)?);
        let mut screen = Screen::open(&window, &self.scene, &self.config, self.arguments)?;
        self.modes = screen.modes()?;
        if let Some(mode) = self.modes.iter().copied().find(|mode| mode.name() == self.remembered.present) {
            screen.set_mode(mode);
        }
        let context = egui::Context::default();
        context.set_theme(theme(self.remembered.light));
        context.set_zoom_factor(self.remembered.scale.clamp(0.2, 5.0));
        let most = screen.gpu().report().limits.get("max_image_edge").map(|edge| *edge as usize);
        let scale = Some(window.scale_factor() as f32);
        let egui = State::new(context.clone(), egui::ViewportId::ROOT, &window, scale, window.theme(), most);
        match self.arguments.frame.config.as_deref().map(Watch::new).transpose() {
            Ok(watch) => self.watch = watch,
            Err(failure) => self.message = Some(failure.message()),
        }
        self.shaders = ShaderWatch::new(screen.gpu(), self.arguments.shaders.as_deref())?;
        self.follow_assets();
        self.last = Instant::now();
        Ok(Open { screen, egui, context, window })
    }

    /// One turn: what is to be done, the interface, the frame.
    fn turn(&mut self, event_loop: &ActiveEventLoop) -> Result<(), Failure> {
        let mut actions = self.actions_due();
        actions.extend(self.take_edits());
        self.act(actions, event_loop)?;
        let commands: Vec<_> = self.commands.iter().flat_map(Receiver::try_iter).collect();
        for command in commands {
            match command {
                Ok(action) => self.act(vec![action], event_loop)?,
                Err(failure) => self.show_mistake(Err(failure))?,
            }
        }
        let done = self.take_background();
        self.show_mistake(done)?;
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        let evaluated = Instant::now();
        self.evaluate();
        let statistics_time = evaluated.elapsed();

        let gpu_ms = self.steady_gpu_ms();
        let Some(open) = &mut self.open else { return Ok(()) };
        let mut actions = Vec::new();
        let size = open.window.inner_size();
        let window = Extent::new(size.width, size.height);
        if size.width > 0 && size.height > 0 {
            let line = self.background.line();
            let mut raw = open.egui.take_egui_input(&open.window);
            let points = raw.screen_rect.map_or(egui::Vec2::ZERO, |rect| rect.size());
            let events = self.inputs.drain(..).flat_map(|input| self.pointer.events(&input, points));
            raw.events.extend(events);
            let model = Model {
                catalogue: &self.catalogue,
                config: self.background.coming.as_ref().map_or(&self.config, |coming| &coming.config),
                slots: &self.slots,
                frames: self.recorder.frames(),
                planned: self.planned.as_ref().map(|(declaration, plan)| Planned { declaration, plan }),
                report: self.report.as_ref(),
                scene: &self.scene_name,
                cameras: &self.cameras,
                recent: &self.remembered.recent,
                modes: &self.modes,
                mode: open.screen.mode(),
                is_light: self.remembered.light,
                device: &open.screen.gpu().report().name,
                plays: self.plays,
                compares: self.other.is_some(),
                records: self.recording.is_some(),
                truth: self.truth.as_ref().map(Truth::state),
                measured: &self.measured,
                costs: self.costs.medians(),
                progress: line.as_deref(),
                message: self.message.as_deref(),
            };
            let (interface, navigation) = (&mut self.interface, &mut self.navigation);
            let mut place = None;
            let step = self.arguments.time_step.map_or(seconds, f64::from);
            let begun = Instant::now();
            let output = open.context.run_ui(raw, |ui| {
                actions.clear();
                place = Some(interface.show(ui, &model, navigation, step, &mut actions));
            });
            let ui_time = begun.elapsed();
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
            let begun = Instant::now();
            let primitives = open.context.tessellate(output.shapes, scale);
            let egui_time = ui_time + begun.elapsed();
            let is_last = self.arguments.frames == Some(self.frame + 1);
            if is_last && self.arguments.screenshot.is_some() {
                self.wishes.push(Wish::LastWindow);
            }
            let aspect = f64::from(picture.width) / f64::from(picture.height);
            let camera = self.navigation.camera();
            self.wishes.retain_mut(|wish| match wish {
                Wish::TruthDisplay(asked) => {
                    asked.note(&self.config, gpu_ms);
                    asked.suits(camera, self.time, picture)
                }
                Wish::Depth { seen, .. } => {
                    *seen = Some((camera.clone(), aspect));
                    true
                }
                _ => true,
            });
            let mut wanted: Vec<Wanted> = self.wishes.iter().map(Wish::wanted).collect();
            wanted.sort_unstable_by_key(|wanted| wanted.name());
            wanted.dedup();
            let drawn = open.screen.draw(Drawing {
                camera: self.navigation.camera(),
                time: self.time,
                window,
                picture,
                interface: &primitives,
                textures: output.textures_delta,
                pixels_per_point: scale,
                wanted: &wanted,
                inspection: self.interface.inspector.inspection(),
            })?;
            self.awaited.extend(self.wishes.drain(..).map(|wish| (drawn.frame, wish)));
            let most = self.arguments.frames_in_flight as usize - 1;
            let results = open.screen.finish(if is_last { 0 } else { most })?;
            let begun = Instant::now();
            results.into_iter().try_for_each(|result| self.take(result))?;
            self.costs.add([egui_time, drawn.overlay_time, statistics_time + begun.elapsed()]);
            self.advance_truth(picture)?;
        }
        let step = self.arguments.time_step.map_or(seconds, f64::from);
        self.clock += step;
        self.time += if self.plays { step } else { 0.0 };
        self.act(actions, event_loop)?;
        self.frame += 1;
        if self.arguments.frames.is_some_and(|frames| self.frame >= frames) {
            let last = self.actions_due();
            self.act(last, event_loop)?;
            event_loop.exit();
        }
        Ok(())
    }

    /// The actions of the file before the next frame.
    fn actions_due(&mut self) -> Vec<Action> {
        let due = self.steps.iter().take_while(|step| step.frame <= self.frame).count();
        self.steps.drain(..due).map(|step| step.action).collect()
    }

    /// Keeps what a finished frame has brought.
    pub(super) fn take(&mut self, mut result: FrameResult) -> Result<(), Failure> {
        while let Some((_, wish)) = self.awaited.pop_front_if(|(frame, _)| *frame <= result.frame) {
            let name = wish.wanted().name();
            let Some((_, pixels)) = result.copied.iter().find(|(copied, _)| copied == name) else { continue };
            match wish {
                Wish::Window(output) => output.write(|file| picture::write_png(file, pixels))?,
                Wish::Radiance(output) => output.write(|file| picture::write_exr(file, pixels))?,
                Wish::TruthRadiance => self.take_radiance(pixels.clone()),
                Wish::TruthDisplay(asked) => self.take_display(pixels.clone(), *asked)?,
                Wish::LastWindow => self.last_window = Some(pixels.clone()),
                Wish::Depth { at, seen } => {
                    let point = seen.and_then(|(camera, aspect)| point_at(pixels, at, &camera, aspect));
                    point.into_iter().for_each(|point| self.navigation.look_at(point));
                }
            }
        }
        // A plan is used again as long as the frame stays what it is.
        let is_known = self.planned.as_ref().is_some_and(|(_, plan)| Arc::ptr_eq(plan, &result.plan));
        if !is_known {
            self.slots = result.what_runs();
        }
        self.interface.inspector.take(result.inspected.take());
        self.planned = Some((result.declaration.clone(), result.plan.clone()));
        if let Some(all) = &mut self.all {
            all.push(result.sample.clone());
        }
        self.recorder.push(std::mem::take(&mut result.sample));
        self.steady += 1;
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

    /// Writes what the next run begins with.
    fn remember(&mut self) -> Result<(), Failure> {
        let Some(open) = self.open.as_ref().filter(|_| self.arguments.time_step.is_none()) else { return Ok(()) };
        let size = open.window.inner_size();
        if size.width > 0 && size.height > 0 {
            self.remembered.window = Some([size.width, size.height]);
        }
        self.remembered.scale = open.context.zoom_factor();
        self.remembered.panels = self.interface.panels_shown();
        self.remembered.note(&self.scene_name, self.navigation.camera(), self.navigation.distance());
        self.remembered.save()
    }

    fn fail(&mut self, failure: Failure, event_loop: &ActiveEventLoop) {
        self.failure.get_or_insert(failure);
        event_loop.exit();
    }
}

/// Colours of the panels.
pub(super) fn theme(is_light: bool) -> egui::Theme {
    if is_light { egui::Theme::Light } else { egui::Theme::Dark }
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
