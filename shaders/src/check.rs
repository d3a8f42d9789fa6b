//! Parameters of `shaders/check`: the scan for NaN and infinity, and the probe that reads other resources where one was found.
use super::types::{Address, SampledImage};
use bytemuck::{Pod, Zeroable};

/// Push constants of `scan.comp`: one mip of one layer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScanParams {
    /// The image to scan, a float format.
    pub image: SampledImage,
    /// Index of the mip.
    pub mip: u32,
    /// Width and height of that mip, pixels.
    pub size: [u32; 2],
    /// The [`Counted`] to add to.
    pub counted: Address,
}

/// Push constants of `scan_words.comp`: a buffer of floats.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScanWordsParams {
    /// The buffer.
    pub words: Address,
    /// The [`Counted`] to add to.
    pub counted: Address,
    /// Number of words.
    pub count: u32,
}

/// Result of a scan. Zeroed before it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Counted {
    /// Pixels or words with a NaN.
    pub nan: u32,
    /// Pixels or words with an infinity and no NaN.
    pub infinite: u32,
    /// Bitwise complement of the least index among them; the index of a pixel is `y * width + x`.
    pub last: u32,
}

/// Contents of one pixel or word.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Seen {
    /// Bits of up to four channels, each as a 32-bit float or unsigned integer.
    pub bits: [u32; 4],
}

/// [`ProbeParams::kind`]: an image of floats or of normalised integers.
pub const FLOAT_IMAGE: u32 = 0;
/// [`ProbeParams::kind`]: an image of unsigned integers.
pub const UINT_IMAGE: u32 = 1;
/// [`ProbeParams::kind`]: a buffer.
pub const WORDS: u32 = 2;

/// Push constants of `probe.comp`, which reads one image or buffer, the source, at the place that corresponds to the first finding in
/// another one, the subject.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ProbeParams {
    /// [`Counted`] table of the subject: of an image by layer, then mip; of a buffer a single one.
    pub counted: Address,
    /// The [`Seen`] to write.
    pub seen: Address,
    /// The source, if it is a buffer.
    pub words: Address,
    /// The source, if it is an image: one layer.
    pub image: SampledImage,
    /// Kind of the source: [`FLOAT_IMAGE`], [`UINT_IMAGE`] or [`WORDS`].
    pub kind: u32,
    /// Entries of `counted`.
    pub pieces: u32,
    /// Size of mip 0 of the subject; zero if it is a buffer.
    pub size: [u32; 2],
    /// First mip of the subject that was scanned.
    pub mip: u32,
    /// Mips of each layer that were scanned.
    pub mips: u32,
    /// First layer of the subject that was scanned.
    pub layer: u32,
    /// Words of the subject, if it is a buffer.
    pub count: u32,
    /// 1 if the source is the subject itself, which is then read at the mip of the finding.
    pub own: u32,
    /// Size of the first mip of the source, if it is an image.
    pub source_size: [u32; 2],
    /// Words of the source, if it is a buffer.
    pub source_count: u32,
    /// The layer of the source that `image` is a view of.
    pub source_layer: u32,
    /// First and last layer of the source.
    pub source_layers: [u32; 2],
}
