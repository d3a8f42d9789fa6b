//! NaN and infinity are traced to the frame, pass, output and place of origin, even if they are visible only frames later.
use anyhow::{Context, Result, bail, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::{Gpu, Kernel};
use magpie::graph::check::{FindingTracker, Link, Place, Poison, PoisonValue, Report};
use magpie::graph::{HistoryScope, ImportKey, Origin, Shape};
use magpie::measure::PassTime;
use magpie::pixels::Pixels;
use magpie::prelude::*;
use magpie::scene::{ResidentOptions, ResidentScene};
use magpie::slot::SlotError;
use magpie_passes::contracts::{LightingIn, LightingOut};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::{SampledImage, Stage, StorageImage};
use magpie_tests::bench::{Bench, Shot};
use magpie_tests::harness::{builtin, config, gpu};
use std::collections::BTreeSet;

#[path = "nan_provenance/resources.rs"]
mod resources;

const SIZE: [u32; 2] = [96, 54];
/// A pixel of the floor in front of the camera, so that no pass skips it as background.
const ON_SURFACE: [u32; 2] = [48, 50];

/// Adds a constant to its input, or to 0 without one.
const ADD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint source; uint result; uvec2 size; float more; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(size)))) return;
    vec4 before = source == 0xffffffffu ? vec4(0.0) : load(source, pixel);
    store(result, pixel, before + more);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Add {
    source: SampledImage,
    result: StorageImage,
    size: [u32; 2],
    more: f32,
}

const NOTHING: SampledImage = SampledImage::NONE;

fn poison(pass: &str, output: &str, place: Place, value: PoisonValue) -> Poison {
    Poison { pass: pass.to_owned(), output: output.to_owned(), place, value }
}

/// Returns the only report.
fn only(tracker: &FindingTracker) -> Result<&Report> {
    match tracker.reports() {
        [report] => Ok(report),
        all => {
            bail!("{} reports instead of one: {}", all.len(), all.iter().map(|r| format!("\n{r}")).collect::<String>())
        }
    }
}

fn path(report: &Report) -> String {
    report.path.iter().map(Link::to_string).collect::<Vec<_>>().join(" → ")
}

#[test]
fn every_pass_of_the_default_frame() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let scene = builtin("courtyard")?;
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    let shot = Shot { scene: &resident, camera: &scene.cameras[0], extent: Extent::new(SIZE[0], SIZE[1]) };
    // 16 bits per channel of visibility cannot hold bad values.
    let config = config(&["shadows.precision=32"])?;
    let clean = bench.frame(shot, &config, &[])?.clean()?;
    ensure!(bench.tracker.reports().is_empty(), "a clean frame has no reports");
    let declaration = &clean.executed.declaration;
    let passes = clean.executed.plan.order.iter().copied().filter(|&p| !declaration.passes[p as usize].weak);
    let (mut traced, mut bounded) = (BTreeSet::new(), BTreeSet::new());
    let (mut runs, mut seeded) = (0, 0);
    for (number, pass) in (0..).zip(passes) {
        let name = declaration.pass_name(pass);
        for output in declaration.outputs_of(pass) {
            let Shape::Image { format, extent, .. } = declaration.resources[output.resource as usize].shape else {
                continue;
            };
            let elsewhere = [(3 + 7 * number) % SIZE[0], (40 + (SIZE[1] - 4) * number) % SIZE[1]];
            // In alternation, as testing both doubles the time.
            let (value, [x, y]) =
                if seeded % 2 == 0 { (PoisonValue::Nan, ON_SURFACE) } else { (PoisonValue::Infinity, elsewhere) };
            seeded += 1;
            let (x, y) = (x % extent.width, y % extent.height);
            bench.tracker.clear();
            let frame = bench.frames();
            let seed = poison(name, &output.name, Place::pixel(x, y), value);
            let ran = bench.poisoned_frame(shot, &config, seed);
            if !format.is_float() {
                let error = ran.err().context("a bounded format was poisoned")?.to_string();
                ensure!(error.contains("cannot hold it") && error.contains(name), "{error}");
                bounded.insert(name.to_owned());
                continue;
            }
            ensure!(!ran?.findings.is_empty(), "{name}:{} was not found", output.name);
            let report = only(&bench.tracker).with_context(|| format!("{name}:{} {value:?}", output.name))?;
            let origin = &report.origin;
            ensure!(
                (report.frame, origin.pass.as_str(), origin.output.as_str()) == (frame, name, &output.name),
                "{report}"
            );
            ensure!(origin.place == Place::pixel(x, y), "{report}");
            ensure!(
                [origin.nan, origin.infinite]
                    == [u64::from(value == PoisonValue::Nan), u64::from(value != PoisonValue::Nan)],
                "{report}"
            );
            // The previous half of a history has no contents before it is written.
            let has_contents =
                |resource, version| version > 0 || !declaration.resource_name(resource).ends_with(".next");
            let reads = declaration.uses_of(pass).iter();
            let reads = reads.filter(|u| u.reads.is_some_and(|version| has_contents(u.resource, version))).count();
            ensure!(origin.inputs.len() == reads, "{} of {reads} inputs: {report}", origin.inputs.len());
            let said = report.to_string();
            ensure!(origin.inputs.iter().all(|i| said.contains(&i.to_string())), "{said}");
            traced.insert(name.to_owned());
            runs += 1;
        }
    }
    let lost: Vec<&String> = bounded.difference(&traced).collect();
    println!("{runs} seeds in {traced:?}, each traced; only bounded outputs: {lost:?}");
    const BOUNDED: [&str; 6] = [
        "reproject.surfaces",
        "shadows.trace",
        "shadows.penumbra_width",
        "shadows.gradient",
        "ao.search",
        "post.tone_map",
    ];
    let is_bounded = |pass: &str| BOUNDED.contains(&pass) || pass.starts_with("shadows.blur_gradient");
    ensure!(traced.len() >= 6 && lost.iter().all(|pass| is_bounded(pass)), "{lost:?}");
    Ok(())
}

