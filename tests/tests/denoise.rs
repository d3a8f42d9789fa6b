//! The denoisers on patterns with known results: constants stay, values without variance are unchanged, surfaces do not mix, no NaN
//! appears, and disoccluded pixels have no history.
use anyhow::{Context, Result, bail, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::config::Config;
use magpie::gpu::Kernel;
use magpie::pixels::Pixels;
use magpie::prelude::*;
use magpie::scene::Scene;
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_passes::contracts::{GBuffer, ShadowGroup, ShadowIn, ShadowOut};
use magpie_passes::parts::denoise::{self, Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::denoise::WIDEST_NOISE;
use magpie_shaders::{SampledImage, Stage, StorageImage};
use magpie_tests::fixtures::{add, camera, material, plane, scene, sun};
use magpie_tests::harness::{builtin, config_without_bounces, gpu};

const SIZE: [u32; 2] = [96, 54];

/// `low + (high - low) * x`, where x is, by `kind`: 0 the constant 1; 1 random per pixel; 2 random per pixel and frame; 3 the same on
/// instances with odd numbers and its negative on the others; 4 the same in the left half of the picture and 0 in the right half; 5 mostly
/// small and rarely up to 17, with a mean of 1.
const PATTERN: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/random.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint ids; uint result; uvec2 size; uint kind; uint frame; float low; float high; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    Random random = random_of(uint(p.y) * size.x + uint(p.x), kind == 1u ? 0u : frame, 7u);
    vec4 x = kind == 0u ? vec4(1.0) : random4(random);
    if (kind == 5u) x = 17.0 * pow(x, vec4(16.0));
    if (kind == 4u && uint(p.x) >= size.x / 2u) x = vec4(0.0);
    if (kind == 3u) x = mix(vec4(low), vec4(high), x) * ((load_uint(ids, p).x & 1u) == 0u ? -1.0 : 1.0);
    else x = mix(vec4(low), vec4(high), x);
    store(result, p, x);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    ids: SampledImage,
    result: StorageImage,
    size: [u32; 2],
    kind: u32,
    frame: u32,
    low: f32,
    high: f32,
}

/// A slot that denoises a pattern in place of shadows.
struct Patterned {
    pattern: Kernel,
    denoiser: Denoiser,
    content: Content,
    kind: u32,
    low: f32,
    high: f32,
    /// Penumbra width passed to the denoiser, pixels; negative for none.
    reach: f32,
}

impl Patterned {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let words = magpie_shaders::compile("pattern.comp", PATTERN, Stage::Compute).map_err(SlotError::other)?;
        let channels = settings.u32("channels")?;
        Ok(Self {
            pattern: build.kernel_from_words("pattern.comp", &words)?,
            denoiser: Denoiser::new(build, "shadows", Options::read(settings)?)?,
            content: if channels == 0 { Content::Radiance } else { Content::Visibility { channels } },
            kind: settings.u32("kind")?,
            low: settings.f32("low")?,
            high: settings.f32("high")?,
            reach: settings.f32("reach")?,
        })
    }

    /// A pass that draws a pattern.
    fn draw(&self, g: &mut FrameGraph, gbuffer: GBuffer, name: &str, params: Params) -> Handle<Image> {
        let pattern = self.pattern;
        g.pass(name, Queue::Graphics, |p| {
            let ids = p.sample(gbuffer.ids);
            let (made, target) = p.create("made", ImageDesc::like(Format::Rgba32Float, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (made.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = Params { ids: c.id(ids), result: c.id(target), size, ..params };
                c.dispatch(pattern, &params, extent);
            })
        })
    }
}

impl Effect for Patterned {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: ShadowIn) -> ShadowOut {
        let Self { kind, low, high, reach, .. } = *self;
        let params = Params { kind, low, high, frame: view.frame, ..Params::zeroed() };
        let (gbuffer, reprojected) = (i.gbuffer, i.reprojected);
        let noisy = self.draw(g, gbuffer, "shadows.pattern", params);
        let width = reach / WIDEST_NOISE;
        let reach = (reach >= 0.0).then(|| {
            self.draw(g, gbuffer, "shadows.pattern_reach", Params { kind: 0, low: 0.0, high: width, ..params })
        });
        let i = DenoiseIn {
            signal: Signal { image: noisy, content: self.content },
            surfaces: Surfaces { gbuffer, reprojected },
            hints: Hints::default().width(reach),
        };
        let visibility = self.denoiser.add(g, view, i, "");
        let mut out = ShadowOut::default();
        out.groups[0] =
            Some(ShadowGroup { visibility, lights: [0, u32::MAX, u32::MAX, u32::MAX], coloured: false, raw: false });
        out
    }
}

