//! `magpie render`.

use std::{path::Path, sync::Arc};

use magpie::{
    config::Config,
    graph::{
        Declaration, Plan,
        dump::{Dump, Gains},
    },
    measure::{Recorder, Report, Run, chrome_trace, pass_table, slot_table},
    pixels::Mapping,
};
use magpie_passes::ReadBack;

use crate::{
    args::{Loudness, RenderArguments},
    console::{self, Progress},
    exit::Failure,
    input,
    output::{Output, keep_apart},
    picture,
    session::{self, Options, Session},
};

/// Findings that are printed in full; the rest is counted.
const FINDINGS_SHOWN: usize = 20;

/// Every file that a run writes.
#[derive(Default)]
struct Outputs {
    picture: Option<Output>,
    timings: Option<Output>,
    trace: Option<Output>,
    graph: Option<Output>,
}

impl Outputs {
    fn plan(arguments: &RenderArguments) -> Result<Self, Failure> {
        let plan = |argument, path: &Option<_>, endings: &[&str]| {
            path.as_deref().map(|path: &Path| Output::plan(argument, path, endings)).transpose()
        };
        let outputs = Self {
            picture: plan("--out", &arguments.out, &["png", "exr"])?,
            timings: plan("--timings", &arguments.timings, &["json", "csv"])?,
            trace: plan("--trace", &arguments.trace, &["json"])?,
            graph: plan("--dump-graph", &arguments.dump_graph, &["txt", "json", "dot", "html"])?,
        };
        if arguments.view_as.is_some() && outputs.picture.as_ref().is_some_and(|picture| picture.ending() == "exr") {
            let fault = "--view-as: an EXR has the numbers themselves; colours are for a PNG";
            return Err(Failure::Usage(fault.to_owned()));
        }
        let all = [&outputs.picture, &outputs.timings, &outputs.trace, &outputs.graph];
        let all: Vec<&Output> = all.into_iter().flatten().collect();
        let inputs = [
            ("scene", &arguments.scene),
            ("environment map", &arguments.lighting.environment.environment),
            ("camera file", &arguments.frame.camera),
            ("configuration", &arguments.frame.config),
        ];
        let inputs: Vec<(&str, &Path)> = inputs.iter().filter_map(|(what, p)| Some((*what, p.as_deref()?))).collect();
        keep_apart(&all, &inputs)?;
        Ok(outputs)
    }
}

