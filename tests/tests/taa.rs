//! Temporal anti-aliasing and upsampling: static pixels converge to the mean over the pixel, moving objects leave no ghosts.
use anyhow::{Context, Result, bail, ensure};
use glam::{Affine3A, DMat3, Quat, Vec3, Vec3Swizzles};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Light, Material, Scene};
use magpie_accuracy::metrics::{Picture, disocclusion, flicker, flip_ldr, mse, psnr};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene};
use magpie_tests::harness::{builtin, config_without_bounces, gpu};
use magpie_tests::rooms;
use std::f32::consts::PI;

const SIZE: [u32; 2] = [240, 135];
const SMALL: [u32; 2] = [96, 54];
/// No shadows, to measure edges only.
const HARD: &str = "stages.shadows=off";
/// Shadows without noise and history, to measure this effect only.
const SHARP: &str = "shadows.edges=hard";
const TAA: &str = "post.anti_aliasing=taa";

/// Images of one frame.
struct Seen {
    /// Linear radiance at the slot's input, in the size of the frame.
    input: Picture,
    /// Linear radiance of the output.
    picture: Picture,
    /// Display values, encoded to sRGB and decoded again.
    display: Picture,
    result: FrameResult,
}

/// Renders frames with every check on.
struct Run<'a> {
    renderer: Renderer,
    scene: &'a Scene,
    size: [u32; 2],
}

impl<'a> Run<'a> {
    fn new(gpu: &Gpu, scene: &'a Scene, size: [u32; 2], changes: &[&str]) -> Result<Self> {
        let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(
            gpu,
            scene,
            &Slots::default(),
            &config_without_bounces(&[changes, &[SHARP]].concat())?,
            options,
        )?;
        renderer.read_slots(&["sky"])?;
        Ok(Self { renderer, scene, size })
    }

    fn frame(&mut self, camera: &Camera, time: f64, read_back: bool) -> Result<FrameResult> {
        let request = FrameRequest { camera, time, view: None, read_back };
        let result = self.renderer.frame(request)?.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        Ok(result)
    }

    fn see(&mut self, camera: &Camera, time: f64) -> Result<Seen> {
        let mut result = self.frame(camera, time, true)?;
        let images = result.images.take().context("nothing was read back")?;
        let input = result.slots[0].1.as_ref().context("no sky")?;
        let seen = Seen {
            input: Picture::from_pixels(input)?,
            picture: Picture::from_pixels(&images.linear)?,
            display: Picture::from_pixels(images.display.as_ref().context("no display")?)?,
            result,
        };
        ensure!([seen.picture.width as u32, seen.picture.height as u32] == self.size, "{:?}", images.linear.extent);
        Ok(seen)
    }

    /// Renders a static view; returns every frame.
    fn still(&mut self, frames: usize, time: f64) -> Result<Vec<Seen>> {
        let camera = self.scene.cameras[0].clone();
        (0..frames).map(|_| self.see(&camera, time)).collect()
    }
}

