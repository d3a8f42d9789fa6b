//! Memory saved by aliasing: memory of the transients against the most that is alive at once, and against the sum of all.
use anyhow::{Context, Result, ensure};
use magpie::graph::plan::{Memory, Packed, Plan};
use magpie::graph::{
    Extent, Format, FrameGraph, Handle, Image, ImageDesc, Queue, Queues, Record, Size, Switches, plan,
};
use magpie::scene::BUILTIN;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};

/// Greatest ratio of placed memory to the most bytes alive at once.
const OVER_LOWER_BOUND: f64 = 1.05;
/// Greatest ratio of placed memory to the unaliased sum, for a frame with many effects.
const OF_UNALIASED: f64 = 0.6;

fn step(g: &mut FrameGraph, name: &str, inputs: &[Handle<Image>], desc: ImageDesc) -> Handle<Image> {
    g.pass(name, Queue::Graphics, |p| {
        for input in inputs {
            p.sample(*input);
        }
        (p.create("image", desc).0.read(), |_: &mut Record<'_>| {})
    })
}

/// A frame as large as one with every effect: a G-buffer that most passes read, denoised shadows of four lights, ambient occlusion,
/// reflections and indirect light at half size, bloom with a mip pyramid, and a chain of post-processing.
fn sixty_passes(full: Extent) -> FrameGraph {
    let mut g = FrameGraph::new(full);
    let formats = [
        Format::D32Float,
        Format::Rgba8Srgb,
        Format::Rgba16Snorm,
        Format::Rg8Unorm,
        Format::Rg16Float,
        Format::Rg32Uint,
    ];
    let [depth, colour, normal, material, motion, ids] = g.pass("gbuffer.draw", Queue::Graphics, |p| {
        let images = formats.map(|format| match format {
            Format::D32Float => p.depth("depth", ImageDesc::full(format), 0.0).0.read(),
            other => p.color(&format!("{other:?}"), ImageDesc::full(other), [0.0; 4]).0.read(),
        });
        (images, |_: &mut Record<'_>| {})
    });
    let denoise = |g: &mut FrameGraph, effect: &str, noisy: Handle<Image>, format: Format, size: Size| {
        let desc = ImageDesc { size, ..ImageDesc::full(format) };
        let moments = ImageDesc { size, ..ImageDesc::full(Format::Rg16Float) };
        let blended = step(g, &format!("{effect}.temporal"), &[noisy, motion, depth, normal, ids], desc);
        let variance = step(g, &format!("{effect}.variance"), &[blended, depth, normal], moments);
        (0..3).fold(blended, |image, level| {
            step(g, &format!("{effect}.atrous{level}"), &[image, variance, depth, normal], desc)
        })
    };
    let mut lit = Vec::new();
    for light in 0..4 {
        let effect = format!("shadows{light}");
        let noisy = step(&mut g, &format!("{effect}.trace"), &[depth, normal], ImageDesc::full(Format::R8Unorm));
        lit.push(denoise(&mut g, &effect, noisy, Format::R8Unorm, Size::Full));
    }
    for (effect, format) in [("ao", Format::R8Unorm), ("gi", Format::Rgba16Float), ("reflections", Format::Rgba16Float)]
    {
        let noisy = step(&mut g, &format!("{effect}.trace"), &[depth, normal, material], ImageDesc::half(format));
        let calm = denoise(&mut g, effect, noisy, format, Size::Half);
        lit.push(step(&mut g, &format!("{effect}.upsample"), &[calm, depth, normal], ImageDesc::full(format)));
    }
    lit.extend([depth, colour, normal, material]);
    let hdr = ImageDesc::full(Format::Rgba16Float);
    let lit = step(&mut g, "direct.shade", &lit, hdr);
    let lit = step(&mut g, "sky.fill", &[lit, depth], hdr);
    let resolved = step(&mut g, "taa.resolve", &[lit, motion, depth], hdr);
    let mut pyramid = vec![resolved];
    for level in 1..6 {
        let desc = ImageDesc::fixed(Format::Rgba16Float, full.mip(level));
        let from = pyramid[level as usize - 1];
        pyramid.push(step(&mut g, &format!("bloom.down{level}"), &[from], desc));
    }
    let mut glow = pyramid[5];
    for level in (1..5).rev() {
        let desc = ImageDesc::fixed(Format::Rgba16Float, full.mip(level));
        glow = step(&mut g, &format!("bloom.up{level}"), &[glow, pyramid[level as usize]], desc);
    }
    let bright = step(&mut g, "bloom.add", &[resolved, glow], hdr);
    let shown = step(&mut g, "post.tone_map", &[bright], ImageDesc::full(Format::Rgba8Unorm));
    g.output(shown);
    g
}

fn within(what: &str, memory: &Memory, aliased: u64) -> Result<()> {
    let (over, of) = (aliased as f64 / memory.lower_bound as f64, aliased as f64 / memory.unaliased as f64);
    println!(
        "{what}: {} bytes unaliased, {aliased} aliased, {} at least: {over:.4} of the least, {:.1} % of the unaliased",
        memory.unaliased,
        memory.lower_bound,
        100.0 * of
    );
    ensure!(aliased >= memory.lower_bound, "{what}: less than what is alive at once");
    ensure!(over <= OVER_LOWER_BOUND, "{what}: {over} of the lower bound");
    Ok(())
}

#[test]
fn a_frame_of_sixty_passes() -> Result<()> {
    for (width, height) in [(1920, 1080), (1280, 720), (641, 359), (320, 180)] {
        let frame = sixty_passes(Extent::new(width, height)).finish()?;
        for words in ["", "no-reorder"] {
            let mut switches = Switches::default();
            ensure!(words.is_empty() || switches.set(words), "{words}");
            let plan: Plan = plan(&frame.declaration, &switches, Queues::default(), &mut Packed);
            ensure!(plan.order.len() >= 60, "{} passes", plan.order.len());
            within(&format!("{width}x{height} {words}"), &plan.memory, plan.memory.aliased)?;
            let share = plan.memory.aliased as f64 / plan.memory.unaliased as f64;
            ensure!(share <= OF_UNALIASED, "{share} of the unaliased sum");
        }
    }
    Ok(())
}

#[test]
fn the_default_frame_on_the_device() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, _) in BUILTIN {
        let scene = builtin(name)?;
        let options = RenderOptions { width: 320, height: 180, seed: 0, check: false, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&[])?, options)?;
        let result =
            renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false })?;
        let result = result.context("a size of zero")?;
        // The device's actual memory, not the plan's.
        within(name, &result.plan.memory, result.sample.memory.transient_bytes)?;
    }
    Ok(())
}
