//! `magpie bench`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use magpie::{
    config::Config,
    gpu::{Gpu, GpuOptions},
    prelude::Rays,
    scene::Scene,
};
use magpie_accuracy::{
    display::Display,
    metrics::{DynamicRange, Picture, flip_ldr, side_by_side},
};
use magpie_bench::{
    BenchError, FrameBenchError, Options,
    lights::{self, LightsOptions},
    motion::{self, MotionOptions, Place, Seen},
    pairs::{self, PairsOptions},
    rays::{self, RayBenchError, RayOptions},
    run,
};

use crate::{
    args::{
        BenchGraphArguments, BenchLightsArguments, BenchMotionArguments, BenchPairsArguments, BenchRaysArguments,
        BenchRenderArguments, BenchSceneArguments,
    },
    console,
    exit::Failure,
    input,
    output::{Output, keep_apart},
    picture::write_png,
    session,
};

/// Advice that ends the error for a scene without a camera.
const NO_CAMERA: &str = "--supply camera adds one that frames it";

impl From<BenchError> for Failure {
    fn from(error: BenchError) -> Self {
        match error {
            BenchError::Gpu(error) => error.into(),
            other => Self::running(other),
        }
    }
}

/// The file that `--json` names, if it names one.
fn json_file(wanted: Option<&Option<PathBuf>>) -> Result<Option<Output>, Failure> {
    wanted.and_then(Option::as_ref).map(|path| Output::plan("--json", path, &["json"])).transpose()
}

/// Prints the table and writes JSON to the file; `--json` without a file prints JSON in place of the table.
fn print_report(
    file: Option<Output>,
    wants_json: bool,
    table: &str,
    json: impl Fn() -> Result<String, Failure>,
) -> Result<(), Failure> {
    if file.is_none() && wants_json {
        return console::print(&json()?);
    }
    console::print(table)?;
    file.map_or(Ok(()), |file| file.write_text(&json()?))
}

/// Opens a device without validation layers, which would be measured too.
fn open_gpu(device: Option<&String>) -> Result<Gpu, Failure> {
    Ok(Gpu::new(&GpuOptions { device: device.cloned(), validation: false, ..GpuOptions::default() })?)
}

/// `magpie bench graph`.
pub(crate) fn graph(arguments: &BenchGraphArguments) -> Result<(), Failure> {
    let file = json_file(arguments.json.as_ref())?;
    let options = if arguments.quick {
        Options::quick()
    } else {
        Options { passes: arguments.passes.clone(), repeat: arguments.repeat }
    };
    let gpu = open_gpu(arguments.device.as_ref())?;
    let report = run(&gpu, &options, |next| log::info!("{next}"))?;
    print_report(file, arguments.json.is_some(), &report.table(), || report.to_json().map_err(Failure::running))
}

impl From<RayBenchError> for Failure {
    fn from(error: RayBenchError) -> Self {
        match error {
            RayBenchError::Gpu(error) => error.into(),
            other => Self::running(other),
        }
    }
}

/// `magpie bench rays`.
pub(crate) fn rays(arguments: &BenchRaysArguments) -> Result<(), Failure> {
    let json = json_file(arguments.json.as_ref())?;
    let csv = arguments.csv.as_ref().map(|path| Output::plan("--csv", path, &["csv"])).transpose()?;
    let outputs: Vec<&Output> = [&json, &csv].into_iter().flatten().collect();
    let inputs: Vec<(&str, &Path)> = arguments.scene.iter().map(|s| ("--scene", s.as_path())).collect();
    keep_apart(&outputs, &inputs)?;
    arguments.charts.as_deref().map_or(Ok(()), make_folder)?;

    let named = || arguments.scene.clone().into_iter();
    let all = || session::scenes().into_iter().map(|(name, _)| PathBuf::from(name));
    let names: Vec<PathBuf> = if arguments.scene.is_empty() { all().collect() } else { named().collect() };
    let load = |name: &PathBuf| session::load_scene(name, None, arguments.supply);
    let scenes = names.iter().map(load).collect::<Result<Vec<_>, _>>()?;
    for scene in &scenes {
        session::first_camera(scene, NO_CAMERA)?;
    }
    let gpu = open_gpu(arguments.device.as_ref())?;
    let mut ways: Vec<_> = arguments.rays.iter().map(|r| r.way()).collect();
    for &way in &ways {
        gpu.check_rays(way).map_err(|e| Failure::from(e).context(format!("--rays {way}")))?;
    }
    if ways.is_empty() {
        ways = gpu.rays();
    }
    ways.sort_unstable();
    ways.dedup();
    let commit = env!("MAGPIE_COMMIT").to_owned();
    let options = RayOptions { ways, size: arguments.size, quick: arguments.quick, commit };
    let report = rays::run(&gpu, &scenes, &options, |next| log::info!("{next}"))?;

    if let Some(csv) = csv {
        csv.write_text(&report.to_csv())?;
    }
    if let Some(folder) = &arguments.charts {
        write_charts(folder, &rays::charts(&report).map_err(Failure::running)?)?;
    }
    print_report(json, arguments.json.is_some(), &report.table(), || report.to_json().map_err(Failure::running))
}

/// Creates the folder of `--charts`.
fn make_folder(folder: &Path) -> Result<(), Failure> {
    let failed = |e| Failure::input(e).context(format!("--charts {}", folder.display()));
    std::fs::create_dir_all(folder).map_err(failed)
}

fn write_charts(folder: &Path, charts: &[(String, String)]) -> Result<(), Failure> {
    charts.iter().try_for_each(|(name, svg)| Output::plan("--charts", &folder.join(name), &["svg"])?.write_text(svg))
}

