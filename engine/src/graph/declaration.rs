//! A declared frame as plain data: what the plan is made from.

use super::{
    access::{Access, Domain, Layout, Queue, Uses},
    desc::{Extent, Format},
};

/// Everything that was declared, in the order of declaration. Passes and resources are named by their index.
#[derive(Clone, Debug, PartialEq)]
pub struct Declaration {
    /// What `Size::Full` means, pixels.
    pub full: Extent,
    /// Images, buffers and acceleration structures.
    pub resources: Vec<ResourceDecl>,
    /// Passes.
    pub passes: Vec<PassDecl>,
    /// What the frame is made for.
    pub outputs: Vec<OutputDecl>,
}

/// A resource.
#[derive(Clone, Debug, PartialEq)]
pub struct ResourceDecl {
    /// `pass:output` of the pass that makes it, or the name it was imported by.
    pub name: String,
    /// What it is like.
    pub shape: Shape,
    /// Where it comes from.
    pub origin: Origin,
    /// The pass that wrote each version; none for the contents that an imported resource came with.
    pub writers: Vec<Option<u32>>,
}

impl ResourceDecl {
    /// Bytes that its contents take, without padding; zero for an acceleration structure, which is never transient.
    pub fn bytes(&self) -> u64 {
        match self.shape {
            Shape::Image { format, extent, mips } => (0..mips)
                .map(|level| extent.mip(level))
                .map(|mip| u64::from(mip.width) * u64::from(mip.height) * u64::from(format.bytes_per_pixel()))
                .sum(),
            Shape::Buffer { bytes } => bytes,
            Shape::Tlas => 0,
        }
    }

    /// Whether it was imported without contents, so that version 0 is nothing.
    pub fn is_undefined(&self) -> bool {
        matches!(self.origin, Origin::Imported { last, .. } if last.is_empty())
    }

    /// Whether it is made and forgotten within the frame.
    pub fn is_transient(&self) -> bool {
        self.origin == Origin::Transient
    }
}

/// What a resource is like, sizes resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// An image.
    Image {
        /// Format of its pixels.
        format: Format,
        /// Size of mip 0.
        extent: Extent,
        /// Number of mips.
        mips: u32,
    },
    /// A buffer.
    Buffer {
        /// Its size.
        bytes: u64,
    },
    /// An acceleration structure.
    Tlas,
}

/// Where a resource comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Made by a pass, gone after the frame.
    Transient,
    /// It exists before and after the frame.
    Imported {
        /// The caller's name for the object behind it.
        key: ImportKey,
        /// Last uses before the frame; empty where nothing is known and contents do not matter.
        last: Uses,
        /// Layout before the frame.
        layout: Layout,
        /// What the frame makes it ready for at its end.
        leave: Option<(Access, Domain)>,
    },
}

/// The caller's name for the object behind an imported resource. The graph only hands it back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImportKey(pub u32);

/// State in which an imported image comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageState {
    /// Last use before the frame; none where contents are not defined.
    pub access: Option<(Access, Domain)>,
}

impl ImageState {
    /// New, or its contents do not matter any more.
    pub const UNDEFINED: Self = Self { access: None };

    /// Last used so.
    pub fn last(access: Access, domain: Domain) -> Self {
        Self { access: Some((access, domain)) }
    }
}

/// A pass.
#[derive(Clone, Debug, PartialEq)]
pub struct PassDecl {
    /// Its name, such as `shadows.trace`.
    pub name: String,
    /// The stage it belongs to: its name up to the first dot.
    pub stage: String,
    /// The queue it would like.
    pub queue: Queue,
    /// Where it runs, from its accesses.
    pub domain: Domain,
    /// It observes: it does not keep what it reads alive.
    pub weak: bool,
    /// What it does with which resource. Colour attachments are in the order of the fragment shader's outputs.
    pub uses: Vec<Use>,
    /// What it leaves for others, by name.
    pub outputs: Vec<NamedOutput>,
}

/// One use of one resource by one pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Use {
    /// Index of the resource.
    pub resource: u32,
    /// How it is used.
    pub access: Access,
    /// The version it builds on: read, or kept where it is not written.
    pub reads: Option<u32>,
    /// The version it makes.
    pub writes: Option<u32>,
    /// What the attachment is cleared to.
    pub clear: Option<Clear>,
}

/// What an attachment is cleared to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clear {
    /// Channels of a colour attachment; of an unsigned one, whole numbers.
    Color([f32; 4]),
    /// Depth; 0 is infinitely far.
    Depth(f32),
}

/// An output of a pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedOutput {
    /// Its name within the pass: that which it was made or imported by. If the pass changes something made elsewhere whose name
    /// is also that of another of its outputs, it is the resource's full name.
    pub name: String,
    /// Index of the resource.
    pub resource: u32,
    /// The version that the pass wrote.
    pub version: u32,
}

/// Contents that the frame is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputDecl {
    /// Index of the resource.
    pub resource: u32,
    /// The version that is wanted.
    pub version: u32,
}