fn mean<'a>(pictures: impl Iterator<Item = &'a Picture>) -> Picture {
    let mut sum: Vec<[f64; 3]> = Vec::new();
    let (mut count, mut size) = (0.0, (0, 0));
    for picture in pictures {
        sum.resize(picture.pixels.len(), [0.0; 3]);
        for (sum, pixel) in sum.iter_mut().zip(&picture.pixels) {
            (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
        }
        (count, size) = (count + 1.0, (picture.width, picture.height));
    }
    let pixels = sum.iter().map(|s| s.map(|x| (x / count) as f32)).collect();
    Picture { width: size.0, height: size.1, pixels }
}

/// A picture downsampled by a box filter of `by` by `by` pixels.
fn shrunk(large: &Picture, by: usize) -> Picture {
    let (width, height) = (large.width / by, large.height / by);
    let at = |i: usize, k: usize| large.pixels[(i / width * by + k / by) * large.width + i % width * by + k % by];
    let pixel = |i: usize| {
        let sum = |c: usize| (0..by * by).map(|k| f64::from(at(i, k)[c])).sum::<f64>();
        [0, 1, 2].map(|c| (sum(c) / (by * by) as f64) as f32)
    };
    Picture { width, height, pixels: (0..width * height).map(pixel).collect() }
}

/// PSNR of the display values of linear radiance without a tone curve, decibels.
fn shown_psnr(test: &Picture, reference: &Picture) -> Result<f64> {
    Ok(psnr(&test.encoded(), &reference.encoded(), 1.0)?)
}

#[test]
fn a_still_picture_becomes_the_mean_of_its_samples_and_keeps_still() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let frames = Run::new(&gpu, &scene, SIZE, &[TAA])?.still(64, 0.0)?;
    let reference = mean(frames.iter().map(|f| &f.input));
    let at = |frame: usize| shown_psnr(&frames[frame - 1].picture, &reference);
    let (first, eighth, last) = (at(1)?, at(8)?, at(64)?);
    println!("PSNR against the mean of 64 samples: frame 1 {first:.1}, 8 {eighth:.1}, 64 {last:.1} dB");
    ensure!(last > 40.0, "{last} dB after 64 frames");
    ensure!(eighth > first + 6.0 && last > eighth, "{first}, {eighth}, {last} dB");

    let late = |of: fn(&Seen) -> &Picture| frames[47..].iter().map(|f| of(f).clone()).collect::<Vec<_>>();
    let (before, after) = (late(|f| &f.input), late(|f| &f.picture));
    let still = std::slice::from_ref(&reference);
    let (before, after) = (flicker(&before, still)?, flicker(&after, still)?);
    println!("flicker of frames 48 to 64: input {before:?}, picture {after:?}");
    ensure!(after.variance * 1000.0 < before.variance, "{before:?} to {after:?}");
    Ok(())
}

/// The reference does not depend on the sample sequence: a picture of eight times the size, without textures, whose mip levels would
/// differ.
#[test]
fn the_mean_is_that_over_the_area_of_the_pixels() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("cornell")?;
    // The edge of a light that is far brighter than white is white except for a small part, which 64 samples do not resolve.
    scene.materials.iter_mut().for_each(|m| m.emission = m.emission.min(Vec3::ONE));
    let (small, large) = ([96, 96], [768, 768]);
    let reference = shrunk(&Run::new(&gpu, &scene, large, &[HARD])?.still(1, 0.0)?[0].picture, 8);
    let psnr_of = |changes: &[&str], frames: usize| -> Result<f64> {
        let seen = Run::new(&gpu, &scene, small, &[changes, &[HARD]].concat())?.still(frames, 0.0)?;
        shown_psnr(&seen[frames - 1].picture, &reference)
    };
    let none = psnr_of(&[], 1)?;
    let (full, scaled) = (psnr_of(&[TAA], 64)?, psnr_of(&[TAA, "post.resolution_scale=0.67"], 64)?);
    println!("PSNR against 64 samples in a grid: none {none:.1}, taa {full:.1}, at 67 % {scaled:.1} dB");
    ensure!(full > 40.0 && full > none + 10.0, "{full} dB, without {none}");
    ensure!(scaled > none + 5.0, "{scaled} dB, without {none}");
    Ok(())
}

