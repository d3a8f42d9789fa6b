//! What passes of several denoisers read, declared once.
use super::DenoiseIn;
use super::signal::Packed;
use crate::contracts::{Channel, GBufferToken};
use magpie::graph::{BufferToken, PassBuilder, SampleToken};
use magpie::prelude::*;
use magpie_shaders::denoise::{HistoryImages, NO_IMAGE, NoisyImage};
use magpie_shaders::{Address, SampledImage};

/// Index of an image that may be missing.
pub fn index_of(c: &Record<'_>, image: Option<SampleToken>) -> u32 {
    image.map_or(NO_IMAGE, |token| c.id(token).index())
}

/// What the first pass of a denoiser with histories reads of this frame.
#[derive(Clone, Copy)]
pub struct Samples {
    block: BufferToken,
    gbuffer: GBufferToken,
    taps: SampleToken,
    noisy: SampleToken,
    width: Option<SampleToken>,
    packing: u32,
    samples: u32,
    /// Width and height of the noisy image.
    pub extent: Extent,
}

impl Samples {
    /// Declares what `i` brings. `channels` are read beside the motion vectors.
    pub fn declare(p: &mut PassBuilder<'_>, view: &View, i: &DenoiseIn, packing: u32, channels: &[Channel]) -> Self {
        Self {
            block: p.read(view.block),
            gbuffer: i.surfaces.gbuffer.read(p, &[channels, &[Channel::Motion]].concat()),
            taps: p.sample(i.surfaces.reprojected.taps),
            noisy: p.sample(i.signal.image),
            width: i.hints.width.map(|width| p.sample(width)),
            packing,
            samples: i.hints.samples(),
            extent: p.extent(i.signal.image),
        }
    }

    /// The [`View`] as the shader sees it.
    pub fn view(&self, c: &Record<'_>) -> Address {
        c.id(self.block)
    }

    /// The samples.
    pub fn noisy(&self, c: &Record<'_>) -> NoisyImage {
        let (image, width) = (c.id(self.noisy), index_of(c, self.width));
        NoisyImage { image, width, samples: self.samples, packing: self.packing }
    }

    /// The motion vectors and the pixels of the previous frame.
    pub fn motion(&self, c: &Record<'_>) -> [SampledImage; 2] {
        [self.gbuffer.images(c).motion, c.id(self.taps)]
    }
}

/// The history that the previous frame left.
#[derive(Clone, Copy)]
pub struct Before {
    /// Mean over frames, and the deviation of the samples.
    pub signal: Packed,
    /// Number of samples.
    pub frames: Handle<Image>,
    /// Mean over the last few frames.
    pub fast: Option<Handle<Image>>,
}

/// What a pass reads to find the history of surfaces and of what they reflect.
#[derive(Clone, Copy)]
pub struct TwoHistories {
    guide: SampleToken,
    previous_guide: SampleToken,
    hit_distance: Option<SampleToken>,
    signal: super::signal::PackedSample,
    frames: SampleToken,
    fast: Option<SampleToken>,
}

impl TwoHistories {
    /// The channels of the G-buffer that [`Samples`] has to declare.
    pub const CHANNELS: &[Channel] = &[Channel::Depth, Channel::Normal];

    /// Declares the images.
    pub fn declare(p: &mut PassBuilder<'_>, i: &DenoiseIn, before: Before) -> Self {
        Self {
            guide: p.sample(i.surfaces.reprojected.guide),
            previous_guide: p.sample(i.surfaces.reprojected.previous_guide),
            hit_distance: i.hints.hit_distance.map(|distance| p.sample(distance)),
            signal: before.signal.sample(p),
            frames: p.sample(before.frames),
            fast: before.fast.map(|fast| p.sample(fast)),
        }
    }

    /// The images for the shader.
    pub fn images(&self, c: &Record<'_>, samples: &Samples) -> HistoryImages {
        let (values, deviations) = self.signal.ids(c);
        HistoryImages {
            guide: c.id(self.guide),
            previous_guide: c.id(self.previous_guide),
            normal: samples.gbuffer.images(c).normal,
            hit_distance: index_of(c, self.hit_distance),
            values,
            deviations,
            frames: c.id(self.frames),
            fast: index_of(c, self.fast),
        }
    }
}
