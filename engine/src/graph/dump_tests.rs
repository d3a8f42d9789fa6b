//! The dumps of one small frame that has a bit of everything.

use super::super::{plan::plan_with, *};

fn frame() -> (Frame, Plan) {
    let mut g = FrameGraph::new(Extent::new(16, 8));
    let tlas = g.import_tlas("scene", Access::Trace, ImportKey::Caller(0));
    let readback = g.import_buffer("readback", BufferDesc::new(2048), Access::HostRead, ImportKey::Caller(1));
    g.leave(readback.read(), Access::HostRead, Domain::Copy);
    let depth = g.pass("gbuffer.draw", Queue::Graphics, |p| {
        let (depth, _) = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0);
        (depth.read(), |_: &mut Record| {})
    });
    let light = g.pass("shadows.trace", Queue::AsyncCompute, |p| {
        p.trace(tlas);
        p.sample(depth);
        let (light, _) = p.create("light", ImageDesc::like(Format::Rgba32Float, depth));
        (light, |_: &mut Record| {})
    });
    g.pass("ao.trace", Queue::AsyncCompute, |p| {
        p.sample(depth);
        let _ = p.create("open", ImageDesc { mips: 2, ..ImageDesc::half(Format::R8Unorm) });
        ((), |_: &mut Record| {})
    });
    let light = g.pass("sky.draw", Queue::Graphics, |p| (p.write(light).0, |_: &mut Record| {}));
    g.output(light.read());
    let _ = g.pass("copy", Queue::Transfer, |p| {
        p.copy_from(light.read());
        (p.copy_to(readback).0, |_: &mut Record| {})
    });
    let frame = g.finish().unwrap();
    let plan = plan_with(&frame.declaration, "");
    (frame, plan)
}

#[test]
fn text_reads_as_words() {
    let (frame, plan) = frame();
    let expected = "\
frame of 16x8: 4 passes, 1 left out, 7 barriers
transient memory: 2560 bytes when nothing is shared, 2560 at least

passes
   0 gbuffer.draw  (stage gbuffer, raster, wants graphics queue)
       wait   gbuffer.draw:depth: anything before depth (raster), layout undefined to depth attachment, contents are new
       make   gbuffer.draw:depth version 0: depth
   1 shadows.trace  (stage shadows, compute, wants async compute queue)
       wait   gbuffer.draw:depth: depth (raster) before sample (compute), layout depth attachment to shader read
       wait   shadows.trace:light: anything before storage write (compute), layout undefined to general, contents are new
       read   scene version 0: trace
       read   gbuffer.draw:depth version 0: sample
       make   shadows.trace:light version 0: storage write
   2 sky.draw  (stage sky, compute, wants graphics queue)
       wait   shadows.trace:light: storage write (compute) before storage read-write (compute)
       change shadows.trace:light version 0 to 1: storage read-write
   3 copy  (stage copy, copy, wants transfer queue)
       wait   shadows.trace:light: storage read-write (compute) before copy from (copy), layout general to transfer source
       wait   readback: host read (copy) before copy to (copy)
       read   shadows.trace:light version 1: copy from
       change readback version 0 to 1: copy to
 end
       wait   readback: copy to (copy) before host read (copy)

left out
     ao.trace: nothing that is kept needs `ao.trace:open`

resources
     scene  acceleration structure, imported, 0 bytes, pass 1
     readback  buffer of 2048 bytes, imported, 2048 bytes, pass 3
     gbuffer.draw:depth  image D32Float 16x8, 512 bytes, passes 0 to 1
     shadows.trace:light  image Rgba32Float 16x8, 2048 bytes, passes 1 to 3
     ao.trace:open  image R8Unorm 8x4, 2 mips, not used

outputs
     shadows.trace:light version 1
";
    assert_eq!(super::text(&frame.declaration, &plan), expected);
}

#[test]
fn dot_has_a_box_per_pass_and_marks_what_is_left_out() {
    let (frame, plan) = frame();
    let dot = super::dot(&frame.declaration, &plan);
    let lines: Vec<&str> = dot.lines().map(str::trim).collect();
    for expected in [
        "p0 [shape=box style=solid label=\"0 gbuffer.draw\"];",
        "p2 [shape=box style=dashed label=\"ao.trace\"];",
        "p4 [shape=box style=solid label=\"3 copy\"];",
        "r3_1 [shape=ellipse style=solid peripheries=2 label=\"shadows.trace:light version 1\"];",
        "r4_0 [shape=ellipse style=dashed peripheries=1 label=\"ao.trace:open version 0\"];",
        "r3_0 -> p3 [label=\"storage read-write\"];",
        "p3 -> r3_1 [label=\"storage read-write\"];",
    ] {
        assert!(lines.contains(&expected), "{expected} is not in\n{dot}");
    }
    assert_eq!(lines.iter().filter(|l| l.contains("shape=box")).count(), 5);
    assert_eq!((lines[0], lines.last()), ("digraph frame {", Some(&"}")));
}

#[test]
fn json_says_the_same() {
    let (frame, plan) = frame();
    let all: serde_json::Value = serde_json::from_str(&super::json(&frame.declaration, &plan)).unwrap();
    assert_eq!(all["size"], serde_json::json!([16, 8]));
    assert_eq!(all["passes"].as_array().unwrap().len(), 4);
    assert_eq!(
        all["passes"][1]["uses"][0],
        serde_json::json!({"resource": "scene", "access": "trace", "reads": 0, "writes": null})
    );
    assert_eq!(
        all["passes"][1]["barriers"][0],
        serde_json::json!({
            "resource": "gbuffer.draw:depth", "from": ["depth (raster)"], "to": "sample (compute)",
            "layout_from": "depth attachment", "layout_to": "shader read", "discard": false,
        })
    );
    assert_eq!(all["barriers_at_end"].as_array().unwrap().len(), 1);
    assert_eq!(all["left_out"][0]["name"], "ao.trace");
    assert_eq!(all["resources"][1]["leave"], "host read");
    assert_eq!(all["memory"], serde_json::json!({"transient_unaliased": 2560, "transient_lower_bound": 2560}));
}

#[test]
fn dumps_are_the_same_every_time() {
    let ((a, plan_a), (b, plan_b)) = (frame(), frame());
    assert_eq!(super::text(&a.declaration, &plan_a), super::text(&b.declaration, &plan_b));
    assert_eq!(super::dot(&a.declaration, &plan_a), super::dot(&b.declaration, &plan_b));
    assert_eq!(super::json(&a.declaration, &plan_a), super::json(&b.declaration, &plan_b));
}
