//! `magpie compare`.

use std::{fmt::Write, path::Path};

use magpie_accuracy::metrics::{Comparison, DynamicRange, Picture, side_by_side};
use serde::Serialize;

use crate::{
    args::CompareArguments,
    console,
    exit::Failure,
    output::{Output, keep_apart},
    picture::{read_picture, write_png},
};

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    test: String,
    reference: String,
    #[serde(flatten)]
    comparison: &'a Comparison,
}

/// `magpie compare`.
pub(crate) fn compare(arguments: &CompareArguments) -> Result<(), Failure> {
    let (a, b) = (arguments.test.as_path(), arguments.reference.as_path());
    let diff = arguments.diff.as_ref().map(|path| Output::plan("--diff", path, &["png"])).transpose()?;
    keep_apart(&diff.iter().collect::<Vec<_>>(), &[("picture under test", a), ("reference", b)])?;
    let ((test, test_range), (reference, reference_range)) = (read(a)?, read(b)?);

    let pair = || format!("{} against {}", a.display(), b.display());
    let comparison = Comparison::of(&test, &reference).map_err(|e| Failure::input(e).context(pair()))?;
    if let Some(file) = diff {
        // HDR metrics apply if either image has values beyond the display range.
        let range = if test_range == DynamicRange::High { test_range } else { reference_range };
        let drawn = side_by_side(&test, &reference, range).map_err(|e| Failure::input(e).context(pair()))?;
        file.write(|out| write_png(out, &drawn))?;
    }
    if !arguments.json {
        return console::print(&table(&pair(), &comparison));
    }
    let (test, reference) = (a.display().to_string(), b.display().to_string());
    let report = Report { test, reference, comparison: &comparison };
    console::print(&(serde_json::to_string_pretty(&report).map_err(Failure::running)? + "\n"))
}

fn read(path: &Path) -> Result<(Picture, DynamicRange), Failure> {
    read_picture(path).map_err(|error| Failure::input(error).context(path.display().to_string()))
}

fn table(pair: &str, c: &Comparison) -> String {
    let mut text = format!("{pair}, {}x{}\n", c.width, c.height);
    let mut line = |name: &str, value: String, about: &str| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {name:<16}{value:>12}  {about}");
    };
    let number =
        |x: f64| if x == 0.0 || (1e-4..1e6).contains(&x.abs()) { format!("{x:.6}") } else { format!("{x:.5e}") };
    line("RMSE", number(c.rmse), "linear, 0 is equal");
    line("relMSE", number(c.relmse), "linear, 0 is equal");
    line("SMAPE", number(c.smape), "linear, 0 to 1");
    line("PSNR", c.psnr.map_or("equal".to_owned(), |x| format!("{x:.2} dB")), "as displayed, higher is closer");
    line("SSIM", number(c.ssim), "as displayed, 1 is equal");
    line("FLIP", number(c.flip_ldr), "as displayed, 0 to 1");
    let e = c.exposures;
    let stops = format!("{} exposures from {:+.2} to {:+.2} stops, 0 to 1", e.count, e.start, e.stop);
    line("FLIP HDR", number(c.flip_hdr), &stops);
    let (test, reference) = (number(c.mean_test), number(c.mean_reference));
    line("mean", test, &format!("luminance; {reference} in the reference"));
    text
}
