//! A declared frame as plain data: the input of the plan.
//!
//! Everything is in a few flat lists, so that comparing two frames is cheap and the lists can be reused without allocating.

use super::{
    access::{Access, Domain, Layout, Queue, Uses},
    desc::{Extent, Format, Part},
};

/// Everything that was declared, in the order of declaration. Passes and resources are referred to by index.
#[derive(Clone, Debug, PartialEq)]
pub struct Declaration {
    /// Size of an image with [`Size::Full`](super::Size::Full), pixels.
    pub full: Extent,
    /// Images, buffers and acceleration structures.
    pub resources: Vec<ResourceDecl>,
    /// Passes, in the order of declaration.
    pub passes: Vec<PassDecl>,
    /// The uses of all passes, pass by pass; [`PassDecl::uses`] is the range of one pass.
    pub uses: Vec<Use>,
    /// Clear values of attachments, by the index of the use, ascending.
    pub clears: Vec<(u32, Clear)>,
    /// Indices of the buffers that hold only 32-bit floats, ascending.
    pub floats: Vec<u32>,
    /// The contents that the frame is rendered for; everything that they do not depend on may be culled.
    pub outputs: Vec<OutputDecl>,
    /// Pairs of images or buffers that carry contents from frame to frame.
    pub histories: Vec<HistoryDecl>,
    names: String,
}

/// A name, as a range of the one string that holds all names of the declaration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Name {
    start: u32,
    length: u32,
}

/// A half-open range of indices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Span {
    /// First index.
    pub start: u32,
    /// One past the last index.
    pub end: u32,
}

impl Span {
    /// The range as a standard range.
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..self.end as usize
    }

    /// Number of indices.
    pub fn len(self) -> usize {
        (self.end - self.start) as usize
    }

    /// Whether the range is empty.
    pub fn is_empty(self) -> bool {
        self.end == self.start
    }
}

impl Declaration {
    /// An empty declaration for a frame of `full` pixels.
    pub fn new(full: Extent) -> Self {
        Self {
            full,
            resources: Vec::new(),
            passes: Vec::new(),
            uses: Vec::new(),
            clears: Vec::new(),
            floats: Vec::new(),
            outputs: Vec::new(),
            histories: Vec::new(),
            names: String::new(),
        }
    }

    /// Empties the declaration and keeps the capacity of its lists.
    pub(super) fn clear(&mut self, full: Extent) {
        self.full = full;
        self.resources.clear();
        self.passes.clear();
        self.uses.clear();
        self.clears.clear();
        self.floats.clear();
        self.outputs.clear();
        self.histories.clear();
        self.names.clear();
    }

    pub(super) fn add_name(&mut self, name: &str) -> Name {
        let start = self.names.len() as u32;
        self.names.push_str(name);
        Name { start, length: name.len() as u32 }
    }

    /// The text of a name.
    pub fn text(&self, name: Name) -> &str {
        &self.names[name.start as usize..][..name.length as usize]
    }

    /// Name of a pass, such as `shadows.trace`.
    pub fn pass_name(&self, pass: u32) -> &str {
        self.text(self.passes[pass as usize].name)
    }

    /// First part of a pass's name, up to the dot: `shadows` of `shadows.trace`. Passes of one slot share it.
    pub fn stage(&self, pass: u32) -> &str {
        let name = self.pass_name(pass);
        name.split_once('.').map_or(name, |(stage, _)| stage)
    }

    /// The uses of a pass. Colour attachments are in the order of the fragment shader's outputs.
    pub fn uses_of(&self, pass: u32) -> &[Use] {
        &self.uses[self.passes[pass as usize].uses.range()]
    }

    /// Bytes of the images and of the frame's own buffers that a pass reads and writes, if it touches each of their pixels once. What the
    /// caller imports, such as the scene, is not counted: of that, a pass reads some here and there. Nor is what is kept of a history's
    /// new half before anything was written to it, since that is undefined.
    pub fn traffic(&self, pass: u32) -> u64 {
        let of = |u: &Use| {
            let resource = &self.resources[u.resource as usize];
            let key = match resource.origin {
                Origin::Imported { key, .. } => Some(key),
                Origin::Transient => None,
            };
            let is_undefined = matches!(key, Some(ImportKey::Next(_))) && u.reads == Some(0);
            let touched = match key {
                Some(ImportKey::Caller(_)) => 0,
                _ => u64::from(u.access.reads() && !is_undefined) + u64::from(u.access.writes()),
            };
            touched * resource.shape.bytes_of(u.part)
        };
        self.uses_of(pass).iter().map(of).sum()
    }

    /// The clear value of an attachment, by the index of its use; `None` if it is not cleared.
    pub fn clear_of(&self, use_index: u32) -> Option<Clear> {
        let at = self.clears.binary_search_by_key(&use_index, |(at, _)| *at).ok()?;
        Some(self.clears[at].1)
    }

