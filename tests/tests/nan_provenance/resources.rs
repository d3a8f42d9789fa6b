//! NaN provenance for mips, layers, sizes and formats of images, and for buffers.
use crate::{ADD, Add, NOTHING, only, path, poison};
use anyhow::{Context, Result, bail, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::Kernel;
use magpie::graph::check::{Input, InputValue, NotScannable, Place, PoisonValue, Values};
use magpie::graph::{Buffer, HistoryScope, Part};
use magpie::prelude::*;
use magpie_shaders::Address;
use magpie_tests::bench::Bench;
use magpie_tests::harness::gpu;

/// Adds a constant to the words of a buffer, as floats, or to zeros if the source is 0.
const ADD_WORDS: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats { float at[]; };
layout(push_constant, scalar) uniform Push { uvec2 source; uvec2 result; uint count; float more; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    float before = source == uvec2(0u) ? 0.0 : Floats(source).at[i];
    Floats(result).at[i] = before + more;
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct AddWords {
    source: Address,
    result: Address,
    count: u32,
    more: f32,
}

fn add_words(c: &mut Record<'_>, kernel: Kernel, params: AddWords) {
    c.dispatch_groups(kernel, &params, [params.count.div_ceil(64), 1, 1]);
}

fn input<'a>(inputs: &'a [Input], name: &str) -> Result<&'a Input> {
    inputs.iter().find(|i| i.name == name).with_context(|| format!("no input {name} among {inputs:?}"))
}

#[test]
fn every_mip_and_layer_of_every_float_format() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let add = bench.kernel("add.comp", ADD)?;
    let full = Extent::new(37, 11);
    for format in [
        Format::R16Float,
        Format::Rg16Float,
        Format::Rgba16Float,
        Format::R32Float,
        Format::Rg32Float,
        Format::Rgba32Float,
    ] {
        for (mip, layer, x, y) in [(0, 0, 36, 10), (1, 2, 17, 4), (2, 1, 0, 0)] {
            bench.tracker.clear();
            bench.run(full, &[], |g, _| {
                let desc = ImageDesc { mips: 3, layers: 3, ..ImageDesc::full(format) };
                let mut image = None;
                for (m, l) in (0..3).flat_map(|m| (0..3).map(move |l| (m, l))) {
                    let part = Part { mip: m, mips: 1, layer: l, layers: 1 };
                    let extent = full.mip(u32::from(m));
                    image = Some(g.pass(&format!("user.fill{m}{l}"), Queue::Graphics, |p| {
                        let (made, result) = match image.take() {
                            None => p.create_part("image", desc, part),
                            Some(before) => p.write_part(before, part),
                        };
                        (made, move |c: &mut Record<'_>| {
                            let size = [extent.width, extent.height];
                            c.dispatch(add, &Add { source: NOTHING, result: c.id(result), size, more: 0.5 }, extent);
                        })
                    }));
                }
                let image = image.context("no image")?;
                // Reads one mip of one layer and writes an image of half the size.
                let part = Part { mip, mips: 1, layer, layers: 1 };
                let half = g.pass("user.halve", Queue::Graphics, |p| {
                    let source = p.sample_part(image.read(), part);
                    let (half, result) = p.create("half", ImageDesc::half(Format::R32Float));
                    let extent = full.mip(u32::from(mip));
                    (half, move |c: &mut Record<'_>| {
                        let size = [extent.width.min(19), extent.height.min(6)];
                        c.dispatch(add, &Add { source: NOTHING, result: c.id(result), size: [19, 6], more: 0.0 }, full);
                        let _ = (c.id(source), size);
                    })
                });
                g.output(half.read());
                g.output(image.read());
                let place = Place::Pixel { x, y, mip: mip.into(), layer: layer.into() };
                g.poison(poison(&format!("user.fill{mip}{layer}"), "image", place, PoisonValue::Nan));
                Ok(())
            })?;
            let report = only(&bench.tracker).with_context(|| format!("{format:?} mip {mip} layer {layer}"))?;
            let place = Place::Pixel { x, y, mip: mip.into(), layer: layer.into() };
            ensure!(report.origin.place == place && report.origin.pass == format!("user.fill{mip}{layer}"), "{report}");
            let Values::Float(values) = report.origin.value.values else { bail!("{report}") };
            ensure!(values[0].is_nan() && report.origin.value.channels == format.channels(), "{report}");
        }
    }
    Ok(())
}

