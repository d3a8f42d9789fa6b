//! Signals that are denoised, and the formats of the images that hold them.
use magpie::graph::{HistoryScope, PassBuilder, SampleToken, StorageToken};
use magpie::prelude::*;
use magpie_shaders::denoise::{NO_IMAGE, SIGNAL_FOUR, SIGNAL_ONE, SIGNAL_RADIANCE, SIGNAL_TWO};
use magpie_shaders::{SampledImage, StorageImage};

/// A noisy image.
#[derive(Clone, Copy, Debug)]
pub struct Signal {
    /// The image, in any float or normalised format with enough channels.
    pub image: Handle<Image>,
    /// What the image holds.
    pub content: Content,
}

/// What a noisy image holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Visibility of 1 to 4 lights, or of one light in 3 colour channels, 0 to 1. Channels are filtered independently. Filters compare
    /// geometric normals only: the shading normal matters only where it turns away from a light, which makes visibility 0.
    Visibility {
        /// Number of channels.
        channels: u32,
    },
    /// Ambient occlusion, or anything else from 0 to 1 in one channel that depends on the shading normal.
    Occlusion,
    /// Radiance in three channels. Its variance is that of the luminance. It depends on the shading normal.
    Radiance,
}

/// Bits per channel of a denoiser's images. History lengths always have 8, and the unfiltered mean of luminance has 32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 16-bit unorm for values from 0 to 1; 16-bit floats, up to 65504, for radiance.
    Sixteen,
    /// 32-bit floats.
    ThirtyTwo,
}

/// Formats of the one or two images that hold a signal with its standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packing {
    /// One of the `SIGNAL_*` constants of the shaders.
    pub layout: u32,
    /// Format of the image with values, which also holds the deviations if `deviations` is `None`.
    pub values: Format,
    /// Format of a separate image for deviations.
    pub deviations: Option<Format>,
}

impl Content {
    /// Number of channels.
    pub fn channels(self) -> u32 {
        match self {
            Self::Visibility { channels } => channels,
            Self::Occlusion => 1,
            Self::Radiance => 3,
        }
    }

    pub(super) fn depends_on_shading_normal(self) -> bool {
        !matches!(self, Self::Visibility { .. })
    }

    /// Number of channels that have a variance; radiance has one, of its luminance.
    pub(super) fn variances(self) -> u32 {
        if self == Self::Radiance { 1 } else { self.channels() }
    }

    /// Format of history lengths, one for each variance.
    pub(super) fn frames(self) -> Format {
        match self.variances() {
            1 => Format::R8Unorm,
            2 => Format::Rg8Unorm,
            _ => Format::Rgba8Unorm,
        }
    }

    /// Format of history lengths that count samples by fractions, one for each variance.
    pub(super) fn counts(self) -> Format {
        match self.variances() {
            1 => Format::R16Float,
            2 => Format::Rg16Float,
            _ => Format::Rgba16Float,
        }
    }

    /// Format of what weights compare: each channel, or the luminance of radiance.
    pub(super) fn compared(self, precision: Precision) -> Format {
        match (self, precision) {
            (Self::Radiance, Precision::Sixteen) => Format::R16Float,
            (Self::Radiance, Precision::ThirtyTwo) => Format::R32Float,
            _ => self.result(precision),
        }
    }

    /// Formats of the signal with its standard deviations.
    pub(super) fn packing(self, precision: Precision) -> Packing {
        let fixed = precision == Precision::Sixteen;
        let (two, four) =
            if fixed { (Format::Rg16Unorm, Format::Rgba16Unorm) } else { (Format::Rg32Float, Format::Rgba32Float) };
        match (self, self.channels()) {
            (Self::Radiance, _) => {
                let values = if fixed { Format::Rgba16Float } else { Format::Rgba32Float };
                Packing { layout: SIGNAL_RADIANCE, values, deviations: None }
            }
            (_, 1) => Packing { layout: SIGNAL_ONE, values: two, deviations: None },
            (_, 2) => Packing { layout: SIGNAL_TWO, values: four, deviations: None },
            _ => Packing { layout: SIGNAL_FOUR, values: four, deviations: Some(four) },
        }
    }

    /// Formats of the unfiltered temporal mean and deviation of the samples; for radiance those of the luminance. Luminance always has 32 bits:
    /// a running mean in 16-bit floats would stall up to a hundredth away from the true mean.
    pub(super) fn moments(self, precision: Precision) -> Packing {
        match self {
            Self::Radiance => Packing { layout: SIGNAL_ONE, values: Format::Rg32Float, deviations: None },
            _ => self.packing(precision),
        }
    }