#[test]
fn upsampling_beats_bilinear_that_takes_as_long() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let size = [320, 180];
    let reference = mean(Run::new(&gpu, &scene, size, &[TAA])?.still(24, 0.0)?.iter().map(|f| &f.input));
    let camera = scene.cameras[0].clone();
    let own = |f: &Seen| {
        let passes = f.result.sample.passes.iter();
        let frame = passes.filter(|p| !p.name.starts_with("check.") && !p.name.starts_with("read_back."));
        frame.filter_map(|p| p.gpu_ns).sum::<u64>()
    };
    // They take turns, a frame each, so that whatever else the machine does meets all of them.
    let scales = ["0.67", "0.75", "0.85", "1.0"];
    let mut runs = vec![Run::new(&gpu, &scene, size, &[TAA, "post.resolution_scale=0.67"])?];
    for scale in scales {
        runs.push(Run::new(&gpu, &scene, size, &[&format!("post.resolution_scale={scale}")])?);
    }
    let mut shortest = vec![u64::MAX; runs.len()];
    let mut errors = vec![0.0; runs.len()];
    for frame in 0..24 {
        for (i, run) in runs.iter_mut().enumerate() {
            let seen = run.see(&camera, 0.0)?;
            // The first frames also make what later ones keep.
            if frame >= 2 {
                shortest[i] = shortest[i].min(own(&seen));
            }
            if frame == 23 {
                errors[i] = flip_ldr(&seen.picture, &reference)?;
            }
        }
    }
    let ms = |i: usize| shortest[i] as f64 / 1e6;
    let (taa_ms, taa) = (ms(0), errors[0]);
    println!("taa at 67 %: {taa_ms:.1} ms, FLIP {taa:.4}");
    for (i, scale) in scales.iter().enumerate() {
        println!("bilinear at {scale}: {:.1} ms, FLIP {:.4}", ms(i + 1), errors[i + 1]);
    }
    ensure!(taa < 0.7 * errors[1], "FLIP {taa}, bilinear from as many pixels {}", errors[1]);
    let as_long = (1..runs.len()).find(|&i| ms(i) >= taa_ms).map(|i| errors[i]);
    let bilinear = as_long.context("upsampling takes longer than the frame at full size")?;
    ensure!(taa < bilinear, "FLIP {taa}, bilinear in the same time {bilinear}");
    Ok(())
}

fn turned(camera: &Camera, angle: f64) -> Camera {
    let mut other = camera.clone();
    other.world_from_camera.matrix3 *= DMat3::from_rotation_y(angle);
    other
}

#[test]
fn a_moving_picture_is_better_than_its_samples_and_stays_sharp() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    // 0.4 degrees per frame: about two and a half pixels.
    let camera = |frame: usize| turned(&scene.cameras[0], 0.007 * frame as f64);
    let mut run = Run::new(&gpu, &scene, SIZE, &[TAA])?;
    let seen: Vec<Seen> = (0..16).map(|frame| run.see(&camera(frame), 0.0)).collect::<Result<_>>()?;
    let mut still = Run::new(&gpu, &scene, SIZE, &[TAA])?;
    for frame in [5, 15] {
        still.renderer.cut();
        let samples: Vec<Seen> = (0..16).map(|_| still.see(&camera(frame), 0.0)).collect::<Result<_>>()?;
        let reference = mean(samples.iter().map(|f| &f.input));
        let (raw, taa) = (
            mse(&seen[frame].input.encoded(), &reference.encoded())?,
            mse(&seen[frame].picture.encoded(), &reference.encoded())?,
        );
        println!("frame {frame} of a turn: error of the input {raw:.6}, of the picture {taa:.6}");
        ensure!(taa < 0.6 * raw, "frame {frame}: {taa} against {raw}");
    }
    Ok(())
}