#[test]
fn all_mips_that_one_pass_wrote_and_inputs_of_another_size() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let (add, words) = (bench.kernel("add.comp", ADD)?, bench.kernel("add_words.comp", ADD_WORDS)?);
    let full = Extent::new(32, 16);
    let bytes: u64 = [32 * 16, 16 * 8, 8 * 4].iter().map(|pixels| pixels * 4).sum();
    bench.run(full, &[], |g, _| {
        let texels = g.pass("user.texels", Queue::Graphics, |p| {
            let (texels, to) = p.create_buffer("texels", BufferDesc::floats(bytes / 4));
            let count = (bytes / 4) as u32;
            (texels, move |c: &mut Record<'_>| {
                add_words(c, words, AddWords { source: Address::default(), result: c.id(to), count, more: 2.0 });
            })
        });
        let image = g.pass("user.begin", Queue::Graphics, |p| {
            let desc = ImageDesc { mips: 3, ..ImageDesc::full(Format::R32Float) };
            let (image, result) = p.create_part("image", desc, Part::mip(0));
            (image, move |c: &mut Record<'_>| {
                c.dispatch(add, &Add { source: NOTHING, result: c.id(result), size: [32, 16], more: 1.0 }, full);
            })
        });
        let image = g.pass("user.copy", Queue::Graphics, |p| {
            let (from, (image, to)) = (p.copy_from(texels.read()), p.copy_to(image));
            (image, move |c: &mut Record<'_>| {
                let mips = [(0, 0), (32 * 16 * 4, 1), ((32 * 16 + 16 * 8) * 4, 2)];
                let mips = mips.map(|(offset, mip)| magpie::graph::MipCopy { offset, mip });
                c.copy_to_image(from, to, &mips);
            })
        });
        g.output(image.read());
        g.poison(poison("user.copy", "image", Place::Pixel { x: 3, y: 2, mip: 2, layer: 0 }, PoisonValue::Infinity));
        Ok(())
    })?;
    let report = only(&bench.tracker)?;
    println!("{report}");
    let origin = &report.origin;
    ensure!(origin.place == Place::Pixel { x: 3, y: 2, mip: 2, layer: 0 } && origin.infinite == 1, "{report}");
    let [texels, image] = [input(&origin.inputs, "user.texels:texels")?, input(&origin.inputs, "user.begin:image")?];
    // Pixel 19 of 32 corresponds to element 399 of 672.
    let InputValue::At(Place::Element(399), value) = texels.seen else { bail!("{report}") };
    ensure!(value.values == Values::Float([2.0, 0.0, 0.0, 0.0]), "{report}");
    ensure!(image.seen == InputValue::Unknown(NotScannable::Overwritten), "{report}");
    Ok(())
}

