//! Resources that outlive a frame: histories, which pass an image or buffer from each frame to the next, and kept buffers and
//! kept layered images, whose contents stay until a pass changes them.
//!
//! A history is a pair of objects. Each frame reads one and writes the other, and they swap after the frame was submitted. What is read
//! is valid if the previous frame wrote it, in the same size and format, for the same scope, and without a camera cut in between.
//! If it is not valid, it reads as zero, never as an older frame.

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

/// Identifies the owner of histories. Each instance of an effect has its own, so that switching the implementation of a slot
/// starts with empty histories.
#[derive(Debug, PartialEq, Eq, Hash)]
pub struct HistoryScope(u32);

static SCOPES: AtomicU32 = AtomicU32::new(0);

impl HistoryScope {
    /// A new scope, different from all others.
    #[allow(clippy::new_without_default, reason = "two defaults would not be equal")]
    pub fn new() -> Self {
        Self(SCOPES.fetch_add(1, Ordering::Relaxed))
    }
}

/// An image that is passed from frame to frame.
#[derive(Debug)]
pub struct History {
    /// What the previous frame wrote; all zeros if `valid` is false.
    pub previous: Handle<Image>,
    /// What this frame writes. Its contents are undefined before, so every pixel must be written.
    pub next: WriteHandle<Image>,
    /// Whether `previous` holds what the previous frame wrote.
    pub valid: bool,
}

/// A buffer that is passed from frame to frame.
#[derive(Debug)]
pub struct BufferHistory {
    /// What the previous frame wrote; all zeros if `valid` is false.
    pub previous: Handle<Buffer>,
    /// What this frame writes. Its contents are undefined before, so every byte must be written.
    pub next: WriteHandle<Buffer>,
    /// Whether `previous` holds what the previous frame wrote.
    pub valid: bool,
}

/// A buffer that keeps its contents from frame to frame, and grows when more is asked for.
#[derive(Debug)]
pub struct KeptBuffer {
    /// The buffer, to be read or changed in place.
    pub buffer: WriteHandle<Buffer>,
    /// Number of bytes from its start that hold data of earlier frames; the rest is zero.
    pub valid_bytes: u64,
}

/// A layered image that keeps its contents from frame to frame, such as a shadow map: each layer is redrawn only when its inputs change.
#[derive(Debug)]
pub struct KeptLayers {
    /// The image, with one layer per key.
    pub image: WriteHandle<Image>,
    /// Indices of the layers whose contents are not those of their key, ascending. A frame that reads the image must write all of
    /// them first.
    pub stale: Vec<u32>,
}

/// How a resource outlives a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Persistence {
    /// A history: two objects, swapped each frame.
    History,
    /// A kept buffer.
    Buffer,
    /// A kept image, with a key per layer for what it was made from.
    Layers,
}

/// The state of one history, kept buffer or kept image.
#[derive(Clone, Debug)]
pub(super) struct HistoryEntry {
    /// Number by which the executor finds the objects behind it. Numbers are reused.
    pub index: u32,
    /// Unique, unlike `index`: tells objects of a new entry from those of an old one with the same index.
    pub generation: u64,
    pub persistence: Persistence,
    /// Shape in the current frame.
    pub shape: Shape,
    /// Shape in the last frame that ran and declared it; `None` before there was one.
    last_shape: Option<Shape>,
    /// Whether that frame wrote it, and no camera cut came after.
    is_current: bool,
    /// Size in bytes of the valid part of a kept buffer.
    pub valid_bytes: u64,
    /// Keys with which the layers of a kept image were last written; `None` for a layer without valid contents.
    layer_keys: Vec<Option<u64>>,
    /// Keys of the layers that the current frame asks for.
    wanted_layer_keys: Vec<u64>,
    /// Whether the current frame has declared it.
    pub declared: bool,
}

impl HistoryEntry {
    /// Whether it holds what the previous frame wrote. Frames that were declared but did not run do not count.
    pub fn is_valid(&self) -> bool {
        self.is_current && self.last_shape == Some(self.shape)
    }
}

