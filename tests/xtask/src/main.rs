//! `cargo xtask`: set-up, demo and test commands, and the template of a pass.
//!
//! This crate is compiled before a C++ compiler or a Vulkan loader need exist, so it depends on neither: `magpie devices`, built as early
//! as possible, tells whether a device is good enough.

mod apt;
mod demo;
mod new_pass;
mod probe;
mod setup;
mod shell;
mod system;
mod test;
mod workplace;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Set-up, demo and tests of Magpie, and the template of a pass.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Look for a Vulkan device that Magpie accepts, and install a software one where there is none
    Setup {
        /// Print the commands and files, change nothing
        #[arg(long)]
        dry_run: bool,
    },
    /// Set up, build, and render the default scene: an image and the table of passes
    Demo {
        /// Arguments for `magpie render`: an optional scene first, then flags
        #[arg(last = true)]
        arguments: Vec<String>,
    },
    /// Set up, then check formatting, lints, tests and documentation
    Test {
        /// Leave out everything that needs a Vulkan device
        #[arg(long)]
        no_gpu: bool,
        /// Leave out the slow tests
        #[arg(long)]
        quick: bool,
    },
    /// Make the files of a new effect with a running example, and build it into the frame
    NewPass {
        /// Name of the effect, in kebab or snake case: depth-of-field
        name: String,
    },
}

fn main() -> ExitCode {
    let done = match Arguments::parse().task {
        Task::Setup { dry_run } => setup::setup(dry_run),
        Task::Demo { arguments } => demo::demo(&arguments),
        Task::Test { no_gpu, quick } => test::test(test::Extent { no_gpu, quick }),
        Task::NewPass { name } => new_pass::new_pass(&name),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            // The exit status of clap for wrong usage.
            if error.is::<new_pass::BadName>() { ExitCode::from(2) } else { ExitCode::FAILURE }
        }
    }
}
