//! `magpie bench`.

use magpie::gpu::{Gpu, GpuOptions};
use magpie_bench::{BenchError, Options, run};

use crate::{args::BenchGraphArguments, console, exit::Failure, output::Output};

impl From<BenchError> for Failure {
    fn from(error: BenchError) -> Self {
        match error {
            BenchError::Gpu(error) => error.into(),
            other => Self::running(other),
        }
    }
}

/// `magpie bench graph`.
pub(crate) fn graph(arguments: &BenchGraphArguments) -> Result<(), Failure> {
    let file = arguments.json.as_ref().and_then(Option::as_ref);
    let file = file.map(|path| Output::plan("--json", path, &["json"])).transpose()?;
    let options = if arguments.quick {
        Options::quick()
    } else {
        Options { passes: arguments.passes.clone(), repeat: arguments.repeat }
    };
    let gpu = Gpu::new(&GpuOptions { device: arguments.device.clone(), validation: false, ..GpuOptions::default() })?;
    let report = run(&gpu, &options, |next| log::info!("{next}"))?;
    let json = || report.to_json().map_err(Failure::running);
    match (file, &arguments.json) {
        (None, Some(_)) => console::print(&json()?),
        (file, _) => {
            console::print(&report.table())?;
            file.map_or(Ok(()), |file| file.write_text(&json()?))
        }
    }
}
