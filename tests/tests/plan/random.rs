//! Random frames: any sequence of bytes is a script that declares a frame without mistakes.

use magpie::graph::{
    Access, Buffer, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, Image, ImageDesc, ImageState, ImportKey,
    PassBuilder, Queue, Record, Tlas, WriteHandle,
};
use proptest::prelude::*;

/// What a random frame does.
#[derive(Clone, Debug)]
pub struct Script {
    /// Imported images: last use, what they are left for.
    images: Vec<(u8, u8)>,
    /// Imported buffers: last use, what they are left for.
    buffers: Vec<(u8, u8)>,
    /// Last use of the acceleration structure.
    tlas: u8,
    steps: Vec<Step>,
    /// Versions that the frame is made for.
    outputs: Vec<u8>,
}

/// One pass.
#[derive(Clone, Debug)]
struct Step {
    kind: u8,
    weak: bool,
    queue: u8,
    /// What it does, and with which resource.
    actions: Vec<(u8, u8)>,
}

/// Scripts of frames with up to a dozen passes.
pub fn scripts() -> impl Strategy<Value = Script> {
    let pair = || (any::<u8>(), any::<u8>());
    let actions = prop::collection::vec(pair(), 0..6);
    let step = (any::<u8>(), prop::bool::weighted(0.25), any::<u8>(), actions)
        .prop_map(|(kind, weak, queue, actions)| Step { kind, weak, queue, actions });
    let imports = || prop::collection::vec(pair(), 0..3);
    let outputs = prop::collection::vec(any::<u8>(), 0..4);
    (imports(), imports(), any::<u8>(), prop::collection::vec(step, 1..13), outputs)
        .prop_map(|(images, buffers, tlas, steps, outputs)| Script { images, buffers, tlas, steps, outputs })
}

struct Picture {
    /// Absent only while a pass changes it.
    write: Option<WriteHandle<Image>>,
    depth: bool,
    half: bool,
    defined: bool,
    /// Last step that used it.
    used: usize,
}

struct Bytes {
    write: Option<WriteHandle<Buffer>>,
    read_by: usize,
    written_by: usize,
}

struct World {
    pictures: Vec<Picture>,
    bytes: Vec<Bytes>,
    tlas: Handle<Tlas>,
    /// The step that is declared, from 1.
    step: usize,
    has_depth: bool,
}

impl Script {
    /// Declares the frame.
    pub fn declare(&self) -> FrameGraph {
        let mut g = FrameGraph::new(Extent::new(33, 17));
        let mut world = self.import(&mut g);
        let mut versions: Vec<Handle<Image>> = Vec::new();
        for (i, step) in self.steps.iter().enumerate() {
            (world.step, world.has_depth) = (i + 1, false);
            let name = format!("step{i}");
            let queue = [Queue::Graphics, Queue::AsyncCompute, Queue::Transfer][step.queue as usize % 3];
            let declare = |p: &mut PassBuilder<'_>| {
                for (n, &(action, pick)) in step.actions.iter().enumerate() {
                    match step.kind % 5 {
                        0 | 1 => world.raster(p, action, pick as usize, n),
                        2 | 3 => world.compute(p, action, pick as usize, n),
                        _ => world.copy(p, action, pick as usize),
                    }
                }
                ((), |_: &mut Record| {})
            };
            if step.weak {
                g.weak_pass(&name, queue, declare)
            } else {
                g.pass(&name, queue, declare)
            }
            versions.extend(world.pictures.iter().filter_map(|p| p.write.as_ref()).map(WriteHandle::read));
        }
        for &pick in &self.outputs {
            if let Some(&version) = versions.get(pick as usize % versions.len().max(1)) {
                g.output(version);
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
            Some((Access::CopyRead, Domain::Copy)),
        ];
        let pick = |list: &[Option<(Access, Domain)>], byte: u8| list[byte as usize % list.len()];
        let mut pictures = Vec::new();
        for (i, &(last, leave)) in self.images.iter().enumerate() {
            let state = ImageState { access: pick(&states, last) };
            let desc = ImageDesc::full(Format::Rgba16Float);
            let write = g.import_image(&format!("image{i}"), desc, state, ImportKey::Caller(i as u32));
            if let Some((access, domain)) = pick(&states, leave) {
                g.leave(write.read(), access, domain);
            }
            let defined = state.access.is_some();
            pictures.push(Picture { write: Some(write), depth: false, half: false, defined, used: 0 });
        }
        let before = [Access::HostRead, Access::BufferRead, Access::BufferReadWrite, Access::CopyWrite, Access::Index];
        let after = [None, Some((Access::HostRead, Domain::Copy)), Some((Access::BufferRead, Domain::Compute))];
        let mut bytes = Vec::new();
        for (i, &(last, leave)) in self.buffers.iter().enumerate() {
            let last = before[last as usize % before.len()];
            let write = g.import_buffer(&format!("buffer{i}"), BufferDesc::new(64), last, ImportKey::Caller(100 + i as u32));
            if let Some((access, domain)) = pick(&after, leave) {
                g.leave(write.read(), access, domain);
            }
            bytes.push(Bytes { write: Some(write), read_by: 0, written_by: 0 });
        }
        let last = [Access::Trace, Access::CopyWrite, Access::BufferWrite][self.tlas as usize % 3];
        let tlas = g.import_tlas("tlas", last, ImportKey::Caller(200));
        World { pictures, bytes, tlas, step: 0, has_depth: false }
    }
}