#[test]
fn inputs_are_shown_at_the_place_that_corresponds() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let add = bench.kernel("add.comp", ADD)?;
    let ramp = bench.kernel(
        "ramp.comp",
        r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint unused; uint result; uvec2 size; float more; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(size)))) return;
    if (more == 0.0) store(result, pixel, vec4(pixel, 0.0, 0.0));
    else store_uint(result, pixel, uvec4(pixel, 0u, 0u));
}
"#,
    )?;
    let full = Extent::new(40, 20);
    bench.run(full, &[], |g, _| {
        let mut make = |name: &str, format, more| {
            g.pass(name, Queue::Graphics, |p| {
                let (image, result) = p.create("x", ImageDesc::full(format));
                (image.read(), move |c: &mut Record<'_>| {
                    c.dispatch(ramp, &Add { source: NOTHING, result: c.id(result), size: [40, 20], more }, full);
                })
            })
        };
        let (floats, ids) = (make("user.floats", Format::Rg32Float, 0.0), make("user.ids", Format::Rg32Uint, 1.0));
        let half = g.pass("user.half", Queue::Graphics, |p| {
            p.sample(floats);
            p.sample(ids);
            let (half, result) = p.create("half", ImageDesc::half(Format::Rgba16Float));
            (half.read(), move |c: &mut Record<'_>| {
                let params = Add { source: NOTHING, result: c.id(result), size: [20, 10], more: 0.0 };
                c.dispatch(add, &params, Extent::new(20, 10));
            })
        });
        g.output(half);
        g.poison(poison("user.half", "half", Place::pixel(13, 4), PoisonValue::Nan));
        Ok(())
    })?;
    let report = only(&bench.tracker)?;
    println!("{report}");
    let inputs = &report.origin.inputs;
    let [floats, ids] = [input(inputs, "user.floats:x")?, input(inputs, "user.ids:x")?];
    // The centre of pixel (13, 4) of 20x10 is in pixel (27, 9) of 40x20.
    ensure!(floats.to_string() == "user.floats:x at (27, 9): (27.0, 9.0)", "{floats}");
    ensure!(ids.to_string() == "user.ids:x at (27, 9): (27, 9)", "{ids}");
    Ok(())
}

#[test]
fn buffers_of_floats_transient_and_kept() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let (words, scope) = (bench.kernel("add_words.comp", ADD_WORDS)?, HistoryScope::new());
    const COUNT: u32 = 1000;
    for frame in 0..4 {
        bench.run(Extent::new(8, 8), &[], |g, _| {
            let kept = g.kept_buffer(&scope, "sums", BufferDesc::new(u64::from(COUNT) * 4).of_floats());
            let fresh = g.pass("user.make", Queue::Graphics, |p| {
                let (fresh, result) = p.create_buffer("fresh", BufferDesc::floats(COUNT.into()));
                (fresh.read(), move |c: &mut Record<'_>| {
                    let params = AddWords { source: Address::default(), result: c.id(result), count: COUNT, more: 3.0 };
                    add_words(c, words, params);
                })
            });
            let sums = g.pass("user.sum", Queue::Graphics, |p| {
                p.read(fresh);
                let (sums, both) = p.write_buffer(kept.buffer);
                (sums.read(), move |c: &mut Record<'_>| {
                    add_words(c, words, AddWords { source: c.id(both), result: c.id(both), count: COUNT, more: 1.0 });
                })
            });
            g.output(sums);
            if frame == 1 {
                g.poison(poison("user.sum", "sums", Place::Element(777), PoisonValue::Nan));
            }
            Ok(())
        })?;
    }
    let report = only(&bench.tracker)?;
    println!("{report}");
    let origin = &report.origin;
    ensure!((report.frame, origin.place, origin.nan, origin.infinite) == (1, Place::Element(777), 1, 0), "{report}");
    ensure!(input(&origin.inputs, "user.make:fresh")?.to_string() == "user.make:fresh at element 777: 3.0", "{report}");
    ensure!(input(&origin.inputs, "sums")?.seen == InputValue::Unknown(NotScannable::Overwritten), "{report}");
    ensure!(path(report) == "user.sum (frame 1) → kept buffer sums → user.sum (frame 2)", "{report}");
    ensure!((report.arose, report.last_frame) == (1, 3), "{report}");

    // A NaN that arises in a transient propagates to its readers.
    let mut bench = Bench::new(&gpu)?;
    bench.run(Extent::new(8, 8), &[], |g, _| {
        let mut chain: Option<Handle<Buffer>> = None;
        for name in ["user.a", "user.b", "user.c"] {
            chain = Some(g.pass(name, Queue::Graphics, |p| {
                let source = chain.map(|b| p.read(b));
                let (made, result) = p.create_buffer("x", BufferDesc::floats(COUNT.into()));
                (made.read(), move |c: &mut Record<'_>| {
                    let source = source.map_or(Address::default(), |s| c.id(s));
                    add_words(c, words, AddWords { source, result: c.id(result), count: COUNT, more: 1.0 });
                })
            }));
        }
        g.output(chain.context("no chain")?);
        g.poison(poison("user.b", "x", Place::Element(999), PoisonValue::Infinity));
        Ok(())
    })?;
    let report = only(&bench.tracker)?;
    ensure!(path(report) == "user.b (frame 0) → user.c (frame 0)", "{report}");
    ensure!(report.origin.infinite == 1 && report.origin.place == Place::Element(999), "{report}");
    Ok(())
}