fn slots() -> Slots {
    let mut slots = Slots::default();
    let float = |key, default| SettingSpec::float(key, "", "Of the pattern.", default, -1e9..=1e9);
    let mut settings = denoise::settings();
    settings.push(denoise::precision());
    settings.extend([
        SettingSpec::integer("channels", "", "Channels; 0 for radiance.", 1, 0..=4),
        SettingSpec::integer("kind", "", "Which pattern.", 0, 0..=5),
        float("low", 0.0),
        float("high", 1.0),
        float("reach", -1.0),
    ]);
    slots.shadows.register("pattern", "A pattern, denoised.", &settings, |build, settings| {
        Ok(Box::new(Patterned::new(build, settings)?))
    });
    slots
}

/// The images of these names in the last of some frames, each from its own run, all scanned for NaN.
fn images(scene: &Scene, config: &Config, frames: u32, wanted: &[(&str, &str)]) -> Result<Option<Vec<Pixels>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let mut found = Vec::new();
    for view in wanted {
        let [width, height] = SIZE;
        let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, scene, &slots(), config, options)?;
        let mut last = None;
        for frame in 1..=frames {
            let time = f64::from(frame) / 20.0;
            let request =
                FrameRequest { camera: &scene.cameras[0], time, view: Some(*view), read_back: frame == frames };
            let result = renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "frame {frame}: {:?}", result.findings);
            last = result.images;
        }
        found.push(last.context("no image")?.linear);
    }
    Ok(Some(found))
}

fn patterned(settings: &[&str]) -> Result<Config> {
    let mut config = config_without_bounces(&[])?;
    config.set("stages.shadows=pattern")?;
    // Patterns have values outside of 0 to 1, which 16 bits hold as radiance only.
    config.set("shadows.precision=32")?;
    for setting in settings {
        config.set(&format!("shadows.{setting}"))?;
    }
    slots().catalogue().check(&config, "test")?;
    Ok(config)
}

/// Two boards that meet at a right angle, and one that floats in front of them.
fn boards() -> Scene {
    let mut s = scene("boards", camera(Vec3::new(0.3, 2.0, 4.0), Vec3::new(0.0, 0.6, 0.0)));
    let grey = || material([0.5; 3], 0.0, 0.8);
    add(&mut s, plane(3.0), grey(), Affine3A::IDENTITY);
    let upright =
        Affine3A::from_rotation_translation(Quat::from_rotation_x(90_f32.to_radians()), Vec3::new(0.0, 3.0, -1.5));
    add(&mut s, plane(3.0), grey(), upright);
    let floating = Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.2),
        Quat::from_rotation_x(90_f32.to_radians()),
        Vec3::new(-0.5, 1.2, -0.5),
    );
    add(&mut s, plane(3.0), grey(), floating);
    s.lights.push(sun(Vec3::new(0.3, 1.0, 0.5)));
    s
}

const PATTERN_MADE: (&str, &str) = ("shadows.pattern", "made");
/// Output of the last of four levels.
const SVGF: (&str, &str) = ("shadows.level_3", "result");
const BILATERAL: (&str, &str) = ("shadows.bilateral", "filtered");
const RECURRENT: (&str, &str) = ("shadows.post_blur", "result");
const PICA_PICA: (&str, &str) = ("shadows.clean_up", "result");
/// The denoisers with the setting that chooses them.
const DENOISERS: [(&str, (&str, &str)); 4] = [
    ("denoiser=svgf", SVGF),
    ("denoiser=pica-pica", PICA_PICA),
    ("denoiser=recurrent-blur", RECURRENT),
    ("denoiser=bilateral", BILATERAL),
];
const IDS: (&str, &str) = ("gbuffer.draw", "ids");

