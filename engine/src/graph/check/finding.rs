//! What the scan found in one frame: non-finite values, where they are, and what the pass read there.

use std::fmt;

use super::super::desc::{Extent, Format, Part};

/// Non-finite values in one output of one pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Name of the pass that wrote them; `import` for contents that the frame imported.
    pub pass: String,
    /// Index of that pass in the declaration; `None` for imported contents.
    pub pass_index: Option<u32>,
    /// Name of the output within the pass, or the name under which the resource was imported.
    pub output: String,
    /// Index of the resource in the declaration.
    pub resource: u32,
    /// The version of the resource that holds them.
    pub version: u32,
    /// Pixels or elements with a NaN.
    pub nan: u64,
    /// Pixels or elements with an infinity and no NaN.
    pub infinite: u64,
    /// The first bad pixel or element: ordered by layer, then mip, then row by row.
    pub place: Place,
    /// The value at `place`.
    pub value: Value,
    /// The parts that hold bad values, each one mip of one layer; for a buffer, the whole buffer.
    pub parts: Vec<Part>,
    /// What the pass read, each at the place that corresponds to `place`.
    pub inputs: Vec<Input>,
}

/// A place in an image or a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// A pixel of one mip of one layer.
    Pixel {
        /// Column, counted from the left.
        x: u32,
        /// Row, counted from the top.
        y: u32,
        /// Mip level; `x` and `y` count pixels of this mip.
        mip: u32,
        /// Array layer.
        layer: u32,
    },
    /// The 32-bit word with this index.
    Element(u64),
}

impl Place {
    /// A pixel of mip 0 of layer 0.
    pub fn pixel(x: u32, y: u32) -> Self {
        Self::Pixel { x, y, mip: 0, layer: 0 }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::Pixel { x, y, mip, layer } = self else {
            let Self::Element(index) = self else { return Ok(()) };
            return write!(f, "element {index}");
        };
        write!(f, "({x}, {y})")?;
        if *mip > 0 {
            write!(f, " of mip {mip}")?;
        }
        if *layer > 0 {
            write!(f, " of layer {layer}")?;
        }
        Ok(())
    }
}

/// The value at a [`Place`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    /// The channels; those beyond `channels` are meaningless.
    pub values: Values,
    /// Number of channels that the format has, 1 to 4; 1 for a buffer.
    pub channels: u32,
}

/// Channels of a pixel or element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Values {
    /// Floats, including what shaders read as floats: normalised integers and depth.
    Float([f32; 4]),
    /// Unsigned integers.
    Uint([u32; 4]),
}

impl Value {
    pub(super) fn of(bits: [u32; 4], format: Option<Format>) -> Self {
        let values = match format {
            Some(format) if format.is_uint() => Values::Uint(bits),
            Some(_) | None => Values::Float(bits.map(f32::from_bits)),
        };
        Self { values, channels: format.map_or(1, Format::channels) }
    }

    /// Whether any channel is NaN or infinite.
    pub fn is_bad(&self) -> bool {
        match self.values {
            Values::Float(values) => values[..self.channels as usize].iter().any(|v| !v.is_finite()),
            Values::Uint(_) => false,
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.channels as usize;
        let texts: Vec<String> = match self.values {
            Values::Float(values) => values[..count].iter().map(|v| format!("{v:?}")).collect(),
            Values::Uint(values) => values[..count].iter().map(u32::to_string).collect(),
        };
        match texts.as_slice() {
            [one] => f.write_str(one),
            all => write!(f, "({})", all.join(", ")),
        }
    }
}

/// One resource that a pass read.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// Full name: `pass:output`, or the name under which it was imported.
    pub name: String,
    /// The value at the corresponding place, or why it is not known.
    pub seen: InputValue,
}

/// What the scan could read of an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InputValue {
    /// The value, and the place where it was read. Places correspond by relative position: the same fraction of the width and
    /// height, or of the buffer's length.
    At(Place, Value),
    /// The input was not read back.
    Unknown(NotScannable),
}

/// Why the value of an input is not reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotScannable {
    /// The pass overwrote it. If it was bad before, the finding of an earlier pass reports that.
    Overwritten,
    /// A buffer that was not declared to hold floats is not scanned.
    Raw,
    /// A buffer of floats above the size limit of the scan.
    TooLarge,
    /// Acceleration structures are not scanned.
    Acceleration,
    /// An imported image without sampled usage.
    NotSampled,
}

impl NotScannable {
    /// The reason, for the report.
    pub fn name(self) -> &'static str {
        match self {
            Self::Overwritten => "overwritten by the pass",
            Self::Raw => "not scanned: a buffer not declared to be of floats",
            Self::TooLarge => "not scanned: a buffer of 8 GiB or more",
            Self::Acceleration => "not scanned: an acceleration structure",
            Self::NotSampled => "not scanned: an image from outside that cannot be sampled",
        }
    }
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.seen {
            InputValue::At(place, value) => write!(f, "{} at {place}: {value}", self.name),
            InputValue::Unknown(why) => write!(f, "{}: {}", self.name, why.name()),
        }
    }
}

