//! `magpie render`.

use std::{collections::VecDeque, path::Path, sync::Arc};

use magpie::{
    config::Config,
    graph::{
        Declaration, Plan,
        dump::{Dump, Gains},
    },
    measure::{Recorder, Report, Run, chrome_trace, pass_table, slot_table},
    pixels::Mapping,
    scene::{Camera, CameraPath},
};
use magpie_passes::ReadBack;

use crate::{
    args::{Loudness, MAX_FRAMES, RenderArguments},
    console::{self, Progress},
    exit::Failure,
    input,
    output::{Numbered, Output, keep_apart},
    picture,
    session::{self, Options, Session},
};

/// Findings that are printed in full; the rest is counted.
const FINDINGS_SHOWN: usize = 20;

/// Frames that are measured if nothing else is said.
const FRAMES: u32 = 32;

/// Part of a step by which rounded steps may miss the end of a path.
const ROUNDING: f64 = 0.05;

/// Where pictures go.
enum Pictures {
    Nowhere,
    /// The last frame.
    Last(Output),
    /// Every measured frame.
    Each(Numbered),
}

/// Where the camera is.
enum Viewpoint {
    Still(Camera),
    Along(CameraPath),
}

impl Viewpoint {
    /// The camera so many seconds after the beginning.
    fn camera(&self, since: f64) -> Result<Camera, Failure> {
        match self {
            Self::Still(camera) => Ok(camera.clone()),
            Self::Along(path) => {
                path.camera(path.times()[0] + since).map_err(|error| Failure::from(error).context("--camera-path"))
            }
        }
    }
}

/// Every file that a run writes.
struct Outputs {
    pictures: Pictures,
    timings: Option<Output>,
    trace: Option<Output>,
    graph: Option<Output>,
}

impl Outputs {
    /// `frames`: those that are measured.
    fn plan(arguments: &RenderArguments, frames: u32) -> Result<Self, Failure> {
        let plan = |argument, path: &Option<_>, endings: &[&str]| {
            path.as_deref().map(|path: &Path| Output::plan(argument, path, endings)).transpose()
        };
        let (out, endings) = (arguments.out.as_deref(), &["png", "exr"]);
        let numbered = out.map(|out| Numbered::plan("--out", out, endings, frames)).transpose()?.flatten();
        let pictures = match (out, numbered) {
            (_, Some(numbered)) => Pictures::Each(numbered),
            (Some(out), None) => Pictures::Last(Output::plan("--out", out, endings)?),
            (None, None) => Pictures::Nowhere,
        };
        let outputs = Self {
            pictures,
            timings: plan("--timings", &arguments.timings, &["json", "csv"])?,
            trace: plan("--trace", &arguments.trace, &["json"])?,
            graph: plan("--dump-graph", &arguments.dump_graph, &["txt", "json", "dot", "html"])?,
        };
        let first = match &outputs.pictures {
            Pictures::Nowhere => None,
            Pictures::Last(picture) => Some(picture),
            Pictures::Each(numbered) => Some(&numbered.frame(0)?),
        };
        if arguments.view_as.is_some() && first.is_some_and(|picture| picture.ending() == "exr") {
            let fault = "--view-as: an EXR has the numbers themselves; colours are for a PNG";
            return Err(Failure::Usage(fault.to_owned()));
        }
        let all = [first, outputs.timings.as_ref(), outputs.trace.as_ref(), outputs.graph.as_ref()];
        let all: Vec<&Output> = all.into_iter().flatten().collect();
        let inputs = [
            ("scene", &arguments.scene),
            ("environment map", &arguments.lighting.environment.environment),
            ("camera file", &arguments.frame.camera),
            ("camera path", &arguments.camera_path),
            ("configuration", &arguments.frame.config),
        ];
        let inputs: Vec<(&str, &Path)> = inputs.iter().filter_map(|(what, p)| Some((*what, p.as_deref()?))).collect();
        keep_apart(&all, &inputs)?;
        if let Pictures::Each(numbered) = &outputs.pictures {
            numbered.keep_from(&inputs)?;
        }
        Ok(outputs)
    }
}

