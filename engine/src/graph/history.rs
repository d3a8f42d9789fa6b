//! What outlives a frame: histories, which hand images or buffers from each frame to the next, and buffers that keep what they
//! hold.
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
    declaration::Shape,
    handle::{Buffer, Handle, Image, WriteHandle},
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

/// How something outlives a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keeping {
    /// Two halves in turn.
    Pair,
    /// One buffer.
    Single,
}

/// What is known of one history or kept buffer.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Its number, by which the executor knows the objects behind it.
    pub slot: u32,
    pub keeping: Keeping,
    pub shape: Shape,
    /// Its contents are those of the frame before.
    pub valid: bool,
    /// Bytes of a kept buffer that hold something.
    pub valid_bytes: u64,
    /// This frame declared it.
    pub declared: bool,
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

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The camera jumped: nothing that was seen before is of use. What kept buffers hold is no picture, and stays.
    pub fn cut(&mut self) {
        self.entries.values_mut().filter(|e| e.keeping == Keeping::Pair).for_each(|entry| entry.valid = false);
    }

    /// Declares a pair for this frame; gives its slot and whether it is valid. `None` when this frame has declared it already.
    pub fn declare_pair(&mut self, scope: &HistoryScope, name: Cow<'static, str>, shape: Shape) -> Option<(u32, bool)> {
        let entry = self.entry(scope, name, Keeping::Pair, shape);
        if entry.declared {
            return None;
        }
        if entry.shape != shape {
            (entry.shape, entry.valid) = (shape, false);
        }
        entry.declared = true;
        Some((entry.slot, entry.valid))
    }

    /// Declares a kept buffer of at least `bytes` bytes; gives its slot, its size and how much of it is valid.
    pub fn declare_kept(
        &mut self,
        scope: &HistoryScope,
        name: Cow<'static, str>,
        bytes: u64,
    ) -> Option<(u32, u64, u64)> {
        let entry = self.entry(scope, name, Keeping::Single, Shape::Buffer { bytes });
        if entry.declared {
            return None;
        }
        // By half at least, so that one that grows by a little each frame is copied few times.
        let held = entry.shape.bytes();
        let grown = if bytes > held { bytes.max(held + held / 2) } else { held };
        (entry.shape, entry.declared) = (Shape::Buffer { bytes: grown }, true);
        Some((entry.slot, grown, entry.valid_bytes))
    }

    fn entry(&mut self, scope: &HistoryScope, name: Cow<'static, str>, keeping: Keeping, shape: Shape) -> &mut Entry {
        let (free, next) = (&mut self.free, &mut self.next_slot);
        self.entries.entry((scope.0, name)).or_insert_with(|| {
            let slot = free.pop().unwrap_or_else(|| {
                *next += 1;
                *next - 1
            });
            Entry { slot, keeping, shape, valid: false, valid_bytes: 0, declared: false }
        })
    }

    /// What the frame declared, by slot, in no particular order.
    pub fn declared(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values().filter(|e| e.declared)
    }

    /// The frame ran: `written` says which slots it wrote. What it did not declare or write is forgotten.
    pub fn end(&mut self, written: impl Fn(u32) -> bool) {
        let free = &mut self.free;
        self.entries.retain(|_, entry| {
            let keep = match entry.keeping {
                Keeping::Pair => {
                    entry.valid = entry.declared && written(entry.slot);
                    entry.valid
                }
                Keeping::Single => {
                    entry.valid_bytes = entry.shape.bytes();
                    entry.declared
                }
            };
            if !keep {
                free.push(entry.slot);
            }
            keep
        });
        free.sort_unstable_by(|a, b| b.cmp(a));
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
            pages.end(|_| false);
            (held, valid)
        };
        assert_eq!(frame(100, false), (100, 0));
        assert_eq!(frame(100, true), (100, 100));
        assert_eq!(frame(110, false), (150, 100));
        assert_eq!(frame(400, false), (400, 150));
        assert_eq!(frame(10, false), (400, 400));
    }
}