    /// Whether a resource is a buffer that holds only 32-bit floats.
    pub fn is_floats(&self, resource: u32) -> bool {
        self.floats.binary_search(&resource).is_ok()
    }

    /// Full name of a resource: `pass:output` with the pass that makes it, or the name under which it was imported.
    pub fn resource_name(&self, resource: u32) -> String {
        let decl = &self.resources[resource as usize];
        let local = self.text(decl.name);
        decl.maker.map_or_else(|| local.to_owned(), |maker| format!("{}:{local}", self.pass_name(maker)))
    }

    /// The resources that a pass writes, by name. The name is the one under which the resource was made or imported. If two
    /// outputs of the pass share it, the one made elsewhere gets its full name instead.
    pub fn outputs_of(&self, pass: u32) -> Vec<NamedOutput> {
        let uses = self.uses_of(pass);
        // A pass that writes several parts of one image has one output: the last version.
        let is_last = |at: usize| !uses[at + 1..].iter().any(|u| u.resource == uses[at].resource && u.writes.is_some());
        let written = || {
            let writes = uses.iter().enumerate().filter_map(|(at, u)| Some((at, u.resource, u.writes?)));
            writes.filter(|(at, ..)| is_last(*at)).map(|(_, resource, version)| (resource, version))
        };
        let local = |resource: u32| self.text(self.resources[resource as usize].name);
        let named = |(resource, version): (u32, u32)| {
            let alone = written().filter(|(other, _)| local(*other) == local(resource)).count() == 1;
            let made_here = self.resources[resource as usize].maker == Some(pass);
            let name = if alone || made_here { local(resource).to_owned() } else { self.resource_name(resource) };
            NamedOutput { name, resource, version }
        };
        written().map(named).collect()
    }

    /// The images that a pass writes, by the names that `--view` knows: the new half of a history has that of the history.
    pub fn images_of(&self, pass: u32) -> Vec<NamedOutput> {
        let mut images = self.outputs_of(pass);
        images.retain(|output| self.resources[output.resource as usize].shape.is_image());
        for output in &mut images {
            if let Some(history) = output.name.strip_suffix(".next") {
                output.name = history.to_owned();
            }
        }
        images
    }

    /// The pass that wrote each version of each resource.
    pub fn writers(&self) -> Writers {
        Writers::of(self)
    }
}

/// The pass that wrote each version of each resource.
pub struct Writers {
    /// For each resource, the index in `writers` of its version 0.
    first: Vec<u32>,
    writers: Vec<Option<u32>>,
}

impl Writers {
    fn of(declaration: &Declaration) -> Self {
        let mut next = 0;
        let mut first = Vec::with_capacity(declaration.resources.len());
        for resource in &declaration.resources {
            first.push(next);
            next += resource.versions;
        }
        let mut writers = vec![None; next as usize];
        for (pass, decl) in declaration.passes.iter().enumerate() {
            for u in &declaration.uses[decl.uses.range()] {
                if let Some(version) = u.writes {
                    writers[(first[u.resource as usize] + version) as usize] = Some(pass as u32);
                }
            }
        }
        Self { first, writers }
    }

    /// The pass that wrote a version; `None` for the contents with which a resource was imported.
    pub fn get(&self, resource: u32, version: u32) -> Option<u32> {
        self.writers[(self.first[resource as usize] + version) as usize]
    }
}

/// A declared resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ResourceDecl {
    /// Local name, without the pass; see [`Declaration::resource_name`].
    pub name: Name,
    /// Index of the pass that makes it; `None` if it is imported.
    pub maker: Option<u32>,
    /// Kind, format and size.
    pub shape: Shape,
    /// Whether it is transient or imported.
    pub origin: Origin,
    /// Number of versions; version 0 is what the maker wrote or what was imported.
    pub versions: u32,
}

impl ResourceDecl {
    /// Size of the contents in bytes, without padding.
    pub fn bytes(&self) -> u64 {
        self.shape.bytes()
    }

    /// Whether it was imported without contents, so that version 0 is undefined.
    pub fn is_undefined(&self) -> bool {
        matches!(self.origin, Origin::Imported { last, .. } if last.is_empty())
    }

    /// Whether it exists only within this frame.
    pub fn is_transient(&self) -> bool {
        self.origin == Origin::Transient
    }
}

/// Kind, format and size of a resource, with relative sizes resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    /// An image.
    Image {
        /// Format of its pixels.
        format: Format,
        /// Size of mip 0.
        extent: Extent,
        /// Number of mips, at least 1.
        mips: u32,
        /// Number of layers, at least 1.
        layers: u32,
    },
    /// A buffer.
    Buffer {
        /// Size in bytes.
        bytes: u64,
    },
    /// An acceleration structure.
    Accel {
        /// Size in bytes; zero if it was imported, since its owner knows the size.
        bytes: u64,
        /// Whether it is a top level.
        top: bool,
    },
}

