//! Frames in flight: the processor goes on while the device works, and nothing else changes.
use anyhow::{Context, Result, ensure};
use magpie::graph::Switches;
use magpie::graph::execute::ExecuteOptions;
use magpie::measure::FrameSample;
use magpie::scene::{BUILTIN, Scene};
use magpie_passes::{FrameRequest, FrameResult, MOST_IN_FLIGHT, RenderError, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu, gpu_without_validation};
use std::collections::VecDeque;

#[path = "../../demo/examples/headless_turntable.rs"]
#[allow(dead_code)] // its `main` is not used here
mod headless_turntable;

const SIZE: [u32; 2] = [64, 45];

/// A frame as in a viewer: the scene moves, and each is read back.
fn request(scene: &Scene, frame: u32) -> FrameRequest<'_> {
    FrameRequest { camera: &scene.cameras[0], time: f64::from(frame) / 30.0, view: None, read_back: true }
}

/// Results of the first frames after a restart. Each is taken as late as the number in flight allows.
fn results(renderer: &mut Renderer, scene: &Scene, frames: u32, in_flight: u32) -> Result<Vec<FrameResult>> {
    renderer.restart();
    let (mut tickets, mut results) = (VecDeque::new(), Vec::new());
    for frame in 0..frames {
        tickets.push_back(renderer.submit(request(scene, frame))?.context("a size of zero")?);
        let most = if frame + 1 == frames { 0 } else { in_flight as usize - 1 };
        while tickets.len() > most {
            let oldest = tickets.pop_front().context("no ticket")?;
            let frame = oldest.frame();
            let result = renderer.finish(oldest)?;
            ensure!(result.frame == frame && result.findings.is_empty(), "{frame}: {:?}", result.findings);
            results.push(result);
        }
    }
    ensure!(results.iter().zip(0..).all(|(result, frame)| result.frame == frame), "frames out of order");
    Ok(results)
}

/// Bytes of both images.
fn bytes(result: &FrameResult) -> Option<(&[u8], &[u8])> {
    let images = result.images.as_ref()?;
    Some((&images.linear.bytes, &images.display.as_ref()?.bytes))
}

fn renderer(gpu: &magpie::gpu::Gpu, scene: &Scene, settings: &[&str], in_flight: u32) -> Result<Renderer> {
    let [width, height] = SIZE;
    let options = RenderOptions {
        width,
        height,
        check: gpu.validates(),
        frames_in_flight: in_flight,
        ..RenderOptions::default()
    };
    Ok(Renderer::new(gpu, scene, &Slots::default(), &config(settings)?, options)?)
}

/// Every frame has the same bytes, in every scene, while it moves, with anti-aliasing over time.
#[test]
fn pictures_do_not_depend_on_frames_in_flight() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let three = Switches { queues: Some(3), ..Switches::default() };
    let bits = (0..6).flat_map(|bit| [1 << bit, 63 ^ (1 << bit)]).chain([0, 63]);
    let all: Vec<Switches> = [Switches::default(), three].into_iter().chain(bits.map(Switches::combination)).collect();
    for (name, _) in BUILTIN {
        let scene = builtin(name)?;
        let settings = ["post.anti_aliasing=taa"];
        let expected = results(&mut renderer(&gpu, &scene, &settings, 1)?, &scene, 6, 1)?;
        let last = bytes(&expected[5]).context("no image")?;
        ensure!(
            last.0.iter().any(|b| *b != 0) && bytes(&expected[4]) != Some(last),
            "{name}: black, or nothing changes"
        );
        for in_flight in 2..=MOST_IN_FLIGHT {
            let mut renderer = renderer(&gpu, &scene, &settings, in_flight)?;
            // The scene with all features runs under all switches, with as many in flight as there may be.
            let thoroughly = *name == "carousel" && in_flight == MOST_IN_FLIGHT;
            let of_scene = if thoroughly { &all[..] } else { &all[..2] };
            for switches in of_scene {
                renderer.set_switches(*switches);
                let found = results(&mut renderer, &scene, 6, in_flight)?;
                let differ = (0..6).find(|&frame| bytes(&found[frame]) != bytes(&expected[frame]));
                ensure!(differ.is_none(), "{name}, {in_flight} in flight, {switches:?}: frame {differ:?} differs");
            }
        }
        println!("{name}: the same pictures");
    }
    Ok(())
}

/// When a frame was submitted, how long the processor took to get there, and when the device ended it and how long it took: nanoseconds.
struct Times {
    submitted: u64,
    prepared_ns: u64,
    ended: u64,
    gpu_ns: u64,
}

fn times(sample: &FrameSample) -> Option<Times> {
    let prepared_ns = sample.plan_ns + sample.bind_ns + sample.record_ns + sample.submit_ns;
    let (submitted, gpu_ns) = (sample.start_ns? + prepared_ns, sample.gpu_ns?);
    let prepared_ns = sample.declare_ns + prepared_ns;
    Some(Times { submitted, prepared_ns, ended: sample.gpu_begin_ns? + gpu_ns, gpu_ns })
}

