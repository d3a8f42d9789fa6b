//! The arguments of `magpie`.

mod accuracy;
mod bench;
mod plan;
mod reference;
mod view;

use std::{path::PathBuf, str::FromStr};

use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum};
use magpie::graph::Switches;
use magpie::pixels::Mapping;
use magpie_passes::MOST_IN_FLIGHT;

pub use accuracy::{AccuracyArguments, AccuracyCommand, TuneArguments};
pub use bench::{
    Bench, BenchGraphArguments, BenchLightsArguments, BenchMotionArguments, BenchPairsArguments, BenchRays,
    BenchRaysArguments, BenchRenderArguments, BenchSceneArguments,
};
pub use plan::PlanArguments;
pub use reference::ReferenceArguments;
pub use view::ViewArguments;

/// Greatest width and height of a picture, pixels.
const MAX_EXTENT: u32 = 16_384;
/// Greatest number of frames.
pub(crate) const MAX_FRAMES: u32 = 1_000_000;

/// Magpie: a frame-graph-based hybrid renderer on Vulkan.
#[derive(Debug, Parser)]
#[command(name = "magpie", version, max_term_width = 120)]
pub struct Arguments {
    /// How much is said.
    #[command(flatten)]
    pub loudness: Loudness,
    /// What to do; `view` if nothing is said.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// How much is said on standard error.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct Loudness {
    /// Say more
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Say nothing but errors, and show no progress
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List each Vulkan device: driver, ray backends, queues, limits; why one is refused
    Devices {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// List the built-in scenes
    Scenes,
    /// List every stage, its implementations and their settings
    Stages {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Say what a frame of a scene is made of: what runs in each stage, what is idle and why, and what memory it takes
    Plan(Box<PlanArguments>),
    /// Show a scene in a window: fly through it, swap what fills its stages, watch what each pass takes
    View(Box<ViewArguments>),
    /// Render without a window and print the pass table
    Render(Box<RenderArguments>),
    /// Trace the truth: the same scene by an unbiased path tracer
    Reference(Box<ReferenceArguments>),
    /// Say how far a picture is from its reference: RMSE, relMSE, SMAPE, PSNR, SSIM, FLIP
    Compare(CompareArguments),
    /// Show what accuracy costs: error against time for every implementation and setting, as JSON, CSV and a page with charts
    Accuracy(Box<AccuracyArguments>),
    /// Choose a configuration from measured fronts: the most accurate within a budget, or the cheapest within an error
    Tune(Box<TuneArguments>),
    /// Measure parts of the engine
    #[command(arg_required_else_help = false)]
    Bench {
        /// What is measured
        #[command(subcommand)]
        what: Bench,
    },
}

/// Arguments of `magpie compare`.
#[derive(Args, Debug)]
pub struct CompareArguments {
    /// The picture under test: PNG (sRGB) or EXR (linear)
    #[arg(value_name = "A")]
    pub test: PathBuf,
    /// The reference, of the same size
    #[arg(value_name = "B")]
    pub reference: PathBuf,
    /// As JSON
    #[arg(long)]
    pub json: bool,
    /// Draw A, B and the FLIP of each pixel, black for equal, side by side
    #[arg(long, value_name = "F.png")]
    pub diff: Option<PathBuf>,
}

/// Arguments of `magpie render`.
#[derive(Args, Debug)]
pub struct RenderArguments {
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(value_name = "SCENE", required_unless_present = "print_config")]
    pub scene: Option<PathBuf>,
    /// Write the picture: PNG as displayed, EXR as linear radiance before the tone map; with %d or %04d in the name, every measured frame
    #[arg(long, value_name = "F.png|F.exr|F_%04d.png")]
    pub out: Option<PathBuf>,
    /// Light from all around, and what is supplied.
    #[command(flatten)]
    pub lighting: LightingArguments,
    /// Width and height of the picture, pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", allow_hyphen_values = true)]
    pub size: Extent,
    /// Frames to measure; the last one is the picture [default: 32, or those of --camera-path]
    #[arg(long, value_name = "N", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    pub frames: Option<u32>,
    /// Frames before them
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    pub warmup: u32,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u32,
    /// Scene time from frame to frame, seconds
    #[arg(long, value_name = "SECONDS", default_value = "0.0166667", allow_negative_numbers = true, value_parser = time_step)]
    pub time_step: f32,
    /// Move the camera along a recorded path, from its first key at the first measured frame on
    #[arg(long, value_name = "F.json", conflicts_with = "camera")]
    pub camera_path: Option<PathBuf>,
    /// The camera and the configuration.
    #[command(flatten)]
    pub frame: FrameArguments,
    /// The device, and how it traces rays.
    #[command(flatten)]
    pub device: DeviceArguments,
    /// Treat these ways to trace rays as missing, even if the device has them: to try what happens elsewhere
    #[arg(long, value_enum, value_name = "WAYS", value_delimiter = ',')]
    pub without_rays: Vec<DriverRays>,
    /// Write the times of every pass
    #[arg(long, value_name = "F.json|F.csv")]
    pub timings: Option<PathBuf>,
    /// Count what the shaders of every pass did, where the device can; it costs time
    #[arg(long)]
    pub statistics: bool,
    /// Write a Chrome trace, which opens in Perfetto
    #[arg(long, value_name = "F.json")]
    pub trace: Option<PathBuf>,
    /// Write this output of this pass to --out instead of the picture
    #[arg(long, value_name = "PASS:OUTPUT", requires = "out")]
    pub view: Option<ViewName>,
    /// Colours of --view in a PNG, words with commas between: rgb, r, g, b, a, luminance or relative (alpha over luminance); linear or log;
    /// false for false colours; LO..HI for the numbers of the first and the last colour
    #[arg(long, value_name = "WORDS", requires = "view")]
    pub view_as: Option<Mapping>,
    /// Write the plan of the last frame
    #[arg(long, value_name = "F.txt|F.json|F.dot|F.html")]
    pub dump_graph: Option<PathBuf>,
    /// Leave steps of the frame graph out, or plan for so many queues, to compare
    #[arg(long, value_name = "serial,no-cull,no-alias,no-async,no-reorder,no-cache,queues=N", value_parser = switches,
          default_value = "", hide_default_value = true)]
    pub graph: Switches,
    /// Turn on the validation layers and scan every output for NaN and Inf; any finding is an error
    #[arg(long)]
    pub check: bool,
    /// Name the pass in which a device is lost, on any device; on some, passes then run one after another
    #[arg(long)]
    pub breadcrumbs: bool,
    /// Frames that are submitted before the oldest of them is waited for; 1 lets processor and device take turns
    #[arg(long, value_name = "N", default_value_t = 2,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_IN_FLIGHT)))]
    pub frames_in_flight: u32,
    /// Print the whole configuration as TOML, and do nothing else
    #[arg(long)]
    pub print_config: bool,
}

