//! Why there is no number.
use magpie::graph::Format;

/// Why two pictures, or two sequences, cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricError {
    /// A picture without a pixel.
    #[error("{what} is {width}x{height}: wanted at least one pixel")]
    Empty {
        /// Which picture.
        what: &'static str,
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
    },
    /// A table that does not fit the size.
    #[error("{what} is {width}x{height}: wanted {} values, got {got}", width * height)]
    Length {
        /// Which picture or mask.
        what: &'static str,
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
        /// Length of the table.
        got: usize,
    },
    /// Two pictures of different sizes.
    #[error("{what} is {got_width}x{got_height}, wanted {width}x{height} as the reference has it")]
    Size {
        /// Which picture or mask differs.
        what: &'static str,
        /// Pixels of the reference.
        width: usize,
        /// Pixels of the reference.
        height: usize,
        /// Pixels of the other.
        got_width: usize,
        /// Pixels of the other.
        got_height: usize,
    },
    /// A NaN or an infinity.
    #[error("{what} has {value} in channel {channel} of pixel ({x}, {y})")]
    NotFinite {
        /// Which picture.
        what: &'static str,
        /// Column, from the left.
        x: usize,
        /// Row, from the top.
        y: usize,
        /// 0 red, 1 green, 2 blue.
        channel: usize,
        /// What stands there.
        value: f32,
    },
    /// An image of ids is no picture.
    #[error("an image of format {0:?} holds ids, not colours")]
    Ids(Format),
    /// A parameter out of its range.
    #[error("{name} is {got}: wanted {wanted}")]
    Parameter {
        /// Name.
        name: &'static str,
        /// Range in words.
        wanted: &'static str,
        /// Value.
        got: f64,
    },
    /// A sequence with too few pictures, or two of different lengths.
    #[error("{what} has {got} pictures: wanted {wanted}")]
    Frames {
        /// Which sequence.
        what: &'static str,
        /// Wanted in words.
        wanted: String,
        /// Number of pictures.
        got: usize,
    },
    /// A change that the metric is relative to is none.
    #[error("{metric}: {fault}")]
    Nothing {
        /// Name.
        metric: &'static str,
        /// What is missing, in words.
        fault: &'static str,
    },
    /// One picture of a sequence is at fault.
    #[error("frame {frame}: {fault}")]
    Frame {
        /// Index, from 0.
        frame: usize,
        /// What is wrong with it.
        fault: Box<MetricError>,
    },
}