/// Things thinner than a pixel do not become single pixels of their colour while the camera moves, though most frames miss them.
#[test]
fn what_is_thinner_than_a_pixel_has_its_share_of_it() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = scene("rods", camera([0.0, 0.0, 4.0], [0.0; 3]));
    let white = Material { unlit: true, ..material([0.8; 3], 0.0, 1.0) };
    let wall = Affine3A::from_rotation_translation(Quat::from_rotation_x(0.5 * PI), Vec3::new(0.0, 0.0, -1.0));
    add(&mut scene, plane(8.0), white, wall);
    for k in 0..30_u8 {
        let black = Material { unlit: true, ..material([0.01; 3], 0.0, 1.0) };
        let at = Vec3::new(0.19 * f32::from(k) - 2.8, 0.0, 0.01 * f32::from(k));
        let rod = Affine3A::from_rotation_translation(Quat::from_rotation_z(0.03 * f32::from(k)), at);
        add(&mut scene, block(Vec3::new(0.0015, 4.0, 0.0015)), black, rod);
    }
    let view = |frame: usize| turned(&scene.cameras[0], 0.007 * frame as f64);
    let last = 15;
    let mut run = Run::new(&gpu, &scene, SIZE, &[TAA])?;
    let seen: Vec<Seen> = (0..=last).map(|frame| run.see(&view(frame), 0.0)).collect::<Result<_>>()?;
    run.renderer.cut();
    let samples: Vec<Seen> = (0..64).map(|_| run.see(&view(last), 0.0)).collect::<Result<_>>()?;
    let wanted = mean(samples.iter().map(|f| &f.input));
    let dark = |picture: &Picture| {
        let pixels = picture.pixels.iter().zip(&wanted.pixels);
        pixels.filter(|(found, wanted)| found[1] < 0.5 * wanted[1]).count()
    };
    let (raw, taa) = (dark(&seen[last].input), dark(&seen[last].picture));
    println!("pixels of less than half of their light: {raw} without, {taa} with anti-aliasing");
    ensure!(raw > 100, "rods are hardly hit: {raw} pixels");
    ensure!(taa * 10 < raw, "{taa} dark pixels of {raw}");
    let errors = [&seen[last].input, &seen[last].picture].map(|found| mse(&found.encoded(), &wanted.encoded()));
    let [raw, taa] = errors;
    let (raw, taa) = (raw?, taa?);
    println!("error of the input {raw:.6}, of the picture {taa:.6}");
    ensure!(taa < 0.3 * raw, "{taa} against {raw}");
    Ok(())
}

/// A thin thing that stood still and jumps is gone from its old place in the same frame, and soon all of it is in its new one.
#[test]
fn what_jumps_leaves_nothing_and_arrives() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let [rest, jumped] = [0.0, 1.0];
    for (thickness, late, changes) in
        [(0.02, 0.2, vec![TAA]), (0.006, 0.4, vec![TAA]), (0.02, 0.3, vec![TAA, "post.resolution_scale=0.8"])]
    {
        let mut scene = scene("rod", camera([0.0, 0.0, 4.0], [0.0; 3]));
        let white = Material { unlit: true, ..material([0.8; 3], 0.0, 1.0) };
        let wall = Affine3A::from_rotation_translation(Quat::from_rotation_x(0.5 * PI), Vec3::new(0.0, 0.0, -1.0));
        add(&mut scene, plane(8.0), white, wall);
        let black = Material { unlit: true, ..material([0.01; 3], 0.0, 1.0) };
        let from = Vec3::new(-0.5, 0.0, 0.0);
        add(&mut scene, block(Vec3::new(thickness / 2.0, 0.8, 0.01)), black, Affine3A::from_translation(from));
        scene.instances[1].node = Some(rooms::slide(&mut scene, from, from + Vec3::new(0.83, 0.1, 0.0), jumped));

        let mut run = Run::new(&gpu, &scene, SIZE, &changes)?;
        let samples = |run: &mut Run<'_>, time| -> Result<(Picture, Vec<Seen>)> {
            let seen = run.still(64, time)?;
            Ok((mean(seen.iter().map(|f| &f.input)), seen))
        };
        // At a scale below 1 the mean of the samples has another size than the picture: the picture at rest is as good.
        let (_, at_rest) = samples(&mut run, rest)?;
        let after = run.still(64, jumped)?;
        let (wanted, fresh) = samples(&mut Run::new(&gpu, &scene, SIZE, &changes)?, jumped)?;
        let [old, new] = [&at_rest, &fresh].map(|frames| &frames[63].picture);
        let differs = |sign: f32| -> Vec<bool> {
            old.pixels.iter().zip(&new.pixels).map(|(old, new)| sign * (new[1] - old[1]) > 0.02).collect()
        };
        let (left, entered) = (differs(1.0), differs(-1.0));
        let of = |frame: usize, which: &[bool]| left_over(&after[frame - 1].picture, old, new, which);
        let (ghost, missing) = ([1, 4, 16].map(|n| of(n, &left)), [1, 4, 16].map(|n| of(n, &entered)));
        println!(
            "{thickness} {changes:?}: {ghost:.3?} of the old place is left, {missing:.3?} of the new one is missing"
        );
        ensure!(left.iter().filter(|&&is| is).count() > 50 && entered.iter().filter(|&&is| is).count() > 50, "no rod");
        for share in ghost {
            ensure!(share.abs() < 0.05, "{share} of what was there is left");
        }
        ensure!(missing[1] < late && missing[2] < 0.5 * late, "{missing:?} of it has not arrived");
        if changes.len() == 1 {
            let error = |found: &Picture| mse(&found.encoded(), &wanted.encoded());
            let (raw, taa) = (error(&after[63].input)?, error(&after[63].picture)?);
            println!("error of the input {raw:.6}, of the picture {taa:.6}");
            ensure!(taa < 0.1 * raw, "{taa} against {raw}");
        }
    }
    Ok(())
}

