//! Random frames: any numbers are a script that declares a valid frame.

use magpie::graph::{
    Access, Blas, Buffer, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, HistoryScope, Image, ImageDesc,
    ImageState, ImportKey, Kind, Part, PassBuilder, Queue, Record, Size, Tlas, WriteHandle,
};
use proptest::prelude::*;

/// A script of a frame.
#[derive(Clone, Debug)]
pub struct Script {
    /// Imported images: last use, requested final state.
    images: Vec<(u8, u8)>,
    /// Imported buffers: last use, requested final state.
    buffers: Vec<(u8, u8)>,
    /// Histories and kept buffers.
    histories: Vec<u8>,
    /// Last use of a caller's acceleration structure.
    tlas: u8,
    steps: Vec<Step>,
    /// Outputs of the frame, as choices of versions.
    outputs: Vec<u8>,
}

/// One pass.
#[derive(Clone, Debug)]
struct Step {
    kind: u8,
    weak: bool,
    queue: u8,
    /// Actions: kind, choice of resource, choice of part.
    actions: Vec<(u8, u8, u8)>,
}

/// Scripts of frames with up to `most` passes.
pub fn scripts(most: usize) -> impl Strategy<Value = Script> {
    let pair = || (any::<u8>(), any::<u8>());
    let actions = prop::collection::vec((any::<u8>(), any::<u8>(), any::<u8>()), 1..6);
    let step = (any::<u8>(), prop::bool::weighted(0.2), any::<u8>(), actions)
        .prop_map(|(kind, weak, queue, actions)| Step { kind, weak, queue, actions });
    let imports = || prop::collection::vec(pair(), 0..3);
    let bytes = |most: usize| prop::collection::vec(any::<u8>(), 0..most);
    (imports(), imports(), bytes(3), any::<u8>(), prop::collection::vec(step, 1..most), bytes(6)).prop_map(
        |(images, buffers, histories, tlas, steps, outputs)| Script {
            images,
            buffers,
            histories,
            tlas,
            steps,
            outputs,
        },
    )
}

/// A resource and what the script may do with it.
struct Item<K> {
    /// None while a pass writes it, and if it is read-only.
    write: Option<WriteHandle<K>>,
    read: Handle<K>,
    defined: bool,
    /// Last step that used it, and which further reads are allowed there.
    step: usize,
    again: Option<Access>,
    depth: bool,
    storable: bool,
    size: (Extent, u32, u32),
}

impl<K: Kind> Item<K> {
    fn new(write: WriteHandle<K>, step: usize) -> Self {
        let read = write.read();
        Self { write: Some(write), ..Self::only_read(read, step) }
    }

    fn only_read(read: Handle<K>, step: usize) -> Self {
        let size = (Extent::new(1, 1), 1, 1);
        Self { write: None, read, defined: true, step, again: None, depth: false, storable: true, size }
    }
}

struct World {
    images: Vec<Item<Image>>,
    buffers: Vec<Item<Buffer>>,
    blas: Vec<Item<Blas>>,
    tlas: Vec<Item<Tlas>>,
    /// Index of the step that is being declared, from 1.
    step: usize,
    /// Size of its attachments.
    target: Option<Extent>,
    has_depth: bool,
}

const EXTENTS: [Extent; 3] =
    [Extent { width: 33, height: 17 }, Extent { width: 17, height: 9 }, Extent { width: 64, height: 64 }];
const FORMATS: [Format; 4] = [Format::Rgba16Float, Format::R8Unorm, Format::Rgba32Float, Format::Rgba8Srgb];

