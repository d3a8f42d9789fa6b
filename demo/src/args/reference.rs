//! Arguments of `magpie reference`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use magpie_passes::reference::{self, PixelSampling};

use super::{Extent, LightingArguments, Rays};

/// Arguments of `magpie reference`.
#[derive(Args, Debug)]
pub struct ReferenceArguments {
    /// `builtin:NAME`, `builtin:NAME?KEY=VALUE`, or a path to a .gltf or .glb file
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Samples per pixel, those of earlier runs counted in
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32))]
    pub samples: u32,
    /// Write linear radiance with its standard error to this file; if it is there already, go on where it stopped
    #[arg(long, value_name = "F.exr")]
    pub out: PathBuf,
    /// Write the picture as a display shows it, too
    #[arg(long, value_name = "F.png")]
    pub png: Option<PathBuf>,
    /// One value of the configuration: the settings of `post` are for --png, `gbuffer.multiple_scattering` is for all; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Begin anew in the place of --out
    #[arg(long)]
    pub restart: bool,
    /// Add the samples of another run of the same picture, with another seed; repeatable
    #[arg(long, value_name = "F.exr")]
    pub merge: Vec<PathBuf>,
    /// Only what the slot of this name gives, at the centres of pixels
    #[arg(long, value_enum, default_value_t = Only::All)]
    pub only: Only,
    /// Where in a pixel samples lie; without it all over, and with --only at the centre
    #[arg(long, value_enum, value_name = "WHERE")]
    pub pixel: Option<Pixel>,
    /// How local lights and emissive surfaces are chosen. It changes the noise, not the light
    #[arg(long, value_enum, value_name = "HOW", default_value_t = Lights::Auto)]
    pub lights: Lights,
    /// Greatest number of scatterings, 1 for light straight from lights; 0 for no limit
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    pub depth: u32,
    /// Distance up to which geometry occludes for `--only ao`, metres
    #[arg(long, value_name = "METRES", default_value = "1", allow_negative_numbers = true, value_parser = super::time_step)]
    pub ao_range: f32,
    /// Which moment of the animation, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub time: f32,
    /// Light from all around, and what is supplied.
    #[command(flatten)]
    pub lighting: LightingArguments,
    /// Width and height of the picture, pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", allow_hyphen_values = true)]
    pub size: Extent,
    /// A camera of the scene by name, or a camera file
    #[arg(long, value_name = "NAME|F.toml")]
    pub camera: Option<PathBuf>,
    /// The device by part of its name or by its index in `magpie devices`
    #[arg(long, value_name = "NAME|INDEX")]
    pub device: Option<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u32,
    /// How rays are traced
    #[arg(long, value_enum, default_value_t = Rays::Auto)]
    pub rays: Rays,
    /// Turn on the validation layers; any finding is an error
    #[arg(long)]
    pub check: bool,
}

impl ReferenceArguments {
    /// Where samples lie in a pixel, with the default of `--only` applied.
    pub fn pixel(&self) -> PixelSampling {
        match (self.pixel, self.only) {
            (Some(Pixel::Area), _) | (None, Only::All) => PixelSampling::Area,
            (Some(Pixel::Centre), _) | (None, _) => PixelSampling::Centre,
        }
    }
}

/// Where in a pixel samples lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Pixel {
    /// All over its square.
    Area,
    /// At its centre.
    Centre,
}

/// How the reference chooses local lights and emissive surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Lights {
    /// By the light tree where there are many, else by power.
    Auto,
    /// By the light tree: by distance, direction and power.
    Tree,
    /// By power.
    Power,
}

impl Lights {
    /// For the reference's option.
    pub fn light_tree(self) -> Option<bool> {
        match self {
            Self::Auto => None,
            Self::Tree => Some(true),
            Self::Power => Some(false),
        }
    }
}

/// Which part of the lighting the reference computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Only {
    /// The whole picture.
    All,
    /// Light straight from lights, and emission.
    Direct,
    /// Visibility of the first three shadow-casting lights, one in each channel.
    Shadows,
    /// Ambient occlusion: share of the hemisphere that is not occluded within `--ao-range`.
    Ao,
    /// Indirect light that the first surface scatters specularly.
    Reflections,
    /// Indirect light that the first surface scatters diffusely.
    Gi,
    /// Light that is transmitted through the first surface.
    Transparency,
}

impl Only {
    /// Converts to the reference's type.
    pub fn which(self) -> reference::Only {
        match self {
            Self::All => reference::Only::All,
            Self::Direct => reference::Only::Direct,
            Self::Shadows => reference::Only::Shadows,
            Self::Ao => reference::Only::AmbientOcclusion,
            Self::Reflections => reference::Only::Reflections,
            Self::Gi => reference::Only::Gi,
            Self::Transparency => reference::Only::Transparency,
        }
    }
}
