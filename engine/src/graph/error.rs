//! Mistakes in a declared frame.

use std::fmt;

use super::{
    access::Access,
    desc::{BufferDesc, Extent, Format, ImageDesc, Part},
};

/// One mistake in a declared frame. Declaring continues after it; [`FrameGraph::finish`](super::FrameGraph::finish) returns all of them.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GraphError {
    /// A pass uses contents that a later write has replaced.
    #[error(
        "pass `{pass}` wants version {version} of `{resource}` ({access}), but pass `{writer}` has written version {newest} ({written})"
    )]
    StaleRead {
        /// Name of the pass that reads.
        pass: String,
        /// Full name of the resource.
        resource: String,
        /// The access that was declared.
        access: Access,
        /// The version that the pass declared.
        version: u32,
        /// The newest version.
        newest: u32,
        /// The pass that wrote the newest version.
        writer: String,
        /// How it was written.
        written: Access,
    },
    /// A pass reads a resource that was imported without contents and that no pass has written.
    #[error(
        "pass `{pass}` reads `{resource}` ({access}), which was imported without contents and which no pass has written"
    )]
    Unwritten {
        /// Name of the pass that reads.
        pass: String,
        /// Full name of the resource.
        resource: String,
        /// The access that was declared.
        access: Access,
    },
    /// A pass uses overlapping parts of one resource in two incompatible ways.
    #[error("pass `{pass}` uses `{resource}` in two ways that do not go together: {first} and {second}")]
    Conflict {
        /// Name of the pass.
        pass: String,
        /// Full name of the resource.
        resource: String,
        /// The use declared first.
        first: Access,
        /// The use declared after it.
        second: Access,
    },
    /// A pass copies and also does something else; a pass is one copy, one dispatch, one trace or one draw list.
    #[error("pass `{pass}` copies `{copied}` ({copy}) and also uses `{resource}` ({access}): make them two passes")]
    MixedCopy {
        /// Name of the pass.
        pass: String,
        /// Full name of the copied resource.
        copied: String,
        /// Whether it is the source or the target of the copy.
        copy: Access,
        /// Full name of the other resource.
        resource: String,
        /// Its access.
        access: Access,
    },
    /// The format of an image does not allow the access.
    #[error("pass `{pass}` uses `{resource}` as {access}, which its format {format:?} cannot be")]
    Format {
        /// Name of the pass.
        pass: String,
        /// Full name of the image.
        resource: String,
        /// The access that was declared.
        access: Access,
        /// The format of the image.
        format: Format,
    },
    /// A part lies outside the image, or is empty.
    #[error(
        "pass `{pass}` uses {} of `{resource}`, which has {mips} mips and {layers} layers",
        part_in_words(*part)
    )]
    Part {
        /// Name of the pass.
        pass: String,
        /// Full name of the image.
        resource: String,
        /// The part that was declared.
        part: Part,
        /// Number of mips of the image.
        mips: u32,
        /// Number of layers of the image.
        layers: u32,
    },
    /// An image with no layers, or with more than [`ImageDesc::MAX_LAYERS`].
    #[error("image `{resource}` wants {layers} layers; it can have 1 to {limit}", limit = ImageDesc::MAX_LAYERS)]
    Layers {
        /// Name of the image.
        resource: String,
        /// Layers that were asked for.
        layers: u32,
    },
    /// One history, kept buffer or kept image is declared twice in a frame.
    #[error("the history `{name}` is declared twice in one frame")]
    DuplicateHistory {
        /// The name that the effect gave it.
        name: String,
    },
    /// The attachments of one pass differ in size.
    #[error("attachments of pass `{pass}` differ in size: `{first}` is {first_extent}, `{second}` is {second_extent}")]
    AttachmentExtent {
        /// Name of the pass.
        pass: String,
        /// Full name of the first attachment.
        first: String,
        /// Its size, pixels.
        first_extent: Extent,
        /// Full name of the attachment that differs.
        second: String,
        /// Its size, pixels.
        second_extent: Extent,
    },
    /// A pass has more than one depth attachment, written or tested against.
    #[error("pass `{pass}` has two depth attachments: `{first}` and `{second}`")]
    TwoDepths {
        /// Name of the pass.
        pass: String,
        /// Full name of the first one.
        first: String,
        /// Full name of the second one.
        second: String,
    },
    /// Two outputs of one pass have the same name.
    #[error("pass `{pass}` has two outputs called `{output}`")]
    DuplicateOutput {
        /// Name of the pass.
        pass: String,
        /// The name that both have.
        output: String,
    },
    /// Two passes have the same name.
    #[error("two passes are called `{pass}`")]
    DuplicatePass {
        /// The name that both have.
        pass: String,
    },
    /// A side of an image is 0 or above [`Extent::MAX_SIDE`].
    #[error("image `{resource}` would be {extent}; each side must be 1 to {limit}", limit = Extent::MAX_SIDE)]
    Extent {
        /// Name of the image.
        resource: String,
        /// The size that was asked for, pixels.
        extent: Extent,
    },
    /// An image with no mips, or with more than its size allows.
    #[error("image `{resource}` of {extent} wants {mips} mips; it can have 1 to {most}")]
    Mips {
        /// Name of the image.
        resource: String,
        /// Size of mip 0, pixels.
        extent: Extent,
        /// Mips that were asked for.
        mips: u32,
        /// Number of mips down to one pixel.
        most: u32,
    },
    /// A buffer of 0 bytes, or above [`BufferDesc::MAX_BYTES`].
    #[error("buffer `{resource}` would have {bytes} bytes; it must have 1 to {limit}", limit = BufferDesc::MAX_BYTES)]
    BufferSize {
        /// Name of the buffer.
        resource: String,
        /// The size that was asked for, bytes.
        bytes: u64,
    },
    /// The access with which a resource is imported or left does not apply to its kind.
    #[error("{kind} `{resource}` cannot be in state {access}")]
    State {
        /// Kind of the resource: `image`, `buffer`, `tlas` or `blas`.
        kind: &'static str,
        /// Name of the resource.
        resource: String,
        /// The access that was given as its state.
        access: Access,
    },
    /// A resource is to be left in a state at the end of the frame, but it is transient.
    #[error("`{resource}` is to be left in state {access}, but it is not imported and ends with the frame")]
    NotImported {
        /// Full name of the resource.
        resource: String,
        /// The state that was asked for.
        access: Access,
    },
    /// An implementation outputs an image whose format or size breaks the contract of its slot.
    #[error(
        "slot `{slot}`: \"{implementation}\" gives `{output}` as {:?} of {}, wanted {} of {}",
        .given.0, .given.1, formats_in_words(&.wanted.0), .wanted.1
    )]
    Contract {
        /// Name of the slot.
        slot: String,
        /// Name of the implementation.
        implementation: String,
        /// Name of the image in the contract.
        output: String,
        /// Allowed formats, and the required size.
        wanted: (Vec<Format>, Extent),
        /// Actual format and size.
        given: (Format, Extent),
    },
    /// What fills a slot said that it, or a part of it, has nothing to do, and yet added a pass.
    #[error("slot `{slot}`: \"{implementation}\" says that it is idle ({reason}), yet adds the pass `{pass}`")]
    NotIdle {
        /// The slot.
        slot: String,
        /// What fills it.
        implementation: String,
        /// Why it is idle.
        reason: String,
        /// The pass.
        pass: String,
    },
    /// No pass has that name.
    #[error("no pass is called `{pass}`; there are: {}", known.join(", "))]
    UnknownPass {
        /// The name that was asked for.
        pass: String,
        /// Names of the passes with image outputs.
        known: Vec<String>,
    },
    /// The pass has no image output of that name.
    #[error("pass `{pass}` has no image output called `{output}`; it has: {}", known.join(", "))]
    UnknownOutput {
        /// Name of the pass.
        pass: String,
        /// The name that was asked for.
        output: String,
        /// Names of its image outputs.
        known: Vec<String>,
    },
}

fn formats_in_words(formats: &[Format]) -> String {
    formats.iter().map(|f| format!("{f:?}")).collect::<Vec<_>>().join(" or ")
}

fn part_in_words(part: Part) -> String {
    let range = |first: u16, count: u16| match count {
        Part::REST => format!("{first} and all after"),
        1 => format!("{first}"),
        _ => format!("{first} to {}", u32::from(first) + u32::from(count.max(1)) - 1),
    };
    format!("mips {} of layers {}", range(part.mip, part.mips), range(part.layer, part.layers))
}

/// All mistakes of a declared frame, in the order in which they were found; never empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GraphErrors(pub Vec<GraphError>);

impl fmt::Display for GraphErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_slice() {
            [one] => write!(f, "the frame graph has a mistake: {one}"),
            all => {
                write!(f, "the frame graph has {} mistakes:", all.len())?;
                all.iter().try_for_each(|error| write!(f, "\n  {error}"))
            }
        }
    }
}

impl std::error::Error for GraphErrors {}
