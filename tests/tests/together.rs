//! Interactions of features: anti-aliasing jitters the surfaces that denoisers have a history of, lights share sample sequences, and the
//! floating origin follows the camera.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec2, Vec3};
use magpie::gpu::Gpu;
use magpie::graph::Access;
use magpie::pixels::Pixels;
use magpie::scene::{
    Animation, Channel, ColourSpace, Interpolation, Light, Moment, Node, Property, ResidentOptions, ResidentScene,
    Sampler, Scene, Texture, TextureUse,
};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene};
use magpie_tests::harness::{builtin, config, config_without_bounces, gpu, render};

const SIZE: [u32; 2] = [160, 90];
/// Large enough that most pixels of the courtyard show a single surface.
const LARGE: [u32; 2] = [320, 180];
/// Number of denoised frames: one more than the longest default history.
const FRAMES: u32 = 33;

/// Values of all pixels and channels.
type Values = Vec<f64>;

fn values(image: &Pixels) -> Values {
    let channels = image.format.channels() as usize;
    image.values().iter().flat_map(|v| v[..channels].iter().map(|x| f64::from(*x))).collect()
}

fn mean(images: &[Values]) -> Values {
    (0..images[0].len()).map(|at| images.iter().map(|i| i[at]).sum::<f64>() / images.len() as f64).collect()
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// What repeats every `period` pixels in a part of an image, over the mean there: the deviation of the means of pixels in the same place of
/// their period, less the mean of the period around each.
fn pattern(image: &Pixels, [left, top]: [u32; 2], [across, down]: [u32; 2], period: u32) -> f64 {
    let values = image.values();
    let light =
        |x: u32, y: u32| values[(y * image.extent.width + x) as usize][..3].iter().copied().map(f64::from).sum::<f64>();
    let half = (period / 2) as i32;
    let around = |x: u32, y: u32| {
        let near = (-half..=half).flat_map(|j| (-half..=half).map(move |i| (i, j)));
        let sum = near.map(|(i, j)| light(x.saturating_add_signed(i), y.saturating_add_signed(j))).sum::<f64>();
        sum / f64::from(period * period)
    };
    let places = (0..period * period).map(|place| {
        let column = (0..across).map(|i| i * period + place % period);
        let cells = column.flat_map(|x| (0..down).map(move |j| (left + x, top + j * period + place / period)));
        cells.map(|(x, y)| light(x, y) - around(x, y)).sum::<f64>() / f64::from(across * down)
    });
    let squares = places.map(|mean| mean * mean).sum::<f64>() / f64::from(period * period);
    let cells = (0..across * period).flat_map(|i| (0..down * period).map(move |j| (left + i, top + j)));
    let mean = cells.map(|(x, y)| light(x, y)).sum::<f64>() / f64::from(across * down * period * period);
    squares.sqrt() / mean
}

/// The last of [`FRAMES`] frames: linear radiance, or another image.
fn last(
    gpu: &Gpu,
    scene: &Scene,
    changes: &[&str],
    ([width, height], seed): ([u32; 2], u32),
    view: Option<(&str, &str)>,
) -> Result<Values> {
    let options = RenderOptions { width, height, seed, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config_without_bounces(changes)?, options)?;
    let mut shown = None;
    for frame in 1..=FRAMES {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: frame == FRAMES };
        shown = renderer.frame(request)?.context("no frame")?.images;
    }
    Ok(values(&shown.context("no image")?.linear))
}

#[test]
fn shadows_keep_their_history_under_anti_aliasing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let mut errors = Vec::new();
    for anti_aliasing in ["post.anti_aliasing=none", "post.anti_aliasing=taa"] {
        // The same frames with the same jitter and more rays than 32 frames have: what remains is the error of shadows.
        let many = [anti_aliasing, "shadows.denoiser=none", "shadows.rays=8"];
        let truths = (1..=4).map(|seed| last(&gpu, &scene, &many, (SIZE, seed), None)).collect::<Result<Vec<_>>>()?;
        let denoised = last(&gpu, &scene, &[anti_aliasing], (SIZE, 0), None)?;
        let frames = last(&gpu, &scene, &[anti_aliasing], (LARGE, 0), Some(("shadows.accumulate", "frames")))?;
        // The first of two lights is the sun.
        let mut frames: Vec<f64> = frames.iter().step_by(2).map(|f| (f * 255.0).round()).collect();
        frames.sort_by(f64::total_cmp);
        let (median, few) = (frames[frames.len() / 2], frames.iter().filter(|f| **f < 2.0).count());
        let error = rms(&denoised, &mean(&truths));
        let share = 100.0 * few as f64 / frames.len() as f64;
        println!(
            "{anti_aliasing}: median history {median} frames, one at most in {share:.1} % of pixels; RMSE {error:.5}"
        );
        ensure!(median >= 28.0, "{anti_aliasing}: the median history is {median} frames");
        errors.push(error);
    }
    ensure!(errors[1] <= 1.2 * errors[0], "{} with anti-aliasing, {} without", errors[1], errors[0]);
    Ok(())
}

