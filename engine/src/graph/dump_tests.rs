//! The dumps of one small frame that uses every feature.

use super::{
    super::{plan::plan_with, *},
    Dump, Gains,
};

/// Three queues, a history, an image used mip by mip, an attachment that is handed over to another queue, one that nobody reads,
/// and a culled pass. `first` is the name of its first stage.
fn frame(first: &str) -> Frame {
    let mut g = FrameGraph::new(Extent::new(16, 8));
    let scope = HistoryScope::new();
    let tlas = g.import_tlas("scene", Access::Trace, ImportKey::Caller(0));
    let readback = g.import_buffer("readback", BufferDesc::new(512), Access::HostRead, ImportKey::Caller(1));
    g.leave(readback.read(), Access::HostRead, Domain::Copy);
    let colour = g.history(&scope, "colour", ImageDesc::full(Format::R32Float));
    let (depth, albedo) = g.pass(&format!("{first}.draw"), Queue::Graphics, |p| {
        let (depth, _) = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0);
        let (albedo, _) = p.color("albedo", ImageDesc::full(Format::Rgba8Unorm), [0.0; 4]);
        let _ = p.color("ids", ImageDesc::full(Format::R32Uint), [0.0; 4]);
        ((depth.read(), albedo.read()), |_: &mut Record| {})
    });
    let bounce = g.pass("gi.trace", Queue::AsyncCompute, |p| {
        p.trace(tlas);
        p.sample(depth);
        p.sample(albedo);
        p.sample(colour.previous);
        let desc = ImageDesc { mips: 2, ..ImageDesc::full(Format::R32Float) };
        (p.create_part("bounce", desc, Part::mip(0)).0, |_: &mut Record| {})
    });
    let bounce = g.pass("gi.mips", Queue::AsyncCompute, |p| {
        p.sample_part(bounce.read(), Part::mip(0));
        (p.write_part(bounce, Part::mip(1)).0, |_: &mut Record| {})
    });
    let _ = g.pass("ao.trace", Queue::AsyncCompute, |p| {
        p.sample(depth);
        (p.create("open", ImageDesc::half(Format::R8Unorm)).0, |_: &mut Record| {})
    });
    let lit = g.pass("sky.draw", Queue::Graphics, |p| {
        p.sample(depth);
        (p.create("lit", ImageDesc::full(Format::R32Float)).0, |_: &mut Record| {})
    });
    let next = g.pass("sky.sum", Queue::Graphics, |p| {
        p.sample(lit.read());
        p.sample(bounce.read());
        (p.write(colour.next).0, |_: &mut Record| {})
    });
    let display = g.pass("post.map", Queue::Graphics, |p| {
        p.sample(next.read());
        (p.create("display", ImageDesc::full(Format::Rgba8Unorm)).0, |_: &mut Record| {})
    });
    g.output(display.read());
    let _ = g.pass("copy", Queue::Transfer, |p| {
        p.copy_from(display.read());
        (p.copy_to(readback).0, |_: &mut Record| {})
    });
    g.finish().unwrap()
}

fn on_three_queues(first: &str) -> (Declaration, Plan) {
    let declaration = frame(first).declaration;
    let plan = plan_with(&declaration, "queues=3");
    (declaration, plan)
}

