//! How the values of an image become colours.
use super::Inspected;
use magpie::prelude::Format;
use magpie_shaders::inspect::{
    INSPECT_DISTINCT, INSPECT_FALSE, INSPECT_LENGTH, INSPECT_LUMINANCE, INSPECT_PLAIN, INSPECT_RED, INSPECT_RGB,
    INSPECT_SIGNED,
};

/// What is shown of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channel {
    /// Red, green and blue; of an image with one channel, grey.
    #[default]
    Rgb,
    /// The first channel.
    Red,
    /// The second channel.
    Green,
    /// The third channel.
    Blue,
    /// The fourth channel.
    Alpha,
    /// Luminance of red, green and blue, Rec.709; of an image with fewer than three channels, red.
    Luminance,
    /// Length of the vector of red, green and blue.
    Length,
}

impl Channel {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Rgb, Self::Red, Self::Green, Self::Blue, Self::Alpha, Self::Luminance, Self::Length];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Red => "r",
            Self::Green => "g",
            Self::Blue => "b",
            Self::Alpha => "a",
            Self::Luminance => "luminance",
            Self::Length => "length",
        }
    }

    /// Whether a format has what it shows.
    #[must_use]
    pub fn is_of(self, format: Format) -> bool {
        let least = match self {
            Self::Rgb | Self::Red => 1,
            Self::Green | Self::Length => 2,
            Self::Blue | Self::Luminance => 3,
            Self::Alpha => 4,
        };
        format.channels() >= least
    }

    pub(super) fn code(self) -> u32 {
        match self {
            Self::Rgb => INSPECT_RGB,
            Self::Red => INSPECT_RED,
            Self::Green => INSPECT_RED + 1,
            Self::Blue => INSPECT_RED + 2,
            Self::Alpha => INSPECT_RED + 3,
            Self::Luminance => INSPECT_LUMINANCE,
            Self::Length => INSPECT_LENGTH,
        }
    }
}

/// Which colours the numbers get.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colours {
    /// Grey, or the colours themselves.
    #[default]
    Plain,
    /// False colours: viridis, from dark blue over green to yellow. Of `rgb`, of its luminance.
    False,
    /// Blue below the middle of the range, light grey in it, red above. Of `rgb`, of its luminance.
    Signed,
    /// Another colour for each value, black for zero: for identifiers.
    Distinct,
}

impl Colours {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Plain, Self::False, Self::Signed, Self::Distinct];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::False => "false",
            Self::Signed => "signed",
            Self::Distinct => "distinct",
        }
    }

    pub(super) fn code(self) -> u32 {
        match self {
            Self::Plain => INSPECT_PLAIN,
            Self::False => INSPECT_FALSE,
            Self::Signed => INSPECT_SIGNED,
            Self::Distinct => INSPECT_DISTINCT,
        }
    }
}

/// How an image is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// What values are multiplied with before all else, as a power of two.
    pub exposure: f32,
    /// What is shown of them.
    pub channel: Channel,
    /// The values that get the first and the last colour. If the second is not above the first, it counts as the first plus 1.
    pub range: [f32; 2],
    /// Which colours.
    pub colours: Colours,
    /// Whether plain colours are encoded as sRGB, as linear ones must be for a display.
    pub encodes: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            exposure: 0.0,
            channel: Channel::default(),
            range: [0.0, 1.0],
            colours: Colours::default(),
            encodes: false,
        }
    }
}

impl Look {
    /// How most images of a format are best seen: floats in four channels as linear colours, signed numbers from -1 to 1, integers by
    /// distinct colours, one or two floats in false colours or as they are.
    #[must_use]
    pub fn of(format: Format) -> Self {
        let is_signed = matches!(format, Format::Rg16Snorm | Format::Rgba16Snorm);
        let is_number = format.is_float() && format.channels() == 1;
        Self {
            range: if is_signed { [-1.0, 1.0] } else { [0.0, 1.0] },
            colours: match () {
                () if format.is_uint() => Colours::Distinct,
                () if is_number => Colours::False,
                () => Colours::Plain,
            },
            encodes: format == Format::Rgba8Srgb || (format.is_float() && format.channels() == 4),
            ..Self::default()
        }
    }

    /// Whether the range of an image of this format is unknown before its values are, as of distances.
    #[must_use]
    pub fn wants_fit(format: Format) -> bool {
        format.is_float() && format.channels() < 4
    }

    /// The same with the range of what was found in an image, and no exposure. Signed colours keep 0 in the middle.
    #[must_use]
    pub fn fitted(self, found: &Inspected) -> Self {
        let channels = match self.channel {
            Channel::Rgb | Channel::Luminance | Channel::Length => 0..3,
            Channel::Red => 0..1,
            Channel::Green => 1..2,
            Channel::Blue => 2..3,
            Channel::Alpha => 3..4,
        };
        let shown = channels.filter_map(|channel| *found.ranges.get(channel)?);
        let Some([low, high]) = shown.clone().reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]) else { return self };
        let range = match (self.channel, self.colours) {
            (Channel::Length, _) => {
                let most = |[low, high]: [f64; 2]| low.abs().max(high.abs());
                [0.0, shown.map(|range| most(range).powi(2)).sum::<f64>().sqrt()]
            }
            (_, Colours::Signed) => {
                let most = low.abs().max(high.abs());
                [-most, most]
            }
            _ => [low, high],
        };
        Self { range: range.map(|end| end as f32), exposure: 0.0, ..self }
    }

    /// Factor and addend that bring values to 0..1 over the range.
    pub(super) fn gain_and_bias(&self) -> [f32; 2] {
        let [low, high] = self.range;
        let width = if high > low { high - low } else { 1.0 };
        [self.exposure.exp2() / width, -low / width]
    }
}
