//! Barriers of small frames.

use super::super::{super::*, plan_with};
use super::*;

fn use_as(g: &mut FrameGraph, name: &str, image: Handle<Image>, how: Access) {
    let keep = g.import_buffer(name, BufferDesc::new(4), Access::HostRead, ImportKey::Caller(0));
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

/// The barriers of one resource: before and after each pass, and at the end.
fn barriers_of(g: FrameGraph, resource: u32, words: &str) -> Vec<Vec<Barrier>> {
    let frame = g.finish().unwrap();
    let plan = plan_with(&frame.declaration, words);
    let both = plan.before.iter().zip(&plan.after).flat_map(|(before, after)| [*before, *after]);
    let of = |span: Span| plan.barriers[span.range()].iter().copied().filter(|b| b.resource == resource).collect();
    both.chain([plan.end]).map(of).collect()
}

/// The barriers before each pass and at the end, where there are none after passes.
fn before(g: FrameGraph, resource: u32) -> Vec<Vec<Barrier>> {
    let all = barriers_of(g, resource, "");
    assert!(all.iter().skip(1).step_by(2).all(Vec::is_empty), "on one queue nothing stands after a pass");
    all.into_iter().step_by(2).collect()
}

const WRITE: (Access, Domain) = (Access::StorageWrite, Domain::Compute);
const CHANGE: (Access, Domain) = (Access::StorageReadWrite, Domain::Compute);
const SAMPLE: (Access, Domain) = (Access::Sample, Domain::Compute);
const DRAW: (Access, Domain) = (Access::Sample, Domain::Raster);

fn first() -> Barrier {
    Barrier { discard: true, ..step(&[], &[WRITE], (Layout::Undefined, Layout::General)) }
}

fn step(from: &[(Access, Domain)], to: &[(Access, Domain)], layouts: (Layout, Layout)) -> Barrier {
    Barrier {
        resource: 0,
        part: Part { mip: 0, mips: 1, layer: 0, layers: 1 },
        from: from.iter().copied().collect(),
        to: to.iter().copied().collect(),
        layout_from: layouts.0,
        layout_to: layouts.1,
        discard: false,
        handover: None,
    }
}

#[test]
fn readers_in_one_layout_share_one_barrier() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let x = made(&mut g);
    use_as(&mut g, "a", x.read(), Access::Sample);
    use_as(&mut g, "b", x.read(), Access::Sample);
    draw_with(&mut g, "c", x.read());
    draw_with(&mut g, "d", x.read());
    let to_read = step(&[WRITE], &[SAMPLE, DRAW], (Layout::General, Layout::ReadOnly));
    assert_eq!(before(g, 0), [vec![first()], vec![to_read], vec![], vec![], vec![], vec![]]);
}

#[test]
fn a_write_waits_for_all_readers() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let x = made(&mut g);
    use_as(&mut g, "a", x.read(), Access::Sample);
    draw_with(&mut g, "b", x.read());
    let x = g.pass("change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    g.output(x.read());
    let to_write = step(&[SAMPLE, DRAW], &[CHANGE], (Layout::ReadOnly, Layout::General));
    assert_eq!(before(g, 0)[3], [to_write]);
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
        [vec![first()], vec![step(&[WRITE], &[CHANGE], general)], vec![step(&[CHANGE], &[CHANGE], general)], vec![]];
    assert_eq!(before(g, 0), expected);
}

#[test]
fn storage_reads_stay_in_the_layout_of_the_write() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let x = made(&mut g);
    use_as(&mut g, "a", x.read(), Access::StorageRead);
    let read = step(&[WRITE], &[(Access::StorageRead, Domain::Compute)], (Layout::General, Layout::General));
    assert_eq!(before(g, 0), [vec![first()], vec![read], vec![]]);
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
    let reads = [Access::BufferRead, Access::Index, Access::Indirect].map(|access| (access, Domain::Raster));
    let expected = step(&made, &reads, (Layout::Undefined, Layout::Undefined));
    assert_eq!(before(g, 0), [vec![], vec![expected], vec![]], "new memory that nobody had needs no barrier");
}

#[test]
fn imports_continue_from_their_last_use_and_are_left_as_asked() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = ImageDesc::full(Format::Rgba16Float);
    let state = ImageState::last(Access::Sample, Domain::Compute);
    let x = g.import_image("x", desc, state, ImportKey::Caller(3));
    g.leave(x.read(), Access::CopyRead, Domain::Copy);
    use_as(&mut g, "a", x.read(), Access::Sample);
    draw_with(&mut g, "b", x.read());
    let again = step(&[SAMPLE], &[SAMPLE, DRAW], (Layout::ReadOnly, Layout::ReadOnly));
    let layouts = (Layout::ReadOnly, Layout::TransferSource);
    let left = step(&[SAMPLE, DRAW], &[(Access::CopyRead, Domain::Copy)], layouts);
    assert_eq!(before(g, 0), [vec![again], vec![], vec![left]]);
}