#[test]
fn text_reads_as_words() {
    let (declaration, plan) = on_three_queues("gbuffer");
    let expected = "\
frame of 16x8, planned for the queues graphics, async compute and transfer
transient memory: 3328 bytes unaliased, 2816 bytes as placed (85 %, 1.00 times the lower bound of 2816 bytes)
graph: 7 passes (1 culled), 17 barriers (2.4 per pass), 5 batches, 3 waits between queues

passes
batch 0 on graphics
   0 gbuffer.draw  (stage gbuffer, raster, graphics queue)
       wait   gbuffer.draw:depth: nothing before depth (raster), layout undefined to depth attachment, contents are new
       wait   gbuffer.draw:albedo: nothing before colour (raster), layout undefined to colour attachment, contents are new
       wait   gbuffer.draw:ids: nothing before colour (raster), layout undefined to colour attachment, contents are new
       make   gbuffer.draw:depth version 0: depth
       make   gbuffer.draw:albedo version 0: colour
       make   gbuffer.draw:ids version 0: colour, not stored: nobody reads it later
       after  gbuffer.draw:depth: depth (raster) before anything, layout depth attachment to read only
       after  gbuffer.draw:albedo: colour (raster) before the handover, layout colour attachment to read only, released by graphics to async compute
batch 1 on async compute, waits for batch 0
   1 gi.trace  (stage gi, compute, async compute queue)
       wait   gbuffer.draw:albedo: other queues before sample (compute), layout colour attachment to read only, acquired by async compute from graphics
       wait   gi.trace:bounce mip 0: nothing before storage write (compute), layout undefined to general, contents are new
       read   scene version 0: trace
       read   gbuffer.draw:depth version 0: sample
       read   gbuffer.draw:albedo version 0: sample
       read   colour.previous version 0: sample
       make   gi.trace:bounce version 0: storage write mip 0
       after  gi.trace:bounce mip 0: storage write (compute) before anything, layout general to read only
   2 gi.mips  (stage gi, compute, async compute queue)
       wait   gi.trace:bounce mip 1: nothing before storage read-write (compute), layout undefined to general, contents are new
       read   gi.trace:bounce version 0: sample mip 0
       change gi.trace:bounce version 0 to 1: storage read-write mip 1
batch 2 on graphics
   3 sky.draw  (stage sky, compute, graphics queue)
       wait   sky.draw:lit: colour (raster) before storage write (compute), layout undefined to general, contents are new
       read   gbuffer.draw:depth version 0: sample
       make   sky.draw:lit version 0: storage write
batch 3 on graphics, waits for batch 1
   4 sky.sum  (stage sky, compute, graphics queue)
       wait   sky.draw:lit: storage write (compute) before sample (compute), layout general to read only
       wait   gi.trace:bounce mip 1: other queues before sample (compute), layout general to read only
       wait   colour.next: nothing before storage read-write (compute), layout undefined to general, contents are new
       read   sky.draw:lit version 0: sample
       read   gi.trace:bounce version 1: sample
       change colour.next version 0 to 1: storage read-write
   5 post.map  (stage post, compute, graphics queue)
       wait   colour.next: storage read-write (compute) before sample (compute), layout general to read only
       wait   post.map:display: nothing before storage write (compute), layout undefined to general, contents are new
       read   colour.next version 1: sample
       make   post.map:display version 0: storage write
batch 4 on transfer, waits for batch 3
   6 copy  (stage copy, copy, transfer queue)
       wait   post.map:display: other queues before copy from (copy), layout general to transfer source
       read   post.map:display version 0: copy from
       change readback version 0 to 1: copy to
";
    let text = super::text(&declaration, &plan);
    let (passes, rest) = text.split_once("\nleft out\n").unwrap();
    // The barriers at the end of the frame follow after the batches.
    assert!(passes.starts_with(expected), "wanted\n{expected}\ngot\n{passes}");
    let expected = "     ao.trace: nothing that is kept needs `ao.trace:open`

resources
     scene  acceleration structure, imported, 0 bytes, pass 1 on async compute
     readback  buffer of 512 bytes, imported, 512 bytes, pass 6 on transfer
     colour.previous  image R32Float 16x8, history, read, 512 bytes, pass 1 on async compute
     colour.next  image R32Float 16x8, history, written, 512 bytes, passes 4 to 5 on graphics
     gbuffer.draw:depth  image D32Float 16x8, 512 bytes, passes 0 to 3 on several queues
     gbuffer.draw:albedo  image Rgba8Unorm 16x8, 512 bytes, passes 0 to 1 on several queues
     gbuffer.draw:ids  image R32Uint 16x8, 512 bytes, pass 0 on graphics
     gi.trace:bounce  image R32Float 16x8, 2 mips, 640 bytes, passes 1 to 4 on several queues
     ao.trace:open  image R8Unorm 8x4, not used
     sky.draw:lit  image R32Float 16x8, 512 bytes, passes 3 to 4 on graphics
     post.map:display  image Rgba8Unorm 16x8, 512 bytes, passes 5 to 6 on several queues

memory of transients
heap 0: 2816 bytes of kind 0
";
    assert!(rest.starts_with(expected), "wanted\n{expected}\ngot\n{rest}");
    for transient in &plan.transients {
        let name = declaration.resource_name(transient.resource);
        let line = format!("{:>12} {:>10}  {name}", transient.offset, transient.bytes);
        assert!(rest.contains(&line), "{line} is not in\n{rest}");
    }
    for line in [
        "  sky.draw:lit, after gbuffer.draw:ids\n",
        "  gi.trace:bounce, shares with nobody: it is live on several queues, whose order says nothing about time\n",
        "  queues use it in turn, and as an attachment it may be compressed: ownership is handed over\n",
        "\noutputs\n     post.map:display version 0\n     next frame reads colour.next as colour.previous\n",
    ] {
        assert!(rest.contains(line), "{line} is not in\n{rest}");
    }
}

