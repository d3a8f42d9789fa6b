//! What must wait for what, and how images change layout.
//!
//! Each resource is followed through the passes in order. Reads wait for the last write, and only where an earlier barrier has
//! not shown it to them already; writes wait for every read since the last write, or for that write where nothing read it.

use super::super::{
    access::{Access, Domain, Layout, Uses},
    declaration::{Declaration, Origin, ResourceDecl, Shape},
};

/// Barriers that go together: all that stand before one pass, or at the end of the frame.
pub type BarrierBatch = Vec<Barrier>;

/// One resource, made ready for one use. It covers the whole of it: all mips, all bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Barrier {
    /// Index of the resource.
    pub resource: u32,
    /// Uses that must be over. Their writes become visible to `to`.
    pub from: Uses,
    /// The use that waits.
    pub to: (Access, Domain),
    /// Layout before; [`Layout::Undefined`] for buffers and acceleration structures.
    pub layout_from: Layout,
    /// Layout after; [`Layout::Undefined`] for buffers and acceleration structures.
    pub layout_to: Layout,
    /// Contents before are not kept.
    pub discard: bool,
}

/// One batch before each pass of `order`, and one after the last that leaves imported resources as they are asked for.
pub(super) fn barriers(declaration: &Declaration, order: &[u32]) -> Vec<BarrierBatch> {
    let mut states: Vec<State> = declaration.resources.iter().map(State::new).collect();
    let mut batches: Vec<BarrierBatch> = order
        .iter()
        .map(|&pass| {
            let decl = &declaration.passes[pass as usize];
            let uses = decl.uses.iter();
            uses.filter_map(|u| states[u.resource as usize].advance(u.resource, u.access.at(decl.domain))).collect()
        })
        .collect();
    let leaving = declaration.resources.iter().enumerate().filter_map(|(resource, decl)| match decl.origin {
        Origin::Imported { leave: Some(to), .. } => states[resource].advance(resource as u32, to),
        Origin::Imported { leave: None, .. } | Origin::Transient => None,
    });
    batches.push(leaving.collect());
    batches
}

/// What is known of a resource at one point of the frame.
struct State {
    /// Only images have layouts.
    is_image: bool,
    layout: Layout,
    /// Whether its contents may be lost: nothing has used it yet, and it came without any.
    fresh: bool,
    /// What a read has to wait for: the last write, or the use that the last change of layout was made for.
    source: Uses,
    /// Reads since the source.
    readers: Uses,
    /// Uses that see the source's contents without a further barrier.
    visible: Uses,
}

impl State {
    fn new(decl: &ResourceDecl) -> Self {
        let unknown = Self {
            is_image: matches!(decl.shape, Shape::Image { .. }),
            layout: Layout::Undefined,
            fresh: true,
            source: Uses::ANY,
            readers: Uses::EMPTY,
            visible: Uses::EMPTY,
        };
        match decl.origin {
            // The memory was something else's a moment ago, or was used so in the frame before.
            Origin::Transient => unknown,
            Origin::Imported { .. } if decl.is_undefined() => unknown,
            Origin::Imported { last, layout, .. } => {
                let readers: Uses = last.iter().filter(|(access, _)| !access.writes()).collect();
                Self { layout, fresh: false, source: last, readers, visible: readers, ..unknown }
            }
        }
    }

