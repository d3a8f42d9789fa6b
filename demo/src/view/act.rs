//! What each action does.

use std::path::{Path, PathBuf};

use magpie::{
    config::Config,
    measure::{Recorder, Report, chrome_trace},
    scene::CameraPath,
};
use winit::{dpi::PhysicalSize, event_loop::ActiveEventLoop};

use super::{
    action::{self, Action},
    navigation::Navigation,
    tour::{Recording, Replay},
    watch::Watch,
    window::{App, DISTANCE, SHOWN, Wish},
};
use crate::{args::EnvironmentArguments, exit::Failure, input, output::Output, session};

impl App<'_> {
    /// Does what was asked for. A mistake in it is shown; only what the viewer cannot go on after is returned.
    pub(super) fn act(&mut self, actions: Vec<Action>, event_loop: &ActiveEventLoop) -> Result<(), Failure> {
        for action in actions {
            match self.try_act(action, event_loop) {
                Ok(()) => {}
                Err(failure @ (Failure::Usage(_) | Failure::Input(_))) => {
                    log::warn!("{}", failure.message());
                    self.message = Some(failure.message());
                }
                Err(failure) => return Err(failure),
            }
        }
        Ok(())
    }

    fn try_act(&mut self, action: Action, event_loop: &ActiveEventLoop) -> Result<(), Failure> {
        match action {
            Action::Set(assignment) => {
                let mut over = Config::default();
                over.set(&assignment)?;
                self.catalogue.check(&over, &assignment)?;
                let mut config = self.config.clone();
                for slot in over.stages.keys() {
                    // Settings of the old implementation may not suit the new one.
                    config.settings.remove(slot);
                }
                config.merge(over);
                self.configure(&config)?;
            }
            Action::Reset(slot) => {
                let mut config = self.config.clone();
                config.stages.remove(&slot);
                config.settings.remove(&slot);
                self.configure(&config)?;
            }
            Action::SaveConfig(path) => {
                Output::plan("configuration", &path, &["toml"])?.write_text(&self.config.to_toml()?)?;
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
                self.other = compares.then(|| self.config.clone());
                if let Some(open) = &mut self.open {
                    open.screen.compare(&self.scene, self.other.as_ref())?;
                }
            }
            Action::Swap => {
                if let (Some(other), Some(open)) = (&mut self.other, &mut self.open) {
                    std::mem::swap(&mut self.config, other);
                    let results = open.screen.swap()?;
                    results.into_iter().try_for_each(|result| self.take(result))?;
                    self.recorder = Recorder::of_newest(SHOWN);
                }
            }
            Action::Split(split) => self.interface.split = split.clamp(0.0, 1.0),
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
                let environment = self.environment.clone();
                self.open_scene(&path, environment)?;
            }
            Action::Environment(path) => {
                let environment = EnvironmentArguments { environment: Some(path), ..self.environment.clone() };
                let (camera, distance) = (self.navigation.camera().clone(), self.navigation.distance());
                self.open_scene(&PathBuf::from(&self.scene_name), environment)?;
                self.navigation = Navigation::new(&camera, distance);
            }
            Action::Config(path) => {
                // Followed even where it has a mistake, which will be mended.
                if self.watch.as_ref().is_none_or(|watch| watch.path() != path) {
                    self.watch = Some(Watch::new(&path)?);
                }
                let config = input::configure(&self.catalogue, Some(&path), &self.arguments.frame.set)?;
                self.configure(&config)?;
            }
            Action::Close => event_loop.exit(),
        }
        Ok(())
    }

    /// Writes the numbers that the profiler shows.
    fn export(&mut self, path: &Path) -> Result<(), Failure> {
        let output = Output::plan("export", path, &["json", "csv"])?;
        let is_trace = path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(".trace.json"));
        if is_trace {
            return output.write_text(&chrome_trace(self.recorder.frames()).to_string());
        }
        let none = || Failure::bad("no frame has been measured yet");
        let report = self.recorder.report(self.run().ok_or_else(none)?).map_err(Failure::input)?;
        let report = Report { slots: self.slots.clone(), ..report };
        let is_csv = output.ending() == "csv";
        output.write_text(&if is_csv { report.to_csv() } else { report.to_json().map_err(Failure::running)? })
    }

    fn configure(&mut self, config: &Config) -> Result<(), Failure> {
        let full = self.catalogue.complete(config);
        self.catalogue.check(&full, "the configuration as a whole")?;
        if let Some(open) = &mut self.open {
            open.screen.configure(&full)?;
        }
        (self.config, self.message) = (full, None);
        Ok(())
    }

    fn open_scene(&mut self, path: &Path, environment: EnvironmentArguments) -> Result<(), Failure> {
        let scene = session::load_scene(path, Some(&environment), self.arguments.lighting.supply)?;
        let camera = session::camera(&scene, None)?;
        if let Some(open) = &mut self.open {
            let results = open.screen.open_scene(&scene, &self.config)?;
            open.window.set_title(&format!("Magpie: {}", path.display()));
            results.into_iter().try_for_each(|result| self.take(result))?;
        }
        self.scene_name = path.display().to_string();
        self.cameras = scene.cameras.iter().map(|camera| camera.name.clone()).collect();
        self.navigation = Navigation::new(&camera, DISTANCE);
        (self.scene, self.environment, self.time, self.message) = (scene, environment, 0.0, None);
        self.other = None;
        self.recorder = Recorder::of_newest(SHOWN);
        Ok(())
    }
}
