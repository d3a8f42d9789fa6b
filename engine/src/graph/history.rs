//! What outlives a frame: histories, which hand images or buffers from each frame to the next, and buffers and layered images that
//! keep what they hold.
//!
//! A history is a pair. Each frame reads one half and writes the other, and they change places when the frame has run. What
//! it reads is valid when the frame before wrote it, in the same size, for the same instance of the effect, and no camera cut
//! came between. What is not valid is all zeros, never an older frame.

use std::{
    borrow::Cow,
    collections::HashMap,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, Ordering},
    },
};

use super::{
    access::{Access, Domain},
    declaration::{ImportKey, Shape},
    desc::ImageDesc,
    error::GraphError,
    handle::{Buffer, Handle, Image, WriteHandle},
    pass::{FrameGraph, in_any_pass},
};

/// The owner of histories: one instance of an effect has one, so that another implementation in its slot starts anew.
#[derive(Debug, PartialEq, Eq, Hash)]
pub struct HistoryScope(u32);

static SCOPES: AtomicU32 = AtomicU32::new(0);

impl HistoryScope {
    /// A scope unlike every other.
    #[allow(clippy::new_without_default, reason = "two defaults would not be equal")]
    pub fn new() -> Self {
        Self(SCOPES.fetch_add(1, Ordering::Relaxed))
    }
}

/// An image that goes from frame to frame.
#[derive(Debug)]
pub struct History {
    /// What the frame before wrote; zeros where it is not valid.
    pub previous: Handle<Image>,
    /// What this frame writes, everywhere; its contents are undefined before.
    pub next: WriteHandle<Image>,
    /// Whether `previous` holds what the frame before wrote.
    pub valid: bool,
}

/// A buffer that goes from frame to frame.
#[derive(Debug)]
pub struct BufferHistory {
    /// What the frame before wrote; zeros where it is not valid.
    pub previous: Handle<Buffer>,
    /// What this frame writes, everywhere; its contents are undefined before.
    pub next: WriteHandle<Buffer>,
    /// Whether `previous` holds what the frame before wrote.
    pub valid: bool,
}

/// A buffer that keeps what it holds and grows when more is asked for.
#[derive(Debug)]
pub struct KeptBuffer {
    /// The buffer.
    pub buffer: WriteHandle<Buffer>,
    /// How many bytes from its start hold what earlier frames left; all beyond are zeros.
    pub valid_bytes: u64,
}

/// A layered image that keeps what it holds, for what is made once and looked at for many frames.
#[derive(Debug)]
pub struct KeptLayers {
    /// The image.
    pub image: WriteHandle<Image>,
    /// The layers that do not hold what the frame wants, in ascending order: it writes all of them, if it reads any.
    pub stale: Vec<u32>,
}

/// How something outlives a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keeping {
    /// Two halves in turn.
    Pair,
    /// One buffer.
    Single,
    /// One image, which knows of each layer what it was made from.
    Layers,
}

/// What is known of one history or kept buffer.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Its number, by which the executor knows the objects behind it.
    pub slot: u32,
    /// Unlike that of any other: a slot is taken over when it is free, what lay behind it is not.
    pub birth: u64,
    pub keeping: Keeping,
    /// As this frame wants it.
    pub shape: Shape,
    /// As the newest frame that ran left it; none before there was one.
    left: Option<Shape>,
    /// That frame wrote it, and no cut came after.
    fresh: bool,
    /// Bytes of a kept buffer that hold something.
    pub valid_bytes: u64,
    /// What each layer of a kept image was made from; none where it was not made.
    held: Vec<Option<u64>>,
    /// What this frame wants of each layer.
    wanted: Vec<u64>,
    /// This frame declared it.
    pub declared: bool,
}

impl Entry {
    /// Whether its contents are those of the frame before. Frames that were declared and never ran change nothing.
    pub fn is_valid(&self) -> bool {
        self.fresh && self.left == Some(self.shape)
    }
}