/// Renders the frames and writes what was asked for. Arguments and files are checked before a device is opened.
///
/// # Errors
/// [`Failure`] of the kind that gives the right exit status.
pub fn render(arguments: &RenderArguments, loudness: &Loudness) -> Result<(), Failure> {
    let outputs = Outputs::plan(arguments)?;
    let config = input::configure(&session::catalogue(), arguments.frame.config.as_deref(), &arguments.frame.set)?;
    if arguments.print_config {
        return console::print(&config.to_toml()?);
    }
    let Some(scene_name) = &arguments.scene else {
        return Err(Failure::Usage("SCENE is missing: wanted builtin:NAME or a path to .gltf or .glb".to_owned()));
    };
    let scene = session::load_scene(scene_name, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let camera = session::camera(&scene, arguments.frame.camera.as_deref())?;

    let without_rays: Vec<_> = arguments.without_rays.iter().map(|w| w.way()).collect();
    let options = Options {
        rays: arguments.device.rays,
        without_rays: &without_rays,
        device: arguments.device.device.as_deref(),
        check: arguments.check,
        size: arguments.size,
        seed: arguments.seed,
        switches: arguments.graph,
        statistics: arguments.statistics,
        breadcrumbs: arguments.breadcrumbs,
    };
    let mut session = Session::open(&scene, &config, &options)?;
    log::info!("rendering {} on {}", scene.name, session.device().name);
    let mut recorder = Recorder::new(arguments.warmup as usize);
    let (mut last, mut slots) = (None, Vec::new());
    let frames = arguments.warmup + arguments.frames;
    let progress = Progress::new(u64::from(frames), loudness);
    for frame in 1..=frames {
        let read_back = frame == frames && outputs.picture.is_some();
        let result = session.frame(
            &camera,
            f64::from(frame - 1) * f64::from(arguments.time_step),
            arguments.view.as_ref(),
            read_back,
        )?;
        if frame == frames {
            slots = result.what_runs();
        }
        recorder.push(result.sample);
        if frame == frames {
            last = Some(LastFrame { images: result.images, declaration: result.declaration, plan: result.plan });
        }
        progress.step();
    }
    drop(progress);

    let run = describe_run(&session, arguments, scene_name, config);
    let report = Report { slots, ..recorder.report(run).map_err(Failure::running)? };
    write_outputs(&outputs, last.as_ref(), arguments.view_as.as_ref(), &recorder, &report)?;
    if loudness.verbose > 0 {
        let total: f64 = report.passes.iter().filter_map(|p| Some(p.gpu_ms?.median)).sum();
        let share = |slot: &str| {
            let own = report.passes.iter().filter(|p| p.stage == slot);
            (total > 0.0).then(|| own.filter_map(|p| Some(p.gpu_ms?.median)).sum::<f64>() / total)
        };
        let pixels = u64::from(arguments.size.width) * u64::from(arguments.size.height);
        console::print(&(slot_table(&report.slots, pixels, share) + "\n"))?;
    }
    console::print(&pass_table(&report))?;
    if let Some(last) = &last {
        console::print(&format!("{}\n", Gains::of(&last.plan)))?;
    }
    console::print(&format!("{}\n", report.acceleration))?;
    for left_out in recorder.not_finite() {
        let ask = if arguments.check { "" } else { "; --check names where they arose" };
        console::print(&format!("{left_out}{ask}\n"))?;
    }
    let mut findings = session.origins();
    findings.extend(session.close()?);
    print_findings(&findings)
}

fn describe_run(session: &Session, arguments: &RenderArguments, scene: &Path, config: Config) -> Run {
    Run {
        magpie: env!("CARGO_PKG_VERSION").to_owned(),
        commit: env!("MAGPIE_COMMIT").to_owned(),
        device: session.device(),
        rays: session.rays().to_owned(),
        scene: scene.display().to_string(),
        size: [arguments.size.width, arguments.size.height],
        config,
    }
}

/// The last frame, from which the outputs are written.
struct LastFrame {
    images: Option<ReadBack>,
    declaration: Arc<Declaration>,
    plan: Arc<Plan>,
}

fn write_outputs(
    outputs: &Outputs,
    last: Option<&LastFrame>,
    mapping: Option<&Mapping>,
    recorder: &Recorder,
    report: &Report,
) -> Result<(), Failure> {
    if let Some(output) = &outputs.picture {
        let Some(ReadBack { linear, display }) = last.and_then(|l| l.images.as_ref()) else {
            return Err(Failure::Run(anyhow::anyhow!("the last frame brought no picture back from the device")));
        };
        output.write(|file| match (output.ending(), mapping) {
            ("exr", _) => picture::write_exr(file, linear),
            (_, Some(mapping)) => picture::write_mapped(file, linear, mapping),
            _ => picture::write_png(file, display.as_ref().unwrap_or(linear)),
        })?;
    }
    if let Some(output) = &outputs.timings {
        let csv = output.ending() == "csv";
        output.write_text(&if csv { report.to_csv() } else { report.to_json().map_err(Failure::running)? })?;
    }
    if let Some(output) = &outputs.trace {
        output.write_text(&chrome_trace(recorder.frames()).to_string())?;
    }
    if let (Some(output), Some(LastFrame { declaration, plan, .. })) = (&outputs.graph, last) {
        let dump = Dump::new(declaration, plan).overlap(report.graph.overlap_ms.filter(|_| report.graph.queues > 1));
        output.write_text(&match output.ending() {
            "json" => dump.json(),
            "dot" => dump.dot(),
            "html" => dump.html(),
            _ => dump.text(),
        })?;
    }
    Ok(())
}

/// Prints the findings of `--check` and fails if there are any.
fn print_findings(findings: &[String]) -> Result<(), Failure> {
    for finding in findings.iter().take(FINDINGS_SHOWN) {
        console::complain(finding);
    }
    match findings.len() {
        0 => Ok(()),
        n => Err(Failure::Run(anyhow::anyhow!("--check: {n} finding(s), the first {} above", n.min(FINDINGS_SHOWN)))),
    }
}
