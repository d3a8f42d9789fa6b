//! Errors of metrics.
use magpie::graph::Format;

/// Why two pictures, or two sequences, cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricError {
    /// A picture without pixels.
    #[error("{what} is {width}x{height}: wanted at least one pixel")]
    Empty {
        /// Name of the picture.
        what: &'static str,
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
    },
    /// The number of pixels is not width times height.
    #[error("{what} is {width}x{height}: wanted {} values, got {got}", width * height)]
    Length {
        /// Name of the picture or mask.
        what: &'static str,
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
        /// Pixels that were given.
        got: usize,
    },
    /// Two pictures differ in size.
    #[error("{what} is {got_width}x{got_height}, wanted {width}x{height} as the reference has it")]
    Size {
        /// Name of the picture or mask that differs.
        what: &'static str,
        /// Width of the reference, pixels.
        width: usize,
        /// Height of the reference, pixels.
        height: usize,
        /// Width of the other, pixels.
        got_width: usize,
        /// Height of the other, pixels.
        got_height: usize,
    },
    /// A NaN or an infinity.
    #[error("{what} has {value} in channel {channel} of pixel ({x}, {y})")]
    NotFinite {
        /// Name of the picture.
        what: &'static str,
        /// Column, from the left.
        x: usize,
        /// Row, from the top.
        y: usize,
        /// 0 red, 1 green, 2 blue.
        channel: usize,
        /// The value.
        value: f32,
    },
    /// An image of integer ids cannot be compared.
    #[error("an image of format {0:?} holds ids, not colours")]
    Ids(Format),
    /// A parameter is out of range.
    #[error("{name} is {got}: wanted {wanted}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Valid range.
        wanted: &'static str,
        /// The given value.
        got: f64,
    },
    /// A sequence has too few pictures, or two sequences differ in length.
    #[error("{what} has {got} pictures: wanted {wanted}")]
    Frames {
        /// Name of the sequence.
        what: &'static str,
        /// Required number of pictures.
        wanted: String,
        /// Given number of pictures.
        got: usize,
    },
    /// A metric is relative to a change that is zero.
    #[error("{metric}: {fault}")]
    Nothing {
        /// Name of the metric.
        metric: &'static str,
        /// What does not change.
        fault: &'static str,
    },
    /// A picture of a sequence is invalid.
    #[error("frame {frame}: {fault}")]
    Frame {
        /// Index, from 0.
        frame: usize,
        /// Its error.
        fault: Box<MetricError>,
    },
}
