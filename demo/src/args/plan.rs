//! Arguments of `magpie plan`.

use std::path::PathBuf;

use clap::Args;

use super::{EnvironmentArguments, Extent, Rays, Supply};

/// Arguments of `magpie plan`.
#[derive(Args, Debug)]
pub struct PlanArguments {
    /// `builtin:NAME`, or a path to a .gltf or .glb file
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
    /// Light from all around.
    #[command(flatten)]
    pub environment: EnvironmentArguments,
    /// What the scene is given where it lacks it
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = Supply::All)]
    pub supply: Supply,
    /// Width and height of the picture, pixels [default: 1280x720, 192x108 with --measure]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<Extent>,
    /// A camera of the scene by name, or a camera file
    #[arg(long, value_name = "NAME|F.toml")]
    pub camera: Option<PathBuf>,
    /// Which implementation sits in each stage, and its settings
    #[arg(long, value_name = "F.toml")]
    pub config: Option<PathBuf>,
    /// One value of the configuration: `stages.shadows=off`, `SLOT.SETTING=VALUE`; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// With --measure: the device by part of its name or by its index in `magpie devices`
    #[arg(long, value_name = "NAME|INDEX", requires = "measure")]
    pub device: Option<String>,
    /// With --measure: how rays are traced
    #[arg(long, value_enum, default_value_t = Rays::Auto, requires = "measure")]
    pub rays: Rays,
}

fn share(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("wanted a number from 0 to 1, got \"{text}\""))?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(format!("wanted a number from 0 to 1, got {text}")) }
}