/// Renders the frames and writes what was asked for. Arguments and files are checked before a device is opened.
///
/// # Errors
/// [`Failure`] of the kind that gives the right exit status.
pub fn render(arguments: &RenderArguments, loudness: &Loudness) -> Result<(), Failure> {
    let path = arguments.camera_path.as_deref().map(CameraPath::read).transpose();
    let path = path.map_err(|error| Failure::from(error).context("--camera-path"))?;
    let measured = match (&path, arguments.frames) {
        (_, Some(frames)) => frames,
        (Some(path), None) => frames_of(path, arguments.time_step)?,
        (None, None) => FRAMES,
    };
    let outputs = Outputs::plan(arguments, measured)?;
    let config = input::configure(&session::catalogue(), arguments.frame.config.as_deref(), &arguments.frame.set)?;
    if arguments.print_config {
        return console::print(&config.to_toml()?);
    }
    let Some(scene_name) = &arguments.scene else {
        return Err(Failure::Usage("SCENE is missing: wanted builtin:NAME or a path to .gltf or .glb".to_owned()));
    };
    let scene = session::load_scene(scene_name, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let viewpoint = match path {
        Some(path) => Viewpoint::Along(path),
        None => Viewpoint::Still(session::camera(&scene, arguments.frame.camera.as_deref())?),
    };

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
        frames_in_flight: arguments.frames_in_flight,
    };
    let mut session = Session::open(&scene, &config, &options)?;
    log::info!("rendering {} on {}", scene.name, session.device().name);
    let mut recorder = Recorder::new(arguments.warmup as usize);
    let (mut last, mut slots) = (None, Vec::new());
    let frames = arguments.warmup + measured;
    let progress = Progress::new(u64::from(frames), loudness);
    let mut in_flight = VecDeque::new();
    for frame in 1..=frames {
        let read_back = match &outputs.pictures {
            Pictures::Nowhere => false,
            Pictures::Last(_) => frame == frames,
            Pictures::Each(_) => frame > arguments.warmup,
        };
        let step = f64::from(arguments.time_step);
        // During the warm-up the camera stands where its path begins.
        let (time, since) =
            (f64::from(frame - 1) * step, f64::from((frame - 1).saturating_sub(arguments.warmup)) * step);
        in_flight.push_back(session.submit(&viewpoint.camera(since)?, time, arguments.view.as_ref(), read_back)?);
        let most = if frame == frames { 0 } else { arguments.frames_in_flight as usize - 1 };
        while in_flight.len() > most {
            let Some(oldest) = in_flight.pop_front() else { break };
            let result = session.finish(oldest)?;
            if let (Pictures::Each(numbered), Some(images)) = (&outputs.pictures, &result.images) {
                write_picture(&numbered.frame(result.frame - arguments.warmup)?, images, arguments.view_as.as_ref())?;
            }
            if result.frame + 1 == frames {
                slots = result.what_runs();
                last = Some(LastFrame { images: result.images, declaration: result.declaration, plan: result.plan });
            }
            recorder.push(result.sample);
            progress.step();
        }
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
    if let Pictures::Last(output) = &outputs.pictures {
        let Some(images) = last.and_then(|l| l.images.as_ref()) else {
            return Err(Failure::Run(anyhow::anyhow!("the last frame brought no picture back from the device")));
        };
        write_picture(output, images, mapping)?;
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

fn write_picture(output: &Output, images: &ReadBack, mapping: Option<&Mapping>) -> Result<(), Failure> {
    let ReadBack { linear, display } = images;
    output.write(|file| match (output.ending(), mapping) {
        ("exr", _) => picture::write_exr(file, linear),
        (_, Some(mapping)) => picture::write_mapped(file, linear, mapping),
        _ => picture::write_png(file, display.as_ref().unwrap_or(linear)),
    })
}

/// Number of frames along a path, its first and last key included.
fn frames_of(path: &CameraPath, time_step: f32) -> Result<u32, Failure> {
    let [first, last] = path.times();
    // Steps are rounded: `0.0166667` is meant as a sixtieth. Behind the last key the camera stands, so a step may lie a little beyond it.
    let frames = ((last - first) / f64::from(time_step) + ROUNDING).floor() + 1.0;
    if frames <= f64::from(MAX_FRAMES) {
        return Ok(frames as u32);
    }
    let fault = format!("{} seconds in steps of {time_step} are more than {MAX_FRAMES} frames", last - first);
    Err(Failure::Usage(format!("--camera-path: {fault}; --frames or --time-step make fewer")))
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

#[cfg(test)]
mod tests {
    use super::*;
    use magpie::scene::{CameraFile, CameraKey};

    #[test]
    fn a_path_has_a_frame_at_its_first_and_at_its_last_key() {
        let frames = |seconds: f64, step: f32| {
            let camera = |time| {
                let file = r#"{"position": [0, 0, 1], "target": [0, 0, 0]}"#;
                CameraKey { time, camera: serde_json::from_str::<CameraFile>(file).unwrap() }
            };
            frames_of(&CameraPath::new(vec![camera(-1.0), camera(seconds - 1.0)]).unwrap(), step)
        };
        // The step of `--time-step` unless it is given.
        for seconds in [1, 2, 7, 30, 60] {
            assert_eq!(frames(f64::from(seconds), 0.016_666_7).unwrap(), 60 * seconds + 1, "{seconds} seconds");
        }
        assert_eq!([frames(10.0, 0.1).unwrap(), frames(4.0, 0.05).unwrap(), frames(1.0, 0.3).unwrap()], [101, 81, 4]);
        assert_eq!(frames(0.01, 1.0).unwrap(), 1);
        assert_eq!(frames(2e6, 1.0).unwrap_err().status(), 2);
    }
}
