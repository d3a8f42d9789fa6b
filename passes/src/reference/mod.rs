//! The truth: a progressive path tracer, unbiased and unclamped.
mod estimate;

pub use estimate::{Estimate, SizeMismatch};

use magpie_shaders::Rays;

/// Which light is wanted: all of it, or what the slot of that name gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Only {
    /// The whole picture.
    #[default]
    All,
    /// Light straight from lights and emissive surfaces, and emission.
    Direct,
    /// Share of the key light that is seen, 0 to 1.
    Shadows,
    /// Cosine-weighted share of the hemisphere that nothing near hides, 0 to 1.
    AmbientOcclusion,
    /// Indirect light that the first surface scatters specularly.
    Reflections,
    /// Indirect light that the first surface scatters diffusely.
    Gi,
    /// Light that comes through the first surface.
    Transparency,
}

impl Only {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::All,
        Self::Direct,
        Self::Shadows,
        Self::AmbientOcclusion,
        Self::Reflections,
        Self::Gi,
        Self::Transparency,
    ];

    /// Its name on the command line: that of the slot.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Direct => "direct",
            Self::Shadows => "shadows",
            Self::AmbientOcclusion => "ao",
            Self::Reflections => "reflections",
            Self::Gi => "gi",
            Self::Transparency => "transparency",
        }
    }
}

/// Where in a pixel its samples lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PixelSampling {
    /// Anywhere in its square, equally: what a camera sees.
    #[default]
    Area,
    /// At its centre, as the raster has it without anti-aliasing; textures of the first surface are filtered over the pixel.
    Centre,
}

/// How to trace.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceOptions {
    /// Pixels from left to right, at least 1.
    pub width: u32,
    /// Pixels from top to bottom, at least 1.
    pub height: u32,
    /// Runs with other seeds are independent and can be merged.
    pub seed: u32,
    /// Greatest number of scatterings, 1 for light straight from lights; 0 for no limit.
    pub depth: u32,
    /// Which light.
    pub only: Only,
    /// Where in a pixel.
    pub pixel: PixelSampling,
    /// How far away a thing still counts for ambient occlusion, metres, above 0.
    pub ao_range: f32,
    /// Which moment of the scene's animation, seconds.
    pub time: f64,
    /// How rays are traced; the device must be able to.
    pub rays: Rays,
    /// Ask the validation layers, and refuse samples that are not finite.
    pub check: bool,
}