/// What is added to a scene without a camera or light of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Supply {
    /// Nothing: without a camera of its own or one of --camera, a scene cannot be shown.
    None,
    /// A camera that frames it.
    Camera,
    /// A camera, and a sun and a sky where nothing else is light enough.
    All,
}

impl Supply {
    /// Converts to the engine's type.
    pub fn wanted(self) -> magpie::scene::Supply {
        match self {
            Self::None => magpie::scene::Supply::Nothing,
            Self::Camera => magpie::scene::Supply::Camera,
            Self::All => magpie::scene::Supply::All,
        }
    }
}

/// What lights a scene, and what it is given where it lacks a camera or light, for every command that renders one.
#[derive(Args, Clone, Debug)]
pub struct LightingArguments {
    /// Light from all around.
    #[command(flatten)]
    pub environment: EnvironmentArguments,
    /// What to add to a scene without a camera or light of its own
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = Supply::All)]
    pub supply: Supply,
}

/// What is rendered of a scene: the camera and the configuration.
#[derive(Args, Clone, Debug)]
pub struct FrameArguments {
    /// A camera of the scene by name, or a camera file
    #[arg(long, value_name = "NAME|F.toml")]
    pub camera: Option<PathBuf>,
    /// Which implementation sits in each stage, and its settings
    #[arg(long, value_name = "F.toml")]
    pub config: Option<PathBuf>,
    /// One value of the configuration: `stages.shadows=off`, `SLOT.SETTING=VALUE`; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// What renders: the device, and how it traces rays.
#[derive(Args, Clone, Debug)]
pub struct DeviceArguments {
    /// The device by part of its name or by its index in `magpie devices`
    #[arg(long, value_name = "NAME|INDEX")]
    pub device: Option<String>,
    /// How rays are traced
    #[arg(long, value_enum, default_value_t = Rays::Auto)]
    pub rays: Rays,
}

/// Light from all around, for every command that renders a scene.
#[derive(Args, Clone, Debug)]
pub struct EnvironmentArguments {
    /// Surround the scene with this image, latitude over longitude, in place of its sky; its lights stay
    #[arg(long, value_name = "F.hdr|F.exr")]
    pub environment: Option<PathBuf>,
    /// What the radiance of the image is multiplied with
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "environment", allow_negative_numbers = true,
          value_parser = environment_scale)]
    pub environment_scale: f32,
    /// Angle by which the image is turned about the vertical, counter-clockwise as seen from above
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, requires = "environment", allow_negative_numbers = true,
          value_parser = environment_turn)]
    pub environment_turn: f32,
}

fn switches(text: &str) -> Result<Switches, String> {
    let mut switches = Switches::default();
    for word in text.split(',').filter(|_| !text.is_empty()) {
        if !switches.set(word) {
            let known = Switches::WORDS.join(", ");
            return Err(format!("`{word}` is no switch of the graph; wanted {known} or queues=N with N from 1 to 3"));
        }
    }
    Ok(switches)
}

/// Width and height, pixels, each from 1 to 16384.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
}

