//! Arguments of `magpie view`.

use std::path::PathBuf;

use clap::{Args, value_parser};
use magpie_passes::MOST_IN_FLIGHT;

use super::{DeviceArguments, Extent, FrameArguments, LightingArguments, MAX_FRAMES, time_step};

/// The scene that is shown if none is named.
const DEFAULT_SCENE: &str = "builtin:courtyard";

/// Arguments of `magpie view`.
#[derive(Args, Clone, Debug)]
pub struct ViewArguments {
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    pub scene: PathBuf,
    /// Light from all around, and what is supplied.
    #[command(flatten)]
    pub lighting: LightingArguments,
    /// Width and height of the window at first, pixels [default: as it was last, 1280x720 the first time]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<Extent>,
    /// End by itself after so many frames
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    pub frames: Option<u32>,
    /// Write the last frame of --frames, with its panels
    #[arg(long, value_name = "F.png", requires = "frames")]
    pub screenshot: Option<PathBuf>,
    /// Write the times of every pass, of all frames of --frames
    #[arg(long, value_name = "F.json|F.csv", requires = "frames")]
    pub timings: Option<PathBuf>,
    /// Do what a file says, frame by frame, as if it were done by hand; with `-`, what the lines of standard input say, as they come
    #[arg(long, value_name = "F.json|-", allow_hyphen_values = true)]
    pub actions: Option<PathBuf>,
    /// Show the picture without panels; F2 brings them
    #[arg(long)]
    pub no_panels: bool,
    /// Scene time from frame to frame, seconds [default: the time that passes]. With it, each run is the same: nothing is remembered from
    /// earlier ones, and no frame goes on while something is loaded
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = time_step)]
    pub time_step: Option<f32>,
    /// Follow the shaders in this folder: a file that is saved is compiled, and runs with the next frame [default: `shaders` in the current folder,
    /// if that is Magpie's]
    #[arg(long, value_name = "DIR")]
    pub shaders: Option<PathBuf>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u32,
    /// The camera and the configuration.
    #[command(flatten)]
    pub frame: FrameArguments,
    /// The device, and how it traces rays.
    #[command(flatten)]
    pub device: DeviceArguments,
    /// Turn on the validation layers and scan every output for NaN and Inf; any finding is an error
    #[arg(long)]
    pub check: bool,
    /// Frames that are submitted before the oldest of them is waited for
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = value_parser!(u32).range(1..=i64::from(MOST_IN_FLIGHT)))]
    pub frames_in_flight: u32,
}