/// A block on a floor in front of `count` local lights at the same position.
fn lamps(count: usize) -> Scene {
    let mut s = scene("lamps", camera(Vec3::new(0.0, 4.0, 6.0), Vec3::ZERO));
    add(&mut s, plane(8.0), material([0.5; 3], 0.0, 0.8), Affine3A::IDENTITY);
    add(&mut s, block(Vec3::splat(0.5)), material([0.5; 3], 0.0, 0.8), Affine3A::from_translation(Vec3::Y));
    let lamp = Light::Sphere { centre: DVec3::new(1.0, 5.0, 1.0), radius: 0.6, radiance: Vec3::splat(3.0) };
    s.lights = vec![lamp; count];
    s
}

#[test]
fn lights_of_different_groups_have_points_of_their_own() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, config) = (lamps(5), config(&["shadows.most_lights=8", "shadows.denoiser=none"])?);
    let traced = |pass: &str| -> Result<Pixels> {
        let image = render(&gpu, &scene, &config, SIZE, 1, Some((pass, "visibility")))?.images;
        Ok(image.context("no image")?.linear)
    };
    // The first light of each group of four: equal lights at the same position, in the same pixel.
    let (first, second) = (traced("shadows.trace")?.values(), traced("shadows.trace_2")?.values());
    let partly = first.iter().zip(&second).filter(|(a, b)| a[0] != b[0]).count();
    println!("{partly} pixels differ");
    ensure!(partly > 40, "{partly} pixels differ: the fifth lamp has the points of the first");
    Ok(())
}

#[test]
fn a_step_of_the_origin_moves_no_lamp() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // An object moves, but not the light.
    let mut scene = lamps(1);
    scene.nodes.push(Node { name: "swing".to_owned(), ..Node::default() });
    scene.animations.push(Animation {
        name: "swing".to_owned(),
        duration: 1.0,
        channels: vec![Channel {
            node: 0,
            property: Property::Translation,
            interpolation: Interpolation::Linear,
            times: vec![0.0, 1.0],
            values: vec![0.0, 5.0, 0.0, 3.0, 5.0, 0.0],
        }],
    });
    scene.light_nodes = vec![None];
    let mut resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?;
    let mut moved = |x: f64, time: f64| {
        resident.set_moment(&Moment { time, origin: DVec3::new(x, 0.0, 0.0), cut: false });
        resident.shadow_lights().iter().any(|light| light.moved)
    };
    ensure!(!moved(0.0, 0.0) && !moved(4096.0, 0.1) && !moved(4096.0, 0.2), "a lamp that stands has moved");
    // A light attached to a moving node moves, whatever its own position.
    scene.light_nodes = vec![Some(0)];
    let mut resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?;
    let mut moved = |x: f64, time: f64| {
        resident.set_moment(&Moment { time, origin: DVec3::new(x, 0.0, 0.0), cut: false });
        resident.shadow_lights().iter().any(|light| light.moved)
    };
    moved(0.0, 0.0);
    ensure!(moved(0.0, 0.1) && moved(4096.0, 0.2) && !moved(4096.0, 0.2), "a lamp that swings has not moved");
    Ok(())
}

/// Shaders have the scene's root from the token of this read alone.
#[test]
fn what_reads_the_scene_says_so() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let result = render(&gpu, &builtin("cornell")?, &config(&["post.anti_aliasing=taa"])?, [32, 18], 2, None)?;
    let declaration = &result.declaration;
    let tables = |resource: u32| declaration.resource_name(resource).contains("scene.state");
    for pass in ["gbuffer.draw", "reproject.surfaces", "shadows.trace", "direct.shade", "post.taa"] {
        let at = (0..declaration.passes.len() as u32).find(|p| declaration.pass_name(*p) == pass).context(pass)?;
        let uses = declaration.uses_of(at);
        let reads = uses.iter().any(|u| tables(u.resource) && u.access == Access::BufferRead);
        ensure!(reads, "{pass} reads the scene's tables and does not say so");
    }
    Ok(())
}