type Key = (u32, Cow<'static, str>);

/// All histories, kept buffers and kept images of one executor.
#[derive(Default)]
pub(super) struct SharedHistoryRegistry(Mutex<HistoryRegistry>);

#[derive(Default)]
pub(super) struct HistoryRegistry {
    entries: HashMap<Key, HistoryEntry>,
    /// Indices that are free, largest first, and the first that was never used: equal frames get equal numbers.
    free: Vec<u32>,
    next_index: u32,
    generations: u64,
}

impl SharedHistoryRegistry {
    pub fn lock(&self) -> MutexGuard<'_, HistoryRegistry> {
        // No method leaves the registry in a broken state when it panics, so a poisoned lock is usable.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl HistoryRegistry {
    /// Begins a frame, in which nothing is declared yet.
    pub fn begin_frame(&mut self) {
        self.entries.values_mut().for_each(|entry| entry.declared = false);
    }

    /// Camera cut: invalidates the histories. Kept buffers and images do not depend on the view, and stay.
    pub fn cut(&mut self) {
        self.entries
            .values_mut()
            .filter(|e| e.persistence == Persistence::History)
            .for_each(|entry| entry.is_current = false);
    }

    /// Discards everything, kept buffers and images too.
    pub fn clear(&mut self) {
        *self = Self { generations: self.generations, ..Self::default() };
    }

    /// Declares a history for this frame. Returns its index and whether it is valid, or `None` if this frame has declared it already.
    pub fn declare_history(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        shape: Shape,
    ) -> Option<(u32, bool)> {
        let entry = self.declare(scope, name, Persistence::History, shape)?;
        entry.shape = shape;
        Some((entry.index, entry.is_valid()))
    }

    /// Declares a kept buffer of at least `bytes` bytes. Returns its index, its size and the size of the valid part, or `None` as above.
    pub fn declare_kept_buffer(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        bytes: u64,
    ) -> Option<(u32, u64, u64)> {
        let entry = self.declare(scope, name, Persistence::Buffer, Shape::Buffer { bytes })?;
        // Grows by at least half, so that a buffer that grows a little each frame is rarely copied. Requests of frames that did
        // not run are ignored.
        let layer_keys = entry.last_shape.map_or(0, Shape::bytes);
        let grown = if bytes > layer_keys { bytes.max(layer_keys + layer_keys / 2) } else { layer_keys };
        entry.shape = Shape::Buffer { bytes: grown };
        Some((entry.index, grown, entry.valid_bytes))
    }

    /// Declares a kept image with one key per layer. Returns its index and the stale layers, or `None` as above.
    pub fn declare_kept_layers(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        shape: Shape,
        keys: &[u64],
    ) -> Option<(u32, Vec<u32>)> {
        let entry = self.declare(scope, name, Persistence::Layers, shape)?;
        (entry.shape, entry.wanted_layer_keys) = (shape, keys.to_vec());
        let there = entry.last_shape == Some(shape);
        let holds = |layer: usize| there && entry.layer_keys.get(layer).copied().flatten() == Some(keys[layer]);
        let stale = (0..keys.len()).filter(|layer| !holds(*layer)).map(|layer| layer as u32).collect();
        Some((entry.index, stale))
    }

    fn declare(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        persistence: Persistence,
        shape: Shape,
    ) -> Option<&mut HistoryEntry> {
        let Self { entries, free, next_index, generations } = self;
        let mut new = |index: u32| {
            *generations += 1;
            let (layer_keys, wanted_layer_keys) = (Vec::new(), Vec::new());
            let (last_shape, is_current, valid_bytes, declared) = (None, false, 0, false);
            HistoryEntry {
                index,
                generation: *generations,
                persistence,
                shape,
                last_shape,
                is_current,
                valid_bytes,
                layer_keys,
                wanted_layer_keys,
                declared,
            }
        };
        let entry = entries.entry((scope.0, name)).or_insert_with(|| {
            let index = free.pop().unwrap_or_else(|| {
                *next_index += 1;
                *next_index - 1
            });
            new(index)
        });
        if entry.declared {
            return None;
        }
        if entry.persistence != persistence {
            *entry = new(entry.index); // the name was used for another kind before
        }
        entry.declared = true;
        Some(entry)
    }

    /// The entries that the current frame declared, in no particular order.
    pub fn declared(&self) -> impl Iterator<Item = &HistoryEntry> {
        self.entries.values().filter(|e| e.declared)
    }

    /// A non-finite value was read from a kept image: all its layers become stale.
    pub fn invalidate_layers(&mut self, index: u32) {
        let layers = self.entries.values_mut().filter(|e| e.index == index && e.persistence == Persistence::Layers);
        layers.for_each(|entry| entry.layer_keys.fill(None));
    }

    /// Called after the frame was submitted. `written` tells which indices it wrote. Entries that it did not declare are removed.
    pub fn end_frame(&mut self, written: impl Fn(u32) -> bool) {
        let free = &mut self.free;
        self.entries.retain(|_, entry| {
            if !entry.declared {
                free.push(entry.index);
                return false;
            }
            let written = written(entry.index);
            if entry.persistence == Persistence::Layers && (written || entry.last_shape != Some(entry.shape)) {
                // A frame that writes any layer writes all stale ones.
                entry.layer_keys = entry.wanted_layer_keys.iter().map(|key| written.then_some(*key)).collect();
            }
            (entry.last_shape, entry.is_current) = (Some(entry.shape), written);
            if written {
                entry.valid_bytes = entry.shape.bytes();
            }
            true
        });
        free.sort_unstable_by(|a, b| b.cmp(a));
    }
}

impl FrameGraph {
    /// Declares a layered image that keeps its contents from frame to frame, across camera cuts too. `keys`, one per layer,
    /// identify everything that a layer is made from. A layer is stale if the last frame that wrote the image had another key for
    /// it, or another size or format. A frame that reads the image must first write every stale layer; if there is none, it needs
    /// no pass for that. Layers that were never written are zero. The image is freed after a frame that does not declare it.
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
        let declared = self.histories.lock().declare_kept_layers(scope, name.clone(), shape, keys);
        let (index, stale) = declared.unwrap_or_else(|| {
            self.errors.push(GraphError::DuplicateHistory { name: name.clone().into_owned() });
            (u32::MAX, Vec::new())
        });
        let last = in_any_pass(Access::Sample);
        let image: Handle<Image> = self.import(&name, shape, last, Access::Sample.layout(), ImportKey::Kept(index));
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
        let (scope, mut registry) = (HistoryScope::new(), HistoryRegistry::default());
        let frame = |registry: &mut HistoryRegistry, side: u32, written: bool| {
            registry.begin_frame();
            let (index, valid) = registry.declare_history(&scope, "colour".into(), image(side)).unwrap();
            registry.end_frame(|s| written && s == index);
            (index, valid)
        };
        let (index, valid) = frame(&mut registry, 8, true);
        assert!(!valid);
        assert_eq!(frame(&mut registry, 8, true), (index, true));
        registry.cut();
        assert_eq!(frame(&mut registry, 8, true), (index, false));
        assert_eq!(frame(&mut registry, 16, true), (index, false), "another size");
        assert_eq!(frame(&mut registry, 16, false), (index, true));
        assert!(!frame(&mut registry, 16, true).1, "the frame before did not write it");
        registry.begin_frame();
        registry.end_frame(|_| false);
        assert!(!frame(&mut registry, 16, true).1, "the frame before did not declare it");
    }

    #[test]
    fn another_instance_starts_anew() {
        let (one, two, mut registry) = (HistoryScope::new(), HistoryScope::new(), HistoryRegistry::default());
        registry.begin_frame();
        let (index, _) = registry.declare_history(&one, "colour".into(), image(8)).unwrap();
        assert!(registry.declare_history(&one, "colour".into(), image(8)).is_none(), "twice in one frame");
        registry.end_frame(|_| true);
        registry.begin_frame();
        let (other, valid) = registry.declare_history(&two, "colour".into(), image(8)).unwrap();
        assert!(!valid && other != index);
        registry.end_frame(|_| true);
        assert_eq!(registry.entries.len(), 1, "the first is forgotten");
    }

    #[test]
    fn kept_buffers_grow_and_survive_a_cut() {
        let (scope, mut registry) = (HistoryScope::new(), HistoryRegistry::default());
        let mut frame = |bytes: u64, cut: bool| {
            registry.begin_frame();
            if cut {
                registry.cut();
            }
            let (_, layer_keys, valid) = registry.declare_kept_buffer(&scope, "surfels".into(), bytes).unwrap();
            registry.end_frame(|_| true);
            (layer_keys, valid)
        };
        assert_eq!(frame(100, false), (100, 0));
        assert_eq!(frame(100, true), (100, 100));
        assert_eq!(frame(110, false), (150, 100));
        assert_eq!(frame(400, false), (400, 150));
        assert_eq!(frame(10, false), (400, 400));
    }

    #[test]
    fn distrusted_layers_are_stale_until_they_are_made_again() {
        let (scope, mut registry) = (HistoryScope::new(), HistoryRegistry::default());
        let mut frame = |distrusted: bool| {
            registry.begin_frame();
            let (index, stale) = registry.declare_kept_layers(&scope, "map".into(), image(8), &[7, 9]).unwrap();
            registry.end_frame(|_| !stale.is_empty());
            if distrusted {
                registry.invalidate_layers(index);
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
        let (scope, mut registry) = (HistoryScope::new(), HistoryRegistry::default());
        let mut declare = |side: u32, bytes: u64, runs: bool| {
            registry.begin_frame();
            let (_, valid) = registry.declare_history(&scope, "colour".into(), image(side)).unwrap();
            let (_, layer_keys, valid_bytes) = registry.declare_kept_buffer(&scope, "surfels".into(), bytes).unwrap();
            if runs {
                registry.end_frame(|_| true);
            }
            (valid, layer_keys, valid_bytes)
        };
        assert_eq!(declare(8, 100, true), (false, 100, 0));
        assert_eq!(declare(16, 1 << 60, false), (false, 1 << 60, 100));
        assert_eq!(declare(8, 100, true), (true, 100, 100));
        assert_eq!(declare(16, 100, true), (false, 100, 100));
    }

    #[test]
    fn nothing_is_taken_over_with_an_index() {
        let (one, two, mut registry) = (HistoryScope::new(), HistoryScope::new(), HistoryRegistry::default());
        let mut frame = |scope: &HistoryScope, kept: bool| {
            registry.begin_frame();
            let (index, valid) = if kept {
                registry
                    .declare_kept_buffer(scope, "thing".into(), 64)
                    .map(|(index, _, valid)| (index, valid > 0))
                    .unwrap()
            } else {
                registry.declare_history(scope, "thing".into(), Shape::Buffer { bytes: 64 }).unwrap()
            };
            let generation = registry.declared().next().unwrap().generation;
            registry.end_frame(|_| true);
            (index, generation, valid)
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
        let (scope, mut registry) = (HistoryScope::new(), HistoryRegistry::default());
        let mut frame = |side: u32, keys: [u64; 3], written: bool, cut: bool| {
            registry.begin_frame();
            if cut {
                registry.cut();
            }
            let (_, stale) = registry.declare_kept_layers(&scope, "map".into(), image(side), &keys).unwrap();
            registry.end_frame(|_| written);
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
        let (scope, mut registry) = (HistoryScope::new(), HistoryRegistry::default());
        let mut frame = |written: bool| {
            registry.begin_frame();
            let (_, _, valid) = registry.declare_kept_buffer(&scope, "surfels".into(), 100).unwrap();
            registry.end_frame(|_| written);
            valid
        };
        assert_eq!([frame(false), frame(true), frame(false), frame(false)], [0, 0, 100, 100]);
        registry.clear();
        registry.begin_frame();
        assert_eq!(registry.declare_kept_buffer(&scope, "surfels".into(), 100), Some((0, 100, 0)));
    }
}
