//! The one place where the command line meets the engine and the renderer.

use std::path::Path;

use magpie::prelude::Rays as Way;
use magpie::{
    config::{Catalogue, Config},
    gpu::{DeviceReport, Gpu, GpuOptions},
    graph::{GraphError, Switches, execute::ExecuteOptions},
    measure::Device,
    scene::{self, BUILTIN, BuiltinParameter, Camera, CameraFile, Environment, ResidentError, Scene, SceneError},
};
use magpie_passes::{FrameRequest, FrameResult, FrameTicket, RenderError, RenderOptions, Renderer, Slots};

use crate::{
    args::{EnvironmentArguments, Extent, Rays, Supply, ViewName},
    exit::Failure,
    input,
};

const BUILTIN_PREFIX: &str = "builtin:";

/// Every slot with its implementations and settings.
pub(crate) fn catalogue() -> Catalogue {
    Slots::default().catalogue()
}

/// Every Vulkan device.
pub(crate) fn devices() -> Result<Vec<DeviceReport>, Failure> {
    Ok(magpie::gpu::devices()?)
}

/// Names of the built-in scenes as given on the command line, each with a one-line description.
pub(crate) fn scenes() -> Vec<(String, &'static str)> {
    BUILTIN.iter().map(|(name, about)| (format!("{BUILTIN_PREFIX}{name}"), *about)).collect()
}

/// The parameters of a built-in scene, by its name on the command line.
pub(crate) fn scene_parameters(name: &str) -> &'static [BuiltinParameter] {
    name.strip_prefix(BUILTIN_PREFIX).map_or(&[], scene::builtin_parameters)
}

/// Loads or builds a scene, replaces its sky with the environment map if one is given, and adds a camera and lights where they are missing
/// and wanted.
pub(crate) fn load_scene(
    name: &Path,
    environment: Option<&EnvironmentArguments>,
    supply: Supply,
) -> Result<Scene, Failure> {
    let mut scene = match name.to_str().and_then(|n| n.strip_prefix(BUILTIN_PREFIX)) {
        Some(wanted) => scene::builtin(wanted)?,
        None => scene::load(name)?,
    };
    if let Some(given) = environment.map(load_environment).transpose()?.flatten() {
        scene.environment = Some(given);
    }
    scene::supply(&mut scene, supply.wanted());
    for warning in &scene.warnings {
        log::warn!("{}: {warning}", scene.name);
    }
    for supplied in &scene.supplied {
        log::info!("{}: {supplied}", scene.name);
    }
    Ok(scene)
}

/// Loads the environment map of `--environment`.
fn load_environment(wanted: &EnvironmentArguments) -> Result<Option<Environment>, Failure> {
    let Some(path) = &wanted.environment else { return Ok(None) };
    let (scale, turn) = (wanted.environment_scale, wanted.environment_turn.to_radians());
    let load = || {
        let made = Environment { scale, turn, ..Environment::load(path)? };
        let refuse = |fault| SceneError::Environment { path: path.clone(), fault };
        made.validate().map_err(refuse)?;
        Ok(made)
    };
    load().map(Some).map_err(|error: SceneError| Failure::from(error).context("--environment"))
}

/// The scene's camera of that name, the camera of that file, or the scene's first one.
pub(crate) fn camera(scene: &Scene, wanted: Option<&Path>) -> Result<Camera, Failure> {
    let Some(wanted) = wanted else {
        return first_camera(scene, "--supply camera adds one that frames it, --camera F.toml brings one").cloned();
    };
    if wanted.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        let file = CameraFile::read(wanted).map_err(|e| Failure::from(e).context("--camera"))?;
        let name = wanted.file_stem().unwrap_or_default().to_string_lossy();
        return file.camera(&name).map_err(|e| Failure::from(e).context(format!("--camera {}", wanted.display())));
    }
    let found = input::find("camera", &wanted.to_string_lossy(), &scene.cameras, |c| &c.name);
    found.cloned().map_err(|f| f.context("--camera (a camera file ends in .toml)"))
}

/// The scene's first camera, or a failure that says where one comes from.
pub(crate) fn first_camera<'a>(scene: &'a Scene, hint: &str) -> Result<&'a Camera, Failure> {
    let missing = || Failure::bad(format!("{}: the scene has no camera: {hint}", scene.name));
    scene.cameras.first().ok_or_else(missing)
}

/// Everything that a session needs.
pub(crate) struct Options<'a> {
    pub(crate) device: Option<&'a str>,
    pub(crate) check: bool,
    pub(crate) size: Extent,
    pub(crate) seed: u32,
    pub(crate) switches: Switches,
    pub(crate) statistics: bool,
    pub(crate) breadcrumbs: bool,
    pub(crate) rays: Rays,
    pub(crate) frames_in_flight: u32,
    pub(crate) without_rays: &'a [Way],
}

