//! The device's pipeline statistics match the work that was submitted.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::config::Config;
use magpie::graph::execute::ExecuteOptions;
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record, Switches};
use magpie::measure::{FrameSample, Statistics};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::Address;
use magpie_tests::bench::{Bench, results};
use magpie_tests::harness::{builtin, gpu};

fn counted(frame: &FrameSample, pass: &str) -> Result<Option<Statistics>> {
    let found = frame.passes.iter().find(|p| p.name == pass).with_context(|| format!("{pass} did not run"))?;
    Ok(found.statistics)
}

#[test]
fn a_known_dispatch_is_counted_on_every_queue_that_counts() -> Result<()> {
    #[repr(C)]
    #[derive(Clone, Copy, Pod, Zeroable)]
    struct Params {
        to: Address,
    }
    const BYTES: u64 = 64 * 30 * 4;
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let fill = bench.kernel(
        "fill.comp",
        r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };
layout(push_constant, scalar) uniform Push { uvec2 to; };
void main() {
    uint group = gl_WorkGroupID.x + 5u * (gl_WorkGroupID.y + 3u * gl_WorkGroupID.z);
    Words(to).at[64u * group + gl_LocalInvocationID.x] = group;
}
"#,
    )?;
    let switches = Switches { queues: Some(3), ..Switches::default() };
    for statistics in [true, false, true] {
        bench.executor.set_options(ExecuteOptions { switches, statistics, ..ExecuteOptions::default() });
        let ran = bench.run(Extent::new(1, 1), &[], |g, imports| {
            let step = |g: &mut magpie::graph::FrameGraph, name: &str, queue, groups: [u32; 3]| {
                g.pass(name, queue, |p| {
                    let (words, to) = p.create_buffer("words", BufferDesc::new(BYTES));
                    (words.read(), move |c: &mut Record<'_>| c.dispatch_groups(fill, &Params { to: c.id(to) }, groups))
                })
            };
            let many = step(g, "known.many", Queue::Graphics, [5, 3, 2]);
            let few = step(g, "known.few", Queue::AsyncCompute, [7, 1, 1]);
            for (name, from) in [("known.first", many), ("known.second", few)] {
                let (target, _buffer) = results(&gpu, g, imports, name, BYTES)?;
                let target = g.pass(name, Queue::Transfer, |p| {
                    let from = p.copy_from(from);
                    let (target, to) = p.copy_to(target);
                    (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, BYTES))
                });
                g.leave(target.read(), Access::HostRead, Domain::Copy);
            }
            Ok(())
        })?;
        let frame = &ran.executed.sample;
        let queues: Vec<_> = ["known.many", "known.few", "known.first"]
            .iter()
            .filter_map(|name| frame.passes.iter().find(|p| p.name == *name))
            .map(|p| p.queue)
            .collect();
        ensure!(queues == ["graphics", "async compute", "transfer"], "{queues:?}");
        ensure!(!frame.waits.is_empty(), "no queue waited for another");
        if !statistics || !gpu.has_statistics() {
            ensure!(frame.passes.iter().all(|p| p.statistics.is_none()), "nothing was to be counted");
            if statistics {
                eprintln!("skipped: {} does not count what shaders do", gpu.report().name);
            }
            continue;
        }
        let compute = |compute_invocations| Some(Statistics { compute_invocations, ..Statistics::default() });
        ensure!(counted(frame, "known.many")? == compute(64 * 30), "{:?}", counted(frame, "known.many")?);
        ensure!(counted(frame, "known.few")? == compute(64 * 7), "{:?}", counted(frame, "known.few")?);
        ensure!(counted(frame, "known.first")?.is_none() && counted(frame, "known.second")?.is_none(), "copies");
    }
    Ok(())
}

#[test]
fn the_frame_counts_its_pixels_and_triangles() -> Result<()> {
    const SIZE: [u32; 2] = [96, 56];
    let Some(gpu) = gpu()? else { return Ok(()) };
    if !gpu.has_statistics() {
        eprintln!("skipped: {} does not count what shaders do", gpu.report().name);
        return Ok(());
    }
    let scene = builtin("cornell")?;
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed: 0, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options)?;
    renderer.set_execution(ExecuteOptions { statistics: true, ..renderer.execution() });
    let frame = renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false })?;
    let frame = frame.context("a size of zero")?.sample;
    let pixels = u64::from(SIZE[0] * SIZE[1]);

    let drawn = counted(&frame, "gbuffer.draw")?.context("counts of gbuffer.draw")?;
    println!("gbuffer.draw: {drawn:?}");
    let triangles = drawn.input_vertices / 3;
    ensure!(drawn.input_vertices > 0 && drawn.input_vertices % 3 == 0, "whole triangles: {drawn:?}");
    ensure!((1..=drawn.input_vertices).contains(&drawn.vertex_invocations), "{drawn:?}");
    // A triangle may be outside, and one that is clipped may become several.
    ensure!((1..=8 * triangles).contains(&drawn.clipping_primitives), "{drawn:?}");
    // The box is in the middle of the picture; helper invocations of 2x2 quads may count, and overdraw counts again.
    ensure!((pixels / 4..=20 * pixels).contains(&drawn.fragment_invocations), "{drawn:?}");
    ensure!(drawn.compute_invocations == 0, "{drawn:?}");

    // One thread per pixel, in groups of 8x8 that divide the picture.
    let traced = counted(&frame, "shadows.trace")?.context("counts of shadows.trace")?;
    ensure!(traced == Statistics { compute_invocations: pixels, ..Statistics::default() }, "{traced:?}");
    Ok(())
}
