//! `magpie accuracy` and `magpie tune`.

use std::path::Path;

use magpie::{
    config::Config,
    gpu::{Gpu, GpuOptions},
    scene::Scene,
};
use magpie_accuracy::{
    AccuracyError,
    agreement::Agreement,
    report::{Judge, REPORT_HTML, Report},
    results::{Folder, merge},
    sweep::{Options, QUICK_MINUTES, Subject, sweep},
    tune::{Choice, Confirmer, Goal, Render, Tuner, confirmed, is_same_device, ladder, table},
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

/// Relative difference between a prediction and its rendered value above which a warning is printed.
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
    match &arguments.command {
        Some(AccuracyCommand::Merge { folders, out }) => {
            let _lock = Lock::take("--out", out, "accuracy merge")?;
            return write(merge(folders, out)?, out);
        }
        Some(AccuracyCommand::Compare { first, second, json }) => return agree(first, second, *json),
        None => {}
    }
    let missing = |what: &str| Failure::Usage(format!("{what} is missing"));
    let scene_name = arguments.scene.as_ref().ok_or_else(|| missing("SCENE"))?;
    let out = arguments.out.clone().ok_or_else(|| missing("--out DIR"))?;
    let slots = Slots::default();
    let config = input::configure(&session::catalogue(), arguments.frame.config.as_deref(), &arguments.frame.set)?;
    let scene = session::load_scene(scene_name, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let camera = session::camera(&scene, arguments.frame.camera.as_deref())?;
    // Two runs at once would disturb each other's timings and both append rows.
    let _lock = Lock::take("--out", &out, &format!("accuracy {}", scene_name.display()))?;
    let gpu = open(arguments.device.device.as_ref())?;
    let options = Options {
        out: out.clone(),
        truths: arguments.truths.clone(),
        stages: arguments.stages.clone(),
        quick: arguments.quick,
        minutes: arguments.minutes.or(arguments.quick.then_some(QUICK_MINUTES)),
        judge: Judge { metric: arguments.metric, image: arguments.image },
        size: arguments.size.map(|e| [e.width, e.height]),
        samples: arguments.samples,
        shard: arguments.shard,
        seed: arguments.seed,
        rays: session::choose_rays(&gpu, arguments.device.rays)?,
        commit: env!("MAGPIE_COMMIT").to_owned(),
    };
    let subject = Subject { gpu: &gpu, scene: &scene, camera: &camera, slots: &slots, config: &config };
    let mut bar: Option<Progress> = None;
    let mut folder = sweep(&subject, &options, &mut |at| {
        let bar = bar.get_or_insert_with(|| Progress::of(at.all, at.unit, loudness));
        bar.show(at.done, at.skipped, &at.what);
    })?;
    drop(bar);
    if let Some(shard) = arguments.shard {
        let (index, count) = (shard.index, shard.count);
        log::info!("part {index} of {count} is done; `magpie accuracy merge` makes the report of all parts");
        return Ok(());
    }
    // The metric of the command line replaces the one stored in the folder.
    folder.run.judge = options.judge;
    write(folder, &out)
}

/// `magpie accuracy compare`.
fn agree(first: &Path, second: &Path, as_json: bool) -> Result<(), Failure> {
    let agreement = Agreement::of(&Report::read(first)?, &Report::read(second)?);
    if as_json {
        return console::print(&(serde_json::to_string_pretty(&agreement).map_err(Failure::running)? + "\n"));
    }
    console::print(&agreement.table())
}

fn open(device: Option<&String>) -> Result<Gpu, Failure> {
    let gpu = Gpu::new(&GpuOptions { device: device.cloned(), validation: false, ..GpuOptions::default() })?;
    log::info!("device: {}", gpu.report().name);
    Ok(gpu)
}

/// Makes and writes the report, and prints what is on the fronts.
fn write(folder: Folder, out: &Path) -> Result<(), Failure> {
    let report = Report::build(&folder, out)?;
    report.write(out)?;
    console::print(&report.table())?;
    log::info!("{}", out.join(REPORT_HTML).display());
    Ok(())
}

/// `magpie tune`.
pub(crate) fn tune(arguments: &TuneArguments) -> Result<(), Failure> {
    let goal = match (arguments.budget_ms, arguments.max_error, arguments.all) {
        (Some(ms), None, false) => Some(Goal::Budget(ms)),
        (None, Some(error), false) => Some(Goal::Error(error)),
        (None, None, true) => None,
        _ => return Err(Failure::Usage("wanted one of --budget-ms, --max-error and --all".to_owned())),
    };
    let output = goal.is_some().then(|| Output::plan("--out", &arguments.out, &["toml"])).transpose()?;
    let report = Report::read(&arguments.report)?;
    let mut tuner = Tuner::new(&report, &arguments.report, arguments.metric)?;
    if arguments.no_render {
        return choose(arguments, &mut tuner, goal.zip(output), None);
    }
    let scene: Scene =
        session::load_scene(&arguments.scene, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let camera = session::camera(&scene, arguments.camera.as_deref())?;
    let gpu = open(arguments.device.device.as_ref())?;
    if !is_same_device(&report.run, &gpu.report().name) {
        log::warn!("{} is not {}, on which the report was made", gpu.report().name, report.run.device.name);
    }
    let rays = session::choose_rays(&gpu, arguments.device.rays)?;
    let (none, slots) = (Config::default(), Slots::default());
    let subject = Subject { gpu: &gpu, scene: &scene, camera: &camera, slots: &slots, config: &none };
    let mut confirmer = Confirmer::new(&subject, &report, &tuner, &arguments.report, rays)?;
    let mut render = |config: &Config| {
        let found = confirmer.render(config)?;
        log::info!("rendered: error {:.4}, {:.3} ms, {:+.2} stops", found.error, found.ms, found.stops);
        Ok(found)
    };
    choose(arguments, &mut tuner, goal.zip(output), Some(&mut render))
}

/// Chooses for one goal, or for every budget of the ladder, and writes the chosen configurations.
fn choose(
    arguments: &TuneArguments,
    tuner: &mut Tuner<'_>,
    one: Option<(Goal, Output)>,
    render: Option<Render<'_>>,
) -> Result<(), Failure> {
    let catalogue = session::catalogue();
    let toml = |tuner: &Tuner<'_>, choice: &Choice, goal: Goal| -> Result<String, Failure> {
        catalogue.check(&tuner.config(choice), "the report")?;
        warn(choice);
        Ok(tuner.to_toml(choice, goal, &catalogue))
    };
    if let Some((goal, output)) = one {
        let choice = match render {
            Some(render) => confirmed(tuner, goal, render)?,
            None => tuner.choose(goal)?,
        };
        let text = toml(tuner, &choice, goal)?;
        output.write_text(&text)?;
        return console::print(&text);
    }
    let folder = &arguments.out;
    let failed = |error: std::io::Error| Failure::bad(format!("--out {}: {error}", folder.display()));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let rungs = ladder(tuner, render)?;
    for (step, choice) in &rungs {
        if let Ok(choice) = choice {
            let output = Output::plan("--out", &folder.join(format!("{}.toml", step.name)), &["toml"])?;
            output.write_text(&toml(tuner, choice, Goal::Budget(step.budget_ms))?)?;
        }
    }
    let text = table(tuner, &rungs);
    Output::plan("--out", &folder.join("ladder.txt"), &["txt"])?.write_text(&text)?;
    console::print(&text)
}

/// Warns where a rendered choice misses its prediction, or its brightness is far from that of the reference image.
fn warn(choice: &Choice) {
    let Some(found) = choice.found else { return };
    let off = |predicted: f64, found: f64| 100.0 * (predicted / found - 1.0);
    let (error, ms) = (off(choice.predicted_error, found.error), off(choice.predicted_ms, found.ms));
    if error.abs().max(ms.abs()) > 100.0 * OFF {
        log::warn!(
            "predicted {error:+.1} % in error and {ms:+.1} % in time from what rendering it came to, which the file promises"
        );
    }
    if found.stops.abs() >= 1.0 {
        log::warn!("the picture is {:+.2} stops from the truth's brightness", found.stops);
    }
}
