//! Dependencies between passes, which hold in whatever order they run.
//!
//! Each part of each resource is followed through the passes in the order of declaration. A read depends on the write before it.
//! A write depends on the reads since the last write, or on that write if nothing read it. With several queues, a layout
//! transition for a reader counts as a write, since other queues must not read during it.

use super::{
    super::{
        access::{Layout, Queue},
        declaration::{Declaration, Origin},
    },
    subresources::Subresources,
};

/// Dependencies between kept passes, by their index in the declaration.
pub(super) struct Hazards {
    /// Start of each pass's range in `before`, and one end.
    first: Vec<u32>,
    before: Vec<u32>,
}

impl Hazards {
    /// The passes that must run before this one.
    pub fn before(&self, pass: u32) -> &[u32] {
        &self.before[self.first[pass as usize] as usize..self.first[pass as usize + 1] as usize]
    }
}

const NONE: u32 = u32::MAX;

/// State of one subresource while it is followed.
#[derive(Clone, Copy)]
struct State {
    writer: u32,
    /// Index in `reads` of the newest read since the last write.
    readers: u32,
    /// The reader that transitions the layout for the readers after it; [`NONE`] if the writer's queue does.
    leader: u32,
    layout: Layout,
}

/// The dependencies of the passes in `kept`, which are in the order of declaration.
pub(super) fn hazards(
    declaration: &Declaration,
    kept: &[u32],
    subresources: &Subresources,
    queues: &[Queue],
) -> Hazards {
    let several_queues = queues.iter().any(|queue| *queue != Queue::Graphics);
    let unused = State { writer: NONE, readers: NONE, leader: NONE, layout: Layout::Undefined };
    let mut states = vec![unused; subresources.count()];
    for (resource, decl) in declaration.resources.iter().enumerate() {
        if let Origin::Imported { layout, .. } = decl.origin {
            for subresource in subresources.of_resource(resource as u32) {
                states[subresource as usize].layout = layout;
            }
        }
    }
    // Reads of all subresources; each is linked to the previous one of its subresource.
    let mut reads: Vec<(u32, u32)> = Vec::with_capacity(declaration.uses.len());
    let mut first = vec![0; declaration.passes.len() + 1];
    let mut before: Vec<u32> = Vec::with_capacity(declaration.uses.len());
    let mut position = 0;
    for pass in 0..declaration.passes.len() as u32 {
        first[pass as usize] = before.len() as u32;
        if kept.get(position) != Some(&pass) {
            continue;
        }
        position += 1;
        let begin = before.len();
        for u in declaration.uses_of(pass) {
            for subresource in subresources.of(u) {
                let state = &mut states[subresource as usize];
                let layout = declaration.resources[u.resource as usize].shape.layout(u.access);
                let moves = several_queues && layout != state.layout && !u.access.writes();
                if u.access.writes() || moves {
                    let mut read = state.readers;
                    // Right after a write, the writer's queue transitions the layout for all readers at once.
                    let is_first = read == NONE && state.writer != NONE;
                    if is_first {
                        before.push(state.writer);
                    }
                    while read != NONE {
                        let (reader, next) = reads[read as usize];
                        before.push(reader);
                        read = next;
                    }
                    state.layout = layout;
                    state.readers = NONE;
                    if u.access.writes() {
                        (state.writer, state.leader) = (pass, NONE);
                    } else {
                        state.leader = if is_first { NONE } else { pass };
                    }
                }
                if !u.access.writes() {
                    before.extend([state.leader, state.writer].into_iter().filter(|&p| p != NONE));
                    reads.push((pass, state.readers));
                    state.readers = reads.len() as u32 - 1;
                }
            }
        }
        // The list is short, so it is sorted and deduplicated in place.
        let own = &mut before[begin..];
        own.sort_unstable();
        let mut length = 0;
        for i in 0..own.len() {
            if own[i] != pass && (length == 0 || own[length - 1] != own[i]) {
                own[length] = own[i];
                length += 1;
            }
        }
        before.truncate(begin + length);
    }
    first[declaration.passes.len()] = before.len() as u32;
    Hazards { first, before }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::*;

    fn declared(build: impl FnOnce(&mut FrameGraph)) -> Declaration {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        build(&mut g);
        g.finish().unwrap().declaration
    }

    fn hazards_of(declaration: &Declaration, queues: &[Queue]) -> Vec<Vec<u32>> {
        let kept: Vec<u32> = (0..declaration.passes.len() as u32).collect();
        let found = hazards(declaration, &kept, &Subresources::new(declaration), queues);
        kept.iter().map(|&p| found.before(p).to_vec()).collect()
    }

    fn read(g: &mut FrameGraph, name: &str, image: Handle<Image>) {
        g.pass(name, Queue::Graphics, |p| (drop_token(p.sample(image)), |_: &mut Record| {}));
    }

    fn drop_token<T>(_: T) {}

    #[test]
    fn a_write_waits_for_reads_and_they_for_the_write_before() {
        let declaration = declared(|g| {
            let desc = ImageDesc::full(Format::R32Float);
            let x = g.pass("0", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
            read(g, "1", x.read());
            read(g, "2", x.read());
            let x = g.pass("3", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
            read(g, "4", x.read());
        });
        let one = vec![Queue::Graphics; 5];
        assert_eq!(hazards_of(&declaration, &one), [vec![], vec![0], vec![0], vec![1, 2], vec![3]]);
    }

    #[test]
    fn mips_are_apart() {
        let declaration = declared(|g| {
            let desc = ImageDesc { mips: 3, ..ImageDesc::full(Format::R32Float) };
            let x = g.pass("0", Queue::Graphics, |p| (p.create_part("x", desc, Part::mip(0)).0, |_: &mut Record| {}));
            let x = g.pass("1", Queue::Graphics, |p| {
                p.sample_part(x.read(), Part::mip(0));
                (p.write_part(x, Part::mip(1)).0, |_: &mut Record| {})
            });
            let x = g.pass("2", Queue::Graphics, |p| (p.write_part(x, Part::mip(2)).0, |_: &mut Record| {}));
            read(g, "3", x.read());
        });
        let one = vec![Queue::Graphics; 4];
        assert_eq!(hazards_of(&declaration, &one), [vec![], vec![0], vec![], vec![0, 1, 2]]);
    }

    #[test]
    fn on_several_queues_a_reader_that_changes_the_layout_goes_first() {
        let declaration = declared(|g| {
            let desc = ImageDesc::full(Format::R32Float);
            let state = ImageState::last(Access::ColorLoad, Domain::Raster);
            let x = g.import_image("x", desc, state, ImportKey::Caller(0));
            read(g, "0", x.read());
            read(g, "1", x.read());
            g.pass("2", Queue::Graphics, |p| (drop_token(p.storage(x.read())), |_: &mut Record| {}));
        });
        let one = vec![Queue::Graphics; 3];
        assert_eq!(hazards_of(&declaration, &one), [vec![], vec![], Vec::<u32>::new()]);
        let two = [Queue::Graphics, Queue::AsyncCompute, Queue::Graphics];
        assert_eq!(hazards_of(&declaration, &two), [vec![], vec![0], vec![0, 1]]);
    }
}