impl From<FrameBenchError> for Failure {
    fn from(error: FrameBenchError) -> Self {
        match error {
            FrameBenchError::Config(error) => Self::input(*error),
            FrameBenchError::NoCamera | FrameBenchError::UnknownFeature { .. } => Self::input(error),
            other => Self::running(other),
        }
    }
}

/// What `bench motion` and `bench pairs` measure, and where.
struct FrameBench {
    config: Config,
    scene: Scene,
    gpu: Gpu,
    rays: Rays,
}

impl FrameBench {
    /// Reads the configuration and the scene and opens the device. With `needs_camera` a scene without a camera is refused.
    fn open(scene: &BenchSceneArguments, render: &BenchRenderArguments, needs_camera: bool) -> Result<Self, Failure> {
        let config = input::configure(&session::catalogue(), render.config.as_deref(), &render.set)?;
        let scene = session::load_scene(&scene.path, None, scene.supply)?;
        if needs_camera {
            session::first_camera(&scene, NO_CAMERA)?;
        }
        let gpu = open_gpu(render.device.device.as_ref())?;
        let rays = session::choose_rays(&gpu, render.device.rays)?;
        Ok(Self { config, scene, gpu, rays })
    }
}

/// The file of `--json`, which must not be the scene.
fn json_file_apart(wanted: Option<&Option<PathBuf>>, scene: &BenchSceneArguments) -> Result<Option<Output>, Failure> {
    let json = json_file(wanted)?;
    keep_apart(&json.iter().collect::<Vec<_>>(), &[("SCENE", scene.path.as_path())])?;
    Ok(json)
}

/// `magpie bench motion`.
pub(crate) fn motion(arguments: &BenchMotionArguments) -> Result<(), Failure> {
    let json = json_file_apart(arguments.json.as_ref(), &arguments.scene)?;
    arguments.charts.as_deref().map_or(Ok(()), make_folder)?;
    arguments.pictures.as_deref().map_or(Ok(()), make_folder)?;
    let FrameBench { config, scene, gpu, rays } = FrameBench::open(&arguments.scene, &arguments.render, true)?;
    let options = MotionOptions {
        slot: arguments.slot.clone(),
        picture: arguments.picture,
        only: arguments.only.clone(),
        size: [arguments.size.width, arguments.size.height],
        frames: arguments.frames,
        rays,
        seed: arguments.render.seed,
        seeds: arguments.seeds,
        door: arguments.door.clone(),
        config,
        commit: env!("MAGPIE_COMMIT").to_owned(),
    };
    let display = if options.is_radiance() { Display::of(&options.config) } else { Display::PLAIN };
    let perceived = |place: Place<'_>, seen: &Seen, truth: &Seen| {
        let [seen, truth] = [seen, truth].map(|image| {
            let (width, height) = (image.size.width as usize, image.size.height as usize);
            display.show(&Picture { width, height, pixels: image.colours() })
        });
        if let Some(folder) = arguments.pictures.as_ref().filter(|_| place.run == 0) {
            let name =
                format!("{}-{}-{}.png", place.path, place.frame, place.label.replace(", ", "-").replace(' ', "-"));
            let drawn = side_by_side(&seen, &truth, DynamicRange::Display).map_err(|error| error.to_string())?;
            Output::plan("--pictures", &folder.join(name), &["png"])
                .and_then(|file| file.write(|out| write_png(out, &drawn)))
                .map_err(|failure| failure.message())?;
        }
        flip_ldr(&seen, &truth).map_err(|error| error.to_string())
    };
    let report = motion::run(&gpu, &scene, &options, &perceived, |path| log::info!("{path}"))?;
    if let Some(folder) = &arguments.charts {
        write_charts(folder, &report.charts().map_err(Failure::running)?)?;
    }
    print_report(json, arguments.json.is_some(), &report.table(), || report.to_json().map_err(Failure::running))
}

/// `magpie bench pairs`.
pub(crate) fn pairs(arguments: &BenchPairsArguments) -> Result<(), Failure> {
    let json = json_file_apart(arguments.json.as_ref(), &arguments.scene)?;
    let FrameBench { config, scene, gpu, rays } = FrameBench::open(&arguments.scene, &arguments.render, false)?;
    let options = PairsOptions {
        size: [arguments.size.width, arguments.size.height],
        rays,
        only: arguments.only.clone(),
        seed: arguments.render.seed,
        config,
        commit: env!("MAGPIE_COMMIT").to_owned(),
    };
    let report = pairs::run(&gpu, &scene, &options, |pair| log::info!("{pair}"))?;
    print_report(json, arguments.json.is_some(), &report.table(), || report.to_json().map_err(Failure::running))
}

/// `magpie bench lights`.
pub(crate) fn lights(arguments: &BenchLightsArguments) -> Result<(), Failure> {
    let json = json_file(arguments.json.as_ref())?;
    arguments.charts.as_deref().map_or(Ok(()), make_folder)?;
    let render = &arguments.render;
    let config = input::configure(&session::catalogue(), render.config.as_deref(), &render.set)?;
    let gpu = open_gpu(render.device.device.as_ref())?;
    let options = LightsOptions {
        lamps: arguments.lamps.clone(),
        only: arguments.only.clone(),
        size: [arguments.size.width, arguments.size.height],
        truth_samples: arguments.samples,
        patience: Duration::from_secs(arguments.patience.into()),
        rays: session::choose_rays(&gpu, render.device.rays)?,
        seed: render.seed,
        config,
        commit: env!("MAGPIE_COMMIT").to_owned(),
    };
    let report = lights::run(&gpu, &options, |what| log::info!("{what}"))?;
    if let Some(folder) = &arguments.charts {
        write_charts(folder, &report.charts().map_err(Failure::running)?)?;
    }
    print_report(json, arguments.json.is_some(), &report.table(), || report.to_json().map_err(Failure::running))
}