#[test]
fn switches_that_shaped_the_plan_are_shown() {
    let declaration = frame("gbuffer").declaration;
    let text = |switches: &str| super::text(&declaration, &plan_with(&declaration, switches));
    assert!(text("").starts_with("frame of 16x8, planned for the graphics queue\n"));
    let serial = text("serial");
    assert!(serial.contains("; serial: each pass waits for everything before it; transients do not share memory\n"));
    assert!(serial.contains("  gbuffer.draw:ids, shares with nobody: aliasing is switched off\n"), "{serial}");
    assert!(!text("no-alias").contains("; serial") && text("no-alias").contains("; transients do not share memory\n"));
    assert!(text("").contains("(stage gi, compute, graphics queue, would like async compute)"));
    assert!(!text("no-cull").contains("left out"));
}

#[test]
fn gains_are_those_of_the_plan_in_two_lines() {
    let declaration = frame("gbuffer").declaration;
    let plan = plan_with(&declaration, "");
    let mut gains = Gains::of(&plan);
    assert_eq!((gains.passes, gains.culled, gains.batches, gains.waits, gains.queues), (7, 1, 1, 0, 1));
    assert_eq!(
        (gains.unaliased, gains.aliased, gains.lower_bound),
        (3328, plan.memory.aliased, plan.memory.lower_bound)
    );
    assert!(gains.aliased < gains.unaliased && gains.aliased >= gains.lower_bound);
    assert_eq!((gains.barriers, gains.unstored), (plan.barriers.len(), plan.unstored.len()));
    gains.overlap_ms = Some(1.5);
    let text = gains.to_string();
    assert_eq!(text.lines().count(), 2);
    assert!(
        text.contains("7 passes (1 culled)") && text.ends_with("1 batch, 0 waits between queues, 1.500 ms of overlap")
    );
    let none = Gains::of(&Plan::default());
    assert_eq!((none.share(0), none.over_bound(), none.barriers_per_pass), (1.0, 1.0, 0.0));
}

#[test]
fn dot_has_a_box_per_pass_in_its_batch_and_marks_what_is_left_out() {
    let (declaration, plan) = on_three_queues("gbuffer");
    let dot = super::dot(&declaration, &plan);
    let lines: Vec<&str> = dot.lines().map(str::trim).collect();
    for expected in [
        "subgraph cluster_1 { label=\"batch 1, async compute\";",
        "p0 [shape=box style=solid label=\"0 gbuffer.draw\"];",
        "p3 [shape=box style=dashed label=\"ao.trace\" tooltip=\"nothing that is kept needs `ao.trace:open`\"];",
        "p7 [shape=box style=solid label=\"6 copy\"];",
        "r10_0 [shape=ellipse style=solid peripheries=2 label=\"post.map:display version 0\"];",
        "r8_0 [shape=ellipse style=dashed peripheries=1 label=\"ao.trace:open version 0\"];",
        "r7_0 -> p2 [label=\"sample mip 0\"];",
        "p2 -> r7_1 [label=\"storage read-write mip 1\"];",
        "p2 -> p5 [style=bold ltail=cluster_1 lhead=cluster_3 label=\"wait\"];",
    ] {
        assert!(lines.contains(&expected), "{expected} is not in\n{dot}");
    }
    let count = |word: &str| lines.iter().filter(|l| l.contains(word)).count();
    assert_eq!((count("shape=box"), count("subgraph"), count("label=\"wait\"")), (8, 5, 3));
    assert_eq!((lines[0], lines.last()), ("digraph frame {", Some(&"}")));
    let (declaration, plan) = on_three_queues("a\\\"b");
    assert!(super::dot(&declaration, &plan).contains("label=\"0 a\\\\\\\"b.draw\""));
}