#[test]
fn a_buffer_left_for_the_host() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let buffer = g.import_buffer("readback", BufferDesc::new(64), Access::HostRead, ImportKey::Caller(0));
    let buffer = g.pass("fill", Queue::Graphics, |p| (p.write_buffer(buffer).0, |_: &mut Record| {}));
    g.leave(buffer.read(), Access::HostRead, Domain::Copy);
    let (host, fill) = ((Access::HostRead, Domain::Copy), (Access::BufferReadWrite, Domain::Compute));
    let no_layout = (Layout::Undefined, Layout::Undefined);
    assert_eq!(before(g, 0), [vec![step(&[host], &[fill], no_layout)], vec![step(&[fill], &[host], no_layout)]]);
}

#[test]
fn an_import_without_contents_is_discarded_once() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = ImageDesc::full(Format::Rgba16Float);
    let x = g.import_image("x", desc, ImageState::UNDEFINED, ImportKey::Caller(0));
    let x = g.pass("fill", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    g.leave(x.read(), Access::Sample, Domain::Compute);
    let discard = Barrier { from: Uses::ANY, to: Uses::of(CHANGE), ..first() };
    let left = step(&[CHANGE], &[SAMPLE], (Layout::General, Layout::ReadOnly));
    assert_eq!(before(g, 0), [vec![discard], vec![left]]);
}

#[test]
fn buffers_have_no_layout() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = BufferDesc::new(64);
    let target = g.import_buffer("target", desc, Access::CopyWrite, ImportKey::Caller(0));
    let source = g.import_buffer("source", desc, Access::BufferRead, ImportKey::Caller(1));
    let _ = g.pass("copy", Queue::Transfer, |p| {
        p.copy_from(source.read());
        (p.copy_to(target).0, |_: &mut Record| {})
    });
    let write = (Access::CopyWrite, Domain::Copy);
    let no_layout = (Layout::Undefined, Layout::Undefined);
    assert_eq!(before(g, 0), [vec![step(&[write], &[write], no_layout)], vec![]]);
}

#[test]
fn mips_change_layout_apart_and_together() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = ImageDesc { mips: 3, ..ImageDesc::full(Format::R32Float) };
    let x = g.pass("0", Queue::Graphics, |p| (p.create_part("x", desc, Part::mip(0)).0, |_: &mut Record| {}));
    let x = (1..3).fold(x, |x, mip| {
        g.pass(&mip.to_string(), Queue::Graphics, |p| {
            p.sample_part(x.read(), Part::mip(mip - 1));
            (p.write_part(x, Part::mip(mip)).0, |_: &mut Record| {})
        })
    });
    use_as(&mut g, "all", x.read(), Access::StorageRead);
    let part = |mip: u16, mips: u16| Part { mip, mips, layer: 0, layers: 1 };
    let found = before(g, 0);
    let moved = |b: &Barrier| (b.part, b.layout_from, b.layout_to);
    let moves: Vec<Vec<_>> = found.iter().map(|batch| batch.iter().map(moved).collect()).collect();
    let (undefined, general, read) = (Layout::Undefined, Layout::General, Layout::ReadOnly);
    assert_eq!(
        moves,
        [
            vec![(part(0, 1), undefined, general)],
            vec![(part(0, 1), general, read), (part(1, 1), undefined, general)],
            vec![(part(1, 1), general, read), (part(2, 1), undefined, general)],
            vec![(part(0, 2), read, general), (part(2, 1), general, general)],
            vec![],
        ]
    );
}

#[test]
fn readers_on_several_queues_find_the_layout_changed_by_the_writer() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let x = made(&mut g);
    for (name, queue) in [("a", Queue::AsyncCompute), ("b", Queue::Graphics)] {
        let made = g.pass(name, queue, |p| {
            p.sample(x.read());
            (p.create("y", ImageDesc::full(Format::R32Float)).0, |_: &mut Record| {})
        });
        g.output(made.read());
    }
    let release = Barrier { to: Uses::ANY, ..step(&[WRITE], &[], (Layout::General, Layout::ReadOnly)) };
    let found = barriers_of(g, 0, "queues=2,no-reorder");
    assert_eq!(found, [vec![first()], vec![release], vec![], vec![], vec![], vec![], vec![]]);
}

#[test]
fn who_takes_over_memory_waits_for_who_had_it() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let mut buffer =
        g.pass("0", Queue::Graphics, |p| (p.create_buffer("b", BufferDesc::new(256)).0, |_: &mut Record| {}));
    for name in ["1", "2"] {
        buffer = g.pass(name, Queue::Graphics, |p| {
            p.read(buffer.read());
            (p.create_buffer("b", BufferDesc::new(256)).0, |_: &mut Record| {})
        });
    }
    g.output(buffer.read());
    let (read, write) = ((Access::BufferRead, Domain::Compute), (Access::BufferWrite, Domain::Compute));
    // The write that was read waits too: its barrier may have covered less than the memory that is taken over.
    let taken = Barrier { discard: true, ..step(&[read, write], &[write], (Layout::Undefined, Layout::Undefined)) };
    assert_eq!(before(g, 2), [vec![], vec![], vec![Barrier { resource: 2, ..taken }], vec![]]);
}

