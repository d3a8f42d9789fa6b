//! Denoisers for effects that trace few rays: `svgf`, `bilateral` or none.
//!
//! A [`Denoiser`] takes a [`Signal`], the [`Surfaces`] that are seen, and [`Hints`] about its noise. An effect may have as many as it wants,
//! each with its own [`Options`]. Radiance is denoised without albedo, which the effect multiplies afterwards.
mod bilateral;
mod options;
mod signal;
mod svgf;

use crate::contracts::{GBuffer, Reprojected};
use bilateral::Bilateral;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
pub use options::{Method, Options, adaptive, is_adaptive, precision, settings};
pub use signal::{Content, Precision, Signal};
use svgf::Svgf;

/// The surfaces that are seen, which guide filters.
#[derive(Clone, Copy, Debug)]
pub struct Surfaces {
    /// This frame's G-buffer.
    pub gbuffer: GBuffer,
    /// Where they were one frame ago.
    pub reprojected: Reprojected,
}

/// What an effect knows of the noise of its signal. The default is to know nothing.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct Hints {
    /// How much the signal has changed since the previous frame, 0 to 1 per channel, in one pixel of nine: an image of a third of the size,
    /// rounded up. The history is discarded by as much.
    pub change: Option<Handle<Image>>,
    /// How wide the source of each channel's noise is on the screen, such as a penumbra: pixels over
    /// [`WIDEST_NOISE`](magpie_shaders::denoise::WIDEST_NOISE). Filters average over no more, and 0 means no noise.
    pub width: Option<Handle<Image>>,
    /// A bit for each channel whose subject moves across surfaces that stand still, as the shadows of a moving light do.
    pub moved: u32,
}

impl Hints {
    /// With [`Hints::change`].
    pub fn change(self, change: Option<Handle<Image>>) -> Self {
        Self { change, ..self }
    }

    /// With [`Hints::width`].
    pub fn width(self, width: Option<Handle<Image>>) -> Self {
        Self { width, ..self }
    }

    /// With [`Hints::moved`].
    pub fn moved(self, moved: u32) -> Self {
        Self { moved, ..self }
    }
}

/// Input of a denoiser.
#[derive(Clone, Copy, Debug)]
pub struct DenoiseIn {
    /// What is denoised.
    pub signal: Signal,
    /// On which surfaces.
    pub surfaces: Surfaces,
    /// What is known of its noise.
    pub hints: Hints,
}

impl DenoiseIn {
    /// The shading normals, for signals that depend on them.
    fn normals(&self) -> Option<Handle<Image>> {
        self.signal.content.depends_on_shading_normal().then_some(self.surfaces.gbuffer.normal)
    }
}

/// A denoiser with its histories.
pub struct Denoiser(Kind);

enum Kind {
    None,
    Bilateral(Bilateral),
    Svgf(Box<Svgf>),
}

impl Denoiser {
    /// Describes the pipelines. `effect` is the first part of the names of its passes, `ao` for `ao.accumulate`.
    ///
    /// # Errors
    /// [`SlotError`] for a faulty shader.
    pub fn new(build: &Build<'_>, effect: &'static str, options: Options) -> Result<Self, SlotError> {
        Ok(Self(match options.method {
            Method::Svgf => Kind::Svgf(Box::new(Svgf::new(build, effect, options)?)),
            Method::Bilateral => Kind::Bilateral(Bilateral::new(build, effect, options)?),
            Method::None => Kind::None,
        }))
    }

    /// Adds the passes, and returns the filtered image: as many channels as the signal has, in the format of
    /// [`Options::precision`]; the signal itself where nothing is filtered. `name` is the last part of the passes' names, and
    /// distinguishes the histories of several images.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        match &self.0 {
            Kind::None => i.signal.image,
            Kind::Bilateral(bilateral) => bilateral.add(g, view, i, name),
            Kind::Svgf(svgf) => svgf.add(g, view, i, name),
        }
    }
}
