//! What a renderer looks into, frame by frame.
use super::{bits, looks};
use anyhow::{Context, Result, ensure};
use magpie::gpu::Gpu;
use magpie::pixels::Pixels;
use magpie::scene::Scene;
use magpie_passes::parts::inspect::{Inspected, Inspection, Look, Pick};
use magpie_passes::{FrameRequest, MOST_IN_FLIGHT, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};
use std::collections::VecDeque;

/// A small renderer.
fn renderer(gpu: &Gpu, scene: &Scene, frames_in_flight: u32) -> Result<Renderer> {
    let options =
        RenderOptions { width: 33, height: 21, check: gpu.validates(), frames_in_flight, ..RenderOptions::default() };
    let config = config(&["stages.gi=off", "stages.reflections=off", "stages.rays=heat-map"])?;
    Ok(Renderer::new(gpu, scene, &Slots::default(), &config, options)?)
}

/// What is seen in a frame of a renderer: whether the image was made, its display values, and what was found in it.
struct Frame {
    shown: Option<Pixels>,
    inspected: Option<Inspected>,
    /// Passes of the frame.
    passes: Vec<String>,
}

/// Frames of a renderer, as many in flight as it allows, each with the inspection that its number gives.
fn frames(
    renderer: &mut Renderer,
    scene: &Scene,
    in_flight: usize,
    frames: u32,
    inspection: impl Fn(u32) -> Option<Inspection>,
) -> Result<Vec<Frame>> {
    let (mut tickets, mut seen) = (VecDeque::new(), Vec::new());
    for frame in 0..frames {
        renderer.inspect(inspection(frame))?;
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        let ticket = renderer.submit_with(request, &mut |g, imports, made| {
            made.read_back(g, imports, "display", made.display);
            if let Some(image) = made.inspected {
                made.read_back(g, imports, "shown", image);
            }
            Ok(())
        })?;
        tickets.push_back(ticket.context("a size of zero")?);
        while tickets.len() >= in_flight || (frame + 1 == frames && !tickets.is_empty()) {
            let result = renderer.finish(tickets.pop_front().context("no ticket")?)?;
            let declaration = &result.declaration;
            seen.push(Frame {
                passes: result.plan.order.iter().map(|pass| declaration.pass_name(*pass).to_owned()).collect(),
                shown: result.copied.into_iter().find(|(name, _)| name == "shown").map(|(_, pixels)| pixels),
                inspected: result.inspected,
            });
        }
    }
    Ok(seen)
}

/// An image that a later pass overwrites is shown as its own pass left it, in every frame, with as many in flight as may be.
#[test]
fn an_image_is_caught_before_it_is_overwritten() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let look = Look { encodes: true, ..Look::default() };
    let outputs = |frame: u32| ["direct.shade", "sky.fill"][frame as usize % 2];
    let references = |frames: u32, output: &dyn Fn(u32) -> &'static str| {
        let mut renderer = renderer(&gpu, &scene, 1)?;
        let one = |frame: u32| {
            let view = Some((output(frame), "radiance"));
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: true };
            let result = renderer.frame(request)?.context("no frame")?;
            Ok(result.images.context("no image")?.linear)
        };
        (0..frames).map(one).collect::<Result<Vec<Pixels>>>()
    };
    let wanted = references(8, &outputs)?;
    let after = references(1, &|_| "sky.fill")?;
    ensure!(wanted[0].bytes != after[0].bytes, "the sky overwrites nothing");
    let mut renderer = renderer(&gpu, &scene, MOST_IN_FLIGHT)?;
    let seen = frames(&mut renderer, &scene, MOST_IN_FLIGHT as usize, 8, |frame| {
        let pick = Some(Pick::Pixel([frame, 20]));
        Some(Inspection { look, pick, ..Inspection::of(outputs(frame), "radiance", None) })
    })?;
    ensure!(seen.len() == 8);
    for (frame, seen) in (0..).zip(&seen) {
        let pixels = &wanted[frame as usize];
        let (shown, found) = (seen.shown.as_ref().context("not shown")?, seen.inspected.as_ref().context("not found")?);
        ensure!(found.pass == outputs(frame) && found.output == "radiance", "frame {frame}: {found:?}");
        let bits = bits(pixels);
        let pixel = found.pixel.context("no pixel")?;
        ensure!(pixel.at == [frame, 20], "frame {frame}: {pixel:?}");
        ensure!(pixel.bits[..3] == bits[20 * 33 + frame as usize][..3], "frame {frame}: {pixel:?}");
        for (at, (colour, bits)) in shown.bytes.as_chunks::<4>().0.iter().zip(&bits).enumerate() {
            let wanted = looks(*bits, pixels.format, &look);
            let off = (0..3).map(|c| (f64::from(colour[c]) - wanted[c]).abs()).fold(0.0, f64::max);
            ensure!(off < 0.6, "frame {frame}, pixel {at}: {colour:?}, wanted {wanted:?}");
        }
    }
    Ok(())
}

/// What a frame does not have is no error, and what is not inspected has no pass and no byte.
#[test]
fn frames_without_the_image_go_on() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut renderer = renderer(&gpu, &scene, 2)?;
    let asked = [
        None,
        Some(("gi.resolve", "radiance")), // off
        Some(("direct.shade", "no_such")),
        Some(("rays.heat_map", "colours")), // left out unless somebody looks
        Some(("direct.shade", "")),
        None,
    ];
    let seen = frames(&mut renderer, &scene, 2, 6, |frame| {
        asked[frame as usize].map(|(pass, output)| Inspection::of(pass, output, None))
    })?;
    for (frame, seen) in seen.iter().enumerate() {
        let is_there = frame == 3;
        ensure!(seen.shown.is_some() == is_there && seen.inspected.is_some() == is_there, "frame {frame}");
        let passes = seen.passes.iter().filter(|name| name.starts_with("inspect.")).count();
        ensure!(passes == if is_there { 2 } else { 0 }, "frame {frame}: {:?}", seen.passes);
        ensure!(seen.passes.iter().any(|name| name == "rays.heat_map") == is_there, "frame {frame}: {:?}", seen.passes);
    }
    // Some time later nothing is left of it, and a picture is what it is without.
    let plain = frames(&mut renderer, &scene, 2, 1, |_| None)?;
    ensure!(plain[0].passes == seen[0].passes, "{:?}", plain[0].passes);
    Ok(())
}
