//! Denoisers, which every effect that traces few rays is made of: visibility of up to four lights, a channel each, or radiance. What goes in
//! is light without albedo; an effect multiplies it afterwards.
mod bilateral;
mod reprojection;
mod svgf;

use crate::contracts::{GBuffer, Reprojected};
use bilateral::Bilateral;
use magpie::prelude::*;
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
pub use reprojection::Reprojection;
use svgf::Svgf;

/// What is in an image that is denoised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// So many numbers, 1 to 4, each on its own.
    Channels(u32),
    /// Radiance in three channels, of which the luminance decides.
    Radiance,
}

/// What goes into a denoiser.
#[derive(Clone, Copy, Debug)]
pub struct DenoiseIn {
    /// The image.
    pub noisy: Handle<Image>,
    /// What is in it.
    pub content: Content,
    /// The surfaces that are seen.
    pub gbuffer: GBuffer,
    /// Where they were one frame ago.
    pub reprojected: Reprojected,
    /// It depends on the shading normal, as openness and what is reflected do; visibility depends on the surface's plane alone.
    pub shading: bool,
    /// How much of it has changed since then, 0 to 1, found in one pixel of nine; a third as large. History is forgotten there.
    pub change: Option<Handle<Image>>,
    /// How wide, in pixels over [`PENUMBRA_MOST`](magpie_shaders::shadows::PENUMBRA_MOST), what each channel's noise comes from is: nothing
    /// is blurred further than that, and where it is 0 there is no noise.
    pub reach: Option<Handle<Image>>,
    /// Channels whose picture moves over surfaces that stand still, as the shadows of a light that moves do: a bit for each.
    pub moved: u32,
}

impl DenoiseIn {
    /// The shading normals, where they count.
    fn normals(&self) -> Option<Handle<Image>> {
        self.shading.then_some(self.gbuffer.normal)
    }
}

/// One of several.
pub enum Denoiser {
    /// Noise stays.
    None,
    /// One blur.
    Bilateral(Bilateral),
    /// Spatiotemporal variance-guided filtering.
    Svgf(Box<Svgf>),
}

/// Whether anything is filtered.
pub fn filters(settings: &Settings) -> Result<bool, SlotError> {
    Ok(settings.choice("denoiser")? != "none")
}

/// Whether the denoiser asks an effect that has [`adaptive`] what has changed.
pub fn is_adaptive(settings: &Settings) -> Result<bool, SlotError> {
    Ok(settings.choice("denoiser")? == "svgf" && settings.switch("adaptive")?)
}

/// The settings that an effect takes over.
pub fn settings() -> Vec<SettingSpec> {
    vec![
        SettingSpec::choice(
            "denoiser",
            "`svgf`: the mean over frames, filtered as far as its variance asks for. `bilateral`: one blur along surfaces, cheap, blurs \
             penumbrae and noise alike. `none`: noise stays.",
            "svgf",
            &["svgf", "bilateral", "none"],
        )
        .sweep_all(),
        SettingSpec::integer(
            "history",
            "frames",
            "Of `svgf`: over how many frames the mean goes. Higher: less noise; what changes without moving is seen later.",
            32,
            (1, 255),
        ),
        SettingSpec::integer(
            "levels",
            "",
            "Of `svgf`: how often the filter doubles its reach, from 1 pixel on. Higher: smoother wide penumbrae, more time.",
            4,
            (1, 6),
        ),
        SettingSpec::float(
            "sigma",
            "standard deviations",
            "Of `svgf`: how far two values may be apart to be averaged with a weight of 1/e. Higher: smoother, and shadows lose detail.",
            2.0,
            (0.1, 16.0),
        ),
        SettingSpec::integer("radius", "pixels", "Of `bilateral`: how far it blurs to each side.", 4, (1, 16)),
    ]
}

/// What an effect that looks for changes takes over as well.
pub fn adaptive() -> SettingSpec {
    SettingSpec::switch(
        "adaptive",
        "Of `svgf` at full resolution: rays in one pixel of nine find what has changed since the frame before, where history is \
         forgotten: moved shadows and switched lights are seen at once, for a ninth of a ray a pixel and some noise.",
        true,
    )
    .sweep_all()
}

impl Denoiser {
    /// The one that the settings name, for the effect of this name.
    pub fn new(build: &Build<'_>, effect: &'static str, settings: &Settings) -> Result<Self, SlotError> {
        Ok(match settings.choice("denoiser")? {
            "svgf" => Self::Svgf(Box::new(Svgf::new(build, effect, settings)?)),
            "bilateral" => Self::Bilateral(Bilateral::new(build, effect, settings)?),
            _ => Self::None,
        })
    }

    /// Denoises an image. `name` goes behind the names of the passes, and keeps the histories of several images apart.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        match self {
            Self::None => i.noisy,
            Self::Bilateral(bilateral) => bilateral.add(g, view, i, name),
            Self::Svgf(svgf) => svgf.add(g, view, i, name),
        }
    }
}

impl Content {
    /// Format of the image, filtered.
    fn colour(self) -> Format {
        match self {
            Self::Radiance => Format::Rgba32Float,
            Self::Channels(count) => floats(count),
        }
    }

    /// Of how many channels there is a variance.
    fn variances(self) -> u32 {
        match self {
            Self::Radiance => 1,
            Self::Channels(count) => count,
        }
    }

    /// Format of variances.
    fn variance(self) -> Format {
        floats(self.variances())
    }

    /// Format of numbers of frames.
    fn frames(self) -> Format {
        match self.variances() {
            1 => Format::R8Unorm,
            2 => Format::Rg8Unorm,
            _ => Format::Rgba8Unorm,
        }
    }

    fn is_radiance(self) -> bool {
        self == Self::Radiance
    }
}

fn floats(channels: u32) -> Format {
    match channels {
        1 => Format::R32Float,
        2 => Format::Rg32Float,
        _ => Format::Rgba32Float,
    }
}
