//! The frame graph while it is declared.

use std::{
    borrow::Cow,
    collections::HashSet,
    sync::{
        Arc,
        atomic::{AtomicU32, Ordering},
    },
};

use super::{
    access::{Access, Domain, Layout, Queue, Uses},
    builder::PassBuilder,
    check::Poison,
    declaration::{
        Declaration, HistoryDecl, ImageState, ImportKey, Name, Origin, OutputDecl, PassDecl, ResourceDecl, Shape, Span,
        Use,
    },
    desc::{BufferDesc, Content, Extent, Format, ImageDesc, Size},
    error::{GraphError, GraphErrors},
    handle::{Accel, Buffer, Handle, Image, Kind, Tlas, WriteHandle},
    history::{BufferHistory, History, HistoryScope, KeptBuffer, SharedHistoryRegistry},
    record::Record,
};

/// What a pass does when its turn comes.
pub type RecordFn = Box<dyn for<'a> FnOnce(&mut Record<'a>) + Send>;

/// An image that a pass has just written, as an observer sees it.
#[derive(Clone, Debug)]
pub struct Produced {
    /// Name of the pass.
    pub pass: String,
    /// Index of the pass.
    pub pass_index: u32,
    /// Name of the output within the pass.
    pub output: String,
    /// The version that was written, to read.
    pub image: Handle<Image>,
    /// Its format.
    pub format: Format,
    /// Its size.
    pub extent: Extent,
}

/// Called with the index of every pass right after it was declared.
pub type Observer = Box<dyn FnMut(&mut FrameGraph, u32)>;

/// Sees the image that a slot of the frame gives, if it gives one, while it is the newest version.
pub type SlotObserver = Box<dyn FnMut(&mut FrameGraph, &str, Option<Handle<Image>>)>;

/// One frame, declared anew every time.
///
/// Declaring never fails: mistakes are collected, and [`finish`](Self::finish) returns them together.
pub struct FrameGraph {
    pub(super) declaration: Declaration,
    pub(super) errors: Vec<GraphError>,
    /// One per pass.
    pub(super) records: Vec<Option<RecordFn>>,
    pub(super) observer: Option<Observer>,
    pub(super) slot_observer: Option<SlotObserver>,
    /// Passes and outputs that somebody looks at.
    pub(super) watched: Vec<(String, String)>,
    /// Outputs that tests overwrite with NaN or infinity.
    pub(super) poisons: Vec<Poison>,
    /// What outlives the frame.
    pub(super) histories: Arc<SharedHistoryRegistry>,
    /// Distinguishes handles of this frame from those of others.
    number: u32,
}

/// A frame declared without mistakes.
pub struct Frame {
    /// What was declared.
    pub declaration: Declaration,
    /// What each pass records, by its index; taken out when its turn comes.
    pub records: Vec<Option<RecordFn>>,
}

static GRAPHS: AtomicU32 = AtomicU32::new(0);

impl FrameGraph {
    /// An empty frame of so many pixels, to be planned and looked at. A frame that is to run comes from
    /// [`Executor::begin`](super::execute::Executor::begin): only there do histories go on from the frame before.
    pub fn new(full: Extent) -> Self {
        Self::on(Declaration::new(full), Vec::new(), Arc::default())
    }

    /// An empty frame in lists that an earlier one no longer needs.
    pub(super) fn on(
        declaration: Declaration,
        records: Vec<Option<RecordFn>>,
        histories: Arc<SharedHistoryRegistry>,
    ) -> Self {
        histories.lock().begin_frame();
        let number = GRAPHS.fetch_add(1, Ordering::Relaxed);
        Self {
            declaration,
            errors: Vec::new(),
            records,
            observer: None,
            slot_observer: None,
            watched: Vec::new(),
            poisons: Vec::new(),
            histories,
            number,
        }
    }

