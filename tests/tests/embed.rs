//! Magpie inside of an application that has a Vulkan device of its own: the same pictures, bit for bit, and no validation message from
//! the opening of the application's instance to its end.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie::gpu::{DeviceSetup, Gpu, GpuError, GpuOptions};
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderError, RenderOptions, Renderer, Slots};
use magpie_tests::harness::builtin;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{env, fs};

#[path = "../../demo/examples/embed.rs"]
#[allow(dead_code)] // its `main` is not used here
mod embed;
use embed::{Device, Messages, Target, animate, render};

const SIZE: [u32; 2] = [64, 36];

/// One test at a time: the layers may crash where one thread opens a device while another uses one (Vulkan-ValidationLayers, issue 4391).
fn alone() -> Option<MutexGuard<'static, ()>> {
    static ONE: Mutex<()> = Mutex::new(());
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    Some(ONE.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Runs the application with the validation layers on, and fails if they have said anything once all of it is destroyed.
fn application(more: impl FnOnce(&mut DeviceSetup), work: impl FnOnce(&Arc<Device>) -> Result<()>) -> Result<()> {
    let messages = Messages::default();
    let device = Device::open(Some(messages.clone()), more)?;
    let worked = work(&device);
    ensure!(Arc::strong_count(&device) == 1 || worked.is_err(), "something still holds the device");
    drop(device);
    worked?;
    let said = messages.lock().unwrap_or_else(PoisonError::into_inner).clone();
    ensure!(said.is_empty(), "{} messages, the first: {}", said.len(), said[0]);
    Ok(())
}

fn moving() -> Result<Scene> {
    builtin("carousel")
}

fn options([width, height]: [u32; 2]) -> RenderOptions {
    RenderOptions { width, height, ..RenderOptions::default() }
}

/// The display values of frames on a device that Magpie opened itself: the one of this name. Each has a size and a time.
fn on_its_own(device: &str, frames: &[([u32; 2], f64)]) -> Result<Vec<Vec<u8>>> {
    let wanted = GpuOptions { device: Some(device.to_owned()), validation: true, ..GpuOptions::default() };
    let (gpu, scene) = (Gpu::new(&wanted)?, moving()?);
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options(frames[0].0))?;
    let mut pictures = Vec::new();
    for &([width, height], time) in frames {
        renderer.resize(width, height);
        let request = FrameRequest { camera: &scene.cameras[0], time, view: None, read_back: true };
        let images = renderer.frame(request)?.and_then(|result| result.images);
        pictures.push(images.and_then(|images| images.display).context("no picture")?.bytes);
    }
    gpu.check_validation()?;
    Ok(pictures)
}

fn same(found: &[Vec<u8>], wanted: &[Vec<u8>]) -> Result<()> {
    ensure!(found.len() == wanted.len(), "{} pictures instead of {}", found.len(), wanted.len());
    for (frame, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let differ = found.iter().zip(wanted).filter(|(a, b)| a != b).count();
        ensure!(found.len() == wanted.len() && differ == 0, "frame {frame}: {differ} of {} bytes differ", wanted.len());
    }
    ensure!(wanted.windows(2).all(|pair| pair[0] != pair[1]), "two frames in a row are the same");
    Ok(())
}

/// The example: two targets by turns, several frames in flight, each waiting on the device for the copy of an earlier one.
#[test]
fn pictures_are_those_of_magpies_own_device() -> Result<()> {
    let Some(_alone) = alone() else { return Ok(()) };
    let times = [0.0, 0.1, 0.2, 0.3, 0.4];
    let (mut pictures, mut name, mut rays) = (Vec::new(), String::new(), Vec::new());
    application(
        |_| (),
        |device| {
            let gpu = device.magpie()?;
            (name, rays) = (gpu.report().name.clone(), gpu.rays());
            animate(device, &gpu, &moving()?, SIZE, &times, |frame, pixels| {
                ensure!(frame == pictures.len(), "frame {frame} comes after {} others", pictures.len());
                pictures.push(pixels);
                Ok(())
            })?;
            Ok(gpu.check_validation()?)
        },
    )?;
    same(&pictures, &on_its_own(&name, &times.map(|time| (SIZE, time)))?)?;
    let own = Gpu::new(&GpuOptions { device: Some(name), ..GpuOptions::default() })?;
    ensure!(own.rays() == rays, "the application's device traces by {rays:?}, Magpie's own by {:?}", own.rays());
    Ok(())
}