impl Shape {
    /// Size of the contents in bytes, without padding.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Image { format, extent, mips, layers } => {
                let pixels = |mip: Extent| u64::from(mip.width) * u64::from(mip.height);
                let one: u64 = (0..mips).map(|level| pixels(extent.mip(level))).sum();
                one * u64::from(format.bytes_per_pixel()) * u64::from(layers)
            }
            Self::Buffer { bytes } | Self::Accel { bytes, .. } => bytes,
        }
    }

    /// The same of some mips and layers.
    pub fn bytes_of(self, part: Part) -> u64 {
        match self {
            Self::Image { format, extent, .. } => {
                let pixels = |mip: Extent| u64::from(mip.width) * u64::from(mip.height);
                let mips = u32::from(part.mip)..u32::from(part.mip + part.mips);
                let one: u64 = mips.map(|level| pixels(extent.mip(level))).sum();
                one * u64::from(format.bytes_per_pixel()) * u64::from(part.layers)
            }
            Self::Buffer { .. } | Self::Accel { .. } => self.bytes(),
        }
    }

    /// Number of mips and layers; (1, 1) for a buffer or an acceleration structure.
    pub fn parts(self) -> (u32, u32) {
        match self {
            Self::Image { mips, layers, .. } => (mips, layers),
            Self::Buffer { .. } | Self::Accel { .. } => (1, 1),
        }
    }

    /// Whether it is an image; only images have layouts.
    pub fn is_image(self) -> bool {
        matches!(self, Self::Image { .. })
    }

    /// Layout during an access; [`Layout::Undefined`] for anything but an image.
    pub fn layout(self, access: Access) -> Layout {
        if self.is_image() { access.layout() } else { Layout::Undefined }
    }
}

/// Where a resource comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// Made by a pass; its memory is reused after its last use.
    Transient,
    /// Exists before and after the frame.
    Imported {
        /// Which object it is.
        key: ImportKey,
        /// Uses before the frame that it must be synchronised with; empty where the contents do not matter.
        last: Uses,
        /// Layout when the frame begins.
        layout: Layout,
        /// The use for which the frame makes it ready at its end, if any.
        leave: Option<(Access, Domain)>,
    },
}

/// Identifies the object behind an imported resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImportKey {
    /// An object of the caller, by its index in [`Imports`](super::execute::Imports).
    Caller(u32),
    /// The half of a history that the previous frame wrote.
    Previous(u32),
    /// The half of a history that this frame writes.
    Next(u32),
    /// A kept buffer or kept image.
    Kept(u32),
}

/// State of an imported image when the frame begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageState {
    /// Last use before the frame; `None` if the contents are undefined.
    pub access: Option<(Access, Domain)>,
}

impl ImageState {
    /// Undefined contents: the image is new, or its contents are no longer needed.
    pub const UNDEFINED: Self = Self { access: None };

    /// Defined contents, last used in this way.
    pub fn last(access: Access, domain: Domain) -> Self {
        Self { access: Some((access, domain)) }
    }
}

/// A declared pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PassDecl {
    /// Full name, such as `shadows.trace`; see [`Declaration::pass_name`].
    pub name: Name,
    /// The queue that it requests; the plan may choose another.
    pub queue: Queue,
    /// Kind of work, derived from its accesses.
    pub domain: Domain,
    /// Whether it only observes: it keeps nothing alive that it reads.
    pub weak: bool,
    /// Its range of [`Declaration::uses`].
    pub uses: Span,
}

/// One use of one resource by one pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Use {
    /// Index of the resource.
    pub resource: u32,
    /// The kind of access.
    pub access: Access,
    /// The mips and layers that are used, counts resolved.
    pub part: Part,
    /// The version that is read, or of which the unwritten rest is kept.
    pub reads: Option<u32>,
    /// The version that this use creates.
    pub writes: Option<u32>,
}

/// Clear value of an attachment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clear {
    /// Channels of a colour attachment; for an unsigned format they are truncated to integers.
    Color([f32; 4]),
    /// Depth; 0 is infinitely far.
    Depth(f32),
}

/// An output of a pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedOutput {
    /// Its name within the pass; see [`Declaration::outputs_of`].
    pub name: String,
    /// Index of the resource.
    pub resource: u32,
    /// The version that the pass wrote.
    pub version: u32,
}

/// Contents that the frame is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct OutputDecl {
    /// Index of the resource.
    pub resource: u32,
    /// The version that is wanted.
    pub version: u32,
}

/// Contents that go from one frame to the next: this frame's `next` is the `previous` of the frame after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HistoryDecl {
    /// Index of the resource with what the frame before left.
    pub previous: u32,
    /// Index of the resource that this frame writes.
    pub next: u32,
}