type Key = (u32, Cow<'static, str>);

/// Every history and kept buffer of one executor.
#[derive(Default)]
pub(super) struct Book(Mutex<Pages>);

#[derive(Default)]
pub(super) struct Pages {
    entries: HashMap<Key, Entry>,
    /// Slots that are free again, and the first never used: a frame like the last gets the same ones.
    free: Vec<u32>,
    next_slot: u32,
    births: u64,
}

impl Book {
    pub fn open(&self) -> MutexGuard<'_, Pages> {
        // A page is whole at every point where a holder of the lock could panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pages {
    /// A frame begins: nothing is declared.
    pub fn begin(&mut self) {
        self.entries.values_mut().for_each(|entry| entry.declared = false);
    }

    /// The camera jumped: nothing that was seen before is of use. What kept buffers hold is no picture, and stays.
    pub fn cut(&mut self) {
        self.entries.values_mut().filter(|e| e.keeping == Keeping::Pair).for_each(|entry| entry.fresh = false);
    }

    /// Forgets everything, kept buffers too.
    pub fn clear(&mut self) {
        *self = Self { births: self.births, ..Self::default() };
    }

    /// Declares a pair for this frame; gives its slot and whether it is valid. `None` when this frame has declared it already.
    pub fn declare_pair(&mut self, scope: &HistoryScope, name: Cow<'static, str>, shape: Shape) -> Option<(u32, bool)> {
        let entry = self.declare(scope, name, Keeping::Pair, shape)?;
        entry.shape = shape;
        Some((entry.slot, entry.is_valid()))
    }

    /// Declares a kept buffer of at least `bytes` bytes; gives its slot, its size and how much of it is valid.
    pub fn declare_kept(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        bytes: u64,
    ) -> Option<(u32, u64, u64)> {
        let entry = self.declare(scope, name, Keeping::Single, Shape::Buffer { bytes })?;
        // By half at least, so that one that grows by a little each frame is copied few times. What a frame that did not run
        // asked for does not count.
        let held = entry.left.map_or(0, Shape::bytes);
        let grown = if bytes > held { bytes.max(held + held / 2) } else { held };
        entry.shape = Shape::Buffer { bytes: grown };
        Some((entry.slot, grown, entry.valid_bytes))
    }

    /// Declares a kept image, whose layers are to be made from what these keys stand for; gives its slot and the layers that are not.
    pub fn declare_layers(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        shape: Shape,
        keys: &[u64],
    ) -> Option<(u32, Vec<u32>)> {
        let entry = self.declare(scope, name, Keeping::Layers, shape)?;
        (entry.shape, entry.wanted) = (shape, keys.to_vec());
        let there = entry.left == Some(shape);
        let holds = |layer: usize| there && entry.held.get(layer).copied().flatten() == Some(keys[layer]);
        let stale = (0..keys.len()).filter(|layer| !holds(*layer)).map(|layer| layer as u32).collect();
        Some((entry.slot, stale))
    }

    fn declare(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        keeping: Keeping,
        shape: Shape,
    ) -> Option<&mut Entry> {
        let Self { entries, free, next_slot, births } = self;
        let mut new = |slot: u32| {
            *births += 1;
            let (held, wanted) = (Vec::new(), Vec::new());
            let (left, fresh, valid_bytes, declared) = (None, false, 0, false);
            Entry { slot, birth: *births, keeping, shape, left, fresh, valid_bytes, held, wanted, declared }
        };
        let entry = entries.entry((scope.0, name)).or_insert_with(|| {
            let slot = free.pop().unwrap_or_else(|| {
                *next_slot += 1;
                *next_slot - 1
            });
            new(slot)
        });
        if entry.declared {
            return None;
        }
        if entry.keeping != keeping {
            *entry = new(entry.slot); // one name for two things, one after the other
        }
        entry.declared = true;
        Some(entry)
    }

    /// What the frame declared, by slot, in no particular order.
    pub fn declared(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values().filter(|e| e.declared)
    }

    /// Something that is not finite was met in a kept image: none of its layers holds what it should.
    pub fn distrust(&mut self, slot: u32) {
        let layers = self.entries.values_mut().filter(|e| e.slot == slot && e.keeping == Keeping::Layers);
        layers.for_each(|entry| entry.held.fill(None));
    }

    /// The frame ran: `written` says which slots it wrote. What it did not declare is forgotten.
    pub fn end(&mut self, written: impl Fn(u32) -> bool) {
        let free = &mut self.free;
        self.entries.retain(|_, entry| {
            if !entry.declared {
                free.push(entry.slot);
                return false;
            }
            let written = written(entry.slot);
            if entry.keeping == Keeping::Layers && (written || entry.left != Some(entry.shape)) {
                // A frame that wrote any layer wrote all that were stale.
                entry.held = entry.wanted.iter().map(|key| written.then_some(*key)).collect();
            }
            (entry.left, entry.fresh) = (Some(entry.shape), written);
            if written {
                entry.valid_bytes = entry.shape.bytes();
            }
            true
        });
        free.sort_unstable_by(|a, b| b.cmp(a));
    }
}

impl FrameGraph {
    /// A layered image that keeps what it holds from frame to frame, camera cuts or not. `keys`, one for each layer, stand for
    /// everything that the layers are made from; a layer is stale where the newest frame that wrote the image had another key for
    /// it, and in another size or format. A frame that reads the image writes every stale layer first, and where there is none it
    /// needs no pass to do so. What was never written is zero. It lasts as long as each frame declares it.
    pub fn kept_layers(
        &mut self,
        scope: &HistoryScope,
        name: impl Into<Cow<'static, str>>,
        desc: ImageDesc,
        keys: &[u64],
    ) -> KeptLayers {
        let name = name.into();
        let desc = ImageDesc { layers: keys.len() as u32, ..desc };
        let shape = self.image_shape(&name, desc);
        let declared = self.book.open().declare_layers(scope, name.clone(), shape, keys);
        let (slot, stale) = declared.unwrap_or_else(|| {
            self.errors.push(GraphError::DuplicateHistory { name: name.clone().into_owned() });
            (u32::MAX, Vec::new())
        });
        let last = in_any_pass(Access::Sample);
        let image: Handle<Image> = self.import(&name, shape, last, Access::Sample.layout(), ImportKey::Kept(slot));
        self.leave(image, Access::Sample, Domain::Compute);
        KeptLayers { image: WriteHandle::new(image), stale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(side: u32) -> Shape {
        use super::super::{Extent, Format};
        Shape::Image { format: Format::R8Unorm, extent: Extent::new(side, side), mips: 1, layers: 1 }
    }

    #[test]
    fn a_history_is_valid_from_its_second_frame_on_until_something_breaks_it() {
        let (scope, mut pages) = (HistoryScope::new(), Pages::default());
        let frame = |pages: &mut Pages, side: u32, written: bool| {
            pages.begin();
            let (slot, valid) = pages.declare_pair(&scope, "colour".into(), image(side)).unwrap();
            pages.end(|s| written && s == slot);
            (slot, valid)
        };
        let (slot, valid) = frame(&mut pages, 8, true);
        assert!(!valid);
        assert_eq!(frame(&mut pages, 8, true), (slot, true));
        pages.cut();
        assert_eq!(frame(&mut pages, 8, true), (slot, false));
        assert_eq!(frame(&mut pages, 16, true), (slot, false), "another size");
        assert_eq!(frame(&mut pages, 16, false), (slot, true));
        assert!(!frame(&mut pages, 16, true).1, "the frame before did not write it");
        pages.begin();
        pages.end(|_| false);
        assert!(!frame(&mut pages, 16, true).1, "the frame before did not declare it");
    }

    #[test]
    fn another_instance_starts_anew() {
        let (one, two, mut pages) = (HistoryScope::new(), HistoryScope::new(), Pages::default());
        pages.begin();
        let (slot, _) = pages.declare_pair(&one, "colour".into(), image(8)).unwrap();
        assert!(pages.declare_pair(&one, "colour".into(), image(8)).is_none(), "twice in one frame");
        pages.end(|_| true);
        pages.begin();
        let (other, valid) = pages.declare_pair(&two, "colour".into(), image(8)).unwrap();
        assert!(!valid && other != slot);
        pages.end(|_| true);
        assert_eq!(pages.entries.len(), 1, "the first is forgotten");
    }

    #[test]
    fn kept_buffers_grow_and_survive_a_cut() {
        let (scope, mut pages) = (HistoryScope::new(), Pages::default());
        let mut frame = |bytes: u64, cut: bool| {
            pages.begin();
            if cut {
                pages.cut();
            }
            let (_, held, valid) = pages.declare_kept(&scope, "surfels".into(), bytes).unwrap();
            pages.end(|_| true);
            (held, valid)
        };
        assert_eq!(frame(100, false), (100, 0));
        assert_eq!(frame(100, true), (100, 100));
        assert_eq!(frame(110, false), (150, 100));
        assert_eq!(frame(400, false), (400, 150));
        assert_eq!(frame(10, false), (400, 400));
    }

    #[test]
    fn distrusted_layers_are_stale_until_they_are_made_again() {
        let (scope, mut pages) = (HistoryScope::new(), Pages::default());
        let mut frame = |distrusted: bool| {
            pages.begin();
            let (slot, stale) = pages.declare_layers(&scope, "map".into(), image(8), &[7, 9]).unwrap();
            pages.end(|_| !stale.is_empty());
            if distrusted {
                pages.distrust(slot);
            }
            stale
        };
        assert_eq!(frame(false), [0, 1]);
        assert_eq!(frame(true), [0; 0]);
        assert_eq!(frame(false), [0, 1]);
        assert_eq!(frame(false), [0; 0]);
    }

    #[test]
    fn frames_that_did_not_run_change_nothing() {
        let (scope, mut pages) = (HistoryScope::new(), Pages::default());
        let mut declare = |side: u32, bytes: u64, runs: bool| {
            pages.begin();
            let (_, valid) = pages.declare_pair(&scope, "colour".into(), image(side)).unwrap();
            let (_, held, valid_bytes) = pages.declare_kept(&scope, "surfels".into(), bytes).unwrap();
            if runs {
                pages.end(|_| true);
            }
            (valid, held, valid_bytes)
        };
        assert_eq!(declare(8, 100, true), (false, 100, 0));
        assert_eq!(declare(16, 1 << 60, false), (false, 1 << 60, 100));
        assert_eq!(declare(8, 100, true), (true, 100, 100));
        assert_eq!(declare(16, 100, true), (false, 100, 100));
    }

    #[test]
    fn nothing_is_taken_over_with_a_slot() {
        let (one, two, mut pages) = (HistoryScope::new(), HistoryScope::new(), Pages::default());
        let mut frame = |scope: &HistoryScope, kept: bool| {
            pages.begin();
            let (slot, valid) = if kept {
                pages.declare_kept(scope, "thing".into(), 64).map(|(slot, _, valid)| (slot, valid > 0)).unwrap()
            } else {
                pages.declare_pair(scope, "thing".into(), Shape::Buffer { bytes: 64 }).unwrap()
            };
            let birth = pages.declared().next().unwrap().birth;
            pages.end(|_| true);
            (slot, birth, valid)
        };
        let first = frame(&one, false);
        assert_eq!(frame(&one, false), (first.0, first.1, true));
        let as_kept = frame(&one, true);
        assert!(as_kept.0 == first.0 && as_kept.1 != first.1 && !as_kept.2, "one name for two things: {as_kept:?}");
        let other = frame(&two, true);
        assert!(other.0 != first.0 && !other.2);
        let again = frame(&one, true);
        assert!(again.0 == first.0 && again.1 != as_kept.1 && !again.2, "it was forgotten meanwhile: {again:?}");
    }

    #[test]
    fn layers_are_stale_until_a_frame_with_their_key_wrote_them() {
        let (scope, mut pages) = (HistoryScope::new(), Pages::default());
        let mut frame = |side: u32, keys: [u64; 3], written: bool, cut: bool| {
            pages.begin();
            if cut {
                pages.cut();
            }
            let (_, stale) = pages.declare_layers(&scope, "map".into(), image(side), &keys).unwrap();
            pages.end(|_| written);
            stale
        };
        assert_eq!(frame(8, [1, 2, 3], false, false), [0, 1, 2]);
        assert_eq!(frame(8, [1, 2, 3], true, false), [0, 1, 2], "nobody wrote them");
        assert_eq!(frame(8, [1, 2, 3], false, true), [0; 0], "a cut of the camera changes nothing");
        assert_eq!(frame(8, [1, 5, 3], false, false), [1]);
        assert_eq!(frame(8, [1, 2, 3], false, false), [0; 0], "what was wanted and not written never came");
        assert_eq!(frame(8, [4, 2, 6], true, false), [0, 2]);
        assert_eq!(frame(8, [4, 2, 6], false, false), [0; 0]);
        assert_eq!(frame(16, [4, 2, 6], false, false), [0, 1, 2], "another size");
        assert_eq!(frame(8, [4, 2, 6], false, false), [0, 1, 2], "its memory is gone");
    }

    #[test]
    fn a_kept_buffer_that_nobody_wrote_holds_nothing() {
        let (scope, mut pages) = (HistoryScope::new(), Pages::default());
        let mut frame = |written: bool| {
            pages.begin();
            let (_, _, valid) = pages.declare_kept(&scope, "surfels".into(), 100).unwrap();
            pages.end(|_| written);
            valid
        };
        assert_eq!([frame(false), frame(true), frame(false), frame(false)], [0, 0, 100, 100]);
        pages.clear();
        pages.begin();
        assert_eq!(pages.declare_kept(&scope, "surfels".into(), 100), Some((0, 100, 0)));
    }
}
