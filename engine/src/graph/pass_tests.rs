//! Every mistake that a declaration can have, and the names of stages and outputs.

use std::{cell::RefCell, rc::Rc};

use super::super::*;

const COLOUR: Format = Format::Rgba16Float;

fn graph() -> FrameGraph {
    FrameGraph::new(Extent::new(64, 32))
}

fn make(g: &mut FrameGraph, pass: &str) -> WriteHandle<Image> {
    g.pass(pass, Queue::Graphics, |p| (p.create("x", ImageDesc::full(COLOUR)).0, |_: &mut Record| {}))
}

/// Declares one pass for its uses only; it records nothing.
fn with<T>(g: &mut FrameGraph, pass: &str, declare: impl FnOnce(&mut PassBuilder<'_>) -> T) {
    let _ = g.pass(pass, Queue::Graphics, |p| (declare(p), |_: &mut Record| {}));
}

fn errors(g: FrameGraph) -> Vec<GraphError> {
    match g.finish() {
        Ok(_) => Vec::new(),
        Err(GraphErrors(errors)) => errors,
    }
}

fn s(text: &str) -> String {
    text.to_owned()
}

#[test]
fn a_stale_read_names_both_versions_and_accesses() {
    let mut g = graph();
    let x = make(&mut g, "a.make");
    let old = x.read();
    let x = g.pass("b.change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    with(&mut g, "c.fresh", |p| p.sample(x.read()));
    with(&mut g, "d.stale", |p| p.sample(old));
    let errors = errors(g);
    assert_eq!(
        errors,
        [GraphError::StaleRead {
            pass: s("d.stale"),
            resource: s("a.make:x"),
            access: Access::Sample,
            version: 0,
            newest: 1,
            writer: s("b.change"),
            written: Access::StorageReadWrite,
        }]
    );
    assert_eq!(
        errors[0].to_string(),
        "pass `d.stale` wants version 0 of `a.make:x` (sample), but pass `b.change` has written version 1 (storage read-write)"
    );
}

#[test]
fn contents_that_nothing_wrote_cannot_be_read() {
    let mut g = graph();
    let x = g.import_image("x", ImageDesc::full(COLOUR), ImageState::UNDEFINED, ImportKey::Caller(0));
    with(&mut g, "read", |p| p.sample(x.read()));
    let x = g.pass("over", Queue::Graphics, |p| (p.color_load(x).0, |_: &mut Record| {}));
    with(&mut g, "fine", |p| p.sample(x.read()));
    let unwritten = |pass: &str, access| GraphError::Unwritten { pass: s(pass), resource: s("x"), access };
    assert_eq!(errors(g), [unwritten("read", Access::Sample), unwritten("over", Access::ColorLoad)]);
}

#[test]
fn an_import_without_contents_can_be_written() {
    let mut g = graph();
    let x = g.import_image("x", ImageDesc::full(COLOUR), ImageState::UNDEFINED, ImportKey::Caller(0));
    let x = g.pass("fill", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    with(&mut g, "read", |p| p.sample(x.read()));
    assert_eq!(errors(g), []);
}

#[test]
fn uses_that_do_not_go_together() {
    let mut g = graph();
    let x = make(&mut g, "make");
    let buffer = g.import_buffer("b", BufferDesc::new(4), Access::HostRead, ImportKey::Caller(0));
    with(&mut g, "two layouts", |p| {
        p.sample(x.read());
        p.sample(x.read());
        p.storage(x.read());
    });
    with(&mut g, "read and write", |p| {
        p.sample(x.read());
        let _ = p.write(x);
    });
    with(&mut g, "write and read", |p| {
        let (y, _) = p.create("y", ImageDesc::full(COLOUR));
        p.sample(y.read());
    });
    with(&mut g, "twice", |p| {
        let (buffer, _) = p.write_buffer(buffer);
        let _ = p.write_buffer(buffer);
    });
    let clash = |pass: &str, resource: &str, first, second| GraphError::Conflict {
        pass: s(pass),
        resource: s(resource),
        first,
        second,
    };
    assert_eq!(
        errors(g),
        [
            clash("two layouts", "make:x", Access::Sample, Access::StorageRead),
            clash("read and write", "make:x", Access::Sample, Access::StorageReadWrite),
            clash("write and read", "write and read:y", Access::StorageWrite, Access::Sample),
            clash("twice", "b", Access::BufferReadWrite, Access::BufferReadWrite),
        ]
    );
}

#[test]
fn a_copy_is_a_pass_of_its_own() {
    let mut g = graph();
    let x = make(&mut g, "make");
    let buffer = g.import_buffer("b", BufferDesc::new(4), Access::HostRead, ImportKey::Caller(0));
    with(&mut g, "mixed", |p| {
        p.sample(x.read());
        let _ = p.copy_to(buffer);
    });
    let (copied, copy, access) = (s("b"), Access::CopyWrite, Access::Sample);
    assert_eq!(errors(g), [GraphError::MixedCopy { pass: s("mixed"), copied, copy, resource: s("make:x"), access }]);
}

#[test]
fn formats_must_suit() {
    let mut g = graph();
    with(&mut g, "p", |p| {
        let _ = p.color("a", ImageDesc::full(Format::D32Float), [0.0; 4]);
        let _ = p.depth("b", ImageDesc::full(Format::R32Float), 0.0);
        let _ = p.create("c", ImageDesc::full(Format::Rgba8Srgb));
        let _ = p.color("d", ImageDesc::full(Format::Rgba8Srgb), [0.0; 4]);
    });
    let wrong =
        |name: &str, access, format| GraphError::Format { pass: s("p"), resource: format!("p:{name}"), access, format };
    assert_eq!(
        errors(g),
        [
            wrong("a", Access::Color, Format::D32Float),
            wrong("b", Access::Depth, Format::R32Float),
            wrong("c", Access::StorageWrite, Format::Rgba8Srgb),
        ]
    );
}

#[test]
fn attachments_agree_in_size_and_one_is_depth() {
    let mut g = graph();
    with(&mut g, "p", |p| {
        let _ = p.color("a", ImageDesc::full(COLOUR), [0.0; 4]);
        let _ = p.color("b", ImageDesc::half(COLOUR), [0.0; 4]);
        let _ = p.depth("c", ImageDesc::full(Format::D32Float), 0.0);
        let _ = p.depth("d", ImageDesc::full(Format::D32Float), 0.0);
    });
    let (full, half) = (Extent::new(64, 32), Extent::new(32, 16));
    assert_eq!(
        errors(g),
        [
            GraphError::AttachmentExtent {
                pass: s("p"),
                first: s("p:a"),
                first_extent: full,
                second: s("p:b"),
                second_extent: half
            },
            GraphError::TwoDepths { pass: s("p"), first: s("p:c"), second: s("p:d") },
        ]
    );
}

#[test]
fn a_depth_test_goes_with_sampling_and_with_no_other_depth() {
    let mut g = graph();
    let desc = ImageDesc::full(Format::D32Float);
    let mut drawn = |pass: &str| g.pass(pass, Queue::Graphics, |p| (p.depth("d", desc, 0.0).0, |_: &mut Record| {}));
    let (a, b, c) = (drawn("a"), drawn("b"), drawn("c"));
    let colours = make(&mut g, "colours");
    let empty = g.import_image("empty", desc, ImageState::UNDEFINED, ImportKey::Caller(0));
    with(&mut g, "fine", |p| {
        let token = p.depth_test(a.read());
        assert_eq!((token.resource, token), (a.read().id(), p.depth_test(a.read())));
        p.sample(a.read());
        let _ = p.color("lit", ImageDesc::full(COLOUR), [0.0; 4]);
    });
    with(&mut g, "writes too", |p| {
        p.depth_test(b.read());
        let _ = p.depth_load(b);
    });
    with(&mut g, "writes first", |p| {
        let (c, _) = p.depth_load(c);
        p.depth_test(c.read());
    });
    with(&mut g, "two", |p| {
        let _ = p.depth("new", desc, 0.0);
        p.depth_test(a.read());
    });
    with(&mut g, "colour", |p| p.depth_test(colours.read()));
    with(&mut g, "nothing there", |p| p.depth_test(empty.read()));
    with(&mut g, "other size", |p| {
        let _ = p.color("half", ImageDesc::half(COLOUR), [0.0; 4]);
        p.depth_test(a.read());
    });
    let test = Access::DepthTest;
    let clash = |pass: &str, resource: &str, first, second| GraphError::Conflict {
        pass: s(pass),
        resource: s(resource),
        first,
        second,
    };
    let (half, full) = (Extent::new(32, 16), Extent::new(64, 32));
    assert_eq!(
        errors(g),
        [
            clash("writes too", "b:d", test, Access::DepthLoad),
            clash("writes first", "c:d", Access::DepthLoad, test),
            GraphError::TwoDepths { pass: s("two"), first: s("two:new"), second: s("a:d") },
            GraphError::Format { pass: s("colour"), resource: s("colours:x"), access: test, format: COLOUR },
            GraphError::Unwritten { pass: s("nothing there"), resource: s("empty"), access: test },
            GraphError::AttachmentExtent {
                pass: s("other size"),
                first: s("other size:half"),
                first_extent: half,
                second: s("a:d"),
                second_extent: full,
            },
        ]
    );
}

#[test]
fn a_depth_test_of_a_version_that_was_drawn_over_is_stale() {
    let mut g = graph();
    let desc = ImageDesc::full(Format::D32Float);
    let d = g.pass("a", Queue::Graphics, |p| (p.depth("d", desc, 0.0).0, |_: &mut Record| {}));
    let old = d.read();
    with(&mut g, "over", |p| p.depth_load(d));
    with(&mut g, "stale", |p| p.depth_test(old));
    let found = errors(g);
    assert!(matches!(&found[..], [GraphError::StaleRead { access: Access::DepthTest, .. }]), "{found:?}");
}

#[test]
fn names_are_unique() {
    let mut g = graph();
    with(&mut g, "p", |p| {
        let _ = p.create("x", ImageDesc::full(COLOUR));
        let _ = p.create("x", ImageDesc::full(COLOUR));
    });
    with(&mut g, "p", |_| ());
    assert_eq!(
        errors(g),
        [GraphError::DuplicateOutput { pass: s("p"), output: s("x") }, GraphError::DuplicatePass { pass: s("p") }]
    );
}

#[test]
fn sizes_are_checked() {
    let mut g = graph();
    let (empty, long) = (Extent::new(0, 4), Extent::new(4, 32769));
    with(&mut g, "p", |p| {
        let _ = p.create("empty", ImageDesc::fixed(COLOUR, empty));
        let _ = p.create("long", ImageDesc::fixed(COLOUR, long));
        let _ = p.create("mips", ImageDesc { mips: 8, ..ImageDesc::full(COLOUR) });
        let _ = p.create("most", ImageDesc { mips: 7, ..ImageDesc::full(COLOUR) });
        let _ = p.create_buffer("none", BufferDesc::new(0));
        let _ = p.create_buffer("huge", BufferDesc::new(u64::MAX));
    });
    assert_eq!(
        errors(g),
        [
            GraphError::Extent { resource: s("empty"), extent: empty },
            GraphError::Extent { resource: s("long"), extent: long },
            GraphError::Mips { resource: s("mips"), extent: Extent::new(64, 32), mips: 8, most: 7 },
            GraphError::BufferSize { resource: s("none"), bytes: 0 },
            GraphError::BufferSize { resource: s("huge"), bytes: u64::MAX },
        ]
    );
}

#[test]
fn states_must_suit_their_kind_and_outlive_the_frame() {
    let mut g = graph();
    let state = ImageState::last(Access::Index, Domain::Raster);
    let image = g.import_image("i", ImageDesc::full(COLOUR), state, ImportKey::Caller(0));
    let buffer = g.import_buffer("b", BufferDesc::new(4), Access::Sample, ImportKey::Caller(1));
    let tlas = g.import_tlas("t", Access::Index, ImportKey::Caller(2));
    g.leave(image.read(), Access::HostRead, Domain::Copy);
    g.leave(buffer.read(), Access::HostRead, Domain::Copy);
    g.leave(tlas, Access::Trace, Domain::Compute);
    let x = make(&mut g, "make");
    g.leave(x.read(), Access::Sample, Domain::Compute);
    let state = |kind, resource: &str, access| GraphError::State { kind, resource: s(resource), access };
    assert_eq!(
        errors(g),
        [
            state("image", "i", Access::Index),
            state("buffer", "b", Access::Sample),
            state("tlas", "t", Access::Index),
            state("image", "i", Access::HostRead),
            GraphError::NotImported { resource: s("make:x"), access: Access::Sample },
        ]
    );
}

#[test]
#[should_panic(expected = "handles do not outlive their frame")]
fn a_handle_of_another_frame_is_a_programmers_mistake() {
    let x = make(&mut graph(), "make");
    with(&mut graph(), "read", |p| p.sample(x.read()));
}

#[test]
fn overwriting_keeps_what_is_there_and_does_not_count_as_a_read() -> Result<(), GraphErrors> {
    let mut g = graph();
    let x = make(&mut g, "a.make");
    let x = g.pass("b.fill", Queue::Graphics, |p| (p.overwrite(x).0, |_: &mut Record| {}));
    let x = g.pass("c.change", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    g.output(x.read());
    let declaration = g.finish()?.declaration;
    let image = 64 * 32 * 8;
    assert_eq!([0, 1, 2].map(|pass| declaration.traffic(pass)), [image, image, 2 * image]);
    let plan = plan::plan_with(&declaration, "");
    assert_eq!(plan.order, [0, 1, 2], "the pixels of `a.make` that `b.fill` leaves are needed");
    Ok(())
}

#[test]
fn sizes_resolve() {
    let mut g = FrameGraph::new(Extent::new(641, 361));
    let half = g.pass("a", Queue::Graphics, |p| {
        let (half, _) = p.create("half", ImageDesc::half(COLOUR));
        (half.read(), |_: &mut Record| {})
    });
    assert_eq!(g.extent(half), Extent::new(321, 181));
    let desc = ImageDesc { format: Format::R8Unorm, ..g.desc(half) };
    assert_eq!(g.extent_of(desc), Extent::new(321, 181));
    assert_eq!(g.extent_of(ImageDesc::full(COLOUR)), g.full());
    let same = g.pass("b", Queue::Graphics, |p| {
        assert_eq!(p.extent_of(p.desc(half)), p.extent(half));
        let (same, _) = p.create("same", ImageDesc { format: Format::R8Unorm, ..p.desc(half) });
        (same.read(), |_: &mut Record| {})
    });
    assert_eq!(g.extent(same), Extent::new(321, 181));
    assert_eq!(g.desc(same).format, Format::R8Unorm);
}

#[test]
fn domains_stages_and_tokens() {
    let mut g = graph();
    let x = g.pass("gbuffer.draw", Queue::Graphics, |p| {
        let (x, token) = p.color("x", ImageDesc::full(COLOUR), [0.0; 4]);
        assert_eq!((token.resource, token.pass), (x.read().id(), 0));
        (x, |_: &mut Record| {})
    });
    let buffer = g.import_buffer("b", BufferDesc::new(4), Access::HostRead, ImportKey::Caller(0));
    g.pass("copy", Queue::Transfer, |p| {
        let source = p.copy_from(x.read());
        assert_eq!((source.resource, source.pass), (x.read().id(), 1));
        let _ = p.copy_to(buffer);
        ((), |_: &mut Record| {})
    });
    g.pass("post.tone.map", Queue::AsyncCompute, |p| {
        assert_eq!(p.sample(x.read()), p.sample(x.read()));
        ((), |_: &mut Record| {})
    });
    let frame = g.finish().unwrap();
    let of = |i: u32| (frame.declaration.stage(i), frame.declaration.passes[i as usize].domain);
    assert_eq!([of(0), of(1), of(2)], [("gbuffer", Domain::Raster), ("copy", Domain::Copy), ("post", Domain::Compute)]);
    assert_eq!(frame.declaration.passes[2].uses.len(), 1);
    assert_eq!(frame.records.len(), 3);
}

#[test]
fn outputs_are_found_by_name() {
    let mut g = graph();
    let x = make(&mut g, "a");
    let x = g.pass("b", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    let listed: Vec<(String, String, u32)> = g.outputs().map(|o| (o.pass, o.output, o.image.version())).collect();
    assert_eq!(listed, [(s("a"), s("x"), 0), (s("b"), s("x"), 1)]);
    assert_eq!(g.find("b", "x").unwrap(), x.read());
    let known = vec![s("a"), s("b")];
    assert_eq!(g.find("c", "x").unwrap_err(), GraphError::UnknownPass { pass: s("c"), known });
    let error = g.find("a", "y").unwrap_err();
    assert_eq!(error.to_string(), "pass `a` has no image output called `y`; it has: x");
}

#[test]
fn a_changed_output_keeps_its_full_name_where_the_short_one_is_taken() {
    let mut g = graph();
    let x = make(&mut g, "a");
    with(&mut g, "b", |p| {
        let _ = p.write(x);
        let _ = p.create("x", ImageDesc::full(COLOUR));
    });
    let found = [g.find("b", "a:x"), g.find("b", "x")].map(|found| found.map(|image| (image.id(), image.version())));
    assert_eq!(found, [Ok((0, 1)), Ok((1, 0))]);
    assert_eq!(errors(g), []);
}

#[test]
fn an_observer_sees_each_version_while_it_is_new_and_not_its_own() {
    let mut g = graph();
    let seen = Rc::new(RefCell::new(Vec::new()));
    let sink = seen.clone();
    g.observe(move |g, produced| {
        sink.borrow_mut().push((produced.pass.clone(), produced.output.clone(), produced.image.version()));
        let name = format!("scan.{}", produced.pass);
        g.weak_pass(&name, Queue::Graphics, |p| {
            p.sample(produced.image);
            let _ = p.create("found", ImageDesc::full(Format::R32Uint));
            ((), |_: &mut Record| {})
        });
    });
    let x = make(&mut g, "a");
    let x = g.pass("b", Queue::Graphics, |p| (p.write(x).0, |_: &mut Record| {}));
    g.output(x.read());
    assert_eq!(*seen.borrow(), [(s("a"), s("x"), 0), (s("b"), s("x"), 1)]);
    assert_eq!(errors(g), []);
}

#[test]
fn all_mistakes_are_reported_together() {
    let mut g = graph();
    with(&mut g, "p", |p| p.create_buffer("none", BufferDesc::new(0)));
    with(&mut g, "p", |_| ());
    let text = g.finish().err().unwrap().to_string();
    assert_eq!(
        text,
        "the frame graph has 2 mistakes:\n  buffer `none` would have 0 bytes; it must have 1 to 1099511627776\n  \
         two passes are called `p`"
    );
}

#[test]
fn a_layer_to_draw_is_one_of_a_depth_image() {
    let mut g = graph();
    let scope = HistoryScope::new();
    let depth = g.kept_layers(&scope, "map", ImageDesc::full(Format::D32Float), &[0; 3]).image;
    let colour = g.kept_layers(&scope, "colours", ImageDesc::full(COLOUR), &[0; 3]).image;
    with(&mut g, "beyond", |p| p.depth_layer(depth, 3, 0.0));
    with(&mut g, "wrong", |p| p.depth_layer(colour, 0, 0.0));
    let found = errors(g);
    assert!(
        matches!(&found[..], [GraphError::Part { mips: 1, layers: 3, .. }, GraphError::Format { .. }]),
        "{found:?}"
    );
}