#[test]
fn constant_input_stays_constant() -> Result<()> {
    for (scene, values) in [(builtin("courtyard")?, &[0.3_f32][..]), (boards(), &[0.3, 1e6])] {
        for (denoiser, output) in DENOISERS {
            for &value in values {
                for (channels, reach) in
                    [("channels=1", "reach=-1"), ("channels=0", "reach=-1"), ("channels=1", "reach=6")]
                {
                    let (low, high) = (format!("low={value}"), format!("high={value}"));
                    let config = patterned(&[denoiser, &low, &high, channels, reach])?;
                    let Some(found) = images(&scene, &config, 2, &[output])? else { return Ok(()) };
                    let worst = found[0].values().iter().map(|v| (v[0] / value - 1.0).abs()).fold(0.0, f32::max);
                    ensure!(worst < 1e-5, "{denoiser} {channels} {reach}: {value} becomes another by {worst:e} of it");
                }
            }
        }
    }
    Ok(())
}

#[test]
fn what_does_not_vary_over_frames_is_not_touched() -> Result<()> {
    // Random per pixel, the same in all frames. From the fourth frame on the variance is known to be 0.
    let pattern = ["kind=1", "channels=4", "history=8"];
    let Some(given) = images(&boards(), &patterned(&pattern)?, 1, &[PATTERN_MADE, IDS])? else { return Ok(()) };
    let [made, ids] = [0, 1].map(|k| given[k].values());
    for reach in ["reach=-1", "reach=16"] {
        let config = patterned(&[&pattern[..], &[reach]].concat())?;
        let Some(found) = images(&boards(), &config, 16, &[SVGF])? else { return Ok(()) };
        let filtered = found[0].values();
        let mut surfaces = 0;
        for ((made, filtered), ids) in made.iter().zip(&filtered).zip(&ids) {
            if ids[0] > 0.0 {
                ensure!(made == filtered, "{reach}: {made:?} became {filtered:?}");
                surfaces += 1;
            }
        }
        ensure!(surfaces > 2000, "{surfaces} pixels show a surface");
    }
    Ok(())
}

#[test]
fn no_noise_goes_further_than_its_reach() -> Result<()> {
    // Noise in the left half, zero in the right half: pixels further than the reach from the middle stay exactly zero, those next to it do
    // not.
    let floor = {
        let mut s = scene("floor", camera(Vec3::new(0.0, 4.0, 0.01), Vec3::ZERO));
        add(&mut s, plane(20.0), material([0.5; 3], 0.0, 0.8), Affine3A::IDENTITY);
        s.lights.push(sun(Vec3::Y));
        s
    };
    let [width, middle] = [SIZE[0] as usize, SIZE[0] as usize / 2];
    // `pica-pica` blurs what is noisy, and zero is not.
    for (denoiser, output) in DENOISERS.into_iter().filter(|(denoiser, _)| *denoiser != "denoiser=pica-pica") {
        let mut farthest = Vec::new();
        for reach in [0, 6, 24] {
            let config = patterned(&[denoiser, "kind=4", "low=0", "radius=16", "sigma=16", &format!("reach={reach}")])?;
            let Some(found) = images(&floor, &config, 1, &[output])? else { return Ok(()) };
            let values = found[0].values();
            let far = (0..values.len()).filter(|at| values[*at][0] != 0.0).map(|at| at % width + 1).max();
            let beyond = far.context("nothing is left")?.saturating_sub(middle);
            // Half the width to each side, for all levels together.
            ensure!(
                2 * beyond <= reach,
                "{denoiser}: reach of {reach} pixels, noise {beyond} pixels from where it was"
            );
            farthest.push(beyond);
        }
        ensure!(farthest[0] == 0 && farthest[1] > 0 && farthest[2] > farthest[1], "{denoiser}: {farthest:?}");
    }
    Ok(())
}

