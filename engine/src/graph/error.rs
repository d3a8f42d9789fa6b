//! What can be wrong with a declared frame.

use std::fmt;

use super::{
    access::Access,
    desc::{BufferDesc, Extent, Format, ImageDesc, Part},
};

/// One mistake in a declared frame. Declaring goes on after it; [`FrameGraph::finish`](super::FrameGraph::finish) returns all.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GraphError {
    /// A pass uses contents that a later write has replaced.
    #[error(
        "pass `{pass}` wants version {version} of `{resource}` ({access}), but pass `{writer}` has written version {newest} ({written})"
    )]
    StaleRead {
        /// The pass that reads.
        pass: String,
        /// The resource.
        resource: String,
        /// How it is read.
        access: Access,
        /// The version that is wanted.
        version: u32,
        /// The newest version.
        newest: u32,
        /// The pass that wrote the newest version.
        writer: String,
        /// How it was written.
        written: Access,
    },
    /// A pass reads an imported image that has no contents yet.
    #[error(
        "pass `{pass}` reads `{resource}` ({access}), which was imported without contents and which no pass has written"
    )]
    Unwritten {
        /// The pass that reads.
        pass: String,
        /// The resource.
        resource: String,
        /// How it is read.
        access: Access,
    },
    /// A pass uses one resource in two ways that do not go together.
    #[error("pass `{pass}` uses `{resource}` in two ways that do not go together: {first} and {second}")]
    Conflict {
        /// The pass.
        pass: String,
        /// The resource.
        resource: String,
        /// The use declared first.
        first: Access,
        /// The use declared after it.
        second: Access,
    },
    /// A pass copies and does something else as well; a pass is one copy, one dispatch, one trace or one draw list.
    #[error("pass `{pass}` copies `{copied}` ({copy}) and also uses `{resource}` ({access}): make them two passes")]
    MixedCopy {
        /// The pass.
        pass: String,
        /// The resource that is copied.
        copied: String,
        /// How it is copied.
        copy: Access,
        /// The other resource.
        resource: String,
        /// How that is used.
        access: Access,
    },
    /// A format that does not suit the access.
    #[error("pass `{pass}` uses `{resource}` as {access}, which its format {format:?} cannot be")]
    Format {
        /// The pass.
        pass: String,
        /// The resource.
        resource: String,
        /// The access.
        access: Access,
        /// The format of the resource.
        format: Format,
    },
    /// A part that the image does not have.
    #[error(
        "pass `{pass}` uses {} of `{resource}`, which has {mips} mips and {layers} layers",
        part_in_words(*part)
    )]
    Part {
        /// The pass.
        pass: String,
        /// The image.
        resource: String,
        /// The part.
        part: Part,
        /// Mips of the image.
        mips: u32,
        /// Layers of the image.
        layers: u32,
    },
    /// Layers of an image: none, or more than any device makes.
    #[error("image `{resource}` wants {layers} layers; it can have 1 to {limit}", limit = ImageDesc::MAX_LAYERS)]
    Layers {
        /// The image.
        resource: String,
        /// Layers that were asked for.
        layers: u32,
    },
    /// One history or kept buffer declared twice in a frame.
    #[error("the history `{name}` is declared twice in one frame")]
    DuplicateHistory {
        /// Its name.
        name: String,
    },
    /// Attachments of one pass differ in size.
    #[error("attachments of pass `{pass}` differ in size: `{first}` is {first_extent}, `{second}` is {second_extent}")]
    AttachmentExtent {
        /// The pass.
        pass: String,
        /// The first attachment.
        first: String,
        /// Its size.
        first_extent: Extent,
        /// The attachment that differs.
        second: String,
        /// Its size.
        second_extent: Extent,
    },
    /// More than one depth attachment.
    #[error("pass `{pass}` has two depth attachments: `{first}` and `{second}`")]
    TwoDepths {
        /// The pass.
        pass: String,
        /// The first.
        first: String,
        /// The second.
        second: String,
    },
    /// Two outputs of one pass with one name.
    #[error("pass `{pass}` has two outputs called `{output}`")]
    DuplicateOutput {
        /// The pass.
        pass: String,
        /// The name.
        output: String,
    },
    /// Two passes with one name.
    #[error("two passes are called `{pass}`")]
    DuplicatePass {
        /// The name.
        pass: String,
    },
    /// An image without pixels or larger than any device makes.
    #[error("image `{resource}` would be {extent}; each side must be 1 to {limit}", limit = Extent::MAX_SIDE)]
    Extent {
        /// The image.
        resource: String,
        /// Its size.
        extent: Extent,
    },
    /// More mips than there are, or none.
    #[error("image `{resource}` of {extent} wants {mips} mips; it can have 1 to {most}")]
    Mips {
        /// The image.
        resource: String,
        /// Its size.
        extent: Extent,
        /// Mips that were asked for.
        mips: u32,
        /// Mips down to one pixel.
        most: u32,
    },
    /// A buffer of no bytes or of more than any device holds.
    #[error("buffer `{resource}` would have {bytes} bytes; it must have 1 to {limit}", limit = BufferDesc::MAX_BYTES)]
    BufferSize {
        /// The buffer.
        resource: String,
        /// Its size.
        bytes: u64,
    },
    /// An imported resource comes or is left in a state that its kind cannot have.
    #[error("{kind} `{resource}` cannot be in state {access}")]
    State {
        /// Kind of resource.
        kind: &'static str,
        /// The resource.
        resource: String,
        /// The state.
        access: Access,
    },
    /// A resource is to be left in a state, but it does not outlive the frame.
    #[error("`{resource}` is to be left in state {access}, but it is not imported and ends with the frame")]
    NotImported {
        /// The resource.
        resource: String,
        /// The state.
        access: Access,
    },
    /// What fills a slot gives an image of another format or size than the slot's contract says.
    #[error(
        "slot `{slot}`: \"{implementation}\" gives `{output}` as {:?} of {}, wanted {} of {}",
        .given.0, .given.1, formats_in_words(&.wanted.0), .wanted.1
    )]
    Contract {
        /// The slot.
        slot: String,
        /// What fills it.
        implementation: String,
        /// The image, as the contract calls it.
        output: String,
        /// Formats that it may have, and its size.
        wanted: (Vec<Format>, Extent),
        /// The format and size that it has.
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
    /// No pass of that name.
    #[error("no pass is called `{pass}`; there are: {}", known.join(", "))]
    UnknownPass {
        /// The name asked for.
        pass: String,
        /// Passes with image outputs.
        known: Vec<String>,
    },
    /// No image output of that name.
    #[error("pass `{pass}` has no image output called `{output}`; it has: {}", known.join(", "))]
    UnknownOutput {
        /// The pass.
        pass: String,
        /// The name asked for.
        output: String,
        /// Its image outputs.
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

/// All mistakes of a declared frame, in the order in which they were made; never empty.
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
