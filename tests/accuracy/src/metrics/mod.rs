//! How far one picture is from another.

/// A picture on the host, linear Rec.709.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Rows from the top; `width * height` of them.
    pub pixels: Vec<[f32; 3]>,
}