impl Script {
    /// Declares the frame.
    pub fn declare(&self) -> FrameGraph {
        let mut g = FrameGraph::new(EXTENTS[0]);
        let mut world = self.import(&mut g);
        let mut wanted: Vec<Wanted> = Vec::new();
        for (i, step) in self.steps.iter().enumerate() {
            (world.step, world.has_depth, world.target) = (i + 1, false, None);
            let name = format!("step{i}");
            let queue = [Queue::Graphics, Queue::AsyncCompute, Queue::Transfer][step.queue as usize % 3];
            let declare = |p: &mut PassBuilder<'_>| {
                for (n, &(action, pick, part)) in step.actions.iter().enumerate() {
                    let act = Act { name: format!("{n}"), action, pick: pick as usize, part };
                    match step.kind % 6 {
                        0 | 1 => world.raster(p, &act),
                        2 | 3 => world.compute(p, &act),
                        4 => world.build(p, &act),
                        _ => world.copy(p, &act),
                    }
                }
                ((), |_: &mut Record<'_>| {})
            };
            if step.weak {
                g.weak_pass(&name, queue, declare)
            } else {
                g.pass(&name, queue, declare)
            }
            wanted.extend(world.images.iter().map(|i| Wanted::Image(i.read)));
            wanted.extend(world.buffers.iter().map(|i| Wanted::Buffer(i.read)));
            wanted.extend(world.tlas.iter().map(|i| Wanted::Tlas(i.read)));
        }
        for &pick in &self.outputs {
            // Late versions more often, as they need more passes.
            let count = wanted.len().max(1);
            let pick = pick as usize;
            match wanted.get(if pick.is_multiple_of(2) { pick % count } else { count - 1 - pick % count.min(9) }) {
                Some(Wanted::Image(handle)) => g.output(*handle),
                Some(Wanted::Buffer(handle)) => g.output(*handle),
                Some(Wanted::Tlas(handle)) => g.output(*handle),
                None => {}
            }
        }
        g
    }

    fn import(&self, g: &mut FrameGraph) -> World {
        let states = [
            None,
            Some((Access::Sample, Domain::Compute)),
            Some((Access::Sample, Domain::Raster)),
            Some((Access::ColorLoad, Domain::Raster)),
            Some((Access::StorageReadWrite, Domain::Compute)),
            Some((Access::StorageRead, Domain::Raster)),
            Some((Access::CopyRead, Domain::Copy)),
            Some((Access::CopyWrite, Domain::Copy)),
        ];
        let pick = |list: &[Option<(Access, Domain)>], byte: u8| list[byte as usize % list.len()];
        let mut world = World {
            images: Vec::new(),
            buffers: Vec::new(),
            blas: Vec::new(),
            tlas: Vec::new(),
            step: 0,
            target: None,
            has_depth: false,
        };
        for (i, &(last, leave)) in self.images.iter().enumerate() {
            let state = ImageState { access: pick(&states, last) };
            let mips = 1 + u32::from(last / 8) % 3;
            let desc = ImageDesc { mips, ..ImageDesc::full(Format::Rgba16Float) };
            let write = g.import_image(&format!("image{i}"), desc, state, ImportKey::Caller(i as u32));
            if let Some((access, domain)) = pick(&states, leave) {
                g.leave(write.read(), access, domain);
            }
            let defined = state.access.is_some();
            world.images.push(Item { defined, size: (EXTENTS[0], mips, 1), ..Item::new(write, 0) });
        }
        let before = [Access::HostRead, Access::BufferRead, Access::BufferReadWrite, Access::CopyWrite, Access::Index];
        let after = [
            None,
            Some((Access::HostRead, Domain::Copy)),
            Some((Access::BufferRead, Domain::Compute)),
            Some((Access::BufferReadWrite, Domain::Raster)),
        ];
        for (i, &(last, leave)) in self.buffers.iter().enumerate() {
            let last = before[last as usize % before.len()];
            let key = ImportKey::Caller(100 + i as u32);
            let write = g.import_buffer(&format!("buffer{i}"), BufferDesc::new(64), last, key);
            if let Some((access, domain)) = pick(&after, leave) {
                g.leave(write.read(), access, domain);
            }
            world.buffers.push(Item::new(write, 0));
        }
        let scope = HistoryScope::new();
        for (i, kind) in self.histories.iter().enumerate() {
            let name = format!("history{i}");
            match kind % 3 {
                0 => {
                    let h = g.history(&scope, name, ImageDesc::full(Format::Rgba16Float));
                    let size = (EXTENTS[0], 1, 1);
                    world.images.push(Item { size, ..Item::only_read(h.previous, 0) });
                    world.images.push(Item { defined: false, size, ..Item::new(h.next, 0) });
                }
                1 => {
                    let h = g.history_buffer(&scope, name, BufferDesc::new(96));
                    world.buffers.push(Item::only_read(h.previous, 0));
                    world.buffers.push(Item { defined: false, ..Item::new(h.next, 0) });
                }
                _ => world.buffers.push(Item::new(g.kept_buffer(&scope, name, BufferDesc::new(80)).buffer, 0)),
            }
        }
        let last = [Access::Trace, Access::CopyWrite, Access::BufferWrite, Access::Build][self.tlas as usize % 4];
        world.tlas.push(Item::only_read(g.import_tlas("tlas", last, ImportKey::Caller(200)), 0));
        world
    }
}