/// A constant goes through two histories, so it is visible two frames later.
struct Delayed {
    add: Kernel,
    scope: HistoryScope,
}

impl Effect for Delayed {
    type In = LightingIn;
    type Out = LightingOut;

    fn add(&mut self, g: &mut FrameGraph, _: &View, i: LightingIn) -> LightingOut {
        let add = self.add;
        let desc = ImageDesc::like(Format::Rgba32Float, i.gbuffer.depth);
        let extent = g.extent(i.gbuffer.depth);
        let size = [extent.width, extent.height];
        let (one, two) = (g.history(&self.scope, "one", desc), g.history(&self.scope, "two", desc));
        g.pass("reflections.make", Queue::Graphics, |p| {
            p.sample(i.gbuffer.ids);
            let result = p.write(one.next).1;
            ((), move |c: &mut Record<'_>| {
                c.dispatch(add, &Add { source: NOTHING, result: c.id(result), size, more: 0.25 }, extent);
            })
        });
        g.pass("reflections.delay", Queue::Graphics, |p| {
            let (source, result) = (p.sample(one.previous), p.write(two.next).1);
            ((), move |c: &mut Record<'_>| {
                c.dispatch(add, &Add { source: c.id(source), result: c.id(result), size, more: 0.0 }, extent);
            })
        });
        let radiance = g.pass("reflections.show", Queue::Graphics, |p| {
            let source = p.sample(two.previous);
            let (radiance, result) = p.create("radiance", desc);
            (radiance.read(), move |c: &mut Record<'_>| {
                c.dispatch(add, &Add { source: c.id(source), result: c.id(result), size, more: 0.0 }, extent);
            })
        });
        LightingOut::radiance(radiance)
    }
}

fn kernel(gpu: &Gpu, name: &str, glsl: &str) -> Result<Kernel> {
    Ok(gpu.kernel_from_words(name, &magpie_shaders::compile(name, glsl, Stage::Compute)?)?)
}

fn delayed_slots() -> Slots {
    let mut slots = Slots::default();
    slots.reflections.register("delayed", "Two frames late.", &[], |build, _| {
        let add = kernel(build.gpu()?, "add.comp", ADD).map_err(|e| SlotError::other(std::io::Error::other(e)))?;
        Ok(Box::new(Delayed { add, scope: HistoryScope::new() }))
    });
    slots
}

fn not_finite(image: &Pixels) -> Vec<usize> {
    let values = image.values();
    (0..values.len()).filter(|&i| values[i].iter().any(|v| !v.is_finite())).collect()
}

