//! Devices that cannot filter 32-bit float textures give the same pictures: shaders filter the texels themselves.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use magpie::gpu::GpuOptions;
use magpie::prelude::*;
use magpie::scene::{Environment, Scene, Wrap};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::filter::FETCHED;
use magpie_shaders::{SampledImage, SamplerId, StorageImage};
use magpie_tests::bench::Bench;
use magpie_tests::harness::{builtin, config};

const SIZE: u32 = 64;

/// Draws an image, then samples it from one image width left of it to one right of it, and likewise vertically.
const MAKE: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uint sampler_id; uint size; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, ivec2(size)))) return;
    vec4 made = vec4((p * ivec2(7, 13) + p.yx * ivec2(3, 5)) % 31, (p.x * p.y) % 17, 1.0);
    if (sampler_id == 0xffffffffu) store(to, p, made);
    else store(to, p, sample_bilinear(from, sampler_id, 3.0 * (vec2(p) + 0.37) / float(size) - 1.0));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    from: SampledImage,
    to: StorageImage,
    sampler_id: u32,
    size: u32,
}

/// The samples, filtered by sampler or by shader as the device allows.
fn samples(gpu: &Gpu, wrap: [Wrap; 2]) -> Result<(SamplerId, Vec<[f32; 4]>)> {
    let mut bench = Bench::new(gpu)?;
    let (kernel, extent) = (bench.kernel("make.comp", MAKE)?, Extent::new(SIZE, SIZE));
    let filter = gpu.bilinear(Format::Rgba32Float, wrap)?;
    let ran = bench.run(extent, &["test.sample:image"], |g, _| {
        let desc = ImageDesc::fixed(Format::Rgba32Float, Extent::new(13, 11));
        let made = g.pass("test.make", Queue::Graphics, |p| {
            let (image, to) = p.create("image", desc);
            (image.read(), move |c: &mut Record<'_>| {
                let params = Params { from: SampledImage::default(), to: c.id(to), sampler_id: u32::MAX, size: 13 };
                c.dispatch(kernel, &params, extent);
            })
        });
        let image = g.pass("test.sample", Queue::Graphics, |p| {
            let from = p.sample(made);
            let (image, to) = p.create("image", ImageDesc::full(Format::Rgba32Float));
            (image.read(), move |c: &mut Record<'_>| {
                let params = Params { from: c.id(from), to: c.id(to), sampler_id: filter.index(), size: SIZE };
                c.dispatch(kernel, &params, extent);
            })
        });
        g.output(image);
        Ok(())
    })?;
    Ok((filter, ran.clean()?.values("test.sample:image")?))
}

/// The linear picture of the last of some frames of a moving scene.
fn picture(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<Vec<[f32; 4]>> {
    let options = RenderOptions { width: 64, height: 36, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(changes)?, options)?;
    let mut last = None;
    for frame in 0..4 {
        let request = FrameRequest {
            camera: &scene.cameras[0],
            time: f64::from(frame) / 30.0,
            view: None,
            read_back: frame == 3,
        };
        last = renderer.frame(request)?.and_then(|result| result.images);
    }
    Ok(last.context("no picture")?.linear.values())
}

#[test]
fn pictures_are_the_same_where_samplers_do_not_blend_floats() -> Result<()> {
    if std::env::var_os("MAGPIE_NO_GPU").is_some() {
        return Ok(());
    }
    // One after the other, in a process without other tests: see `harness::gpu`.
    let open = |without_float_filter: bool| {
        let device = std::env::var("MAGPIE_DEVICE").ok();
        Gpu::new(&GpuOptions { device, validation: true, without_float_filter, ..GpuOptions::default() })
    };
    let (plain, without) = (open(false)?, open(true)?);
    ensure!(!without.filters(Format::Rgba32Float) && !without.filters(Format::R32Float));
    ensure!(without.filters(Format::Rgba16Float) && without.filters(Format::Rgba8Unorm), "only those were left out");
    if !plain.filters(Format::Rgba32Float) {
        println!("nothing to compare with: {} filters no 32-bit floats", plain.report().name);
        return Ok(());
    }

    for wrap in [[Wrap::Clamp; 2], [Wrap::Repeat, Wrap::Clamp], [Wrap::Clamp, Wrap::Repeat], [Wrap::Repeat; 2]] {
        let ((sampler, wanted), (fetched, found)) = (samples(&plain, wrap)?, samples(&without, wrap)?);
        ensure!(sampler.index() < FETCHED && fetched.index() >= FETCHED, "{sampler:?} {fetched:?}");
        let spread = wanted.iter().flatten().fold(0.0_f32, |most, v| most.max(*v));
        ensure!(spread > 20.0, "the picture is plain: {spread}");
        // Samplers may quantise weights to 1/256 of a texel in each direction.
        let step = 2.0 * 31.0 / 256.0;
        let worst =
            wanted.iter().flatten().zip(found.iter().flatten()).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
        println!("{wrap:?}: off by at most {worst:.5} of {spread}");
        ensure!(worst < step, "{wrap:?}: off by {worst}");
    }

    let mut around = builtin("carousel")?;
    let radiance = (0..32 * 16).map(|i| Vec3::new((i % 7) as f32, (i % 5) as f32, (i % 32) as f32) * 0.1).collect();
    let (name, width, height) = ("map".to_owned(), 32, 16);
    around.environment = Some(Environment { name, width, height, radiance, scale: 1.0, turn: 0.3 });
    for (what, scene, changes) in [
        ("TAA", builtin("carousel")?, &["post.anti_aliasing=taa"][..]),
        ("TAA upsampling", builtin("carousel")?, &["post.anti_aliasing=taa", "post.resolution_scale=0.67"]),
        ("plain upsampling", builtin("carousel")?, &["post.resolution_scale=0.5"]),
        ("an environment map", around, &[]),
    ] {
        let (wanted, found) = (picture(&plain, &scene, changes)?, picture(&without, &scene, changes)?);
        let pairs = || wanted.iter().flatten().zip(found.iter().flatten()).map(|(a, b)| (f64::from(*a), f64::from(*b)));
        let most = pairs().fold(0.0_f64, |most, (a, b)| most.max((a - b).abs() / (a.abs() + 0.01)));
        let mean = pairs().map(|(a, _)| a.abs()).sum::<f64>() / pairs().count() as f64;
        let rms = (pairs().map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / pairs().count() as f64).sqrt();
        println!("{what}: off by {:.1e} of the mean (root mean square), {most:.1e} of a pixel at most", rms / mean);
        ensure!(mean > 0.01 && rms < 2e-3 * mean, "{what}: off by {rms}, mean {mean}");
    }
    Ok(())
}