#[test]
fn the_variance_of_a_mean_over_different_pixels_is_that_of_independent_samples() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // A camera in front of a wall that moves by one pixel per frame, so that each frame's sample comes from another pixel.
    let (frames, away) = (12, 4.0);
    let step = 2.0 * away * 20_f64.to_radians().tan() / f64::from(SIZE[1]);
    let at = |frame: u32| {
        let x = step * f64::from(frame);
        camera(DVec3::new(x, 0.0, away), DVec3::new(x, 0.0, 0.0))
    };
    let mut wall = scene("wall", at(0));
    let upright = Affine3A::from_rotation_x(90_f32.to_radians());
    add(&mut wall, plane(20.0), material([0.5; 3], 0.0, 0.8), upright);
    wall.lights.push(sun(Vec3::new(0.3, 0.2, 1.0)));
    let config = patterned(&["kind=2", "channels=1"])?;
    let mut images = Vec::new();
    // Mean of the samples in red; deviation of the accumulated mean in green; number of frames.
    let views =
        [("shadows.accumulate", "moments"), ("shadows.accumulate", "accumulated"), ("shadows.accumulate", "frames")];
    for view in views {
        let [width, height] = SIZE;
        let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &wall, &slots(), &config, options)?;
        let mut last = None;
        for frame in 1..=frames {
            let (camera, read_back) = (at(frame), frame == frames);
            let request = FrameRequest { camera: &camera, time: 0.0, view: Some(view), read_back };
            last = renderer.frame(request)?.context("no frame")?.images;
        }
        images.push(last.context("no image")?.linear.values());
    }
    let known: Vec<usize> =
        (0..images[0].len()).filter(|i| (images[2][*i][0] * 255.0).round() as u32 == frames).collect();
    ensure!(known.len() > 2000, "{} pixels know all frames", known.len());
    let mean = |values: &dyn Fn(usize) -> f64| known.iter().map(|i| values(*i)).sum::<f64>() / known.len() as f64;
    // Uniform values in 0 to 1 have the mean 1/2.
    let true_variance = mean(&|i| (f64::from(images[0][i][0]) - 0.5).powi(2));
    let estimated = mean(&|i| f64::from(images[1][i][1]).powi(2));
    println!("variance of the mean over {frames} frames: {true_variance:.5}, estimate {estimated:.5}");
    // The sample variance is about the samples' own mean, which lowers it by one in the number of frames.
    ensure!((estimated / true_variance - 1.0).abs() < 0.2, "{estimated} is estimated, {true_variance} is true");
    Ok(())
}

/// Packed into 16 bits, a signal is the same within their rounding, and its mean over many frames neither drifts nor stops short.
#[test]
fn sixteen_bits_neither_drift_nor_lose_the_mean() -> Result<()> {
    let mean_of = |image: &Pixels, ids: &Pixels, channel: usize| {
        let (values, ids) = (image.values(), ids.values());
        let seen: Vec<f64> =
            values.iter().zip(&ids).filter(|(_, id)| id[0] > 0.0).map(|(v, _)| f64::from(v[channel])).collect();
        seen.iter().sum::<f64>() / seen.len() as f64
    };
    for channels in ["channels=0", "channels=1", "channels=4"] {
        let of = |settings: &[&str], frames: u32| {
            let config = patterned(&[&["history=64", channels], settings].concat())?;
            images(&boards(), &config, frames, &[SVGF, IDS])
        };
        // A constant between two values of the format, as the mean of many frames.
        let Some(still) = of(&["low=0.3", "high=0.3", "precision=16"], 96)? else { return Ok(()) };
        let off = (mean_of(&still[0], &still[1], 0) - 0.3).abs();
        ensure!(
            off < if channels == "channels=0" { 1.3e-4 } else { 8e-6 },
            "{channels}: the constant is off by {off:e}"
        );
        // Random values, whose mean goes on to change by less and less.
        let noise = ["kind=2", "low=0.2", "high=0.6"];
        let Some(exact) = of(&noise, 33)? else { return Ok(()) };
        let Some(packed) = of(&[&noise[..], &["precision=16"]].concat(), 33)? else { return Ok(()) };
        let apart = mean_of(&packed[0], &packed[1], 0) - mean_of(&exact[0], &exact[1], 0);
        println!("{channels}: constant off by {off:.2e}, mean of noise by {apart:.2e}");
        ensure!(apart.abs() < 2e-4, "{channels}: the mean of noise is off by {apart:e}");
    }
    Ok(())
}

#[test]
fn surfaces_do_not_mix() -> Result<()> {
    // Values from 0.5 to 1.5 on one of two neighbours, their negatives on the other: values between -0.5 and 0.5 would show that they mix.
    let Some(ids) = images(&boards(), &patterned(&[])?, 1, &[IDS])? else { return Ok(()) };
    let ids = ids[0].values();
    let with = |reach: &'static str| DENOISERS.map(|(denoiser, output)| (denoiser, output, reach));
    for (denoiser, output, reach) in [with("reach=-1"), with("reach=24")].concat() {
        let config = patterned(&[denoiser, "kind=3", "low=0.5", "high=1.5", "channels=1", "sigma=16", reach])?;
        let Some(found) = images(&boards(), &config, 6, &[output])? else { return Ok(()) };
        let filtered = found[0].values();
        let (mut smooth, mut surfaces) = (0, 0);
        for (filtered, ids) in filtered.iter().zip(&ids) {
            if ids[0] > 0.0 {
                let side = if ids[0] as u32 & 1 == 0 { -1.0 } else { 1.0 };
                ensure!(filtered[0] * side > 0.5, "{denoiser}: {} on instance {}", filtered[0], ids[0]);
                surfaces += 1;
                smooth += i32::from((filtered[0] * side - 1.0).abs() < 0.15);
            }
        }
        // The filter does something.
        ensure!(smooth * 10 > surfaces * 8, "{denoiser}: {smooth} of {surfaces} pixels are near their mean");
    }
    Ok(())
}