impl World {
    fn raster(&mut self, p: &mut PassBuilder<'_>, action: u8, pick: usize, n: usize) {
        let name = format!("target{n}");
        match action % 8 {
            0 | 1 => {
                let (write, _) = p.color(&name, ImageDesc::full(Format::Rgba16Float), [0.0; 4]);
                self.add_picture(write, false, false);
            }
            2 if !self.has_depth => {
                let (write, _) = p.depth(&name, ImageDesc::full(Format::D32Float), 0.0);
                self.has_depth = true;
                self.add_picture(write, true, false);
            }
            3 => self.change(pick, |i| i.defined && !i.half && !i.depth, |w| p.color_load(w).0),
            4 if !self.has_depth => {
                let before = self.used_now();
                self.change(pick, |i| i.depth, |w| p.depth_load(w).0);
                self.has_depth = self.used_now() > before;
            }
            5 => self.read_buffer(pick, |b| drop_token(p.index(b))),
            _ => self.shader(p, action / 8, pick),
        }
    }

    fn compute(&mut self, p: &mut PassBuilder<'_>, action: u8, pick: usize, n: usize) {
        let name = format!("made{n}");
        match action % 8 {
            0 => {
                let half = pick.is_multiple_of(2);
                let format = Format::Rgba16Float;
                let desc = if half { ImageDesc::half(format) } else { ImageDesc::full(format) };
                let (write, _) = p.create(&name, desc);
                self.add_picture(write, false, half);
            }
            1 => {
                let (write, _) = p.create_buffer(&name, BufferDesc::new(1 + pick as u64));
                self.bytes.push(Bytes { write: Some(write), read_by: 0, written_by: self.step });
            }
            _ => self.shader(p, action / 8, pick),
        }
    }

    /// What any shader can do.
    fn shader(&mut self, p: &mut PassBuilder<'_>, action: u8, pick: usize) {
        match action % 8 {
            0 | 1 => self.see(pick, |_| true, |h| drop_token(p.sample(h))),
            2 => self.see(pick, |i| !i.depth, |h| drop_token(p.storage(h))),
            3 => self.change(pick, |i| !i.depth, |w| p.write(w).0),
            4 => self.read_buffer(pick, |b| drop_token(p.read(b))),
            5 => self.read_buffer(pick, |b| drop_token(p.indirect(b))),
            6 => self.change_buffer(pick, |w| p.write_buffer(w).0),
            _ => drop_token(p.trace(self.tlas)),
        }
    }

    fn copy(&mut self, p: &mut PassBuilder<'_>, action: u8, pick: usize) {
        match action % 4 {
            0 => self.see(pick, |_| true, |h| drop_token(p.copy_from(h))),
            1 => self.read_buffer(pick, |b| drop_token(p.copy_from(b))),
            2 => self.change(pick, |_| true, |w| p.copy_to(w).0),
            _ => self.change_buffer(pick, |w| p.copy_to(w).0),
        }
    }

    fn add_picture(&mut self, write: WriteHandle<Image>, depth: bool, half: bool) {
        self.pictures.push(Picture { write: Some(write), depth, half, defined: true, used: self.step });
    }

    fn used_now(&self) -> usize {
        self.pictures.iter().filter(|i| i.used == self.step).count()
    }

    fn picture(&mut self, pick: usize, suits: impl Fn(&Picture) -> bool) -> Option<&mut Picture> {
        let step = self.step;
        let mut free: Vec<_> = self.pictures.iter_mut().filter(|i| i.used != step && suits(i)).collect();
        let count = free.len();
        if count == 0 { None } else { Some(free.swap_remove(pick % count)) }
    }

    fn see(&mut self, pick: usize, suits: impl Fn(&Picture) -> bool, read: impl FnMut(Handle<Image>)) {
        let step = self.step;
        let Some(image) = self.picture(pick, |i| i.defined && suits(i)) else { return };
        image.used = step;
        image.write.as_ref().map(WriteHandle::read).into_iter().for_each(read);
    }

    fn change(
        &mut self,
        pick: usize,
        suits: impl Fn(&Picture) -> bool,
        write: impl FnOnce(WriteHandle<Image>) -> WriteHandle<Image>,
    ) {
        let step = self.step;
        let Some(image) = self.picture(pick, suits) else { return };
        (image.used, image.defined) = (step, true);
        image.write = image.write.take().map(write);
    }

    fn read_buffer(&mut self, pick: usize, read: impl FnMut(Handle<Buffer>)) {
        let step = self.step;
        let count = self.bytes.len().max(1);
        let Some(buffer) = self.bytes.get_mut(pick % count).filter(|b| b.written_by != step) else { return };
        buffer.read_by = step;
        buffer.write.as_ref().map(WriteHandle::read).into_iter().for_each(read);
    }

    fn change_buffer(&mut self, pick: usize, write: impl FnOnce(WriteHandle<Buffer>) -> WriteHandle<Buffer>) {
        let step = self.step;
        let count = self.bytes.len().max(1);
        let free = |b: &&mut Bytes| b.read_by != step && b.written_by != step;
        let Some(buffer) = self.bytes.get_mut(pick % count).filter(free) else { return };
        buffer.written_by = step;
        buffer.write = buffer.write.take().map(write);
    }
}

/// Nothing is recorded, so tokens are of no use.
fn drop_token<T>(_: T) {}