#[test]
fn one_that_shows_two_frames_later() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let mut config = config(&[])?;
    config.set("stages.reflections=delayed")?;
    let [x, y] = ON_SURFACE;
    for check in [true, false] {
        let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed: 0, check, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &delayed_slots(), &config, options)?;
        for frame in 0..6 {
            if frame == 1 {
                renderer.poison(poison("reflections.make", "one.next", Place::pixel(x, y), PoisonValue::Nan));
            }
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
            let result = renderer.frame(request)?.context("no frame")?;
            let seen = not_finite(&result.images.context("no image")?.linear);
            let expected = if frame == 3 { vec![(y * SIZE[0] + x) as usize] } else { Vec::new() };
            ensure!(seen == expected, "frame {frame}: {seen:?} instead of {expected:?}");
            let expected = check && (1..=3).contains(&frame);
            ensure!(result.findings.is_empty() != expected, "frame {frame}: {:?}", result.findings);
        }
        if !check {
            ensure!(renderer.finding_tracker().reports().is_empty(), "nobody looked");
            continue;
        }
        let report = only(renderer.finding_tracker())?;
        println!("{report}");
        let origin = &report.origin;
        ensure!(
            (report.frame, origin.pass.as_str(), origin.output.as_str()) == (1, "reflections.make", "one.next"),
            "{report}"
        );
        ensure!((origin.place, report.last_frame) == (Place::pixel(x, y), 3), "{report}");
        let expected = "reflections.make (frame 1) → history one → reflections.delay (frame 2) → history two → \
            reflections.show (frame 3) → compose.sum (frame 3) → sky.fill (frame 3)";
        ensure!(path(report) == expected, "{report}");
        renderer.restart();
        ensure!(renderer.finding_tracker().reports().is_empty(), "a restart forgets");
    }
    Ok(())
}

#[test]
fn a_camera_cut_ends_what_a_history_carried() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let (add, scope, extent) = (bench.kernel("add.comp", ADD)?, HistoryScope::new(), Extent::new(16, 8));
    for frame in 0..8 {
        if frame == 5 {
            bench.cut();
        }
        bench.run(extent, &[], |g, _| {
            let history = g.history(&scope, "colour", ImageDesc::full(Format::Rgba16Float));
            let sum = g.pass("gi.accumulate", Queue::Graphics, |p| {
                let (source, (sum, result)) = (p.sample(history.previous), p.write(history.next));
                (sum, move |c: &mut Record<'_>| {
                    let params = Add { source: c.id(source), result: c.id(result), size: [16, 8], more: 1.0 };
                    c.dispatch(add, &params, extent);
                })
            });
            g.output(sum.read());
            if frame == 2 {
                g.poison(poison("gi.accumulate", "colour.next", Place::pixel(9, 6), PoisonValue::Infinity));
            }
            Ok(())
        })?;
    }
    let report = only(&bench.tracker)?;
    println!("{report}");
    ensure!((report.frame, report.arose, report.last_frame) == (2, 1, 4), "{report}");
    ensure!(path(report) == "gi.accumulate (frame 2) → history colour → gi.accumulate (frame 3)", "{report}");
    Ok(())
}

#[test]
fn the_scan_changes_no_picture() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for name in ["courtyard", "cornell"] {
        let scene = builtin(name)?;
        let run = |check| -> Result<Vec<u8>> {
            let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed: 5, check, ..RenderOptions::default() };
            let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&[])?, options)?;
            let mut bytes = Vec::new();
            for _ in 0..3 {
                let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
                let result = renderer.frame(request)?.context("no frame")?;
                ensure!(result.findings.is_empty(), "{}", result.findings[0]);
                let scans = result.sample.passes.iter().filter(|p| p.name.starts_with("check.")).count();
                ensure!((scans > 0) == check, "{scans} scans");
                let images = result.images.context("no image")?;
                bytes.extend(images.linear.bytes);
                bytes.extend(images.display.context("no image")?.bytes);
            }
            ensure!(
                renderer.finding_tracker().reports().is_empty() && renderer.finding_tracker().unscanned().count() == 0,
                "{name}"
            );
            Ok(bytes)
        };
        let (with, without) = (run(true)?, run(false)?);
        ensure!(with == without && with.iter().any(|b| *b != 0), "{name}: the picture changed");
    }
    Ok(())
}