/// Share of the previous content that remains where a moving object has just left: 1 all of it, 0 none.
fn left_over(now: &Picture, before: &Picture, truth: &Picture, new: &[bool]) -> f64 {
    let [mut along, mut all] = [0.0; 2];
    for i in (0..new.len()).filter(|&i| new[i]) {
        for c in 0..3 {
            let step = f64::from(before.pixels[i][c] - truth.pixels[i][c]);
            along += step * f64::from(now.pixels[i][c] - truth.pixels[i][c]);
            all += step * step;
        }
    }
    along / all
}

#[test]
fn what_comes_into_sight_has_no_ghost() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("carousel")?;
    let camera = scene.cameras[0].clone();
    let (step, last) = (0.1, 8);
    let time = |frame: usize| 0.4 + step * frame as f64;
    let ids = |time: f64| -> Result<Vec<u32>> {
        let mut run = Run::new(&gpu, &scene, SIZE, &[])?;
        let request = FrameRequest { camera: &camera, time, view: Some(("gbuffer.draw", "ids")), read_back: true };
        let image = run.renderer.frame(request)?.and_then(|r| r.images).context("no ids")?.linear;
        Ok(image.bytes.as_chunks::<8>().0.iter().map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    };
    let (before, now) = (ids(time(last - 1))?, ids(time(last))?);
    // Colours that occur in the 3x3 now, but did not in the 3x3 before.
    let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
    let is_new = |i: usize| {
        let (x, y) = (i % width, i / width);
        let inside = (1..width - 1).contains(&x) && (1..height - 1).contains(&y);
        let around =
            || [0, 1, 2].into_iter().flat_map(move |r| (i + r * width - width - 1)..(i + r * width - width + 2));
        inside && around().all(|k| now[k] == now[i] && before[k] != now[i])
    };
    let new: Vec<bool> = (0..now.len()).map(is_new).collect();
    let still = |time: f64| -> Result<Picture> {
        Ok(mean(Run::new(&gpu, &scene, SIZE, &[TAA])?.still(16, time)?.iter().map(|f| &f.input)))
    };
    let (old, truth) = (still(time(last - 1))?, still(time(last))?);
    for changes in [vec![TAA], vec![TAA, "post.resolution_scale=0.67"]] {
        let mut run = Run::new(&gpu, &scene, SIZE, &changes)?;
        let seen: Vec<Seen> = (0..=last).map(|frame| run.see(&camera, time(frame))).collect::<Result<_>>()?;
        let picture = &seen[last].picture;
        let ghost = left_over(picture, &old, &truth, &new);
        let errors = disocclusion(&picture.encoded(), &truth.encoded(), &new)?;
        println!(
            "{changes:?}: {ghost:.4} of what was there is left in {} pixels of {width} a row; {errors:?}",
            errors.pixels_new
        );
        ensure!(errors.pixels_new > 100, "only {} pixels came into sight", errors.pixels_new);
        ensure!(ghost.abs() < 0.05, "{ghost} of what was there before is left");
        if changes.len() == 1 {
            let raw = disocclusion(&seen[last].input.encoded(), &truth.encoded(), &new)?;
            println!("input: {raw:?}");
            ensure!(errors.mse_elsewhere < raw.mse_elsewhere.map(|e| 0.7 * e), "{errors:?} against {raw:?}");
        }
    }
    Ok(())
}