#[test]
fn one_that_was_out_of_sight_for_two_frames() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let (words, scope) = (bench.kernel("add_words.comp", ADD_WORDS)?, HistoryScope::new());
    const COUNT: u32 = 64;
    for frame in 0..4 {
        bench.run(Extent::new(8, 8), &[], |g, _| {
            let raw = BufferDesc::new(u64::from(COUNT) * 4);
            let (one, two) = (g.history_buffer(&scope, "one", raw), g.history_buffer(&scope, "two", raw));
            let mut step = |name: &str, from: Option<Handle<Buffer>>, to: Option<WriteHandle<Buffer>>| {
                g.pass(name, Queue::Graphics, |p| {
                    let source = from.map(|b| p.read(b));
                    let (made, result) = match to {
                        Some(to) => p.write_buffer(to),
                        None => p.create_buffer("seen", raw.of_floats()),
                    };
                    (made.read(), move |c: &mut Record<'_>| {
                        let source = source.map_or(Address::default(), |s| c.id(s));
                        add_words(c, words, AddWords { source, result: c.id(result), count: COUNT, more: 1.0 });
                    })
                })
            };
            step("user.hide", None, Some(one.next));
            step("user.pass", Some(one.previous), Some(two.next));
            let seen = step("user.reveal", Some(two.previous), None);
            g.output(seen);
            if frame == 1 {
                g.poison(poison("user.hide", "one.next", Place::Element(40), PoisonValue::Nan));
            }
            Ok(())
        })?;
    }
    let report = only(&bench.tracker)?;
    println!("{report}");
    ensure!((report.frame, report.origin.pass.as_str(), report.last_frame) == (3, "user.reveal", 3), "{report}");
    ensure!(report.origin.place == Place::Element(40), "{report}");
    ensure!(input(&report.origin.inputs, "two.previous")?.seen == InputValue::Unknown(NotScannable::Raw), "{report}");
    ensure!(report.to_string().contains("two.previous: not scanned"), "{report}");
    Ok(())
}

#[test]
fn more_outputs_than_one_buffer_of_findings_holds() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let words = bench.kernel("add_words.comp", ADD_WORDS)?;
    // 200 outputs at 44 bytes each exceed the first buffer of 4 KiB.
    let ran = bench.run(Extent::new(8, 8), &[], |g, _| {
        let mut last: Option<Handle<Buffer>> = None;
        for i in 0..200 {
            last = Some(g.pass(&format!("user.pass{i}"), Queue::Graphics, |p| {
                let source = last.map(|b| p.read(b));
                let (made, result) = p.create_buffer("x", BufferDesc::floats(4));
                (made.read(), move |c: &mut Record<'_>| {
                    let source = source.map_or(Address::default(), |s| c.id(s));
                    add_words(c, words, AddWords { source, result: c.id(result), count: 4, more: 1.0 });
                })
            }));
        }
        g.output(last.context("no pass")?);
        g.poison(poison("user.pass190", "x", Place::Element(3), PoisonValue::Nan));
        Ok(())
    })?;
    ensure!(
        ran.unscanned.is_empty() && ran.findings.len() == 10,
        "{} findings, {:?}",
        ran.findings.len(),
        ran.unscanned
    );
    let report = only(&bench.tracker)?;
    ensure!((report.origin.pass.as_str(), report.path.len()) == ("user.pass190", 10), "{report}");
    Ok(())
}