impl Finding {
    /// `pass:output`.
    pub fn name(&self) -> String {
        format!("{}:{}", self.pass, self.output)
    }

    /// How many pixels or elements are bad, and where the first one is.
    pub(super) fn counts(&self) -> String {
        let what = match self.place {
            Place::Pixel { .. } => "pixel",
            Place::Element(_) => "element",
        };
        let some = |count: u64| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        let kinds = match (self.nan, self.infinite) {
            (nan, 0) => format!("{} with NaN", some(nan)),
            (0, infinite) => format!("{} with infinity", some(infinite)),
            (nan, infinite) => format!("{} with NaN, {} with infinity", some(nan), some(infinite)),
        };
        format!("{kinds}, the first at {}: {}", self.place, self.value)
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.name(), self.counts())
    }
}

/// The index space of a [`Place`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum IndexSpace {
    /// One mip of an image, with its size.
    Image(Extent),
    /// A buffer, with its number of 32-bit words.
    Buffer(u64),
}

/// The place in `to` at the same relative position as `place` in `from`. Must agree with `shaders/check/probe.comp`.
pub(super) fn corresponding(place: Place, from: IndexSpace, to: IndexSpace, mip: u32, layers: (u32, u32)) -> Place {
    let scaled = |at: u64, from: u64, to: u64| at * to / from.max(1);
    let (index, total) = match (place, from) {
        (Place::Pixel { x, y, .. }, IndexSpace::Image(e)) => {
            (u64::from(y) * u64::from(e.width) + u64::from(x), u64::from(e.width) * u64::from(e.height))
        }
        (Place::Element(index), IndexSpace::Buffer(count)) => (index, count),
        (Place::Pixel { .. }, IndexSpace::Buffer(_)) | (Place::Element(_), IndexSpace::Image(_)) => (0, 1),
    };
    let size = match to {
        IndexSpace::Buffer(count) => return Place::Element(scaled(index, total, count)),
        IndexSpace::Image(size) => size,
    };
    let (width, height) = (u64::from(size.width), u64::from(size.height));
    let (x, y, layer) = match (place, from) {
        (Place::Pixel { x, y, layer, .. }, IndexSpace::Image(e)) => {
            let centre = |at: u32, from: u32, to: u64| scaled(2 * u64::from(at) + 1, 2 * u64::from(from), to);
            (centre(x, e.width, width), centre(y, e.height, height), layer)
        }
        (Place::Pixel { .. } | Place::Element(_), _) => {
            let pixel = scaled(index, total, width * height);
            (pixel % width, pixel / width, 0)
        }
    };
    Place::Pixel { x: x as u32, y: y as u32, mip, layer: layer.clamp(layers.0, layers.1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_correspond_by_their_share_of_the_way() {
        let (full, half) = (IndexSpace::Image(Extent::new(37, 11)), IndexSpace::Image(Extent::new(19, 6)));
        let at = |place, from, to| corresponding(place, from, to, 0, (0, 0));
        for (x, y) in [(0, 0), (36, 10), (17, 2)] {
            assert_eq!(at(Place::pixel(x, y), full, full), Place::pixel(x, y));
        }
        assert_eq!(at(Place::pixel(36, 10), full, half), Place::pixel(18, 5));
        assert_eq!(at(Place::pixel(18, 5), half, full), Place::pixel(36, 10));
        assert_eq!(at(Place::pixel(17, 2), full, IndexSpace::Buffer(37 * 11)), Place::Element(2 * 37 + 17));
        assert_eq!(at(Place::Element(91), IndexSpace::Buffer(37 * 11), full), Place::pixel(17, 2));
        assert_eq!(at(Place::Element(3), IndexSpace::Buffer(4), IndexSpace::Buffer(8)), Place::Element(6));
        let layered = corresponding(Place::Pixel { x: 1, y: 1, mip: 0, layer: 5 }, full, full, 2, (0, 3));
        assert_eq!(layered, Place::Pixel { x: 1, y: 1, mip: 2, layer: 3 });
    }

    #[test]
    fn values_show_the_channels_they_have() {
        let bits = [f32::NAN, 0.5, f32::NEG_INFINITY, 1e20].map(f32::to_bits);
        let shown = |format| Value::of(bits, format).to_string();
        assert_eq!(shown(Some(Format::Rgba16Float)), "(NaN, 0.5, -inf, 1e20)");
        assert_eq!(shown(Some(Format::D32Float)), "NaN");
        assert_eq!(shown(None), "NaN");
        assert_eq!(Value::of([3, 9, 0, 1], Some(Format::Rg32Uint)).to_string(), "(3, 9)");
        assert!(Value::of(bits, Some(Format::R32Float)).is_bad() && !Value::of(bits, Some(Format::Rg32Uint)).is_bad());
        let late = [0.0, 0.0, 0.0, f32::NAN].map(f32::to_bits);
        assert!(!Value::of(late, Some(Format::Rg16Float)).is_bad(), "a channel that is not there");
    }
}