/// With two frames in flight the next one is submitted before the device ends the one before; with one it never is.
#[test]
fn the_processor_records_while_the_device_works() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    for in_flight in 1..=MOST_IN_FLIGHT {
        let mut renderer = renderer(&gpu, &scene, &[], in_flight)?;
        let found = results(&mut renderer, &scene, 24, in_flight)?;
        let times: Option<Vec<Times>> = found.iter().map(|result| times(&result.sample)).collect();
        let Some(times) = times else {
            println!("the clocks of this device cannot be compared");
            return Ok(());
        };
        // The first frames create what is kept, for which they wait. Where the device is the faster one, it is done before the next frame comes.
        let pairs: Vec<&[Times]> = times[8..].windows(2).filter(|p| p[0].gpu_ns > 2 * p[1].prepared_ns).collect();
        let ahead = pairs.iter().filter(|pair| pair[1].submitted < pair[0].ended).count();
        println!("{in_flight} in flight: {ahead} of {} frames were submitted before the one before ended", pairs.len());
        ensure!(in_flight > 1 || ahead == 0, "frames overlap though each was waited for");
        ensure!(in_flight == 1 || ahead * 4 >= pairs.len() * 3, "the processor waits for the device");
    }
    Ok(())
}

/// Results can be asked for in any order, later, or never.
#[test]
fn tickets_may_be_kept_or_dropped() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("carousel")?;
    let expected = results(&mut renderer(&gpu, &scene, &[], 1)?, &scene, 6, 1)?;
    let mut renderer = renderer(&gpu, &scene, &[], 3)?;
    let mut kept = Vec::new();
    for frame in 0..6 {
        let ticket = renderer.submit(request(&scene, frame))?.context("a size of zero")?;
        if frame % 2 == 1 {
            kept.push(ticket);
        }
    }
    let first = &kept[0];
    ensure!(renderer.is_done(first), "with three in flight the second of six frames must be done");
    while let Some(ticket) = kept.pop() {
        let frame = ticket.frame() as usize;
        let result = renderer.finish(ticket)?;
        ensure!(result.frame as usize == frame && bytes(&result) == bytes(&expected[frame]), "frame {frame} differs");
    }
    // A renderer that goes with frames in flight leaves nothing behind, and the device goes on.
    let _ = renderer.submit(request(&scene, 6))?;
    drop(renderer);
    gpu.wait_idle()?;
    gpu.check_validation()?;
    Ok(())
}

/// The example `headless_turntable`: every frame once, in order, and the camera goes around.
#[test]
fn a_turntable_has_every_frame() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("carousel")?;
    let mut frames = Vec::new();
    headless_turntable::turntable(&gpu, &scene, SIZE, 5, |result| {
        ensure!(result.frame as usize == frames.len(), "frame {} after {}", result.frame, frames.len());
        frames.push(bytes(&result).context("no image")?.1.to_vec());
        Ok(())
    })?;
    ensure!(frames.len() == 5 && frames.windows(2).all(|pair| pair[0] != pair[1]), "{} frames", frames.len());
    Ok(())
}

/// The error of a lost device names the pass of the frame in which it was lost, whichever frame is asked for.
#[test]
fn a_lost_device_is_told_by_the_frame_that_lost_it() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut renderer = renderer(&gpu, &scene, &[], 3)?;
    renderer.set_execution(ExecuteOptions { breadcrumbs: true, ..renderer.execution() });
    let good = renderer.submit(request(&scene, 0))?.context("a size of zero")?;
    renderer.lose_device_in("direct.shade");
    let lost = renderer.submit(request(&scene, 1))?.context("a size of zero")?;
    let later = renderer.submit(request(&scene, 2))?.context("a size of zero")?;
    let error = renderer.finish(later).err().context("the device was not lost")?;
    ensure!(error.to_string().contains("direct.shade began last"), "{error}");
    ensure!(renderer.finish(good)?.images.is_some(), "the frame before");
    let error = renderer.finish(lost).err().context("the frame went on")?;
    ensure!(error.to_string().contains("the device was lost"), "{error}");
    Ok(())
}

/// A mistake in one frame leaves those before it alone.
#[test]
fn a_frame_that_fails_leaves_others_alone() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut renderer = renderer(&gpu, &scene, &[], 3)?;
    let good = renderer.submit(request(&scene, 0))?.context("a size of zero")?;
    let wrong = FrameRequest { view: Some(("no", "such")), ..request(&scene, 1) };
    ensure!(matches!(renderer.submit(wrong), Err(RenderError::View(_))), "a view that does not exist");
    let next = renderer.submit(request(&scene, 1))?.context("a size of zero")?;
    ensure!(renderer.finish(good)?.images.is_some() && renderer.finish(next)?.frame == 1, "frames around it");
    Ok(())
}