/// As many frames as may be in flight, into one image: every frame waits on the device for the application's copy of the one before.
#[test]
fn one_image_takes_every_frame_in_flight() -> Result<()> {
    let Some(_alone) = alone() else { return Ok(()) };
    let times = [0.0, 0.1, 0.2, 0.3];
    let (mut pictures, mut name) = (Vec::new(), String::new());
    application(
        |_| (),
        |device| {
            let (gpu, scene) = (device.magpie()?, moving()?);
            name = gpu.report().name.clone();
            let options = RenderOptions { frames_in_flight: 3, ..options(SIZE) };
            let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options)?;
            let target = Target::new(device, &gpu, SIZE)?;
            let image = target.image(&gpu)?;
            let mut tickets = VecDeque::new();
            for time in times {
                let ticket = render(&mut renderer, &scene, time, &image, target.free())?.context("no pixels")?;
                if !tickets.is_empty() {
                    pictures.push(target.pixels()?);
                }
                target.copy(&gpu, ticket.done())?;
                tickets.push_back(ticket);
            }
            pictures.push(target.pixels()?);
            for (frame, ticket) in (0..).zip(tickets) {
                ensure!(renderer.is_done(&ticket), "frame {frame} is not done, yet was copied");
                ensure!(renderer.finish(ticket)?.frame == frame, "tickets in another order");
            }
            Ok(gpu.check_validation()?)
        },
    )?;
    same(&pictures, &on_its_own(&name, &times.map(|time| (SIZE, time)))?)
}

/// The application replaces its image by one of another size while frames are in flight. It drops the old one at once; Magpie keeps it as
/// long as needed.
#[test]
fn the_image_changes_its_size() -> Result<()> {
    let Some(_alone) = alone() else { return Ok(()) };
    let frames = [(SIZE, 0.0), (SIZE, 0.1), ([50, 41], 0.2), ([50, 41], 0.3), (SIZE, 0.4)];
    // Frames whose picture nobody looks at, after which the image goes.
    let unseen = [1, 3];
    let (mut pictures, mut name) = (Vec::new(), String::new());
    application(
        |_| (),
        |device| {
            let (gpu, scene) = (device.magpie()?, moving()?);
            name = gpu.report().name.clone();
            let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options(SIZE))?;
            let mut shown: Option<([u32; 2], Arc<Target>)> = None;
            let in_use = gpu.in_use().1;
            for (size, time) in frames {
                let target = match shown.take().filter(|(known, _)| *known == size) {
                    Some((_, target)) => target,
                    None => Target::new(device, &gpu, size)?,
                };
                renderer.resize(size[0], size[1]);
                let image = target.image(&gpu)?;
                let ticket = render(&mut renderer, &scene, time, &image, target.free())?.context("no pixels")?;
                if unseen.contains(&pictures.len()) {
                    pictures.push(Vec::new());
                    let dropped = Arc::downgrade(&target);
                    drop((image, target));
                    ensure!(dropped.upgrade().is_some(), "the image was destroyed while its frame was in flight");
                    continue;
                }
                target.copy(&gpu, ticket.done())?;
                pictures.push(target.pixels()?);
                shown = Some((size, target));
            }
            // An image that does not fit the picture is refused, and the next frame is as if nothing had been.
            let wrong = Target::new(device, &gpu, [32, 32])?;
            let refused = render(&mut renderer, &scene, 0.5, &wrong.image(&gpu)?, wrong.free());
            let Err(error @ RenderError::Target { .. }) = refused else { anyhow::bail!("it is accepted") };
            ensure!(error.to_string().contains("32x32") && error.to_string().contains("64x36"), "{error}");
            drop((renderer, shown, wrong));
            gpu.wait_idle()?;
            ensure!(gpu.in_use().1 <= in_use, "images are left in the bindless set");
            Ok(gpu.check_validation()?)
        },
    )?;
    let mut wanted = on_its_own(&name, &frames)?;
    unseen.into_iter().for_each(|frame| wanted[frame].clear());
    same(&pictures, &wanted)
}