/// Light that changes its colour and not its luma: a red lamp goes out while a blue one in its place goes on.
#[test]
fn a_change_of_colour_alone_is_seen_at_once() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = rooms::lamp_of_two_colours();
    let grey = scene.materials[0].clone();
    scene.materials.fill(grey);
    let red = scene.lights[0].clone();
    scene.lights[1] = match red {
        Light::Sphere { centre, radius, radiance } => Light::Sphere { centre, radius, radiance: radiance.zyx() },
        _ => bail!("the lamp is no sphere"),
    };
    for changes in [vec![TAA, HARD], vec![TAA, HARD, "post.resolution_scale=0.8"]] {
        let mut run = Run::new(&gpu, &scene, SMALL, &changes)?;
        run.renderer.scale_light(1, 0.0);
        let before = run.still(40, 0.0)?.pop().context("no frame")?.picture;
        [(0, 0.0), (1, 1.0)].into_iter().for_each(|(light, factor)| run.renderer.scale_light(light, factor));
        let after = run.still(64, 0.0)?;
        let mut fresh = Run::new(&gpu, &scene, SMALL, &changes)?;
        fresh.renderer.scale_light(0, 0.0);
        let truth = fresh.still(64, 0.0)?.pop().context("no frame")?.picture;
        let everywhere = vec![true; truth.pixels.len()];
        let left = [4, 12, 40].map(|frame| left_over(&after[frame - 1].picture, &before, &truth, &everywhere));
        println!("{changes:?}: after 4, 12 and 40 frames {left:.4?} of the old colour is left");
        for (left, most) in left.into_iter().zip([0.1, 0.05, 0.01]) {
            ensure!(left.abs() < most, "{left} of the old colour is left");
        }
    }
    Ok(())
}

/// Where an edge lies along the border of the picture and few samples hit what is behind it, these are no change of light.
#[test]
fn edges_along_the_border_keep_still() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    for changes in [vec![TAA, HARD], vec![TAA, HARD, "post.resolution_scale=0.8"]] {
        let frames = Run::new(&gpu, &scene, SMALL, &changes)?.still(64, 0.0)?;
        let shown = |p: &Picture| p.pixels.iter().map(|p| p.map(|x| x / (1.0 + x))).collect::<Vec<_>>();
        let [mut most, mut of_input] = [0.0_f32; 2];
        for pair in frames[31..].windows(2) {
            let largest = |of: fn(&Seen) -> &Picture| {
                let [a, b] = [0, 1].map(|k| shown(of(&pair[k])));
                a.iter().zip(&b).flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs())).fold(0.0, f32::max)
            };
            (most, of_input) = (most.max(largest(|f| &f.picture)), of_input.max(largest(|f| &f.input)));
        }
        println!("{changes:?}: largest change from frame to frame {most:.3}, of the input {of_input:.3}");
        ensure!(of_input > 0.5, "no sample hits another surface than that before");
        ensure!(most < 0.1, "a pixel changes by {most} of white from one frame to the next");
    }
    Ok(())
}

#[test]
fn a_cut_begins_anew() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut run = Run::new(&gpu, &scene, [64, 64], &[TAA])?;
    let before = run.still(5, 0.0)?;
    ensure!(before[0].picture == before[0].input, "the first frame is its own sample");
    ensure!(before[4].picture != before[4].input, "the fifth is no mean");
    run.renderer.cut();
    let after = run.still(2, 0.0)?;
    ensure!(after[0].picture == after[0].input, "the frame after a cut has something of those before");
    ensure!(after[1].picture != after[1].input, "the history does not begin again");
    Ok(())
}