    /// Format of the filtered image.
    pub(super) fn result(self, precision: Precision) -> Format {
        match (self, self.channels(), precision) {
            (Self::Radiance, _, Precision::Sixteen) => Format::Rgba16Float,
            (Self::Radiance, _, Precision::ThirtyTwo) => Format::Rgba32Float,
            (_, 1, Precision::Sixteen) => Format::R16Unorm,
            (_, 2, Precision::Sixteen) => Format::Rg16Unorm,
            (_, _, Precision::Sixteen) => Format::Rgba16Unorm,
            (_, 1, Precision::ThirtyTwo) => Format::R32Float,
            (_, 2, Precision::ThirtyTwo) => Format::Rg32Float,
            (_, _, Precision::ThirtyTwo) => Format::Rgba32Float,
        }
    }
}

/// Handles of a signal with its standard deviations.
#[derive(Clone, Copy, Debug)]
pub struct Packed {
    /// Values, and the deviations if they have no separate image.
    pub values: Handle<Image>,
    /// The separate image of deviations.
    pub deviations: Option<Handle<Image>>,
}

/// Write handles of a signal with its standard deviations.
#[derive(Debug)]
pub struct PackedWrite {
    values: WriteHandle<Image>,
    deviations: Option<WriteHandle<Image>>,
}

/// Tokens of a pass that reads a signal with its standard deviations.
#[derive(Clone, Copy, Debug)]
pub struct PackedSample {
    values: SampleToken,
    deviations: Option<SampleToken>,
}

/// Tokens of a pass that writes a signal with its standard deviations.
#[derive(Clone, Copy, Debug)]
pub struct PackedStore {
    values: StorageToken,
    deviations: Option<StorageToken>,
}

impl Packing {
    /// A history of images in these formats with the size of `like`: what the previous frame wrote, and what this frame writes.
    pub fn history(
        self,
        g: &mut FrameGraph,
        scope: &HistoryScope,
        name: &str,
        like: Handle<Image>,
    ) -> (Packed, PackedWrite) {
        let values = g.history(scope, name.to_owned(), ImageDesc::like(self.values, like));
        let deviations =
            self.deviations.map(|format| g.history(scope, format!("{name}_deviation"), ImageDesc::like(format, like)));
        let (previous, next) = deviations.map_or((None, None), |h| (Some(h.previous), Some(h.next)));
        let previous = Packed { values: values.previous, deviations: previous };
        (previous, PackedWrite { values: values.next, deviations: next })
    }

    /// New images in these formats with the size of `like`.
    pub fn create(self, p: &mut PassBuilder<'_>, name: &str, like: Handle<Image>) -> (Packed, PackedStore) {
        let (values, store) = p.create(name, ImageDesc::like(self.values, like));
        let deviations =
            self.deviations.map(|format| p.create(&format!("{name}_deviation"), ImageDesc::like(format, like)));
        let (deviations, store_deviations) = deviations.unzip();
        let packed = Packed { values: values.read(), deviations: deviations.map(|d| d.read()) };
        (packed, PackedStore { values: store, deviations: store_deviations })
    }
}

impl PackedWrite {
    /// Declares that the pass writes the images.
    pub fn write(self, p: &mut PassBuilder<'_>) -> (Packed, PackedStore) {
        let (values, store) = p.write(self.values);
        let (deviations, store_deviations) = self.deviations.map(|d| p.write(d)).unzip();
        let packed = Packed { values: values.read(), deviations: deviations.map(|d| d.read()) };
        (packed, PackedStore { values: store, deviations: store_deviations })
    }
}

impl Packed {
    /// Declares that the pass reads the images.
    pub fn sample(self, p: &mut PassBuilder<'_>) -> PackedSample {
        PackedSample { values: p.sample(self.values), deviations: self.deviations.map(|d| p.sample(d)) }
    }
}

impl PackedSample {
    /// Indices of values and deviations for the shader.
    pub fn ids(self, c: &Record<'_>) -> (SampledImage, u32) {
        (c.id(self.values), self.deviations.map_or(NO_IMAGE, |d| c.id(d).index()))
    }
}

impl PackedStore {
    /// Indices of values and deviations for the shader.
    pub fn ids(self, c: &Record<'_>) -> (StorageImage, u32) {
        (c.id(self.values), self.deviations.map_or(NO_IMAGE, |d| c.id(d).index()))
    }
}