enum Wanted {
    Image(Handle<Image>),
    Buffer(Handle<Buffer>),
    Tlas(Handle<Tlas>),
}

/// One action of a pass.
struct Act {
    name: String,
    action: u8,
    pick: usize,
    part: u8,
}

impl Act {
    fn desc(&self, extent: Extent, storable: bool) -> ImageDesc {
        let formats = if storable { 3 } else { 4 };
        let format = FORMATS[usize::from(self.part / 4) % formats];
        let mips = [1, 1, 1, 2, 3, 4][usize::from(self.part) % 6];
        let layers = [1, 1, 1, 2, 3][usize::from(self.part / 6) % 5];
        ImageDesc { format, size: Size::Fixed(extent), mips, layers }
    }

    /// A random part of an image.
    fn part(&self, (_, mips, layers): (Extent, u32, u32)) -> Part {
        let (first, some) = (u32::from(self.part), u32::from(self.part / 8));
        let range = |all: u32, first: u32, some: u32| {
            let first = first % all;
            (first as u16, (1 + some % (all - first)) as u16)
        };
        let (mip, mip_count) = range(mips, first, some);
        let (layer, layer_count) = range(layers, first / 2, some / 2);
        match self.part % 4 {
            0 => Part::ALL,
            1 => Part::mip(mip.into()),
            2 => Part::layer(layer.into()),
            _ => Part { mip, mips: mip_count, layer, layers: layer_count },
        }
    }
}

impl World {
    fn raster(&mut self, p: &mut PassBuilder<'_>, act: &Act) {
        let extent = self.target.unwrap_or(EXTENTS[act.pick % EXTENTS.len()]);
        let fits = |i: &Item<Image>, target: Option<Extent>| i.defined && target.is_none_or(|t| t == i.size.0);
        let target = self.target;
        match act.action % 10 {
            0..=2 => {
                let desc = ImageDesc { layers: 1, ..act.desc(extent, false) };
                let (write, _) = p.color(&act.name, desc, [0.0; 4]);
                self.add_image(write, desc, extent);
                self.target = Some(extent);
            }
            3 if !self.has_depth => {
                let desc = ImageDesc::fixed(Format::D32Float, extent);
                let (write, _) = p.depth(&act.name, desc, 0.0);
                self.add_image(write, desc, extent);
                (self.has_depth, self.target) = (true, Some(extent));
            }
            4 => {
                let suits = |i: &Item<Image>| !i.depth && fits(i, target);
                let size = change(&mut self.images, self.step, act.pick, suits, |w| p.color_load(w).0);
                self.target = self.target.or(size.map(|s| s.0));
            }
            5 if !self.has_depth => {
                let suits = |i: &Item<Image>| i.depth && fits(i, target);
                let size = change(&mut self.images, self.step, act.pick, suits, |w| p.depth_load(w).0);
                self.has_depth = size.is_some();
                self.target = self.target.or(size.map(|s| s.0));
            }
            // Only a pass with attachments draws.
            6 if target.is_some() => {
                see(&mut self.buffers, self.step, act.pick, Access::Index, |_| true, |h, _| drop_token(p.index(h)))
            }
            7 if !self.has_depth => {
                let (mut size, suits) = (None, |i: &Item<Image>| i.depth && fits(i, target));
                see(&mut self.images, self.step, act.pick, Access::DepthTest, suits, |h, all| {
                    drop_token(p.depth_test(h));
                    size = Some(all.0);
                });
                self.has_depth = size.is_some();
                self.target = self.target.or(size);
            }
            _ => self.shader(p, act),
        }
    }