#[test]
fn nothing_becomes_nan() -> Result<()> {
    // The scan of every image is the test: empty pictures, black ones, radiance of a million next to black.
    let mut empty = scene("empty", camera(Vec3::new(0.0, 1.0, 4.0), Vec3::new(0.0, 1.0, 0.0)));
    empty.lights.push(sun(Vec3::Y));
    for scene in [empty, boards()] {
        for (denoiser, output) in DENOISERS {
            for (kind, high) in [("kind=0", "high=0"), ("kind=2", "high=1e6"), ("kind=1", "high=1e6")] {
                for (channels, reach) in
                    [("channels=0", "reach=-1"), ("channels=2", "reach=-1"), ("channels=2", "reach=2")]
                {
                    let config = patterned(&[denoiser, kind, "low=0", high, channels, reach])?;
                    if images(&scene, &config, 5, &[output])?.is_none() {
                        return Ok(());
                    }
                }
            }
        }
    }
    Ok(())
}

#[test]
fn what_was_not_seen_before_has_no_history() -> Result<()> {
    // With a static camera only moving objects disocclude.
    let scene = builtin("carousel")?;
    let config = patterned(&["kind=2", "channels=1"])?;
    let frames = 8;
    let wanted = [IDS, ("gbuffer.draw", "motion"), ("shadows.accumulate", "frames")];
    let Some(now) = images(&scene, &config, frames, &wanted)? else { return Ok(()) };
    let Some(before) = images(&scene, &config, frames - 1, &[IDS])? else { bail!("no device the second time") };
    let [ids, motion, counted] = [0, 1, 2].map(|k| now[k].values());
    let before = before[0].values();
    let [width, height] = SIZE.map(|n| n as i32);
    let (mut uncovered, mut kept) = (0, 0);
    for at in 0..ids.len() {
        if ids[at][0] == 0.0 {
            continue;
        }
        let was = |k: usize, size: i32| {
            (at as i32 % width * i32::from(k == 0) + at as i32 / width * i32::from(k == 1)) as f32
                - motion[at][k] * size as f32
        };
        let (x, y) = (was(0, width).floor() as i32, was(1, height).floor() as i32);
        let same = |dx: i32, dy: i32| {
            let (x, y) = (x + dx, y + dy);
            (0..width).contains(&x) && (0..height).contains(&y) && before[(y * width + x) as usize][0] == ids[at][0]
        };
        let frames_kept = (counted[at][0] * 255.0).round();
        if ![(0, 0), (1, 0), (0, 1), (1, 1)].iter().any(|(dx, dy)| same(*dx, *dy)) {
            ensure!(frames_kept == 1.0, "pixel {at}: uncovered, and {frames_kept} frames are known");
            uncovered += 1;
        }
        kept += i32::from(frames_kept > 1.0);
    }
    println!("{uncovered} pixels were uncovered, {kept} have a history");
    ensure!(uncovered > 20 && kept > 1000, "{uncovered} uncovered, {kept} with a history");
    Ok(())
}

/// Means of what the effect gets and of what it returns over all surfaces and frames from `first` on.
fn mean_light(config: &Config, output: (&str, &str), first: u32, frames: u32) -> Result<Option<f64>> {
    let scene = boards();
    let Some(ids) = images(&scene, config, 1, &[IDS])? else { return Ok(None) };
    let ids = ids[0].values();
    let Some(gpu) = gpu()? else { return Ok(None) };
    let [width, height] = SIZE;
    let options = RenderOptions { width, height, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &slots(), config, options)?;
    let (mut sum, mut count) = (0.0, 0.0);
    for frame in 0..frames {
        let read_back = frame >= first;
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: Some(output), read_back };
        let result = renderer.frame(request)?.context("no frame")?;
        let Some(image) = result.images else { continue };
        for (value, id) in image.linear.values().iter().zip(&ids) {
            if id[0] > 0.0 {
                sum += f64::from(value[0]);
                count += 1.0;
            }
        }
    }
    Ok(Some(sum / count))
}

