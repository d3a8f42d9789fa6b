//! The arguments of `magpie accuracy` and `magpie tune`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use magpie_accuracy::{
    report::{Image, Metric},
    sweep::Shard,
};

use super::{DeviceArguments, Extent, FrameArguments, LightingArguments};

/// Arguments of `magpie accuracy`.
#[derive(Args, Debug)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    mut_arg("config", |arg| arg.help("The configuration that is varied")),
    mut_arg("set", |arg| arg.help("One value of it; repeatable"))
)]
pub struct AccuracyArguments {
    /// Merge or compare earlier results instead of measuring
    #[command(subcommand)]
    pub command: Option<AccuracyCommand>,
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(value_name = "SCENE", required = true)]
    pub scene: Option<PathBuf>,
    /// The folder of results; what is there already is not measured again
    #[arg(long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
    /// The stages to measure, separated by commas; without it all
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub stages: Vec<String>,
    /// A smaller picture, fewer samples and frames, and ten minutes at most
    #[arg(long)]
    pub quick: bool,
    /// Take so many minutes at most: configurations race for the fronts, and the report says how sure each place is [default: no limit,
    /// 10 with --quick]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = above_zero)]
    pub minutes: Option<f64>,
    /// Error metric of the fronts: flip, hdr-flip, relmse, rmse, smape, dssim
    #[arg(long, value_name = "METRIC", default_value = "flip")]
    pub metric: Metric,
    /// Image that the fronts are measured on: `picture`, `moving` (the picture while the camera moves) or `slot` (the stage's own image),
    /// where there is one
    #[arg(long, value_name = "IMAGE", default_value = "picture")]
    pub image: Image,
    /// Measure one part of several, on one machine of several
    #[arg(long, value_name = "I/N")]
    pub shard: Option<Shard>,
    /// Width and height of the picture, pixels [default: 640x360, 160x90 with --quick]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<Extent>,
    /// Samples per pixel of the truths [default: 1024, 128 with --quick]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=16_777_216))]
    pub samples: Option<u32>,
    /// Keep truths in this folder, which several runs may share [default: DIR/truths]
    #[arg(long, value_name = "DIR")]
    pub truths: Option<PathBuf>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u32,
    /// The camera and the configuration.
    #[command(flatten)]
    pub frame: FrameArguments,
    /// The device, and how it traces rays.
    #[command(flatten)]
    pub device: DeviceArguments,
    /// Light from all around, and what is supplied.
    #[command(flatten)]
    pub lighting: LightingArguments,
}

