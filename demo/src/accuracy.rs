//! `magpie accuracy` and `magpie tune`.

use std::path::Path;

use magpie::{
    config::Config,
    gpu::{Gpu, GpuOptions},
    scene::Scene,
};
use magpie_accuracy::{
    AccuracyError,
    report::{REPORT_HTML, Report},
    results::{Folder, merge},
    sweep::{Options, Subject, sweep},
    tune::{Goal, Tuner, is_same_device, verify},
};
use magpie_passes::{RenderError, Slots};

use crate::{
    args::{AccuracyArguments, AccuracyCommand, Loudness, TuneArguments},
    console::{self, Progress},
    exit::Failure,
    input,
    lock::Lock,
    output::Output,
    session,
};

/// How far a rendered configuration may be from its promise before it is said, as a share.
const OFF: f64 = 0.15;

impl From<AccuracyError> for Failure {
    fn from(error: AccuracyError) -> Self {
        match error {
            AccuracyError::Render(error) => match *error {
                RenderError::Gpu(error) => error.into(),
                other => Self::running(other),
            },
            AccuracyError::UnknownStage { .. }
            | AccuracyError::NotMeasured { .. }
            | AccuracyError::Different { .. }
            | AccuracyError::Incomplete { .. }
            | AccuracyError::NothingToMerge
            | AccuracyError::NotTunable { .. }
            | AccuracyError::Json { .. }
            | AccuracyError::Unreachable { .. }
            | AccuracyError::File { .. } => Self::input(error),
            other => Self::running(other),
        }
    }
}

/// `magpie accuracy`.
pub(crate) fn accuracy(arguments: &AccuracyArguments, loudness: &Loudness) -> Result<(), Failure> {
    if let Some(AccuracyCommand::Merge { folders, out }) = &arguments.command {
        let _lock = Lock::take("--out", out, "accuracy merge")?;
        let folder = merge(folders, out)?;
        return write(&folder, out);
    }
    let missing = |what: &str| Failure::Usage(format!("{what} is missing"));
    let scene_name = arguments.scene.as_ref().ok_or_else(|| missing("SCENE"))?;
    let out = arguments.out.clone().ok_or_else(|| missing("--out DIR"))?;
    let slots = Slots::default();
    let config = input::configure(&session::catalogue(), arguments.config.as_deref(), &arguments.set)?;
    let scene = session::load_scene(scene_name, Some(&arguments.environment), arguments.supply)?;
    let camera = session::camera(&scene, arguments.camera.as_deref())?;
    // Two runs would time each other, and both would add their rows.
    let _lock = Lock::take("--out", &out, &format!("accuracy {}", scene_name.display()))?;
    let gpu = open(arguments.device.as_ref())?;
    let options = Options {
        out: out.clone(),
        truths: arguments.truths.clone(),
        stages: arguments.stages.clone(),
        quick: arguments.quick,
        size: arguments.size.map(|e| [e.width, e.height]),
        samples: arguments.samples,
        shard: arguments.shard,
        seed: arguments.seed,
        rays: session::choose_rays(&gpu, arguments.rays)?,
        commit: env!("MAGPIE_COMMIT").to_owned(),
    };
    let subject = Subject { gpu: &gpu, scene: &scene, camera: &camera, slots: &slots, config: &config };
    let mut bar: Option<Progress> = None;
    let folder = sweep(&subject, &options, &mut |at| {
        let bar = bar.get_or_insert_with(|| Progress::of(at.all, "steps", loudness));
        bar.show(at.done, at.skipped, &at.what);
    })?;
    drop(bar);
    if let Some(shard) = arguments.shard {
        let (index, count) = (shard.index, shard.count);
        log::info!("part {index} of {count} is done; `magpie accuracy merge` makes the report of all parts");
        return Ok(());
    }
    write(&folder, &out)
}

fn open(device: Option<&String>) -> Result<Gpu, Failure> {
    let gpu = Gpu::new(&GpuOptions { device: device.cloned(), validation: false, ..GpuOptions::default() })?;
    log::info!("device: {}", gpu.report().name);
    Ok(gpu)
}

/// Makes and writes the report, and prints what is on the fronts.
fn write(folder: &Folder, out: &Path) -> Result<(), Failure> {
    let report = Report::build(folder, out)?;
    report.write(out)?;
    console::print(&report.table())?;
    log::info!("{}", out.join(REPORT_HTML).display());
    Ok(())
}

/// `magpie tune`.
pub(crate) fn tune(arguments: &TuneArguments) -> Result<(), Failure> {
    let output = Output::plan("--out", &arguments.out, &["toml"])?;
    let goal = match (arguments.budget_ms, arguments.max_error) {
        (Some(ms), None) => Goal::Budget(ms),
        (None, Some(error)) => Goal::Error(error),
        _ => return Err(Failure::Usage("wanted one of --budget-ms and --max-error".to_owned())),
    };
    let report = Report::read(&arguments.report)?;
    let tuner = Tuner::new(&report, &arguments.report)?;
    let choice = tuner.choose(goal)?;
    let config = tuner.config(&choice);
    let catalogue = session::catalogue();
    catalogue.check(&config, "the report")?;

    let found = if arguments.no_render {
        None
    } else {
        let scene: Scene = session::load_scene(&arguments.scene, Some(&arguments.environment), arguments.supply)?;
        let camera = session::camera(&scene, arguments.camera.as_deref())?;
        let gpu = open(arguments.device.as_ref())?;
        if !is_same_device(&report.run, &gpu.report().name) {
            log::warn!("{} is not {}, on which the report was made", gpu.report().name, report.run.device.name);
        }
        let rays = session::choose_rays(&gpu, arguments.rays)?;
        let none = Config::default();
        let slots = Slots::default();
        let subject = Subject { gpu: &gpu, scene: &scene, camera: &camera, slots: &slots, config: &none };
        let found = verify(&subject, &report, &arguments.report, &config, rays)?;
        let off = found.relmse / choice.relmse - 1.0;
        if off.abs() > OFF {
            log::warn!("rendering it came to an error {:+.1} % from what was promised", 100.0 * off);
        }
        Some(found)
    };
    let text = tuner.to_toml(&choice, goal, found, &catalogue);
    output.write_text(&text)?;
    console::print(&text)
}