    fn compute(&mut self, p: &mut PassBuilder<'_>, act: &Act) {
        match act.action % 10 {
            0..=2 => {
                let extent = EXTENTS[act.pick % EXTENTS.len()];
                let desc = act.desc(extent, true);
                let full = (extent, desc.mips, desc.layers);
                let part = if act.pick.is_multiple_of(3) { act.part(full) } else { Part::ALL };
                let (write, _) = p.create_part(&act.name, desc, part);
                self.add_image(write, desc, extent);
            }
            3 => {
                let (write, _) = p.create_buffer(&act.name, BufferDesc::new(1 + 7 * act.pick as u64));
                self.buffers.push(Item::new(write, self.step));
            }
            4 | 5 => self.next_mip(p, act),
            _ => self.shader(p, act),
        }
    }

    /// Reads one mip and writes the next.
    fn next_mip(&mut self, p: &mut PassBuilder<'_>, act: &Act) {
        let suits = |i: &Item<Image>| i.defined && i.storable && i.size.1 > 1;
        change(&mut self.images, self.step, act.pick, suits, |w| {
            let mip = u32::from(act.part) % (p.desc(w.read()).mips - 1);
            drop_token(p.sample_part(w.read(), Part::mip(mip)));
            p.write_part(w, Part::mip(mip + 1)).0
        });
    }

    /// Actions of any shader.
    fn shader(&mut self, p: &mut PassBuilder<'_>, act: &Act) {
        let (step, pick) = (self.step, act.pick);
        match act.action / 10 % 10 {
            0..=2 => {
                see(
                    &mut self.images,
                    step,
                    pick,
                    Access::Sample,
                    |_| true,
                    |h, size| {
                        drop_token(p.sample_part(h, act.part(size)));
                    },
                );
            }
            3 => {
                see(
                    &mut self.images,
                    step,
                    pick,
                    Access::StorageRead,
                    |i| i.storable,
                    |h, size| {
                        drop_token(p.storage_part(h, act.part(size)));
                    },
                );
            }
            4 | 5 => {
                let part = |p: &PassBuilder<'_>, w: &WriteHandle<Image>| {
                    let desc = p.desc(w.read());
                    act.part((p.extent(w.read()), desc.mips, desc.layers))
                };
                change(
                    &mut self.images,
                    step,
                    pick,
                    |i| i.storable,
                    |w| {
                        let part = part(p, &w);
                        p.write_part(w, part).0
                    },
                );
            }
            6 => see(&mut self.buffers, step, pick, Access::BufferRead, |_| true, |h, _| drop_token(p.read(h))),
            7 => see(&mut self.buffers, step, pick, Access::Indirect, |_| true, |h, _| drop_token(p.indirect(h))),
            8 => drop(change(&mut self.buffers, step, pick, |_| true, |w| p.write_buffer(w).0)),
            _ => see(&mut self.tlas, step, pick, Access::Trace, |_| true, |h, _| drop_token(p.trace(h))),
        }
    }

    /// Builds, refits and compacts acceleration structures.
    fn build(&mut self, p: &mut PassBuilder<'_>, act: &Act) {
        let (step, pick, name) = (self.step, act.pick, act.name.as_str());
        let bytes = 64 + 16 * u64::from(act.part);
        match act.action % 8 {
            0 | 1 => {
                see(&mut self.buffers, step, pick, Access::BuildInput, |_| true, |h, _| drop_token(p.build_input(h)));
                drop_token(p.scratch(&format!("{name}.scratch"), BufferDesc::new(bytes)));
                let (write, _) = p.build::<Blas>(name, bytes);
                self.blas.push(Item::new(write, step));
            }
            2 | 3 => {
                see(&mut self.blas, step, pick, Access::BuildInput, |_| true, |h, _| drop_token(p.build_input(h)));
                drop_token(p.scratch(&format!("{name}.scratch"), BufferDesc::new(bytes)));
                let (write, _) = p.build::<Tlas>(name, bytes);
                self.tlas.push(Item::new(write, step));
            }
            4 => {
                let mut smaller = None;
                see(
                    &mut self.blas,
                    step,
                    pick,
                    Access::BuildInput,
                    |_| true,
                    |h, _| {
                        smaller = Some(p.compact(name, h, bytes).0);
                    },
                );
                self.blas.extend(smaller.map(|w| Item::new(w, step)));
            }
            5 => drop(change(&mut self.blas, step, pick, |_| true, |w| p.refit(w).0)),
            6 => drop(change(&mut self.tlas, step, pick, |_| true, |w| p.refit(w).0)),
            _ => {
                let (write, _) = p.build_in_shader::<Tlas>(name, bytes);
                self.tlas.push(Item::new(write, step));
            }
        }
    }

    fn copy(&mut self, p: &mut PassBuilder<'_>, act: &Act) {
        let (step, pick) = (self.step, act.pick);
        match act.action % 4 {
            0 => see(&mut self.images, step, pick, Access::CopyRead, |_| true, |h, _| drop_token(p.copy_from(h))),
            1 => see(&mut self.buffers, step, pick, Access::CopyRead, |_| true, |h, _| drop_token(p.copy_from(h))),
            2 => drop(change(&mut self.images, step, pick, |_| true, |w| p.copy_to(w).0)),
            _ => drop(change(&mut self.buffers, step, pick, |_| true, |w| p.copy_to(w).0)),
        }
    }

    fn add_image(&mut self, write: WriteHandle<Image>, desc: ImageDesc, extent: Extent) {
        let (depth, storable) = (desc.format.is_depth(), desc.format.is_storable());
        self.images.push(Item {
            depth,
            storable,
            size: (extent, desc.mips, desc.layers),
            ..Item::new(write, self.step)
        });
    }
}