#[test]
fn attachments_that_nobody_reads_are_not_stored() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let drawn = g.pass("draw", Queue::Graphics, |p| {
        let (drawn, _) = p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]);
        let _ = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0);
        (drawn, |_: &mut Record| {})
    });
    g.output(drawn.read());
    let frame = g.finish().unwrap();
    assert_eq!(plan_with(&frame.declaration, "").unstored, [1]);
}

/// Draws depth, then colours: the depth is tested against, and sampled in the same pass and after it.
fn tested_depth() -> FrameGraph {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let depth = g.pass("solid", Queue::Graphics, |p| {
        (p.depth("depth", ImageDesc::full(Format::D32Float), 0.0).0, |_: &mut Record| {})
    });
    let drawn = g.pass("glass", Queue::Graphics, |p| {
        p.depth_test(depth.read());
        p.sample(depth.read());
        (p.color("drawn", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]).0, |_: &mut Record| {})
    });
    g.output(drawn.read());
    use_as(&mut g, "after", depth.read(), Access::Sample);
    let over = g.pass("over", Queue::Graphics, |p| (p.depth_load(depth).0, |_: &mut Record| {}));
    g.output(over.read());
    g
}

#[test]
fn a_depth_test_and_samples_are_one_group_of_reads() {
    const MADE: (Access, Domain) = (Access::Depth, Domain::Raster);
    const TEST: (Access, Domain) = (Access::DepthTest, Domain::Raster);
    const OVER: (Access, Domain) = (Access::DepthLoad, Domain::Raster);
    let clear = Barrier { discard: true, ..step(&[], &[MADE], (Layout::Undefined, Layout::DepthAttachment)) };
    let to_read = step(&[MADE], &[TEST, SAMPLE, DRAW], (Layout::DepthAttachment, Layout::ReadOnly));
    let to_write = step(&[TEST, SAMPLE, DRAW], &[OVER], (Layout::ReadOnly, Layout::DepthAttachment));
    let expected = [vec![clear], vec![to_read], vec![], vec![to_write], vec![]];
    assert_eq!(before(tested_depth(), 0), expected);
}

#[test]
fn what_is_tested_against_is_stored() {
    let frame = tested_depth().finish().unwrap();
    let plan = plan_with(&frame.declaration, "");
    let glass = plan.order.iter().position(|&pass| pass == 1).unwrap();
    assert_eq!(frame.declaration.uses_of(1)[0].writes, None);
    assert!(plan.order[..glass].contains(&0), "what it tests against is drawn before it: {:?}", plan.order);
    assert!(plan.unstored.is_empty(), "{:?}", plan.unstored);
}

/// A kept image of two layers with the second one stale; `looked` says whether a pass reads it.
fn kept_layers(looked: bool) -> FrameGraph {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = ImageDesc::fixed(Format::D32Float, Extent::new(4, 4));
    let kept = g.kept_layers(&HistoryScope::new(), "map", desc, &[1, 2]);
    assert_eq!(kept.stale, [0, 1]);
    let map = g.pass("draw", Queue::Graphics, |p| (p.depth_layer(kept.image, 1, 0.0).0, |_: &mut Record| {}));
    let seen = g.pass("look", Queue::Graphics, |p| {
        p.sample(map.read());
        (p.create("seen", ImageDesc::full(Format::R32Float)).0, |_: &mut Record| {})
    });
    let other = g.pass("other", Queue::Graphics, |p| {
        (p.create("other", ImageDesc::full(Format::R32Float)).0, |_: &mut Record| {})
    });
    g.output(if looked { seen.read() } else { other.read() });
    g
}

#[test]
fn one_layer_is_drawn_and_the_others_keep_what_they_hold() {
    let frame = kept_layers(true).finish().unwrap();
    let plan = plan_with(&frame.declaration, "");
    let of_map: Vec<&Barrier> = plan.barriers.iter().filter(|b| b.resource == 0).collect();
    let layer = Part { mip: 0, mips: 1, layer: 1, layers: 1 };
    assert!(of_map.iter().all(|b| b.part == layer), "the first layer stays as it is: {of_map:?}");
    let ways: Vec<_> = of_map.iter().map(|b| (b.layout_from, b.layout_to)).collect();
    assert_eq!(ways.last(), Some(&(Layout::DepthAttachment, Layout::ReadOnly)), "{ways:?}");
    assert_eq!(ways.len(), 2, "{ways:?}");
    assert!(!of_map[1].discard);
}

#[test]
fn layers_that_nobody_looks_at_are_not_drawn() {
    let frame = kept_layers(false).finish().unwrap();
    let plan = plan_with(&frame.declaration, "");
    assert_eq!(plan.order, [2]);
}
