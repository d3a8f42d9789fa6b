//! `magpie view`: a window to fly through a scene, swap what fills its slots, and watch what each pass takes.

mod act;
mod action;
mod background;
mod costs;
mod input_events;
mod interface;
mod look;
mod meshes;
mod navigation;
mod remembered;
mod screen;
mod shaders;
mod tour;
mod truth;
mod watch;
mod window;
mod window_library;

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use winit::event_loop::EventLoop;

use remembered::Remembered;
use window_library::guarded;

use crate::{
    args::ViewArguments,
    console,
    exit::Failure,
    input,
    output::{Output, keep_apart},
    session,
};

/// Findings of `--check` that are printed in full.
const FINDINGS_SHOWN: usize = 20;

/// Whether the program was asked to end, by Ctrl-C or a signal.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

fn is_interrupted() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// Files that are written at the end.
struct Outputs {
    screenshot: Option<Output>,
    timings: Option<Output>,
}

/// Shows a scene in a window until it is closed. Arguments and files are checked before it opens.
///
/// # Errors
/// [`Failure`] of the kind that gives the right exit status.
pub fn view(arguments: &ViewArguments) -> Result<(), Failure> {
    let plan = |argument, path: &Option<PathBuf>, endings: &[&str]| {
        path.as_deref().map(|path| Output::plan(argument, path, endings)).transpose()
    };
    let outputs = Outputs {
        screenshot: plan("--screenshot", &arguments.screenshot, &["png"])?,
        timings: plan("--timings", &arguments.timings, &["json", "csv"])?,
    };
    let all: Vec<&Output> = outputs.screenshot.iter().chain(&outputs.timings).collect();
    let inputs = [
        ("environment map", &arguments.lighting.environment.environment),
        ("camera file", &arguments.frame.camera),
        ("configuration", &arguments.frame.config),
        ("actions", &arguments.actions),
    ];
    let from_input = arguments.actions.as_deref().is_some_and(|path| path == Path::new("-"));
    let named = inputs.iter().filter_map(|(what, path)| Some((*what, path.as_deref()?)));
    let named = named.filter(|(_, path)| *path != Path::new("-"));
    let inputs: Vec<_> = named.chain([("scene", arguments.scene.as_path())]).collect();
    keep_apart(&all, &inputs)?;
    let steps = arguments.actions.as_deref().filter(|_| !from_input).map(action::read).transpose();
    let steps = steps.map_err(|failure| failure.context("--actions"))?.unwrap_or_default();
    let config = input::configure(&session::catalogue(), arguments.frame.config.as_deref(), &arguments.frame.set)?;
    let scene =
        session::load_scene(&arguments.scene, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let camera = session::camera(&scene, arguments.frame.camera.as_deref())?;
    let is_repeated = arguments.time_step.is_some();
    let remembered = if is_repeated { Remembered::default() } else { Remembered::load() };

    // Without the handler a signal would end the program in the middle of a file.
    if let Err(error) = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed)) {
        log::warn!("Ctrl-C ends the viewer at once: {error}");
    }
    let event_loop = EventLoop::new().map_err(no_display)?;
    let mut app = window::App::new(arguments, scene, &camera, config, steps, remembered);
    if from_input {
        app.commands = Some(action::of_standard_input()?);
    }
    let ran = guarded(|| event_loop.run_app(&mut app).map_err(no_display));
    let findings = guarded(|| ran.and_then(|()| app.end(&outputs)))?;
    for finding in findings.iter().take(FINDINGS_SHOWN) {
        console::complain(finding);
    }
    match findings.len() {
        0 => Ok(()),
        n => Err(Failure::Run(anyhow::anyhow!("--check: {n} finding(s), the first {} above", n.min(FINDINGS_SHOWN)))),
    }
}

/// Without a display there is no window.
fn no_display(error: impl std::fmt::Display) -> Failure {
    let text = error.to_string();
    // The library puts the place in its own source before the reason.
    let after_place = text.rsplit_once(".rs:").and_then(|(_, rest)| rest.split_once(": "));
    let reason = after_place.map_or(text.as_str(), |(_, reason)| reason);
    Failure::NoDevice(anyhow::anyhow!(
        "no display to show a window on ({reason}); `magpie render SCENE --out F.png` needs none"
    ))
}
