//! Denoisers for effects that trace few rays: `svgf`, `pica-pica`, `recurrent-blur`, `bilateral` or `none`.
//!
//! A [`Denoiser`] takes a [`Signal`], the visible [`Surfaces`], and [`Hints`] about the noise. An effect may have several denoisers, each with
//! its own [`Options`]. Effects divide radiance by the albedo before denoising and multiply by it afterwards.
mod bilateral;
mod changes;
mod inputs;
mod options;
mod pica_pica;
mod recurrent_blur;
mod signal;
mod svgf;

use crate::contracts::{GBuffer, Reprojected};
use bilateral::Bilateral;
pub use changes::{Changes, squares, surfaces};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::{SAMPLES_SHARP, SAMPLES_WEIGHTED};
pub use options::{
    Method, Options, adaptive, adaptive_to_lamps, adaptive_to_paths, follows_light, is_adaptive, precision, settings,
    settings_with,
};
use pica_pica::PicaPica;
use recurrent_blur::RecurrentBlur;
pub use signal::{Content, Precision, Signal};
use svgf::Svgf;

/// The visible surfaces, which guide the filters.
#[derive(Clone, Copy, Debug)]
pub struct Surfaces {
    /// This frame's G-buffer.
    pub gbuffer: GBuffer,
    /// Reprojection of its surfaces into the previous frame.
    pub reprojected: Reprojected,
}

/// What an effect knows about the noise of its signal. The default is no hints.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct Hints {
    /// Share of the history to discard as the signal has changed since the previous frame, 0 to 1 per channel, of radiance in the first: what
    /// [`Changes`] gives.
    pub change: Option<Handle<Image>>,
    /// Width on the screen of the source of each channel's noise, such as a penumbra: pixels over
    /// [`WIDEST_NOISE`](magpie_shaders::denoise::WIDEST_NOISE), 0 to 1. Filters are no wider than this, and 0 means no noise.
    pub width: Option<Handle<Image>>,
    /// A bit for each channel whose contents move across static surfaces, as the shadows of a moving light do. Bit 0 is red.
    pub moved: u32,
    /// Distance from each surface to what it reflects, metres. The denoisers `pica-pica` and `recurrent-blur` also look for the history
    /// where the reflected thing was.
    pub hit_distance: Option<Handle<Image>>,
    /// Of radiance: alpha of the signal is the weight of the sample in a mean over frames, 0 to 1, for `pica-pica` and
    /// `recurrent-blur`. Else all weights are 1.
    pub weighted: bool,
    /// Of radiance with a width: the width is all of its noise, so that where it is below a pixel, as in a mirror, a sample is as good as a mean.
    /// Where histories are interpolated, and under jitter, `pica-pica` and `recurrent-blur` then average no more frames than the width asks for, in
    /// place of at least four.
    pub sharp: bool,
    /// Over how many frames the samples of a pixel are alike: 1 for independent ones, more where samples are reused from frame to frame. 0: points
    /// of a stratified sequence, as effects draw them that reuse nothing. `svgf` filters as much as that leaves noise in the mean.
    pub alike: f32,
}

impl Hints {
    /// Sets [`Hints::change`].
    pub fn change(self, change: Option<Handle<Image>>) -> Self {
        Self { change, ..self }
    }

    /// Sets [`Hints::width`].
    pub fn width(self, width: Option<Handle<Image>>) -> Self {
        Self { width, ..self }
    }

    /// Sets [`Hints::moved`].
    pub fn moved(self, moved: u32) -> Self {
        Self { moved, ..self }
    }

    /// Sets [`Hints::hit_distance`].
    pub fn hit_distance(self, hit_distance: Option<Handle<Image>>) -> Self {
        Self { hit_distance, ..self }
    }

    /// Sets [`Hints::alike`].
    pub fn alike(self, alike: f32) -> Self {
        Self { alike, ..self }
    }

    /// Sets [`Hints::weighted`].
    pub fn weighted(self, weighted: bool) -> Self {
        Self { weighted, ..self }
    }

    /// Sets [`Hints::sharp`].
    pub fn sharp(self, sharp: bool) -> Self {
        Self { sharp, ..self }
    }

    /// What samples are, for shaders.
    fn samples(self) -> u32 {
        let of = |is: bool, flag| if is { flag } else { 0 };
        of(self.weighted, SAMPLES_WEIGHTED) | of(self.sharp, SAMPLES_SHARP)
    }
}

/// Input of a denoiser.
#[derive(Clone, Copy, Debug)]
pub struct DenoiseIn {
    /// The noisy image.
    pub signal: Signal,
    /// The surfaces that it shows.
    pub surfaces: Surfaces,
    /// What is known about its noise.
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
    PicaPica(PicaPica),
    RecurrentBlur(RecurrentBlur),
    Svgf(Box<Svgf>),
}

impl Denoiser {
    /// Creates the pipelines. `effect` is the first part of the names of the passes, such as `ao` in `ao.accumulate`.
    ///
    /// # Errors
    /// [`SlotError`] if a pipeline could not be created.
    pub fn new(build: &Build<'_>, effect: &'static str, options: Options) -> Result<Self, SlotError> {
        Ok(Self(match options.method {
            Method::Svgf => Kind::Svgf(Box::new(Svgf::new(build, effect, options)?)),
            Method::PicaPica => Kind::PicaPica(PicaPica::new(build, effect, options)?),
            Method::RecurrentBlur => Kind::RecurrentBlur(RecurrentBlur::new(build, effect, options)?),
            Method::Bilateral => Kind::Bilateral(Bilateral::new(build, effect, options)?),
            Method::None => Kind::None,
        }))
    }

    /// Adds the passes and returns the filtered image. It has at least the channels of the signal, with the bits of [`Options::precision`].
    /// With [`Method::None`] it is the signal itself. `name` is appended to the names of the passes, and distinguishes the histories of several
    /// images.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        match &self.0 {
            Kind::None => i.signal.image,
            Kind::Bilateral(bilateral) => bilateral.add(g, view, i, name),
            Kind::PicaPica(pica_pica) => pica_pica.add(g, view, i, name),
            Kind::RecurrentBlur(recurrent_blur) => recurrent_blur.add(g, view, i, name),
            Kind::Svgf(svgf) => svgf.add(g, view, i, name),
        }
    }
}