/// The blur is fed back: nothing may grow or drift over many frames.
#[test]
fn a_constant_stays_for_a_thousand_frames() -> Result<()> {
    for (channels, rounding) in [("channels=0", 1.3e-4), ("channels=1", 8e-6)] {
        let config = patterned(&["denoiser=recurrent-blur", "low=0.3", "high=0.3", "precision=16", channels])?;
        let Some(mean) = mean_light(&config, RECURRENT, 999, 1000)? else { return Ok(()) };
        println!("{channels}: 0.3 has become {mean}");
        ensure!((mean - 0.3).abs() < rounding, "{channels}: 0.3 has become {mean}");
    }
    Ok(())
}

/// Clamps and weights that compare values could take light from noise, or give it some.
#[test]
fn noise_keeps_its_light() -> Result<()> {
    for (name, pattern) in [
        ("even noise", ["kind=2", "low=0", "high=1", "channels=0"]),
        ("even noise of visibility", ["kind=2", "low=0", "high=1", "channels=1"]),
        ("bright specks", ["kind=5", "low=0", "high=1", "channels=0"]),
    ] {
        let light =
            |denoiser: &str, output| mean_light(&patterned(&[&pattern[..], &[denoiser]].concat())?, output, 16, 112);
        let Some(raw) = light("denoiser=none", PATTERN_MADE)? else { return Ok(()) };
        for (denoiser, output) in DENOISERS {
            let Some(found) = light(denoiser, output)? else { return Ok(()) };
            println!("{name}, {denoiser}: {:.4} of the light", found / raw);
            // Only this one is made to keep it.
            let is_bound = denoiser == "denoiser=recurrent-blur";
            ensure!(!is_bound || (found / raw - 1.0).abs() < 0.01, "{name}: {found} of {raw}");
        }
    }
    Ok(())
}

/// What stands still becomes as sharp as the samples are, though the first frames were blurred and fed back.
#[test]
fn at_rest_the_blur_goes_away() -> Result<()> {
    // Random per pixel, the same in all frames: all differences between pixels are true.
    let pattern = ["kind=1", "channels=0", "denoiser=recurrent-blur"];
    let mut errors = Vec::new();
    for frames in [1, 8, 32, 128] {
        let Some(found) = images(&boards(), &patterned(&pattern)?, frames, &[PATTERN_MADE, RECURRENT, IDS])? else {
            return Ok(());
        };
        let [made, blurred, ids] = [0, 1, 2].map(|k| found[k].values());
        let seen = (0..made.len()).filter(|at| ids[*at][0] > 0.0);
        let squares: Vec<f64> = seen.map(|at| f64::from(made[at][0] - blurred[at][0]).powi(2)).collect();
        errors.push((squares.iter().sum::<f64>() / squares.len() as f64).sqrt());
    }
    println!("difference in frames 1, 8, 32, 128: {errors:.4?}");
    ensure!(errors.is_sorted_by(|a, b| a > b) && errors[3] < 0.05 * errors[0], "{errors:?}");
    Ok(())
}

/// Signals of any number of channels keep their history at rest, with every denoiser that has one.
#[test]
fn every_signal_has_a_history() -> Result<()> {
    let scene = builtin("courtyard")?;
    for denoiser in ["svgf", "pica-pica", "recurrent-blur"] {
        for (slot, traced) in [("ao", "stages.ao=ray-traced"), ("shadows", "stages.shadows=ray-traced")] {
            let mut config = config_without_bounces(&[])?;
            for change in [traced, &format!("{slot}.denoiser={denoiser}"), &format!("{slot}.adaptive=false")] {
                config.set(change)?;
            }
            let pass = format!("{slot}.accumulate");
            let Some(found) = images(&scene, &config, 24, &[(&pass, "frames")])? else { return Ok(()) };
            // Those of `svgf` are stored over 255.
            let scale = if denoiser == "svgf" { 255.0 } else { 1.0 };
            let counts: Vec<f32> = found[0].values().iter().map(|v| scale * v[0]).collect();
            let mean = counts.iter().sum::<f32>() / counts.len() as f32;
            println!("{denoiser}, {slot}: {mean:.1} frames");
            ensure!(mean > 12.0, "{denoiser}, {slot}: {mean} frames");
        }
    }
    Ok(())
}