/// Subcommands of `magpie accuracy`.
#[derive(Debug, Subcommand)]
pub enum AccuracyCommand {
    /// Bring the parts of a run together and make its report
    Merge {
        /// The folders of the parts
        #[arg(value_name = "DIR", required = true)]
        folders: Vec<PathBuf>,
        /// The folder of the whole
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Say how far two reports agree: the order of the rows of each stage (Kendall's tau), and the fronts
    Compare {
        /// The folder of a report
        #[arg(value_name = "A")]
        first: PathBuf,
        /// The folder of another
        #[arg(value_name = "B")]
        second: PathBuf,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
}

/// Arguments of `magpie tune`.
#[derive(Args, Debug)]
#[group(id = "goal", required = true, multiple = false, args = ["budget_ms", "max_error", "all"])]
pub struct TuneArguments {
    /// The scene of the report: `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// The folder of a report of `magpie accuracy`
    #[arg(long, value_name = "DIR")]
    pub report: PathBuf,
    /// The least error in so many milliseconds of the GPU per frame
    #[arg(long, value_name = "X", allow_negative_numbers = true, value_parser = above_zero)]
    pub budget_ms: Option<f64>,
    /// The least time with so much error of the picture, by --metric
    #[arg(long, value_name = "E", allow_negative_numbers = true, value_parser = above_zero)]
    pub max_error: Option<f64>,
    /// A configuration for each of 1, 2, 4, 8, 16 and 33 ms, or for shares of the default's time where that is more; --out names a folder
    #[arg(long)]
    pub all: bool,
    /// Error metric: flip, hdr-flip, relmse, rmse, smape, dssim
    #[arg(long, value_name = "METRIC", default_value = "flip")]
    pub metric: Metric,
    /// Write the configuration, or with --all the configurations and their table into this folder
    #[arg(long, value_name = "F.toml|DIR")]
    pub out: PathBuf,
    /// Do not render the predicted best configurations to confirm them
    #[arg(long)]
    pub no_render: bool,
    /// The camera of the report: by name, or a camera file
    #[arg(long, value_name = "NAME|F.toml")]
    pub camera: Option<PathBuf>,
    /// The device, and how it traces rays.
    #[command(flatten)]
    pub device: DeviceArguments,
    /// Light from all around, and what is supplied.
    #[command(flatten)]
    pub lighting: LightingArguments,
}

fn above_zero(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("wanted a finite number above 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::{super::Command, *};
    use crate::Arguments;

    fn parse(arguments: &[&str]) -> Result<Command, clap::Error> {
        Arguments::try_parse_from([&["magpie"][..], arguments].concat()).map(|a| a.command.unwrap())
    }

    #[test]
    fn a_scene_is_measured_or_folders_are_merged() {
        let Ok(Command::Accuracy(sweep)) =
            parse(&["accuracy", "builtin:cornell", "--out", "r", "--stages", "gi,shadows"])
        else {
            panic!("no sweep")
        };
        assert_eq!((sweep.stages.len(), sweep.quick, sweep.seed, sweep.minutes), (2, false, 0, None));
        assert_eq!((sweep.metric, sweep.image), (Metric::FlipLdr, Image::Picture));
        let Ok(Command::Accuracy(merge)) = parse(&["accuracy", "merge", "a", "b", "--out", "c"]) else {
            panic!("no merge")
        };
        assert!(matches!(merge.command, Some(AccuracyCommand::Merge { folders, .. }) if folders.len() == 2));
        let Ok(Command::Accuracy(compare)) = parse(&["accuracy", "compare", "a", "b", "--json"]) else {
            panic!("no comparison")
        };
        assert!(matches!(compare.command, Some(AccuracyCommand::Compare { json: true, .. })));
        let within = &["accuracy", "s", "--out", "r", "--minutes", "2.5", "--metric", "hdr-flip", "--image", "moving"];
        let Ok(Command::Accuracy(within)) = parse(within) else { panic!("no race") };
        assert_eq!((within.minutes, within.metric, within.image), (Some(2.5), Metric::FlipHdr, Image::Moving));
        for bad in [
            &["accuracy"][..],
            &["accuracy", "s", "--out", "r", "--minutes", "0"],
            &["accuracy", "s", "--out", "r", "--metric", "psnr"],
            &["accuracy", "compare", "a"],
            &["accuracy", "s"],
            &["accuracy", "merge", "--out", "c"],
            &["accuracy", "s", "--out", "r", "--shard", "3/2"],
        ] {
            assert!(parse(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn tuning_has_one_goal() {
        let with = |goal: &[&str]| parse(&[&["tune", "s", "--report", "r", "--out", "f.toml"], goal].concat());
        assert!(with(&["--budget-ms", "16.7"]).is_ok() && with(&["--max-error", "0.01"]).is_ok());
        assert!(with(&["--all"]).is_ok() && with(&["--all", "--metric", "relmse"]).is_ok());
        for bad in [
            &[][..],
            &["--all", "--budget-ms", "1"],
            &["--budget-ms", "1", "--max-error", "1"],
            &["--budget-ms", "0"],
            &["--max-error", "nan"],
        ] {
            assert!(with(bad).is_err(), "{bad:?}");
        }
    }
}
