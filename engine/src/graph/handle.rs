//! Typed, versioned handles to the resources that passes read and write.

use std::{fmt, marker::PhantomData};

/// Kind of resource: a two-dimensional image with all its mips and layers.
#[derive(Clone, Copy, Debug)]
pub enum Image {}

/// Kind of resource: a buffer.
#[derive(Clone, Copy, Debug)]
pub enum Buffer {}

/// Kind of resource: a top-level acceleration structure, whichever way rays are traced.
#[derive(Clone, Copy, Debug)]
pub enum Tlas {}

/// Kind of resource: a bottom-level acceleration structure over one mesh.
#[derive(Clone, Copy, Debug)]
pub enum Blas {}

mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Image {}
    impl Sealed for super::Buffer {}
    impl Sealed for super::Tlas {}
    impl Sealed for super::Blas {}
}

/// The kinds of resource: [`Image`], [`Buffer`], [`Tlas`] and [`Blas`].
pub trait Kind: sealed::Sealed + 'static {
    /// Name of the kind, for messages.
    const NAME: &'static str;
}

impl Kind for Image {
    const NAME: &'static str = "image";
}
impl Kind for Buffer {
    const NAME: &'static str = "buffer";
}
impl Kind for Tlas {
    const NAME: &'static str = "tlas";
}
impl Kind for Blas {
    const NAME: &'static str = "blas";
}

/// The kinds of acceleration structure: [`Tlas`] and [`Blas`].
pub trait Accel: Kind {
    /// Whether it is a top level.
    const TOP: bool;
}
impl Accel for Tlas {
    const TOP: bool = true;
}
impl Accel for Blas {
    const TOP: bool = false;
}

/// The kinds that a build reads: geometry in a [`Buffer`], or a [`Blas`] that a top level contains or that is compacted.
pub trait BuildInput: Kind {}
impl BuildInput for Buffer {}
impl BuildInput for Blas {}

/// The kinds that copies read and write: [`Image`] and [`Buffer`].
pub trait Copyable: Kind {}
impl Copyable for Image {}
impl Copyable for Buffer {}

/// One version of a resource, read-only. It is a plain index, free to copy, and belongs to the frame in which it was made.
///
/// Every write makes a new version. Reading an old version after a newer one was written is an error that
/// [`FrameGraph::finish`](super::FrameGraph::finish) returns.
pub struct Handle<K> {
    pub(super) id: u32,
    pub(super) version: u32,
    /// Number of the graph that made it. Using a handle in another frame panics.
    pub(super) graph: u32,
    kind: PhantomData<fn() -> K>,
}

impl<K> Handle<K> {
    pub(super) fn new(id: u32, version: u32, graph: u32) -> Self {
        Self { id, version, graph, kind: PhantomData }
    }

    /// Index of the resource in [`Declaration::resources`](super::Declaration::resources).
    pub fn id(self) -> u32 {
        self.id
    }

    /// Version of the contents: 0 for the first, plus 1 for every write.
    pub fn version(self) -> u32 {
        self.version
    }
}

impl<K> Clone for Handle<K> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<K> Copy for Handle<K> {}

impl<K> PartialEq for Handle<K> {
    fn eq(&self, other: &Self) -> bool {
        (self.id, self.version, self.graph) == (other.id, other.version, other.graph)
    }
}

impl<K> Eq for Handle<K> {}

impl<K: Kind> fmt::Debug for Handle<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} version {}", K::NAME, self.id, self.version)
    }
}

/// The unique right to write the next version of a resource. Writing consumes it and returns the one for the version after that.
///
/// So two writers of the same version do not compile:
///
/// ```compile_fail,E0382
/// use magpie::graph::{Extent, Format, FrameGraph, ImageDesc, Queue, Record};
///
/// let mut g = FrameGraph::new(Extent::new(64, 64));
/// let noise = g.pass("noise.make", Queue::Graphics, |p| {
///     let (noise, _token) = p.create("noise", ImageDesc::full(Format::R32Float));
///     (noise, |_: &mut Record| {})
/// });
/// let first = g.pass("noise.blur", Queue::Graphics, |p| (p.write(noise).0, |_: &mut Record| {}));
/// let second = g.pass("noise.sharpen", Queue::Graphics, |p| (p.write(noise).0, |_: &mut Record| {}));
/// ```
///
/// nor can the right be cloned:
///
/// ```compile_fail,E0599
/// use magpie::graph::{Image, WriteHandle};
///
/// fn twice(noise: WriteHandle<Image>) -> (WriteHandle<Image>, WriteHandle<Image>) {
///     (noise.clone(), noise)
/// }
/// ```
///
/// A chain of writers does compile:
///
/// ```
/// use magpie::graph::{Extent, Format, FrameGraph, ImageDesc, Queue, Record};
///
/// let mut g = FrameGraph::new(Extent::new(64, 64));
/// let noise = g.pass("noise.make", Queue::Graphics, |p| {
///     let (noise, _token) = p.create("noise", ImageDesc::full(Format::R32Float));
///     (noise, |_: &mut Record| {})
/// });
/// let first = g.pass("noise.blur", Queue::Graphics, |p| (p.write(noise).0, |_: &mut Record| {}));
/// let second = g.pass("noise.sharpen", Queue::Graphics, |p| (p.write(first).0, |_: &mut Record| {}));
/// g.output(second.read());
/// assert!(g.finish().is_ok());
/// ```
#[must_use = "without it nothing can write this resource again: take `.read()` if that is meant"]
pub struct WriteHandle<K> {
    pub(super) at: Handle<K>,
}

impl<K> WriteHandle<K> {
    pub(super) fn new(at: Handle<K>) -> Self {
        Self { at }
    }

    /// A handle to the newest version.
    pub fn read(&self) -> Handle<K> {
        self.at
    }
}

impl<K: Kind> fmt::Debug for WriteHandle<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "writer of {:?}", self.at)
    }
}
