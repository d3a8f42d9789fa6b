//! A declared frame as plain data: what the plan is made from.
//!
//! Everything lies in a few flat lists, so that a frame can be compared with another and thrown away without touching the heap.

use super::{
    access::{Access, Domain, Layout, Queue, Uses},
    desc::{Extent, Format, Part},
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
    /// What the passes do with which resource, pass by pass.
    pub uses: Vec<Use>,
    /// What attachments are cleared to, by the index of the use, ascending.
    pub clears: Vec<(u32, Clear)>,
    /// Buffers whose words are all floats, by index, ascending.
    pub floats: Vec<u32>,
    /// What the frame is made for.
    pub outputs: Vec<OutputDecl>,
    /// Pairs of images or buffers that carry contents from frame to frame.
    pub histories: Vec<HistoryDecl>,
    names: String,
}

/// A name, by its place among all names of the declaration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Name {
    start: u32,
    length: u32,
}

/// From one index up to another, which is not included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Span {
    /// The first.
    pub start: u32,
    /// The one after the last.
    pub end: u32,
}

impl Span {
    /// As a range of indices.
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..self.end as usize
    }

    /// How many.
    pub fn len(self) -> usize {
        (self.end - self.start) as usize
    }

    /// None at all.
    pub fn is_empty(self) -> bool {
        self.end == self.start
    }
}

impl Declaration {
    /// Nothing declared yet, for a frame of so many pixels.
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

    /// Forgets everything but keeps the memory of the lists.
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

    /// The stage that a pass belongs to: its name up to the first dot.
    pub fn stage(&self, pass: u32) -> &str {
        let name = self.pass_name(pass);
        name.split_once('.').map_or(name, |(stage, _)| stage)
    }

    /// What a pass does with which resource. Colour attachments are in the order of the fragment shader's outputs.
    pub fn uses_of(&self, pass: u32) -> &[Use] {
        &self.uses[self.passes[pass as usize].uses.range()]
    }

    /// Bytes of the images and of the frame's own buffers that a pass reads and writes, if it touches each of their pixels once. What the
    /// caller imports, such as the scene, is not counted: of that, a pass reads some here and there.
    pub fn traffic(&self, pass: u32) -> u64 {
        let of = |u: &Use| {
            let resource = &self.resources[u.resource as usize];
            if matches!(resource.origin, Origin::Imported { key: ImportKey::Caller(_), .. }) {
                return 0;
            }
            let both = u64::from(u.access.reads()) + u64::from(u.access.writes());
            both * resource.shape.bytes_of(u.part)
        };
        self.uses_of(pass).iter().map(of).sum()
    }

    /// What an attachment is cleared to, by the index of its use.
    pub fn clear_of(&self, use_index: u32) -> Option<Clear> {
        let at = self.clears.binary_search_by_key(&use_index, |(at, _)| *at).ok()?;
        Some(self.clears[at].1)
    }

    /// Whether a resource is a buffer whose words are all floats.
    pub fn is_floats(&self, resource: u32) -> bool {
        self.floats.binary_search(&resource).is_ok()
    }

    /// `pass:output` of the pass that makes a resource, or the name that it was imported by.
    pub fn resource_name(&self, resource: u32) -> String {
        let decl = &self.resources[resource as usize];
        let local = self.text(decl.name);
        decl.maker.map_or_else(|| local.to_owned(), |maker| format!("{}:{local}", self.pass_name(maker)))
    }

    /// What a pass leaves for others. An output has the name that its resource was made or imported by; where that leaves two
    /// outputs of one pass with one name, that which was made elsewhere has the resource's full name.
    pub fn outputs_of(&self, pass: u32) -> Vec<NamedOutput> {
        let uses = self.uses_of(pass);
        // A pass that writes several parts of one image has one output, the last of its versions.
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

    /// Who wrote which version.
    pub fn writers(&self) -> Writers {
        Writers::of(self)
    }
}

/// The pass that wrote each version of each resource.
pub struct Writers {
    /// Of each resource, the place of its version 0.
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

    /// The pass that wrote a version; none for the contents that an imported resource came with.
    pub fn get(&self, resource: u32, version: u32) -> Option<u32> {
        self.writers[(self.first[resource as usize] + version) as usize]
    }
}

/// A resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ResourceDecl {
    /// The name that it was made or imported by; see [`Declaration::resource_name`].
    pub name: Name,
    /// The pass that makes it; none where it was imported.
    pub maker: Option<u32>,
    /// What it is like.
    pub shape: Shape,
    /// Where it comes from.
    pub origin: Origin,
    /// How many versions there are.
    pub versions: u32,
}

impl ResourceDecl {
    /// Bytes that its contents take, without padding.
    pub fn bytes(&self) -> u64 {
        self.shape.bytes()
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    /// An image.
    Image {
        /// Format of its pixels.
        format: Format,
        /// Size of mip 0.
        extent: Extent,
        /// Number of mips.
        mips: u32,
        /// Number of layers.
        layers: u32,
    },
    /// A buffer.
    Buffer {
        /// Its size.
        bytes: u64,
    },
    /// An acceleration structure.
    Accel {
        /// Its size; zero where it was imported and its size is its owner's.
        bytes: u64,
        /// It is a top level.
        top: bool,
    },
}

impl Shape {
    /// Bytes that contents take, without padding.
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

    /// Mips and layers; one of each for what is no image.
    pub fn parts(self) -> (u32, u32) {
        match self {
            Self::Image { mips, layers, .. } => (mips, layers),
            Self::Buffer { .. } | Self::Accel { .. } => (1, 1),
        }
    }

    /// Whether it is an image: only images have layouts.
    pub fn is_image(self) -> bool {
        matches!(self, Self::Image { .. })
    }

    /// The layout that it has during an access; [`Layout::Undefined`] for what is no image.
    pub fn layout(self, access: Access) -> Layout {
        if self.is_image() { access.layout() } else { Layout::Undefined }
    }
}

/// Where a resource comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// Made by a pass, gone after the frame.
    Transient,
    /// It exists before and after the frame.
    Imported {
        /// The object behind it.
        key: ImportKey,
        /// Last uses before the frame; empty where nothing is known and contents do not matter.
        last: Uses,
        /// Layout before the frame.
        layout: Layout,
        /// What the frame makes it ready for at its end.
        leave: Option<(Access, Domain)>,
    },
}

/// The object behind an imported resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImportKey {
    /// One that the caller brings, by the caller's number.
    Caller(u32),
    /// What the frame before left in a history.
    Previous(u32),
    /// What this frame leaves in a history.
    Next(u32),
    /// A buffer that keeps its contents.
    Kept(u32),
}

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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PassDecl {
    /// Its name, such as `shadows.trace`; see [`Declaration::pass_name`].
    pub name: Name,
    /// The queue it would like.
    pub queue: Queue,
    /// Where it runs, from its accesses.
    pub domain: Domain,
    /// It observes: it does not keep what it reads alive.
    pub weak: bool,
    /// Its uses, in [`Declaration::uses`].
    pub uses: Span,
}

/// One use of one resource by one pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Use {
    /// Index of the resource.
    pub resource: u32,
    /// How it is used.
    pub access: Access,
    /// How much of it, counts resolved.
    pub part: Part,
    /// The version it builds on: read, or kept where it is not written.
    pub reads: Option<u32>,
    /// The version it makes.
    pub writes: Option<u32>,
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