/// One of the suitable items; half of the time one of the newest.
fn choose<K>(items: &mut [Item<K>], pick: usize, suits: impl Fn(&Item<K>) -> bool) -> Option<&mut Item<K>> {
    let mut free: Vec<_> = items.iter_mut().filter(|i| suits(i)).collect();
    let count = free.len();
    let at = if pick.is_multiple_of(2) { pick / 2 % count.max(1) } else { count.saturating_sub(1 + pick / 2 % 3) };
    if count == 0 { None } else { Some(free.swap_remove(at)) }
}

/// Reads one of the items, if there is one.
fn see<K: Kind>(
    items: &mut [Item<K>],
    step: usize,
    pick: usize,
    access: Access,
    suits: impl Fn(&Item<K>) -> bool,
    read: impl FnOnce(Handle<K>, (Extent, u32, u32)),
) {
    let free = |i: &Item<K>| i.step != step || i.again.is_some_and(|a| a.layout() == access.layout());
    let Some(item) = choose(items, pick, |i| i.defined && free(i) && suits(i)) else { return };
    (item.step, item.again) = (step, Some(access));
    read(item.read, item.size);
}

/// Writes one of the items, if there is one; returns its size.
fn change<K: Kind>(
    items: &mut [Item<K>],
    step: usize,
    pick: usize,
    suits: impl Fn(&Item<K>) -> bool,
    write: impl FnOnce(WriteHandle<K>) -> WriteHandle<K>,
) -> Option<(Extent, u32, u32)> {
    let item = choose(items, pick, |i| i.step != step && i.write.is_some() && suits(i))?;
    (item.step, item.again, item.defined) = (step, None, true);
    let new = write(item.write.take()?);
    item.read = new.read();
    item.write = Some(new);
    Some(item.size)
}

/// Nothing is recorded, so tokens are not needed.
fn drop_token<T>(_: T) {}