#[test]
fn json_says_the_same() {
    use serde_json::json;
    let (declaration, plan) = on_three_queues("a\"b");
    let json = Dump::new(&declaration, &plan).overlap(Some(0.25)).json();
    let all: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(all["size"], json!([16, 8]));
    assert_eq!(all["queues"], json!(["graphics", "async compute", "transfer"]));
    assert_eq!((&all["serial"], &all["alias"]), (&json!(false), &json!(true)));
    assert_eq!((&all["gains"]["overlap_ms"], &all["gains"]["waits"]), (&json!(0.25), &json!(3)));
    assert_eq!(all["gains"]["unaliased"], json!(plan.memory.unaliased));
    let list = |of: &serde_json::Value| of.as_array().unwrap().len();
    let passes = all["passes"].as_array().unwrap();
    assert_eq!((passes.len(), list(&all["batches"]), list(&all["resources"])), (7, 5, 11));
    let barriers: usize = passes.iter().map(|p| list(&p["before"]) + list(&p["after"])).sum();
    assert_eq!(barriers + list(&all["end"]), plan.barriers.len());
    assert_eq!(all["batches"][3], json!({"queue": "graphics", "first": 4, "last": 5, "waits": [1]}));
    assert_eq!(passes[0]["name"], "a\"b.draw");
    assert_eq!(
        (&passes[6]["queue"], &passes[6]["wish"], &passes[6]["batch"]),
        (&json!("transfer"), &json!("transfer"), &json!(4))
    );
    assert_eq!(passes[0]["uses"][2]["stored"], false);
    assert_eq!(
        passes[2]["uses"][1],
        json!({
            "resource": "gi.trace:bounce", "access": "storage read-write", "reads": 0, "writes": 1, "stored": true,
            "part": {"mip": 1, "mips": 1, "layer": 0, "layers": 1},
        })
    );
    assert_eq!(
        passes[0]["after"][1],
        json!({
            "resource": "a\"b.draw:albedo", "part": null, "from": "colour (raster)", "to": "nothing",
            "layout_from": "colour attachment", "layout_to": "read only", "discard": false,
            "handover": {"from": "graphics", "to": "async compute", "role": "release"},
        })
    );
    assert_eq!(all["left_out"][0]["name"], "ao.trace");
    let resource =
        |name: &str| all["resources"].as_array().unwrap().iter().find(|r| r["name"] == name).unwrap().clone();
    assert_eq!(resource("readback")["leave"], "host read");
    assert_eq!(resource("colour.next")["kind"], "history, written");
    assert_eq!(resource("sky.draw:lit")["memory"]["after"], json!(["a\"b.draw:ids"]));
    assert_eq!(resource("gi.trace:bounce")["shape"]["mips"], 2);
    assert_eq!(all["histories"], json!([{"previous": "colour.previous", "next": "colour.next"}]));
    assert_eq!(all["heaps"], json!([{"kind": 0, "bytes": plan.memory.aliased}]));
}