impl FromStr for Extent {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |digits: &str| {
            let plain = !digits.is_empty() && digits.len() <= 5 && digits.bytes().all(|b| b.is_ascii_digit());
            digits.parse().ok().filter(|n| plain && (1..=MAX_EXTENT).contains(n))
        };
        let sides = text.split_once('x').and_then(|(w, h)| Some(Self { width: side(w)?, height: side(h)? }));
        sides.ok_or_else(|| format!("wanted WIDTHxHEIGHT in pixels, each from 1 to {MAX_EXTENT}, such as 640x360"))
    }
}

/// One output of one pass, written `PASS:OUTPUT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewName {
    /// Full name of the pass, such as `shadows.trace`.
    pub pass: String,
    /// Name of the output, such as `visibility`.
    pub output: String,
}

impl FromStr for ViewName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some((pass, output)) if !pass.is_empty() && !output.is_empty() && !output.contains(':') => {
                Ok(Self { pass: pass.to_owned(), output: output.to_owned() })
            }
            _ => Err("wanted PASS:OUTPUT, such as shadows.trace:visibility".to_owned()),
        }
    }
}

impl std::fmt::Display for ViewName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}", self.pass, self.output)
    }
}

/// How rays are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rays {
    /// Compute shaders over Magpie's own hierarchy.
    Software,
    /// Ray queries in compute shaders.
    Query,
    /// Ray-tracing pipelines.
    Pipeline,
    /// Whatever suits the device.
    Auto,
}

/// How a driver can trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DriverRays {
    /// Ray queries in compute shaders.
    Query,
    /// Ray-tracing pipelines.
    Pipeline,
}

impl DriverRays {
    /// Converts to the engine's type.
    pub fn way(self) -> magpie::prelude::Rays {
        match self {
            Self::Query => magpie::prelude::Rays::Query,
            Self::Pipeline => magpie::prelude::Rays::Pipeline,
        }
    }
}

fn environment_scale(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(scale) if scale.is_finite() && scale >= 0.0 => Ok(scale),
        _ => Err("wanted a finite number of at least 0".to_owned()),
    }
}

fn environment_turn(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(degrees) if degrees.is_finite() => Ok(degrees),
        _ => Err("wanted a finite number of degrees".to_owned()),
    }
}

fn time_step(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(seconds) if seconds.is_finite() && seconds > 0.0 => Ok(seconds),
        _ => Err("wanted a finite number of seconds above 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_declaration_holds_together() {
        use clap::CommandFactory;
        Arguments::command().debug_assert();
    }

    #[test]
    fn sizes_are_two_plain_numbers() {
        let extent = |text: &str| text.parse::<Extent>().ok().map(|e| (e.width, e.height));
        assert_eq!(extent("640x360"), Some((640, 360)));
        assert_eq!(extent("1x16384"), Some((1, 16_384)));
        for bad in [
            "",
            "x",
            "640",
            "640x",
            "x360",
            "0x10",
            "10x0",
            "640X360",
            "640x360x2",
            "+640x360",
            "-1x5",
            " 640x360",
            "640 x360",
            "16385x1",
            "1x99999999999999999999",
            "6.4x3",
            "1e2x5",
            "٣x٣",
        ] {
            assert_eq!(extent(bad), None, "{bad}");
        }
    }

    #[test]
    fn time_steps_are_finite_and_above_zero() {
        assert_eq!(time_step("0.5"), Ok(0.5));
        for bad in ["0", "-1", "nan", "inf", "1e99", "", "x", "1e-99"] {
            assert!(time_step(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn scales_and_turns_of_an_environment_map_are_finite() {
        assert_eq!((environment_scale("0"), environment_turn("-90.5")), (Ok(0.0), Ok(-90.5)));
        for bad in ["nan", "inf", "-inf", "1e99", "", "x"] {
            assert!(environment_scale(bad).is_err() && environment_turn(bad).is_err(), "{bad}");
        }
        assert!(environment_scale("-1").is_err());
    }

    #[test]
    fn views_name_pass_and_output() {
        let view: ViewName = "shadows.trace:visibility".parse().unwrap();
        assert_eq!((view.pass.as_str(), view.output.as_str()), ("shadows.trace", "visibility"));
        assert_eq!(view.to_string(), "shadows.trace:visibility");
        for bad in ["", ":", "a", "a:", ":b", "a:b:c"] {
            assert!(bad.parse::<ViewName>().is_err(), "{bad}");
        }
    }

    #[test]
    fn defaults_are_those_of_the_manual() {
        let arguments = Arguments::try_parse_from(["magpie", "render", "builtin:cornell"]).unwrap();
        let Some(Command::Render(render)) = arguments.command else { panic!("another command") };
        assert_eq!(render.size, Extent { width: 1280, height: 720 });
        assert_eq!((render.frames, render.warmup, render.seed, render.device.rays), (None, 0, 0, Rays::Auto));
        assert!((render.time_step - 1.0 / 60.0).abs() < 1e-6);
    }
}
