//! The arguments of `magpie bench`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::{DeviceArguments, Extent, Supply};

/// What `magpie bench` measures.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// CPU time per pass of the frame graph, beside hand-written Vulkan and other graphs
    Graph(BenchGraphArguments),
    /// Rays per second in every way that the device has, and what building its acceleration structures costs
    Rays(BenchRaysArguments),
    /// How far an effect is from the truth of each frame while the camera, things or lights move, and after a light is switched on
    Motion(Box<BenchMotionArguments>),
    /// How far the picture is from the truth with every pair of features that ship together, still and while the camera moves
    Pairs(BenchPairsArguments),
    /// Time and error of each implementation of direct light over the number of lamps
    Lights(BenchLightsArguments),
}

/// Arguments of `magpie bench graph`.
#[derive(Args, Debug)]
pub struct BenchGraphArguments {
    /// Write JSON to this file, or to standard output in place of the table
    #[arg(long, value_name = "F.json", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
    /// Numbers of passes, separated by commas
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "10,100,1000,10000", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(magpie_bench::MAX_PASSES)))]
    pub passes: Vec<u32>,
    /// Measured frames of each contestant and size; without it a number that suits the size
    #[arg(long, value_name = "N", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(magpie_bench::MAX_REPEAT)))]
    pub repeat: Option<u32>,
    /// A run of seconds: 10 and 100 passes, 5 frames
    #[arg(long, conflicts_with_all = ["passes", "repeat"])]
    pub quick: bool,
    /// The device by part of its name or by its index in `magpie devices`
    #[arg(long, value_name = "NAME|INDEX")]
    pub device: Option<String>,
}

/// Arguments of `magpie bench rays`.
#[derive(Args, Debug)]
pub struct BenchRaysArguments {
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file; repeatable. Without it, the built-in scenes
    #[arg(long, value_name = "SCENE")]
    pub scene: Vec<PathBuf>,
    /// What to add to a scene without a camera or light of its own
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = Supply::All)]
    pub supply: Supply,
    /// Write JSON to this file, or to standard output in place of the table
    #[arg(long, value_name = "F.json", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
    /// Write CSV, a row per measurement
    #[arg(long, value_name = "F.csv")]
    pub csv: Option<PathBuf>,
    /// Write charts to this folder, as SVG
    #[arg(long, value_name = "DIR")]
    pub charts: Option<PathBuf>,
    /// A run of seconds: few sizes, few rays, few repeats
    #[arg(long)]
    pub quick: bool,
    /// Rays of a dispatch; without it a number that suits the device: 8 million, or 262144 on a processor
    #[arg(long, value_name = "N", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(i64::from(magpie_bench::rays::MIN_RAYS)..=i64::from(magpie_bench::rays::MAX_RAYS)))]
    pub size: Option<u32>,
    /// The ways to trace that take part, separated by commas; without it all that the device has
    #[arg(long, value_enum, value_name = "WAYS", value_delimiter = ',')]
    pub rays: Vec<BenchRays>,
    /// The device by part of its name or by its index in `magpie devices`
    #[arg(long, value_name = "NAME|INDEX")]
    pub device: Option<String>,
}

/// Arguments of `magpie bench motion`.
#[derive(Args, Debug)]
pub struct BenchMotionArguments {
    /// The scene.
    #[command(flatten)]
    pub scene: BenchSceneArguments,
    /// The slot
    #[arg(long, value_name = "SLOT", default_value = "shadows", value_parser = ["shadows", "ao", "reflections", "gi", "direct"])]
    pub slot: String,
    /// Compare the picture at the end of the frame in place of the slot's image
    #[arg(long)]
    pub picture: bool,
    /// The paths and contestants that take part, separated by semicolons; without it, all
    #[arg(long, value_name = "NAMES", value_delimiter = ';')]
    pub only: Vec<String>,
    /// Width and height, pixels
    #[arg(long, value_name = "WxH", default_value = "160x90", allow_hyphen_values = true)]
    pub size: Extent,
    /// Frames of each path
    #[arg(long, value_name = "N", default_value_t = 24, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(4..=1000))]
    pub frames: u32,
    /// Runs of each contestant on each path, each with the next seed; the results are their means
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub seeds: u32,
    /// Name of the thing that path `door` moves, or a part of it
    #[arg(long, value_name = "NAME", default_value = "door")]
    pub door: String,
    /// Write JSON to this file, or to standard output in place of the table
    #[arg(long, value_name = "F.json", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
    /// Write charts to this folder, as SVG
    #[arg(long, value_name = "DIR")]
    pub charts: Option<PathBuf>,
    /// Write the frames 1, 8, 32 and the last of each path and contestant to this folder, as PATH-FRAME-CONTESTANT.png: the frame, its ground
    /// truth, and where they differ
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// How it is rendered.
    #[command(flatten)]
    pub render: BenchRenderArguments,
}