#[test]
fn single_rays_are_as_bright_in_the_mean_as_many() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // A light above the edge of a block's side: each pixel of the side sees the part of the light above its horizon.
    let mut s = scene("side", camera(Vec3::new(0.0, 0.5, 4.0), Vec3::new(0.0, 0.5, 0.0)));
    add(&mut s, block(Vec3::splat(0.5)), material([0.5; 3], 0.0, 0.8), Affine3A::from_translation(Vec3::Y * 0.5));
    let (centre, half) = (DVec3::new(0.0, 3.0, 0.4), 0.8);
    s.lights.push(Light::Rectangle {
        centre,
        half_u: Vec3::X * half,
        half_v: Vec3::Z * half,
        radiance: Vec3::splat(4.0),
    });
    let light = |rays: &str| -> Result<f64> {
        let changes = ["shadows.denoiser=none", rays, "stages.gi=off", "stages.reflections=off", "stages.sky=off"];
        let options = RenderOptions { width: 64, height: 36, ..RenderOptions::default() };
        let known: Vec<&str> = changes.iter().copied().filter(|c| config(&[c]).is_ok()).collect();
        let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &config_without_bounces(&known)?, options)?;
        renderer.read_slots(&["direct"])?;
        let mut sum = 0.0;
        for _ in 0..64 {
            let request = FrameRequest { camera: &s.cameras[0], time: 0.0, view: None, read_back: true };
            let result = renderer.frame(request)?.context("no frame")?;
            let image = result.slots[0].1.as_ref().context("no direct light")?;
            sum += image.values().iter().map(|v| f64::from(v[0])).sum::<f64>();
        }
        Ok(sum)
    };
    let (one, eight) = (light("shadows.rays=1")?, light("shadows.rays=8")?);
    println!("one ray is {:.4} as bright as eight", one / eight);
    ensure!(eight > 1.0 && (one / eight - 1.0).abs() < 0.01, "{one} by single rays, {eight} by eight");
    Ok(())
}

/// A normal map that leans to all sides in turn.
fn bumps() -> Texture {
    let side = 64;
    let mut texels = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let lean = Vec2::new(f32::sin(x as f32), f32::cos(1.7 * y as f32)) * 0.5;
            let normal = lean.extend(1.0).normalize() * 0.5 + 0.5;
            texels.extend(normal.to_array().map(|v| (255.0 * v).round() as u8));
            texels.push(255);
        }
    }
    Texture::new("bumps".to_owned(), [side, side], ColourSpace::Linear, texels)
}

#[test]
fn bumps_keep_no_shadow_noisy() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut errors = Vec::new();
    for bumpy in [false, true] {
        let mut s = lamps(1);
        if bumpy {
            s.textures.push(bumps());
            s.samplers.push(Sampler::default());
            s.materials[0].normal_texture =
                Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] });
            s.meshes[0].uv0 = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vec2::from).to_vec();
        }
        let shadow = |changes: &[&str], frames: u32| -> Result<Values> {
            let options = RenderOptions { width: SIZE[0], height: SIZE[1], ..RenderOptions::default() };
            let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &config(changes)?, options)?;
            renderer.read_slots(&["shadows"])?;
            let mut sum = Vec::new();
            for frame in 0..frames {
                let request = FrameRequest { camera: &s.cameras[0], time: 0.0, view: None, read_back: true };
                let result = renderer.frame(request)?.context("no frame")?;
                let now = values(result.slots[0].1.as_ref().context("no shadows")?);
                if frame == 0 { sum = now } else { sum.iter_mut().zip(now).for_each(|(sum, v)| *sum += v) }
            }
            Ok(sum.into_iter().map(|sum| sum / f64::from(frames)).collect())
        };
        let normals = render(&gpu, &s, &config(&[])?, SIZE, 1, Some(("gbuffer.draw", "normal")))?.images;
        let normals = normals.context("no normals")?.linear.values();
        let leaning = normals.iter().filter(|n| (n[0] - n[2]).abs() + (n[1] - n[3]).abs() > 0.1).count();
        ensure!((leaning > 2000) == bumpy, "{leaning} pixels lean, bumps: {bumpy}");
        let truth = shadow(&["shadows.denoiser=none", "shadows.rays=8"], 16)?;
        let error = rms(&shadow(&[], 1)?, &truth);
        println!("bumps {bumpy}: {error:.4}, one ray {:.4}", rms(&shadow(&["shadows.denoiser=none"], 1)?, &truth));
        errors.push(error);
    }
    ensure!(errors[1] < 1.2 * errors[0], "{} with a normal map, {} without", errors[1], errors[0]);
    Ok(())
}

/// With four fifths of the pixels each way, one output pixel of five has no sample of its own in a frame, in each direction. While the light
/// grows, as in the first frames, such pixels must not stay behind.
#[test]
fn growing_light_shows_no_pattern_of_samples() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let presets = ["shadows", "ao", "direct", "gi", "reflections", "post"].map(|slot| format!("stages.{slot}=high"));
    let options = RenderOptions { width: 320, height: 180, ..RenderOptions::default() };
    let mut renderer =
        Renderer::new(&gpu, &scene, &Slots::default(), &config(&presets.each_ref().map(String::as_str))?, options)?;
    for frame in 1..=8 {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let image = renderer.frame(request)?.context("no frame")?.images.context("no image")?.linear;
        // The front of the tall block.
        let found = pattern(&image, [128, 82], [6, 7], 5);
        println!("frame {frame}: pattern of {:.2} %", 100.0 * found);
        ensure!(found < 0.012, "frame {frame}: {found} of the light repeats with the grid of samples");
    }
    Ok(())
}