    /// Moves on to the next use; gives the barrier that must stand before it, if any.
    fn advance(&mut self, resource: u32, to: (Access, Domain)) -> Option<Barrier> {
        let layout = if self.is_image { to.0.layout() } else { Layout::Undefined };
        let changes = self.fresh || layout != self.layout || to.0.writes();
        if !changes && self.visible.contains(to) {
            self.readers.insert(to);
            return None;
        }
        // Whoever changes contents or layout waits for the readers, and they have waited for the source. Whoever reads waits
        // for the source alone.
        let from = if changes && !self.readers.is_empty() { self.readers } else { self.source };
        let barrier = Barrier { resource, from, to, layout_from: self.layout, layout_to: layout, discard: self.fresh };
        if changes {
            // A change of layout is ordered before `to`, so who comes later is ordered after it by waiting for `to`.
            *self = Self {
                layout,
                fresh: false,
                source: Uses::of(to),
                readers: Uses::EMPTY,
                visible: Uses::EMPTY,
                ..*self
            };
        }
        if !to.0.writes() {
            self.readers.insert(to);
            self.visible.insert(to);
        }
        Some(barrier)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::*;

    fn use_as(g: &mut FrameGraph, name: &str, image: Handle<Image>, how: Access) {
        let keep = g.import_buffer(name, BufferDesc::new(4), Access::HostRead, ImportKey(0));
        let _ = g.pass(name, Queue::Graphics, |p| {
            match how {
                Access::Sample => {
                    p.sample(image);
                }
                Access::StorageRead => {
                    p.storage(image);
                }
                other => panic!("no test reads as {other}"),
            }
            (p.write_buffer(keep).0, |_: &mut Record| {})
        });
    }

    fn draw_with(g: &mut FrameGraph, name: &str, image: Handle<Image>) {
        let drawn = g.pass(name, Queue::Graphics, |p| {
            p.sample(image);
            (p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]).0, |_: &mut Record| {})
        });
        g.output(drawn.read());
    }

    fn made(g: &mut FrameGraph) -> WriteHandle<Image> {
        let desc = ImageDesc::full(Format::Rgba16Float);
        g.pass("make", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}))
    }

    /// Barriers of one resource, by batch.
    fn barriers_of(g: FrameGraph, resource: u32) -> Vec<Vec<Barrier>> {
        let frame = g.finish().unwrap();
        let plan = plan(&frame.declaration);
        assert_eq!(plan.barriers.len(), plan.order.len() + 1);
        let of = |batch: &BarrierBatch| batch.iter().copied().filter(|b| b.resource == resource).collect();
        plan.barriers.iter().map(of).collect()
    }

    const WRITE: (Access, Domain) = (Access::StorageWrite, Domain::Compute);
    const CHANGE: (Access, Domain) = (Access::StorageReadWrite, Domain::Compute);
    const SAMPLE: (Access, Domain) = (Access::Sample, Domain::Compute);
    const DRAW: (Access, Domain) = (Access::Sample, Domain::Raster);

    fn first() -> Barrier {
        Barrier {
            resource: 0,
            from: Uses::ANY,
            to: WRITE,
            layout_from: Layout::Undefined,
            layout_to: Layout::General,
            discard: true,
        }
    }

    fn step(from: &[(Access, Domain)], to: (Access, Domain), layouts: (Layout, Layout)) -> Barrier {
        let from = from.iter().copied().collect();
        Barrier { resource: 0, from, to, layout_from: layouts.0, layout_to: layouts.1, discard: false }
    }

    #[test]
    fn readers_in_one_layout_share_a_barrier_per_domain() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        use_as(&mut g, "a", x.read(), Access::Sample);
        use_as(&mut g, "b", x.read(), Access::Sample);
        draw_with(&mut g, "c", x.read());
        draw_with(&mut g, "d", x.read());
        let to_read = step(&[WRITE], SAMPLE, (Layout::General, Layout::ShaderRead));
        // The draw waits for the compute pass that the layout was changed for: that is what orders it after the change.
        let again = step(&[SAMPLE], DRAW, (Layout::ShaderRead, Layout::ShaderRead));
        assert_eq!(barriers_of(g, 0), [vec![first()], vec![to_read], vec![], vec![again], vec![], vec![]]);
    }

    #[test]
    fn a_write_waits_for_all_readers() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        use_as(&mut g, "a", x.read(), Access::Sample);
        draw_with(&mut g, "b", x.read());
        let x = g.pass("change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        g.output(x.read());
        let to_write = step(&[SAMPLE, DRAW], CHANGE, (Layout::ShaderRead, Layout::General));
        assert_eq!(barriers_of(g, 0)[3], [to_write]);
    }

    #[test]
    fn writes_wait_for_writes() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        let x = g.pass("change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        let x = g.pass("again", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        g.output(x.read());
        let general = (Layout::General, Layout::General);
        let expected =
            [vec![first()], vec![step(&[WRITE], CHANGE, general)], vec![step(&[CHANGE], CHANGE, general)], vec![]];
        assert_eq!(barriers_of(g, 0), expected);
    }

    #[test]
    fn storage_reads_stay_in_the_layout_of_the_write() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let x = made(&mut g);
        use_as(&mut g, "a", x.read(), Access::StorageRead);
        let read = step(&[WRITE], (Access::StorageRead, Domain::Compute), (Layout::General, Layout::General));
        assert_eq!(barriers_of(g, 0), [vec![first()], vec![read], vec![]]);
    }

    #[test]
    fn one_buffer_read_in_three_ways() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let buffer =
            g.pass("make", Queue::Graphics, |p| (p.create_buffer("b", BufferDesc::new(64)).0, |_: &mut Record| {}));
        let drawn = g.pass("draw", Queue::Graphics, |p| {
            p.read(buffer.read());
            p.read(buffer.read());
            p.index(buffer.read());
            p.indirect(buffer.read());
            (p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]).0, |_: &mut Record| {})
        });
        g.output(drawn.read());
        let made = [(Access::BufferWrite, Domain::Compute)];
        let no_layout = (Layout::Undefined, Layout::Undefined);
        let expected = [Access::BufferRead, Access::Index, Access::Indirect]
            .map(|access| step(&made, (access, Domain::Raster), no_layout));
        assert_eq!(barriers_of(g, 0)[1], expected);
    }

    #[test]
    fn imports_continue_from_their_last_use_and_are_left_as_asked() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc::full(Format::Rgba16Float);
        let state = ImageState::last(Access::Sample, Domain::Compute);
        let x = g.import_image("x", desc, state, ImportKey(3));
        g.leave(x.read(), Access::CopyRead, Domain::Copy);
        use_as(&mut g, "a", x.read(), Access::Sample);
        draw_with(&mut g, "b", x.read());
        let again = step(&[SAMPLE], DRAW, (Layout::ShaderRead, Layout::ShaderRead));
        let left =
            step(&[SAMPLE, DRAW], (Access::CopyRead, Domain::Copy), (Layout::ShaderRead, Layout::TransferSource));
        assert_eq!(barriers_of(g, 0), [vec![], vec![again], vec![left]]);
    }

    #[test]
    fn a_buffer_left_for_the_host() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let buffer = g.import_buffer("readback", BufferDesc::new(64), Access::HostRead, ImportKey(0));
        let buffer = g.pass("fill", Queue::Graphics, |p| (p.write_buffer(buffer).0, |_: &mut Record| {}));
        g.leave(buffer.read(), Access::HostRead, Domain::Copy);
        let (host, fill) = ((Access::HostRead, Domain::Copy), (Access::BufferReadWrite, Domain::Compute));
        let no_layout = (Layout::Undefined, Layout::Undefined);
        assert_eq!(barriers_of(g, 0), [vec![step(&[host], fill, no_layout)], vec![step(&[fill], host, no_layout)]]);
    }

    #[test]
    fn an_import_without_contents_is_discarded_once() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc::full(Format::Rgba16Float);
        let x = g.import_image("x", desc, ImageState::UNDEFINED, ImportKey(0));
        let x = g.pass("fill", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
        g.leave(x.read(), Access::Sample, Domain::Compute);
        let discard = Barrier { to: CHANGE, ..first() };
        let left = step(&[CHANGE], SAMPLE, (Layout::General, Layout::ShaderRead));
        assert_eq!(barriers_of(g, 0), [vec![discard], vec![left]]);
    }

    #[test]
    fn buffers_have_no_layout() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = BufferDesc::new(64);
        let target = g.import_buffer("target", desc, Access::CopyWrite, ImportKey(0));
        let source = g.import_buffer("source", desc, Access::BufferRead, ImportKey(1));
        let _ = g.pass("copy", Queue::Transfer, |p| {
            p.copy_from(source.read());
            (p.copy_to(target).0, |_: &mut Record| {})
        });
        let write = (Access::CopyWrite, Domain::Copy);
        let no_layout = (Layout::Undefined, Layout::Undefined);
        assert_eq!(barriers_of(g, 0), [vec![step(&[write], write, no_layout)], vec![]]);
    }
}