#[test]
fn the_page_shows_every_pass_wait_barrier_and_place() {
    let (declaration, plan) = on_three_queues("gbuffer");
    let page = Dump::new(&declaration, &plan).overlap(Some(0.125)).html();
    for pass in (0..declaration.passes.len() as u32).map(|p| declaration.pass_name(p)) {
        assert!(page.contains(pass), "{pass} is missing");
    }
    let drawn = |class: &str| page.matches(&format!("class=\"{class}\"")).count();
    // The legend has one mark of each kind.
    assert_eq!((drawn("pass"), drawn("batch"), drawn("life")), (7, 5, plan.transients.len()));
    assert_eq!((drawn("wait"), drawn("wait last")), (1 + 3, 2));
    let places = plan.before.iter().chain([&plan.end]).filter(|s| !s.is_empty()).count();
    let after = plan.after.iter().filter(|s| !s.is_empty()).count();
    assert_eq!((drawn("before"), drawn("after")), (1 + places, 1 + after));
    let marks = page.matches("barrier before the pass").count() + page.matches("barriers before the pass").count();
    assert_eq!(marks, plan.before.iter().filter(|s| !s.is_empty()).count());
    for t in &plan.transients {
        assert!(page.contains(&format!(" at {} of heap 0", t.offset)), "offset {} is missing", t.offset);
        assert!(page.contains(t.sharing.reason()));
    }
    for words in [
        "nothing that is kept needs `ao.trace:open`",
        "takes memory over from gbuffer.draw:ids",
        "leaves memory to sky.draw:lit",
        "not aliased: it is live on several queues",
        "released by graphics to async compute",
        "batch 3 on graphics waits for batch 1 on async compute",
        "0.125 ms",
        "lower bound 2816 bytes",
        "storage read-write mip 1",
        "colour.next (history, written)",
    ] {
        assert!(page.contains(words), "{words} is missing");
    }
    for foreign in ["http", "<script", "@import", "<link", "src="] {
        assert!(!page.contains(foreign), "{foreign}: the page needs nothing else and runs nothing");
    }
}

#[test]
fn the_page_escapes_every_name() {
    let (declaration, plan) = on_three_queues("<b>&\"'");
    let page = super::html(&declaration, &plan);
    assert!(page.contains("&lt;b&gt;&amp;&quot;&#39;.draw"));
    assert!(!page.contains("<b>&") && !page.contains("&\"'"));
}

/// A device whose buffers and images need different kinds of memory.
struct TwoKinds;

impl plan::Footprints for TwoKinds {
    fn footprint(&mut self, shape: Shape, _: Uses, _: plan::Sharing) -> plan::Footprint {
        plan::Footprint { bytes: shape.bytes(), align: 1, kind: u8::from(!shape.is_image()) }
    }
}

#[test]
fn the_page_has_a_panel_per_heap_and_room_for_many_passes() {
    let mut g = FrameGraph::new(Extent::new(64, 64));
    let mut last: Option<Handle<Image>> = None;
    for i in 0..60 {
        last = Some(g.pass(&format!("stage{}.a_rather_long_name_{i}", i / 4), Queue::Graphics, |p| {
            last.map(|image| p.sample(image));
            let _ = p.create_buffer("counts", BufferDesc::new(1000));
            (p.create("image", ImageDesc::full(Format::R8Unorm)).0.read(), |_: &mut Record| {})
        }));
    }
    g.output(last.unwrap());
    let declaration = g.finish().unwrap().declaration;
    let plan = plan(&declaration, &Switches::default(), Queues::default(), &mut TwoKinds);
    let page = super::html(&declaration, &plan);
    assert!(page.contains(">Heap 0<") && page.contains(">Heap 1<"));
    assert!(page.contains("lower bound 8192 bytes") && page.contains("lower bound 1000 bytes"));
    assert!(page.contains("rotate(-45)"), "names climb where they do not fit side by side");
    assert_eq!(page.matches("class=\"pass\"").count(), 60);
}

#[test]
fn an_empty_frame_has_dumps() {
    let declaration = FrameGraph::new(Extent::new(1, 1)).finish().unwrap().declaration;
    let plan = plan_with(&declaration, "");
    assert!(super::text(&declaration, &plan).contains("graph: 0 passes"));
    assert!(super::html(&declaration, &plan).ends_with("</html>\n"));
    assert!(serde_json::from_str::<serde_json::Value>(&super::json(&declaration, &plan)).unwrap()["passes"].is_array());
}

#[test]
fn dumps_are_the_same_every_time() {
    let ((a, plan_a), (b, plan_b)) = (on_three_queues("gbuffer"), on_three_queues("gbuffer"));
    for dump in [super::text, super::dot, super::json, super::html] {
        assert_eq!(dump(&a, &plan_a), dump(&b, &plan_b));
    }
}