/// Magpie comes and goes while the application keeps its device, and an image that both used.
#[test]
fn the_application_outlives_magpie() -> Result<()> {
    let Some(_alone) = alone() else { return Ok(()) };
    let times = [0.0, 0.1, 0.2];
    let (mut lives, mut name) = (Vec::new(), String::new());
    application(
        |_| (),
        |device| {
            let mut kept: Option<Arc<Target>> = None;
            for life in 0..3 {
                let (gpu, scene) = (device.magpie()?, moving()?);
                name = gpu.report().name.clone();
                let target = match kept.take() {
                    Some(target) => target,
                    None => Target::new(device, &gpu, SIZE)?,
                };
                let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options(SIZE))?;
                let image = target.image(&gpu)?;
                let mut pictures = Vec::new();
                for time in times {
                    let ticket = render(&mut renderer, &scene, time, &image, target.free())?.context("no pixels")?;
                    target.copy(&gpu, ticket.done())?;
                    pictures.push(target.pixels()?);
                }
                if life == 1 {
                    // Magpie goes while a frame is in flight of which nobody has the ticket.
                    drop(render(&mut renderer, &scene, 0.3, &image, target.free())?);
                }
                gpu.check_validation()?;
                lives.push(pictures);
                kept = Some(target);
            }
            // Only the application is left. The image is its own still.
            let target = kept.context("no target")?;
            ensure!(Arc::strong_count(&target) == 1, "Magpie still holds the image");
            let last = lives.last().and_then(|pictures| pictures.last());
            ensure!(Some(&target.pixels()?) == last, "the application's copy changed");
            Ok(())
        },
    )?;
    let wanted = on_its_own(&name, &times.map(|time| (SIZE, time)))?;
    lives.iter().try_for_each(|pictures| same(pictures, &wanted))
}

/// What the application has not enabled is told by name, or gone without where it can be.
#[test]
fn what_a_device_lacks_is_said() -> Result<()> {
    let Some(_alone) = alone() else { return Ok(()) };
    let lacks = |more: fn(&mut DeviceSetup)| -> Result<Vec<String>> {
        let mut found = Vec::new();
        application(more, |device| match device.magpie() {
            Err(GpuError::Unsuited { what, lacks }) => {
                ensure!(what.starts_with("the device "), "{what}");
                found = lacks;
                Ok(())
            }
            other => anyhow::bail!("{other:?}"),
        })?;
        Ok(found)
    };
    let found = lacks(|setup| setup.core.geometry_shader = 0)?;
    ensure!(found == ["the feature geometry_shader is not enabled"], "{found:?}");
    let found = lacks(|setup| (setup.v12.scalar_block_layout, setup.v13.maintenance4) = (0, 0))?;
    let wanted = ["scalar_block_layout", "maintenance4"].map(|name| format!("the feature {name} is not enabled"));
    ensure!(found == wanted, "{found:?}");
    let found = lacks(|setup| setup.queues[0].index = 7)?;
    ensure!(found.len() == 1 && found[0].starts_with("queue 7 of family "), "{found:?}");

    // Without ray queries, Magpie traces in other ways.
    application(
        |setup| setup.ray_query.ray_query = 0,
        |device| {
            let gpu = device.magpie()?;
            ensure!(gpu.rays().iter().all(|rays| rays.name() != "query"), "{:?}", gpu.rays());
            Ok(gpu.check_validation()?)
        },
    )
}

/// The page quotes the example, but for the first excerpt, which shows a device with a swapchain.
#[test]
fn the_page_shows_the_example_as_it_is() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let example = fs::read_to_string(root.join("demo/examples/embed.rs"))?;
    let page = fs::read_to_string(root.join("docs/embedding.md"))?;
    let quoted: Vec<&str> =
        page.split("```rust\n").skip(2).filter_map(|rest| rest.split_once("```")).map(|(code, _)| code).collect();
    ensure!(quoted.len() == 2, "{} excerpts", quoted.len());
    for code in quoted {
        ensure!(example.contains(code), "the example does not hold\n{code}");
    }
    Ok(())
}
