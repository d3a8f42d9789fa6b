//! The command line of Magpie.
use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(magpie_demo::run(std::env::args_os()))
}