/// A device and a renderer on it.
pub(crate) struct Session {
    renderer: Renderer,
    gpu: Gpu,
    rays: Way,
}

impl Session {
    pub(crate) fn open(scene: &Scene, config: &Config, options: &Options<'_>) -> Result<Self, Failure> {
        let gpu = Gpu::new(&GpuOptions {
            device: options.device.map(str::to_owned),
            validation: options.check,
            without_rays: options.without_rays.to_vec(),
            ..GpuOptions::default()
        })?;
        let rays = choose_rays(&gpu, options.rays)?;
        let Extent { width, height } = options.size;
        let Options { seed, check, frames_in_flight, .. } = *options;
        let render_options = RenderOptions { width, height, seed, check, rays, frames_in_flight };
        let mut renderer = Renderer::new(&gpu, scene, &Slots::default(), config, render_options).map_err(failure)?;
        let Options { switches, statistics, breadcrumbs, .. } = *options;
        renderer.set_execution(ExecuteOptions { switches, statistics, breadcrumbs, ..renderer.execution() });
        if statistics && !gpu.has_statistics() {
            log::warn!("--statistics: {} does not count what shaders do", gpu.report().name);
        }
        Ok(Self { renderer, gpu, rays })
    }

    /// Submits the next frame; `read_back` brings the picture, or the output that `view` names, to memory.
    pub(crate) fn submit(
        &mut self,
        camera: &Camera,
        time: f64,
        view: Option<&ViewName>,
        read_back: bool,
    ) -> Result<FrameTicket, Failure> {
        let view = view.map(|v| (v.pass.as_str(), v.output.as_str()));
        let frame = self.renderer.submit(FrameRequest { camera, time, view, read_back }).map_err(failure)?;
        frame.ok_or_else(|| Failure::bad("a size of zero shows nothing".to_owned()))
    }

    /// Waits for a frame.
    pub(crate) fn finish(&mut self, ticket: FrameTicket) -> Result<FrameResult, Failure> {
        self.renderer.finish(ticket).map_err(failure)
    }

    pub(crate) fn device(&self) -> Device {
        let report = self.gpu.report();
        Device { name: report.name.clone(), driver: report.driver.clone(), kind: report.kind.to_owned() }
    }

    /// Name of the ray backend in use.
    pub(crate) fn rays(&self) -> &'static str {
        self.rays.name()
    }

    /// Where NaN and infinity came from, one text each, and which origins could not be found.
    pub(crate) fn origins(&self) -> Vec<String> {
        let tracker = self.renderer.finding_tracker();
        for (name, why) in tracker.unscanned() {
            log::warn!("--check: {name}: {why}");
        }
        let mut findings: Vec<String> = tracker.reports().iter().map(ToString::to_string).collect();
        if tracker.left_out() > 0 {
            findings.push(format!("{} more origins of NaN or infinity", tracker.left_out()));
        }
        findings
    }

    /// Destroys the renderer and returns the messages of the validation layers since the last frame.
    pub(crate) fn close(self) -> Result<Vec<String>, Failure> {
        let Self { renderer, gpu, .. } = self;
        drop(renderer);
        gpu.wait_idle()?;
        match gpu.check_validation() {
            Ok(()) => Ok(Vec::new()),
            Err(magpie::gpu::GpuError::Validation { messages }) => Ok(messages),
            Err(error) => Err(error.into()),
        }
    }
}

/// The way to trace that was asked for, or for `auto` the one that suits the device. Logs the choice.
pub(crate) fn choose_rays(gpu: &Gpu, wanted: Rays) -> Result<Way, Failure> {
    let way = match wanted {
        Rays::Auto => {
            let choice = gpu.choose_rays();
            log::info!("{}", choice.reason);
            return Ok(choice.rays);
        }
        Rays::Software => Way::Software,
        Rays::Query => Way::Query,
        Rays::Pipeline => Way::Pipeline,
    };
    gpu.check_rays(way).map_err(|e| Failure::from(e).context(format!("--rays {way}")))?;
    Ok(way)
}

/// What went wrong, with the exit status of its kind.
pub(crate) fn failure(error: RenderError) -> Failure {
    match error {
        RenderError::Gpu(error) => error.into(),
        RenderError::Stage(error) => error.into(),
        RenderError::Scene(ResidentError::Ray(error)) => Failure::input(error),
        RenderError::Scene(error @ ResidentError::Environment { .. }) => Failure::input(error),
        RenderError::Config(error) => (*error).into(),
        RenderError::View(error @ (GraphError::UnknownPass { .. } | GraphError::UnknownOutput { .. })) => {
            Failure::input(error).context("--view")
        }
        other => Failure::running(other),
    }
}
