//! The command line of Magpie as a library: parsing, printing and files; everything else is the engine's.

mod accuracy;
mod args;
mod bench;
mod commands;
mod compare;
mod console;
mod exit;
mod input;
mod lock;
mod output;
mod picture;
mod plan;
mod reference;
mod render;
mod session;
mod view;

use std::ffi::OsString;

use clap::Parser;

pub use args::{
    AccuracyArguments, AccuracyCommand, Arguments, Bench, BenchGraphArguments, BenchRays, BenchRaysArguments, Command,
    CompareArguments, Extent, Loudness, PlanArguments, Rays, ReferenceArguments, RenderArguments, TuneArguments,
    ViewArguments, ViewName,
};
pub use exit::Failure;
pub use picture::{PictureError, read_picture, write_exr, write_mapped, write_png};
pub use reference::reference;
pub use render::render;
pub use view::view;

/// Parses a command line. Without a command it is that of the viewer.
fn parse(given: &[OsString]) -> Result<Arguments, clap::Error> {
    let arguments = Arguments::try_parse_from(given)?;
    if arguments.command.is_some() {
        return Ok(arguments);
    }
    Arguments::try_parse_from(given.iter().cloned().chain(["view".into()]))
}

/// Runs one command line, the program's name first, and gives the exit status: 0 done, 1 it failed while running, 2 wrong
/// usage or bad input, 3 no usable device, 130 interrupted.
#[must_use]
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let given: Vec<OsString> = arguments.into_iter().collect();
    let arguments = match parse(&given) {
        Ok(arguments) => arguments,
        Err(error) => return exit::report_usage(&error, &given),
    };
    let Some(command) = &arguments.command else { return 0 };
    console::listen(&arguments.loudness);
    let done = match command {
        Command::Devices { json } => commands::devices(*json),
        Command::Scenes => commands::scenes(),
        Command::Stages { json } => commands::stages(*json),
        Command::Plan(arguments) => plan::plan(arguments),
        Command::Compare(compare) => compare::compare(compare),
        Command::Accuracy(wanted) => accuracy::accuracy(wanted, &arguments.loudness),
        Command::Tune(wanted) => accuracy::tune(wanted),
        Command::Bench { what: Bench::Graph(graph) } => bench::graph(graph),
        Command::Bench { what: Bench::Rays(rays) } => bench::rays(rays),
        Command::Bench { what: Bench::Motion(motion) } => bench::motion(motion),
        Command::Bench { what: Bench::Pairs(pairs) } => bench::pairs(pairs),
        Command::Bench { what: Bench::Lights(lights) } => bench::lights(lights),
        Command::Render(render) => render::render(render, &arguments.loudness),
        Command::View(arguments) => view(arguments),
        Command::Reference(wanted) => reference(wanted, &arguments.loudness),
    };
    match done {
        Ok(()) => 0,
        Err(failure) => {
            console::complain(&failure.message());
            failure.status()
        }
    }
}
