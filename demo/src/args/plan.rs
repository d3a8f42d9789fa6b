//! Arguments of `magpie plan`.

use std::path::PathBuf;

use clap::Args;

use super::{DeviceArguments, Extent, FrameArguments, LightingArguments};

/// Arguments of `magpie plan`.
#[derive(Args, Debug)]
#[command(
    mut_arg("supply", |arg| arg.help("What the scene is given where it lacks it")),
    mut_arg("device", |arg| {
        let help = "With --measure: the device by part of its name or by its index in `magpie devices`";
        arg.help(help).requires("measure")
    }),
    mut_arg("rays", |arg| arg.help("With --measure: how rays are traced").requires("measure"))
)]
pub struct PlanArguments {
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// As JSON
    #[arg(long)]
    pub json: bool,
    /// The JSON of `render --timings`, from which shares of the frame's time are taken
    #[arg(long, value_name = "F.json")]
    pub report: Option<PathBuf>,
    /// Render small pictures with and without each effect, and say what each contributes and costs; needs a device
    #[arg(long)]
    pub measure: bool,
    /// With --measure: an effect that changes the picture by less than this (FLIP, 0 to 1) is proposed as off
    #[arg(long, value_name = "X", default_value_t = 0.005, requires = "measure", allow_negative_numbers = true, value_parser = share)]
    pub worth: f64,
    /// With --measure: write the proposed configuration
    #[arg(long, value_name = "F.toml", requires = "measure")]
    pub out: Option<PathBuf>,
    /// With --measure: write the pictures with and without each effect to this folder
    #[arg(long, value_name = "DIR", requires = "measure")]
    pub pictures: Option<PathBuf>,
    /// Light from all around, and what is supplied.
    #[command(flatten)]
    pub lighting: LightingArguments,
    /// Width and height of the picture, pixels [default: 1280x720, 192x108 with --measure]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<Extent>,
    /// The camera and the configuration.
    #[command(flatten)]
    pub frame: FrameArguments,
    /// The device, and how it traces rays.
    #[command(flatten)]
    pub device: DeviceArguments,
}

fn share(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("wanted a number from 0 to 1, got \"{text}\""))?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(format!("wanted a number from 0 to 1, got {text}")) }
}
