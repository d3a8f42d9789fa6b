//! What each action does.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use magpie::{
    config::Config,
    measure::{Recorder, Report, chrome_trace},
    scene::{CameraPath, Scene},
};
use winit::{dpi::PhysicalSize, event_loop::ActiveEventLoop};

use super::{
    action::{self, Action},
    background::Wanted,
    interface::format_of,
    navigation::Navigation,
    shaders::{Outcome, ShaderWatch},
    tour::{Recording, Replay},
    watch::Watch,
    window::{App, DISTANCE, SHOWN, Wish, theme},
};
use crate::{args::EnvironmentArguments, exit::Failure, input, output::Output, session};

impl App<'_> {
    /// Does what was asked for. A mistake in it is shown; only what the viewer cannot go on after is returned.
    pub(super) fn act(&mut self, actions: Vec<Action>, event_loop: &ActiveEventLoop) -> Result<(), Failure> {
        for action in actions {
            let done = self.try_act(action, event_loop);
            self.show_mistake(done)?;
        }
        Ok(())
    }

    /// Shows what the viewer can go on after, and returns the rest.
    pub(super) fn show_mistake(&mut self, done: Result<(), Failure>) -> Result<(), Failure> {
        match done {
            Err(failure @ (Failure::Usage(_) | Failure::Input(_))) => {
                log::warn!("{}", failure.message());
                self.message = Some(failure.message());
                Ok(())
            }
            done => done,
        }
    }

    fn try_act(&mut self, action: Action, event_loop: &ActiveEventLoop) -> Result<(), Failure> {
        match action {
            Action::Set(assignment) => {
                let mut over = Config::default();
                over.set(&assignment)?;
                self.catalogue.check(&over, &assignment)?;
                let mut config = self.wanted_config().clone();
                for slot in over.stages.keys() {
                    // Settings of the old implementation may not suit the new one.
                    config.settings.remove(slot);
                }
                config.merge(over);
                self.configure(&config)?;
            }
            Action::Reset(slot) => {
                let mut config = self.wanted_config().clone();
                config.stages.remove(&slot);
                config.settings.remove(&slot);
                self.configure(&config)?;
            }
            Action::SaveConfig(path) => {
                Output::plan("configuration", &path, &["toml"])?.write_text(&self.wanted_config().to_toml()?)?;
            }
            Action::Screenshot(path) => {
                let output = Output::plan("screenshot", &path, &["png", "exr"])?;
                let is_exr = output.ending() == "exr";
                self.wishes.push(if is_exr { Wish::Radiance(output) } else { Wish::Window(output) });
            }
            Action::Snapshot => {
                let full = || Failure::bad("the current folder has no free name for a snapshot");
                for path in action::free_names(Path::new(""), ["png", "exr"]).ok_or_else(full)? {
                    self.try_act(Action::Screenshot(path), event_loop)?;
                }
            }
            Action::Export(path) => self.export(&path)?,
            Action::Record(path) => {
                self.recording = Some(Recording::new(self.clock, Output::plan("camera path", &path, &["json"])?));
            }
            Action::StopRecording => {
                if let Some(mut recording) = self.recording.take() {
                    let path = recording.path(self.clock, self.navigation.camera(), self.navigation.distance())?;
                    let text = serde_json::to_string_pretty(&path).map_err(Failure::running)?;
                    recording.output.write_text(&(text + "\n"))?;
                }
            }
            Action::ToggleRecording if self.recording.is_some() => self.try_act(Action::StopRecording, event_loop)?,
            Action::ToggleRecording => {
                let full = || Failure::bad("the current folder has no free name for a camera path");
                let [path] = action::free_names(Path::new(""), ["path.json"]).ok_or_else(full)?;
                self.try_act(Action::Record(path), event_loop)?;
            }
            Action::Replay(path) => {
                self.replay = Some(Replay { path: CameraPath::read(&path)?, begun: self.clock });
            }
            Action::Panel(panel) => self.interface.toggle(panel),
            Action::Panels => self.interface.panels = !self.interface.panels,
            Action::Compare(compares) => {
                self.settle()?;
                self.other = compares.then(|| self.config.clone());
                if let Some(open) = &mut self.open {
                    open.screen.compare(&self.scene, self.other.as_ref())?;
                }
            }
            Action::Swap => {
                self.settle()?;
                if let (Some(other), Some(open)) = (&mut self.other, &mut self.open) {
                    std::mem::swap(&mut self.config, other);
                    let results = open.screen.swap()?;
                    results.into_iter().try_for_each(|result| self.take(result))?;
                    self.recorder = Recorder::of_newest(SHOWN);
                    self.steady = 0;
                }
            }
            Action::Truth(shows) => self.show_truth(shows),
            Action::TruthAs(view) => self.interface.truth_view = view,
            Action::ExportTruth(path) => {
                let text = serde_json::to_string_pretty(&self.measured).map_err(Failure::running)?;
                Output::plan("export", &path, &["json"])?.write_text(&(text + "\n"))?;
            }
            Action::Split(split) => self.interface.split = split.clamp(0.0, 1.0),
            Action::Present(name) => {
                let mode = *input::find("way to show pictures", &name, &self.modes, |mode| mode.name())?;
                if let Some(open) = &mut self.open {
                    open.screen.set_mode(mode);
                }
                self.remembered.present = name;
            }
            Action::Light(light) => {
                self.remembered.light = light;
                if let Some(open) = &self.open {
                    open.context.set_theme(theme(light));
                }
            }
            Action::Play(plays) => self.plays = plays,
            Action::Camera(name) => {
                let camera = session::camera(&self.scene, Some(Path::new(&name)))?;
                self.navigation = Navigation::new(&camera, self.navigation.distance());
                if let Some(open) = &mut self.open {
                    open.screen.cut();
                }
            }
            Action::LookAt(at) => self.wishes.push(Wish::Depth { at, seen: None }),
            Action::Resize([width, height]) => {
                if let Some(open) = &self.open {
                    let _ = open.window.request_inner_size(PhysicalSize::new(width.max(1), height.max(1)));
                }
            }
            Action::Minimise(minimised) => {
                if let Some(open) = &self.open {
                    open.window.set_minimized(minimised);
                }
            }
            Action::Open(path) => {
                self.open_scene(Wanted { path, environment: self.environment.clone(), stays: false })?;
            }
            Action::Environment(path) => {
                let environment = EnvironmentArguments { environment: Some(path), ..self.environment.clone() };
                self.open_scene(Wanted { path: PathBuf::from(&self.scene_name), environment, stays: true })?;
            }
            Action::Config(path) => {
                // Followed even where it has a mistake, which will be mended.
                if self.watch.as_ref().is_none_or(|watch| watch.path() != path) {
                    self.watch = Some(Watch::new(&path)?);
                }
                let config = input::configure(&self.catalogue, Some(&path), &self.arguments.frame.set)?;
                self.configure(&config)?;
            }
            Action::Reload => {
                let (path, environment) = (PathBuf::from(&self.scene_name), self.environment.clone());
                self.open_scene(Wanted { path, environment, stays: true })?;
            }
            Action::Input(input) => self.inputs.push(input),
            Action::LoseDevice(pass) => {
                if let Some(open) = &mut self.open {
                    open.screen.lose_device_in(&pass);
                }
            }
            Action::Inspect(pass, output) => {
                let planned = self.planned.as_ref();
                let format = planned.and_then(|(declaration, _)| format_of(declaration, &pass, &output));
                self.interface.inspector.choose(pass, output, format);
            }
            Action::InspectNothing => self.interface.inspector.close(),
            Action::InspectAs(change) => self.interface.inspector.change(&change)?,
            Action::Pick(pixel) => self.interface.inspector.pin(pixel),
            Action::Close => event_loop.exit(),
        }
        Ok(())
    }

    /// Writes the numbers that the profiler shows.
    fn export(&mut self, path: &Path) -> Result<(), Failure> {
        let output = Output::plan("export", path, &["json", "csv"])?;
        let frozen = self.interface.frozen();
        let is_trace = path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(".trace.json"));
        if is_trace {
            let frames = frozen.map_or(self.recorder.frames(), |(frames, _)| frames);
            return output.write_text(&chrome_trace(frames).to_string());
        }
        let none = || Failure::bad("no frame has been measured yet");
        let report = match frozen {
            Some((_, report)) => report.clone(),
            None => self.recorder.report(self.run().ok_or_else(none)?).map_err(Failure::input)?,
        };
        let report = Report { slots: self.slots.clone(), ..report };
        let is_csv = output.ending() == "csv";
        output.write_text(&if is_csv { report.to_csv() } else { report.to_json().map_err(Failure::running)? })
    }

    /// The configuration in use, or the one that will be once its pipelines are made.
    pub(super) fn wanted_config(&self) -> &Config {
        self.background.coming.as_ref().map_or(&self.config, |coming| &coming.config)
    }

    /// Whether each frame has to be the same in every run, so that nothing may come when it is ready.
    fn is_repeatable(&self) -> bool {
        self.arguments.time_step.is_some()
    }

    /// Sets the configuration once its pipelines are made, which is at once where they are already.
    fn configure(&mut self, config: &Config) -> Result<(), Failure> {
        let full = self.catalogue.complete(config);
        self.catalogue.check(&full, "the configuration as a whole")?;
        if let Some(open) = &self.open
            && !self.is_repeatable()
        {
            let set = open.screen.pipelines_of(&full)?;
            if set.missing(open.screen.gpu()) > 0 {
                return self.background.prepare(open.screen.gpu(), set, full);
            }
        }
        self.background.drop_coming();
        self.configure_now(full)
    }

    /// Sets a complete configuration with the next frame.
    pub(super) fn configure_now(&mut self, full: Config) -> Result<(), Failure> {
        if let Some(open) = &mut self.open {
            open.screen.configure(&full)?;
        }
        (self.config, self.message, self.steady) = (full, None, 0);
        Ok(())
    }

    /// Takes a configuration whose pipelines are still being made at once.
    fn settle(&mut self) -> Result<(), Failure> {
        let coming = self.background.coming.as_ref().map(|coming| coming.config.clone());
        self.background.drop_coming();
        coming.map_or(Ok(()), |config| self.configure_now(config))
    }

    fn open_scene(&mut self, wanted: Wanted) -> Result<(), Failure> {
        let supply = self.arguments.lighting.supply;
        if self.is_repeatable() {
            self.show_scene(wanted.load(supply)?, wanted)
        } else {
            self.background.load(wanted, supply)
        }
    }

    /// Shows a scene that was loaded.
    pub(super) fn show_scene(&mut self, scene: Scene, wanted: Wanted) -> Result<(), Failure> {
        let Wanted { path, environment, stays } = wanted;
        let first = if stays { None } else { Some(session::camera(&scene, None)?) };
        if let Some(open) = &mut self.open {
            let results = open.screen.open_scene(&scene, &self.config)?;
            open.window.set_title(&format!("Magpie: {}", path.display()));
            results.into_iter().try_for_each(|result| self.take(result))?;
        }
        if !self.is_repeatable() {
            self.remembered.note(&self.scene_name, self.navigation.camera(), self.navigation.distance());
        }
        self.scene_name = path.display().to_string();
        self.cameras = scene.cameras.iter().map(|camera| camera.name.clone()).collect();
        self.time = if stays { self.time } else { 0.0 };
        self.other = self.other.take().filter(|_| stays);
        if let Some(first) = first {
            let (camera, distance) = self.remembered.camera(&self.scene_name).unwrap_or((first, DISTANCE));
            self.navigation = Navigation::new(&camera, distance);
        }
        (self.scene, self.environment, self.message) = (scene, environment, None);
        if let (Some(open), Some(other)) = (&mut self.open, &self.other) {
            open.screen.compare(&self.scene, Some(other))?;
        }
        (self.recorder, self.steady) = (Recorder::of_newest(SHOWN), 0);
        (self.truth, self.measured) = (None, Vec::new());
        self.follow_assets();
        Ok(())
    }

    /// Follows the files of the scene.
    pub(super) fn follow_assets(&mut self) {
        let scene = Path::new(&self.scene_name);
        let scene = scene.is_file().then(|| Watch::scene(scene));
        let environment = self.environment.environment.as_deref().map(Watch::new);
        self.assets = Vec::new();
        for watch in scene.into_iter().chain(environment) {
            match watch {
                Ok(watch) => self.assets.push(watch),
                Err(failure) => self.message = Some(failure.message()),
            }
        }
    }

    /// What editing of files has brought about since the last frame.
    pub(super) fn take_edits(&mut self) -> Vec<Action> {
        for outcome in self.shaders.iter().flat_map(ShaderWatch::outcomes).collect::<Vec<_>>() {
            let applied = match outcome {
                Outcome::Refused(message) => Err(message),
                Outcome::Compiled { files, reload } => {
                    let count = reload.pipelines();
                    reload.apply().map(|()| (files, count)).map_err(|error| error.to_string())
                }
            };
            match applied {
                Ok((Some(files), count)) => {
                    log::info!("{files}: {count} pipeline(s) made anew");
                    self.message = None;
                }
                Ok((None, _)) => {}
                Err(message) => {
                    log::warn!("{message}");
                    self.message = Some(message);
                }
            }
        }
        let edited = self.watch.as_ref().filter(|watch| watch.has_changed()).map(|watch| watch.path().to_owned());
        let mut actions: Vec<Action> = edited.map(Action::Config).into_iter().collect();
        // Editors and exporters write several files, or one in several steps.
        if self.assets.iter().filter(|watch| watch.has_changed()).count() > 0 {
            self.assets_changed = Some(Instant::now());
        }
        if self.assets_changed.take_if(|then| then.elapsed() >= QUIET).is_some() {
            actions.push(Action::Reload);
        }
        actions
    }
}

/// How long the files of a scene must have been left alone before it is loaded again.
const QUIET: Duration = Duration::from_millis(200);