/// Arguments of `magpie bench pairs`.
#[derive(Args, Debug)]
#[command(
    mut_arg("config", |arg| arg.help("The configuration around the features")),
    mut_arg("rays", |arg| arg.help("How rays are traced where a feature does not say"))
)]
pub struct BenchPairsArguments {
    /// The scene.
    #[command(flatten)]
    pub scene: BenchSceneArguments,
    /// Names of the features that take part, separated by commas; without it all
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Width and height, pixels
    #[arg(long, value_name = "WxH", default_value = "128x72", allow_hyphen_values = true)]
    pub size: Extent,
    /// Write JSON to this file, or to standard output in place of the table
    #[arg(long, value_name = "F.json", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
    /// How it is rendered.
    #[command(flatten)]
    pub render: BenchRenderArguments,
}

/// Arguments of `magpie bench lights`.
#[derive(Args, Debug)]
pub struct BenchLightsArguments {
    /// Numbers of lamps, separated by commas
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "1,10,100,1000,10000", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(magpie_bench::lights::MAX_LAMPS)))]
    pub lamps: Vec<u32>,
    /// The contestants that take part, separated by commas; without it, all
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Width and height, pixels
    #[arg(long, value_name = "WxH", default_value = "160x90", allow_hyphen_values = true)]
    pub size: Extent,
    /// Samples per pixel of the ground truth
    #[arg(long, value_name = "N", default_value_t = 256, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub samples: u32,
    /// Seconds after which a contestant is measured over fewer frames
    #[arg(long, value_name = "SECONDS", default_value_t = 30, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub patience: u32,
    /// Write JSON to this file, or to standard output in place of the table
    #[arg(long, value_name = "F.json", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
    /// Write charts to this folder, as SVG
    #[arg(long, value_name = "DIR")]
    pub charts: Option<PathBuf>,
    /// How it is rendered.
    #[command(flatten)]
    pub render: BenchRenderArguments,
}

/// The scene of `magpie bench motion` and `magpie bench pairs`.
#[derive(Args, Debug)]
pub struct BenchSceneArguments {
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(id = "scene", value_name = "SCENE", default_value = "builtin:courtyard")]
    pub path: PathBuf,
    /// What to add to a scene without a camera or light of its own
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = Supply::All)]
    pub supply: Supply,
}

/// How `magpie bench motion`, `magpie bench pairs` and `magpie bench lights` render.
#[derive(Args, Debug)]
pub struct BenchRenderArguments {
    /// The configuration around the slot
    #[arg(long, value_name = "F.toml")]
    pub config: Option<PathBuf>,
    /// One value of it; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u32,
    /// The device, and how it traces rays.
    #[command(flatten)]
    pub device: DeviceArguments,
}

/// A way to trace rays that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BenchRays {
    /// Compute shaders over Magpie's own hierarchy.
    Software,
    /// Ray queries in compute shaders.
    Query,
    /// Ray-tracing pipelines.
    Pipeline,
}

impl BenchRays {
    /// Converts to the engine's type.
    pub fn way(self) -> magpie::prelude::Rays {
        match self {
            Self::Software => magpie::prelude::Rays::Software,
            Self::Query => magpie::prelude::Rays::Query,
            Self::Pipeline => magpie::prelude::Rays::Pipeline,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::{Arguments, Command};

    #[test]
    fn json_of_a_benchmark_goes_to_a_file_or_to_standard_output() {
        let parse = |arguments: &[&str]| {
            let arguments = Arguments::try_parse_from([&["magpie", "bench", "graph"][..], arguments].concat()).unwrap();
            let Some(Command::Bench { what: Bench::Graph(graph) }) = arguments.command else {
                panic!("another command")
            };
            graph
        };
        let plain = parse(&[]);
        assert_eq!((plain.json, plain.passes), (None, vec![10, 100, 1_000, 10_000]));
        let shown = parse(&["--json", "--passes", "7,30", "--repeat", "9"]);
        assert_eq!((shown.json, shown.passes, shown.repeat), (Some(None), vec![7, 30], Some(9)));
        assert_eq!(parse(&["--json", "f.json", "--quick"]).json, Some(Some(PathBuf::from("f.json"))));
    }
}