#[test]
fn what_the_scan_costs() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let options = RenderOptions { width: 320, height: 180, seed: 0, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&[])?, options)?;
    // Measured in the same frames, so that load on the machine affects both.
    let (mut scans, mut others) = (Vec::new(), Vec::new());
    for frame in 0..11 {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        let result = renderer.frame(request)?.context("no frame")?;
        let (scan, other): (Vec<_>, Vec<_>) = result.sample.passes.iter().partition(|p| p.name.starts_with("check."));
        // GPU time only, as the validation layers dominate CPU time.
        let ms = |passes: &[&PassTime]| passes.iter().map(|p| p.gpu_ns.unwrap_or(0)).sum::<u64>() as f64 / 1e6;
        if frame > 0 {
            scans.push(ms(&scan));
            others.push(ms(&other));
        }
    }
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let (scans, others) = (median(scans), median(others));
    println!("courtyard, 320x180: {scans:.2} ms for the scan, {others:.2} ms for the frame itself, on the device");
    ensure!(scans < others, "the scan takes {scans:.2} ms, the frame itself {others:.2} ms");
    Ok(())
}

#[test]
fn what_cannot_be_poisoned_is_an_error() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let (add, extent) = (bench.kernel("add.comp", ADD)?, Extent::new(8, 8));
    let at = Place::pixel(1, 1);
    for (pass, output, place, why) in [
        ("user.other", "x", at, "no such pass runs"),
        ("user.idle", "x", at, "no such pass runs"),
        ("user.make", "y", at, "no such output"),
        ("user.make", "x", Place::pixel(8, 0), "does not write (8, 0)"),
        ("user.make", "x", Place::Pixel { x: 0, y: 0, mip: 1, layer: 0 }, "of mip 1"),
        ("user.make", "x", Place::Element(0), "no element 0"),
    ] {
        let ran = bench.run(extent, &[], |g, _| {
            let mut make = |name: &str| {
                g.pass(name, Queue::Graphics, |p| {
                    let (x, result) = p.create("x", ImageDesc::full(Format::R32Float));
                    (x, move |c: &mut Record<'_>| {
                        c.dispatch(
                            add,
                            &Add { source: NOTHING, result: c.id(result), size: [8, 8], more: 1.0 },
                            extent,
                        );
                    })
                })
            };
            let (x, _idle) = (make("user.make"), make("user.idle"));
            g.output(x.read());
            g.poison(poison(pass, output, place, PoisonValue::Nan));
            Ok(())
        });
        let error = ran.err().with_context(|| format!("{pass}:{output} {place} was poisoned"))?.to_string();
        ensure!(error.contains(why), "{error}: {why} is missing");
    }
    Ok(())
}

/// Whether an imported resource is the previous half of a history.
fn is_previous(origin: Origin) -> bool {
    matches!(origin, Origin::Imported { key: ImportKey::Previous(_), .. })
}

#[test]
fn histories_are_looked_at_as_they_come() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let (add, scope, extent) = (bench.kernel("add.comp", ADD)?, HistoryScope::new(), Extent::new(8, 8));
    let ran = bench.run(extent, &[], |g, _| {
        let history = g.history(&scope, "colour", ImageDesc::full(Format::R32Float));
        let sum = g.pass("user.sum", Queue::Graphics, |p| {
            let (source, (sum, result)) = (p.sample(history.previous), p.write(history.next));
            (sum, move |c: &mut Record<'_>| {
                c.dispatch(add, &Add { source: c.id(source), result: c.id(result), size: [8, 8], more: 1.0 }, extent);
            })
        });
        g.output(sum.read());
        Ok(())
    })?;
    let ran = ran.clean()?;
    let declaration = &ran.executed.declaration;
    let previous = (0..).zip(&declaration.resources).find(|(_, r)| is_previous(r.origin)).map(|(index, _)| index);
    let previous: u32 = previous.context("no history")?;
    let scan =
        (0..).zip(&declaration.passes).find(|(p, _)| declaration.pass_name(*p) == "check.import.colour.previous");
    let (scan, _) = scan.context("no scan of it")?;
    ensure!(declaration.uses_of(scan).iter().any(|u| u.resource == previous), "it scans something else");
    Ok(())
}