    /// Adds a pass: one dispatch, one trace, one draw list or one copy.
    ///
    /// `declare` says what it uses and returns its outputs and the closure that records it. The name is that of the stage, a
    /// dot and that of the step: `shadows.trace`. The pass is dropped from the plan when nothing needs what it writes; writing
    /// an imported resource is needed by itself.
    pub fn pass<T, F>(&mut self, name: &str, queue: Queue, declare: impl FnOnce(&mut PassBuilder<'_>) -> (T, F)) -> T
    where
        F: FnOnce(&mut Record<'_>) + Send + 'static,
    {
        self.add(name, queue, false, declare)
    }

    /// Adds a pass that only observes: it runs when everything it reads is made anyway, and keeps nothing alive itself.
    ///
    /// Several may write one imported buffer in turn; those whose inputs are dropped leave it as it was.
    pub fn weak_pass<T, F>(
        &mut self,
        name: &str,
        queue: Queue,
        declare: impl FnOnce(&mut PassBuilder<'_>) -> (T, F),
    ) -> T
    where
        F: FnOnce(&mut Record<'_>) + Send + 'static,
    {
        self.add(name, queue, true, declare)
    }

    fn add<T, F>(
        &mut self,
        name: &str,
        queue: Queue,
        weak: bool,
        declare: impl FnOnce(&mut PassBuilder<'_>) -> (T, F),
    ) -> T
    where
        F: FnOnce(&mut Record<'_>) + Send + 'static,
    {
        let index = self.declaration.passes.len() as u32;
        let first_use = self.declaration.uses.len();
        let name = self.declaration.add_name(name);
        let uses = Span { start: first_use as u32, end: first_use as u32 };
        self.declaration.passes.push(PassDecl { name, queue, domain: Domain::Compute, weak, uses });
        let (value, record) = declare(&mut PassBuilder { graph: self, pass: index, first_use });
        self.close(index);
        self.records.push(Some(Box::new(record)));
        if let Some(mut observer) = self.observer.take() {
            observer(self, index);
            self.observer = Some(observer);
        }
        value
    }

    /// Settles the domain of a pass and checks what only all its uses together show.
    fn close(&mut self, index: u32) {
        let end = self.declaration.uses.len() as u32;
        self.declaration.passes[index as usize].uses.end = end;
        let uses = self.declaration.uses_of(index);
        let (mut attachments, mut copies, mut asked) = (0, 0, 0);
        for u in uses {
            // Indices are for drawing, even where nothing but buffers is written.
            attachments += usize::from(u.access.is_attachment() || u.access == Access::Index);
            copies += usize::from(u.access.is_copy());
            asked += usize::from(u.access == Access::BuildInput);
        }
        let domain = match (attachments, copies, asked) {
            (0, 0, _) => Domain::Compute,
            (0, _, 0) => Domain::Copy,
            // What is asked of acceleration structures is copied to a buffer, on queues that build.
            (0, _, _) => Domain::Compute,
            _ => Domain::Raster,
        };
        let suspicious = attachments > 1 || (copies > 0 && copies + asked < uses.len());
        self.declaration.passes[index as usize].domain = domain;
        if suspicious {
            let errors = self.check_uses(index);
            self.errors.extend(errors);
        }
    }

    fn check_uses(&self, index: u32) -> Vec<GraphError> {
        let name_of = |u: &Use| self.declaration.resource_name(u.resource);
        let (pass, uses) = (self.declaration.pass_name(index).to_owned(), self.declaration.uses_of(index));
        let mut errors = Vec::new();
        let attachments: Vec<&Use> = uses.iter().filter(|u| u.access.is_attachment()).collect();
        if let Some(first) = attachments.first() {
            let first_extent = self.extent_at(first.resource);
            for other in &attachments {
                let second_extent = self.extent_at(other.resource);
                if second_extent != first_extent {
                    let (first, second) = (name_of(first), name_of(other));
                    let pass = pass.clone();
                    errors.push(GraphError::AttachmentExtent { pass, first, first_extent, second, second_extent });
                }
            }
        }
        let depths: Vec<&Use> = attachments.iter().copied().filter(|u| u.access.is_depth()).collect();
        if let [first, others @ ..] = depths.as_slice() {
            // Two uses of the same part do not go together anyway, which was found before.
            let is_other = |u: &&&Use| u.resource != first.resource || !u.part.overlaps(first.part);
            if let Some(second) = others.iter().find(is_other) {
                let (first, second) = (name_of(first), name_of(second));
                errors.push(GraphError::TwoDepths { pass: pass.clone(), first, second });
            }
        }
        let copy = uses.iter().find(|u| u.access.is_copy());
        let other = uses.iter().find(|u| !u.access.is_copy() && u.access != Access::BuildInput);
        if let (Some(copy), Some(other)) = (copy, other) {
            let (copied, resource) = (name_of(copy), name_of(other));
            errors.push(GraphError::MixedCopy { pass, copied, copy: copy.access, resource, access: other.access });
        }
        errors
    }

    /// Brings in an image that lives longer than the frame. `state` is how it was used last; `key` is the caller's.
    pub fn import_image(
        &mut self,
        name: &str,
        desc: ImageDesc,
        state: ImageState,
        key: ImportKey,
    ) -> WriteHandle<Image> {
        let shape = self.image_shape(name, desc);
        let (last, layout) = match state.access {
            None => (Uses::EMPTY, Layout::Undefined),
            Some((access, domain)) => {
                self.check_state::<Image>(name, access, access.is_image());
                (Uses::of(access.at(domain)), access.layout())
            }
        };
        WriteHandle::new(self.import(name, shape, last, layout, key))
    }

    /// Brings in a buffer that lives longer than the frame. `last` is how it was used last, in whatever kind of pass.
    pub fn import_buffer(&mut self, name: &str, desc: BufferDesc, last: Access, key: ImportKey) -> WriteHandle<Buffer> {
        self.check_state::<Buffer>(name, last, last.is_buffer());
        let shape = self.buffer_shape(name, desc);
        let buffer = self.import(name, shape, in_any_pass(last), Layout::Undefined, key);
        self.note_content(buffer.id, desc);
        WriteHandle::new(buffer)
    }

    /// Brings in an acceleration structure. `last` is how it was used last: traced, or written as plain bytes.
    pub fn import_tlas(&mut self, name: &str, last: Access, key: ImportKey) -> Handle<Tlas> {
        self.import_accel::<Tlas>(name, last, key).read()
    }

    /// The same for a level of either kind, which this frame may build or refit.
    pub fn import_accel<K: Accel>(&mut self, name: &str, last: Access, key: ImportKey) -> WriteHandle<K> {
        self.check_state::<K>(name, last, last.is_accel());
        let shape = Shape::Accel { bytes: 0, top: K::TOP };
        WriteHandle::new(self.import(name, shape, in_any_pass(last), Layout::Undefined, key))
    }

    pub(super) fn import<K: Kind>(
        &mut self,
        name: &str,
        shape: Shape,
        last: Uses,
        layout: Layout,
        key: ImportKey,
    ) -> Handle<K> {
        let origin = Origin::Imported { key, last, layout, leave: None };
        let name = self.declaration.add_name(name);
        Handle::new(self.add_resource(name, shape, origin, None), 0, self.number)
    }

    /// An image that goes from frame to frame: this frame reads what the one before wrote, and writes what the next will read.
    ///
    /// `scope` belongs to the instance of the effect, `name` is its own name for the image. What the frame before left is not
    /// valid in the first frame, in another size or format, after a camera cut, for another instance, and where the frame
    /// before did not write it; all zeros are read then.
    pub fn history(&mut self, scope: &HistoryScope, name: impl Into<Cow<'static, str>>, desc: ImageDesc) -> History {
        let name = name.into();
        let shape = self.image_shape(&name, desc);
        let (index, valid) = self.declare_history(scope, name.clone(), shape);
        let (previous, next) = self.import_history(&name, shape, index, Layout::ReadOnly);
        History { previous, next: WriteHandle::new(next), valid }
    }

    /// A buffer that goes from frame to frame; see [`FrameGraph::history`].
    pub fn history_buffer(
        &mut self,
        scope: &HistoryScope,
        name: impl Into<Cow<'static, str>>,
        desc: BufferDesc,
    ) -> BufferHistory {
        let name = name.into();
        let shape = self.buffer_shape(&name, desc);
        let (index, valid) = self.declare_history(scope, name.clone(), shape);
        let (previous, next) = self.import_history(&name, shape, index, Layout::Undefined);
        self.note_content(previous.id, desc);
        self.note_content(next.id, desc);
        BufferHistory { previous, next: WriteHandle::new(next), valid }
    }

    /// A buffer of at least so many bytes that keeps what it holds from frame to frame, and when it grows; what was never
    /// written is zero. It lasts as long as each frame declares it.
    pub fn kept_buffer(
        &mut self,
        scope: &HistoryScope,
        name: impl Into<Cow<'static, str>>,
        desc: BufferDesc,
    ) -> KeptBuffer {
        let name = name.into();
        self.buffer_shape(&name, desc);
        let declared = self.histories.lock().declare_kept_buffer(scope, name.clone(), desc.bytes);
        let (index, bytes, valid_bytes) = declared.unwrap_or_else(|| {
            self.errors.push(GraphError::DuplicateHistory { name: name.clone().into_owned() });
            (u32::MAX, desc.bytes, 0)
        });
        let last = in_any_pass(Access::BufferReadWrite);
        let key = ImportKey::Kept(index);
        let buffer = self.import(&name, Shape::Buffer { bytes }, last, Layout::Undefined, key);
        self.note_content(buffer.id, desc);
        KeptBuffer { buffer: WriteHandle::new(buffer), valid_bytes }
    }

    /// Whether anything in it outlives the frame.
    pub(super) fn has_history(&self) -> bool {
        let kept = |r: &ResourceDecl| matches!(r.origin, Origin::Imported { key: ImportKey::Kept(_), .. });
        !self.declaration.histories.is_empty() || self.declaration.resources.iter().any(kept)
    }

    fn declare_history(&mut self, scope: &HistoryScope, name: Cow<'static, str>, shape: Shape) -> (u32, bool) {
        let declared = self.histories.lock().declare_history(scope, name.clone(), shape);
        declared.unwrap_or_else(|| {
            self.errors.push(GraphError::DuplicateHistory { name: name.into_owned() });
            (u32::MAX, false)
        })
    }

    /// Both halves of a history. What is read comes as it was left: readable by shaders.
    fn import_history<K: Kind>(
        &mut self,
        name: &str,
        shape: Shape,
        index: u32,
        layout: Layout,
    ) -> (Handle<K>, Handle<K>) {
        let read = if shape.is_image() { Access::Sample } else { Access::BufferRead };
        let previous =
            self.import(&format!("{name}.previous"), shape, in_any_pass(read), layout, ImportKey::Previous(index));
        let next = self.import(&format!("{name}.next"), shape, Uses::EMPTY, Layout::Undefined, ImportKey::Next(index));
        self.leave(next, read, Domain::Compute);
        self.declaration.histories.push(HistoryDecl { previous: previous.id, next: next.id });
        (previous, next)
    }

    fn check_state<K: Kind>(&mut self, name: &str, access: Access, suits: bool) {
        if !suits {
            self.errors.push(GraphError::State { kind: K::NAME, resource: name.to_owned(), access });
        }
    }

    /// Makes an imported resource ready for this use at the end of the frame, whoever used it before.
    pub fn leave<K: Kind>(&mut self, handle: Handle<K>, access: Access, domain: Domain) {
        self.assert_own(handle);
        let name = self.declaration.resource_name(handle.id);
        let decl = &mut self.declaration.resources[handle.id as usize];
        let suits = match decl.shape {
            Shape::Image { .. } => access.is_image(),
            Shape::Buffer { .. } => access.is_buffer(),
            Shape::Accel { .. } => access.is_accel(),
        };
        match &mut decl.origin {
            Origin::Transient => self.errors.push(GraphError::NotImported { resource: name, access }),
            Origin::Imported { leave, .. } => {
                *leave = Some(access.at(domain));
                self.check_state::<K>(&name, access, suits);
            }
        }
    }

    /// Says that the frame is made for these contents: the passes that make them are kept.
    pub fn output<K: Kind>(&mut self, handle: Handle<K>) {
        self.assert_own(handle);
        self.declaration.outputs.push(OutputDecl { resource: handle.id, version: handle.version });
    }

    /// The image that a pass wrote under a name, as `--view PASS:OUTPUT` asks for it.
    ///
    /// A later pass may have replaced the contents; whoever needs them nevertheless uses [`observe`](Self::observe).
    pub fn find(&self, pass: &str, output: &str) -> Result<Handle<Image>, GraphError> {
        let known: Vec<Produced> = self.outputs().collect();
        let of_pass: Vec<&Produced> = known.iter().filter(|p| p.pass == pass).collect();
        match of_pass.iter().find(|p| p.output == output) {
            Some(found) => Ok(found.image),
            None if of_pass.is_empty() => {
                let mut known: Vec<String> = known.into_iter().map(|p| p.pass).collect();
                known.dedup();
                Err(GraphError::UnknownPass { pass: pass.to_owned(), known })
            }
            None => {
                let known = of_pass.iter().map(|p| p.output.clone()).collect();
                Err(GraphError::UnknownOutput { pass: pass.to_owned(), output: output.to_owned(), known })
            }
        }
    }

    /// Every image that a pass has written so far, in the order of declaration.
    pub fn outputs(&self) -> impl Iterator<Item = Produced> {
        (0..self.declaration.passes.len() as u32).flat_map(|pass| self.produced_by(pass))
    }

    /// The images that a pass wrote.
    pub fn images_of(&self, pass: u32) -> Vec<Produced> {
        self.produced_by(pass).collect()
    }

    fn produced_by(&self, pass: u32) -> impl Iterator<Item = Produced> {
        let images = self.declaration.images_of(pass).into_iter();
        images.filter_map(move |output| match self.declaration.resources[output.resource as usize].shape {
            Shape::Image { format, extent, .. } => Some(Produced {
                pass: self.declaration.pass_name(pass).to_owned(),
                pass_index: pass,
                output: output.name,
                image: Handle::new(output.resource, output.version, self.number),
                format,
                extent,
            }),
            Shape::Buffer { .. } | Shape::Accel { .. } => None,
        })
    }

    /// Size of the frame, pixels.
    pub fn full(&self) -> Extent {
        self.declaration.full
    }

    /// What an image is like; its size is given as that of the image itself.
    pub fn desc(&self, image: Handle<Image>) -> ImageDesc {
        let (format, _, mips, layers) = self.image_at(image);
        ImageDesc { format, size: Size::Like(image), mips, layers }
    }

    /// Size of an image, pixels.
    pub fn extent(&self, image: Handle<Image>) -> Extent {
        self.image_at(image).1
    }

    /// Size that an image of this description has or would have, pixels.
    pub fn extent_of(&self, desc: ImageDesc) -> Extent {
        match desc.size {
            Size::Full => self.full(),
            Size::Half => self.full().half(),
            Size::Like(other) => self.extent(other),
            Size::Fixed(extent) => extent,
        }
    }

    /// What was declared so far.
    pub fn declaration(&self) -> &Declaration {
        &self.declaration
    }

    /// Ends the declaration: a frame that can be planned, or every mistake in it.
    ///
    /// # Errors
    /// [`GraphErrors`], never empty.
    pub fn finish(mut self) -> Result<Frame, GraphErrors> {
        let names = self.check_names();
        self.errors.extend(names);
        if self.errors.is_empty() {
            Ok(Frame { declaration: self.declaration, records: self.records })
        } else {
            Err(GraphErrors(self.errors))
        }
    }

    /// Names that must be different and are not. A frame equal to one that was checked needs no check.
    pub(super) fn check_names(&self) -> Vec<GraphError> {
        let (mut errors, mut seen) = (Vec::new(), HashSet::with_capacity(self.declaration.passes.len()));
        for pass in 0..self.declaration.passes.len() as u32 {
            let name = self.declaration.pass_name(pass);
            if !seen.insert(name) {
                errors.push(GraphError::DuplicatePass { pass: name.to_owned() });
            }
            if self.declaration.uses_of(pass).iter().filter(|u| u.writes.is_some()).count() > 1 {
                let mut outputs = HashSet::new();
                let twice = self.declaration.outputs_of(pass).into_iter().find(|o| !outputs.insert(o.name.clone()));
                errors.extend(twice.map(|o| GraphError::DuplicateOutput { pass: name.to_owned(), output: o.name }));
            }
        }
        errors
    }

    pub(super) fn assert_own<K: Kind>(&self, handle: Handle<K>) {
        assert_eq!(
            handle.graph, self.number,
            "{handle:?} belongs to frame {}, but is used in frame {}: handles do not outlive their frame",
            handle.graph, self.number
        );
    }

    pub(super) fn image_at(&self, image: Handle<Image>) -> (Format, Extent, u32, u32) {
        self.assert_own(image);
        match self.declaration.resources[image.id as usize].shape {
            Shape::Image { format, extent, mips, layers } => (format, extent, mips, layers),
            Shape::Buffer { .. } | Shape::Accel { .. } => unreachable!("{image:?} names no image: handles are typed"),
        }
    }

    /// Size of an image by its index; of anything else, none.
    fn extent_at(&self, resource: u32) -> Extent {
        match self.declaration.resources[resource as usize].shape {
            Shape::Image { extent, .. } => extent,
            Shape::Buffer { .. } | Shape::Accel { .. } => Extent::new(0, 0),
        }
    }

    pub(super) fn image_shape(&mut self, name: &str, desc: ImageDesc) -> Shape {
        let (extent, mips, layers) = (self.extent_of(desc), desc.mips, desc.layers);
        let good = 1..=Extent::MAX_SIDE;
        if !good.contains(&extent.width) || !good.contains(&extent.height) {
            self.errors.push(GraphError::Extent { resource: name.to_owned(), extent });
        } else if !(1..=extent.full_mips()).contains(&mips) {
            let most = extent.full_mips();
            self.errors.push(GraphError::Mips { resource: name.to_owned(), extent, mips, most });
        } else if !(1..=ImageDesc::MAX_LAYERS).contains(&layers) {
            self.errors.push(GraphError::Layers { resource: name.to_owned(), layers });
        }
        Shape::Image { format: desc.format, extent, mips, layers }
    }

    pub(super) fn buffer_shape(&mut self, name: &str, desc: BufferDesc) -> Shape {
        if !(1..=BufferDesc::MAX_BYTES).contains(&desc.bytes) {
            self.errors.push(GraphError::BufferSize { resource: name.to_owned(), bytes: desc.bytes });
        }
        Shape::Buffer { bytes: desc.bytes }
    }

    /// Notes what the words of a buffer are; buffers come in the order of their indices.
    pub(super) fn note_content(&mut self, resource: u32, desc: BufferDesc) {
        if desc.content == Content::Floats {
            self.declaration.floats.push(resource);
        }
    }

    pub(super) fn add_resource(&mut self, name: Name, shape: Shape, origin: Origin, maker: Option<u32>) -> u32 {
        self.declaration.resources.push(ResourceDecl { name, maker, shape, origin, versions: 1 });
        self.declaration.resources.len() as u32 - 1
    }

    pub(super) fn handle<K: Kind>(&self, resource: u32, version: u32) -> Handle<K> {
        Handle::new(resource, version, self.number)
    }
}

/// A use before the frame, in a pass of unknown domain.
pub(super) fn in_any_pass(access: Access) -> Uses {
    [Domain::Raster, Domain::Compute].into_iter().map(|domain| access.at(domain)).collect()
}

#[cfg(test)]
#[path = "pass_tests.rs"]
mod tests;