#[test]
fn what_is_off_is_not_there() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    // Passes of the slot, number of histories, render size, and resources.
    type Outcome = (Vec<String>, usize, [u32; 2], Vec<String>);
    type Case<'a> = (&'a [&'a str], &'a [&'a str], usize, [u32; 2]);
    let run = |changes: &[&str]| -> Result<Outcome> {
        let seen = Run::new(&gpu, &scene, [80, 60], changes)?.still(2, 0.0)?;
        let declaration = &seen[1].result.declaration;
        let names = (0..declaration.passes.len() as u32).map(|i| declaration.pass_name(i).to_owned());
        let full = [declaration.full.width, declaration.full.height];
        let resources = (0..declaration.resources.len() as u32).map(|i| declaration.resource_name(i)).collect();
        Ok((names.filter(|n| n.starts_with("post.")).collect(), declaration.histories.len(), full, resources))
    };
    let cases: [Case<'_>; 5] = [
        (&[], &["post.tone_map"], 0, [80, 60]),
        (&["post.resolution_scale=0.5"], &["post.upscale", "post.tone_map"], 0, [40, 30]),
        (&[TAA], &["post.taa", "post.tone_map"], 4, [80, 60]),
        (&[TAA, "post.resolution_scale=0.5"], &["post.taa", "post.tone_map"], 4, [40, 30]),
        (&["post.sharpening=0.5"], &["post.sharpen", "post.tone_map"], 0, [80, 60]),
    ];
    let others = run(&[])?.1;
    for (changes, passes, histories, full) in cases {
        let got = run(changes)?;
        ensure!(got.0 == passes && got.1 == others + histories && got.2 == full, "{changes:?}: {got:?}, {others}");
        let named = |n: &str| got.3.iter().any(|name| name.starts_with(n));
        ensure!(named("moments") == (histories > 0), "{changes:?}: {:?}", got.3);
    }
    Ok(())
}

#[test]
fn sharpening_steepens_and_never_overshoots() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let picture = |changes: &[&str]| -> Result<Picture> {
        Ok(Run::new(&gpu, &scene, SIZE, changes)?.still(1, 0.0)?.remove(0).picture)
    };
    let (plain, half, full) = (picture(&[])?, picture(&["post.sharpening=0.5"])?, picture(&["post.sharpening=1.0"])?);
    let width = plain.width;
    let gradient = |p: &Picture| -> f64 {
        let p = p.encoded();
        (0..p.pixels.len() - 1).map(|i| f64::from((p.pixels[i][1] - p.pixels[i + 1][1]).powi(2))).sum()
    };
    let [a, b, c] = [&plain, &half, &full].map(gradient);
    println!("gradients: {a:.1}, {b:.1}, {c:.1}");
    ensure!(b > 1.03 * a && c > 1.02 * b, "{a}, {b}, {c}");
    for (x, y) in (1..plain.height - 1).flat_map(|y| (1..width - 1).map(move |x| (x, y))) {
        let i = y * width + x;
        // In the tone-weighted range in which the shader works, whose luma preserves the order.
        let weighted = |p: &[f32; 3]| p.map(|v| v / (1.0 + 0.25 * p[0] + 0.5 * p[1] + 0.25 * p[2]));
        let cross = [i, i - 1, i + 1, i - width, i + width].map(|i| weighted(&plain.pixels[i]));
        let now = weighted(&full.pixels[i]);
        for channel in 0..3 {
            let least = cross.iter().map(|p| p[channel]).fold(f32::MAX, f32::min);
            let most = cross.iter().map(|p| p[channel]).fold(f32::MIN, f32::max);
            let fine = now[channel] >= least - 1e-4 && now[channel] <= most + 1e-4;
            ensure!(fine, "({x}, {y}): {} is not in {least} to {most}", now[channel]);
        }
    }
    Ok(())
}

/// Lights with a radiance of a million, scaling, sharpening and a turning camera: all values are finite.
#[test]
fn everything_stays_finite() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    for material in &mut scene.materials {
        material.emission *= 1e6;
    }
    for scale in ["0.5", "0.83", "1.0"] {
        let scale = format!("post.resolution_scale={scale}");
        let mut run = Run::new(&gpu, &scene, [101, 57], &[TAA, &scale, "post.sharpening=1.0"])?;
        for frame in 0..12 {
            let camera = turned(&scene.cameras[0], 0.01 * f64::from(frame / 3));
            run.see(&camera, 0.0)?.display.check("the picture")?;
        }
    }
    Ok(())
}
