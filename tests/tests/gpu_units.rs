//! Small frames: upload and read-back, textures, the scan for NaN, ray counts, and errors that name their cause.
use anyhow::{Result, bail, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, GpuOptions, ImageUse};
use magpie::graph::check::Place;
use magpie::graph::{
    Access, BufferDesc, Domain, Extent, Format, FrameGraph, ImageDesc, ImageState, MipCopy, Queue, Record,
};
use magpie::scene::{Light, ResidentOptions, ResidentScene, Sampler, Scene};
use magpie::slot::{Build, SlotError};
use magpie_passes::Slots;
use magpie_shaders::{Address, SampledImage, SamplerId, StorageImage};
use magpie_tests::bench::{Bench, Shared, Shot, results};
use magpie_tests::fixtures::{add, camera, material, plane, scene, sphere};
use magpie_tests::harness::{builtin, config, gpu};
use magpie_tests::oracle::gbuffer::{Eye, octahedral};
use magpie_tests::oracle::shading::incident;
use std::sync::Arc;

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
"#;

fn upload(gpu: &Gpu, data: &[u8]) -> Result<Arc<Buffer>> {
    let mut buffer = Buffer::new(gpu, "upload", data.len() as u64, BufferMemory::Upload, BufferUse::Storage)?;
    buffer.write(0, data)?;
    Ok(Arc::new(buffer))
}

#[test]
fn buffers_go_up_through_a_shader_and_come_back() -> Result<()> {
    const COUNT: u32 = 1000;
    #[repr(C)]
    #[derive(Clone, Copy, Pod, Zeroable)]
    struct Params {
        from: Address,
        to: Address,
        count: u32,
    }
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let square = bench.kernel(
        "square.comp",
        &format!(
            "{HEAD}{}",
            r#"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };
layout(push_constant, scalar) uniform Push { uvec2 from; uvec2 to; uint count; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) Words(to).at[i] = WordBuffer(from).at[i] * WordBuffer(from).at[i] + 1u;
}
"#
        ),
    )?;
    assert_eq!(square.local_size, [64, 1, 1]);
    let numbers: Vec<u32> = (0..COUNT).map(|i| i * 77 + 5).collect();
    let source = upload(&gpu, bytemuck::cast_slice(&numbers))?;
    let bytes = u64::from(COUNT) * 4;
    let mut read = None;
    bench.run(Extent::new(1, 1), &[], |g, imports| {
        let key = imports.borrow_mut().buffer(&source);
        let from = g.import_buffer("from", BufferDesc::new(bytes), Access::BufferRead, key).read();
        // Through a device-local transient, and from there by a copy.
        let squares = g.pass("test.square", Queue::Graphics, |p| {
            let from = p.read(from);
            let (squares, to) = p.create_buffer("squares", BufferDesc::new(bytes));
            (squares.read(), move |c: &mut Record<'_>| {
                let params = Params { from: c.id(from), to: c.id(to), count: COUNT };
                c.dispatch_groups(square, &params, [COUNT.div_ceil(64), 1, 1]);
            })
        });
        let (target, buffer) = results(&gpu, g, imports, "read back", bytes)?;
        let target = g.pass("test.copy", Queue::Transfer, |p| {
            let from = p.copy_from(squares);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
        });
        g.leave(target.read(), Access::HostRead, Domain::Copy);
        read = Some(buffer);
        Ok(())
    })?;
    let Some(read) = read else { bail!("nothing was declared") };
    let squares: Vec<u32> = bytemuck::pod_collect_to_vec(read.contents());
    let expected: Vec<u32> = numbers.iter().map(|n| n.wrapping_mul(*n) + 1).collect();
    assert_eq!(squares, expected);
    Ok(())
}

/// Samples an uploaded image at the centre at several mip levels.
fn sampled(
    bench: &mut Bench,
    format: Format,
    levels: &[[u8; 4]],
    sampler: Sampler,
    lods: &[f32],
) -> Result<Vec<[f32; 4]>> {
    #[repr(C)]
    #[derive(Clone, Copy, Pod, Zeroable)]
    struct Params {
        lods: Address,
        to: Address,
        image: SampledImage,
        sampler: SamplerId,
        count: u32,
    }
    let gpu = bench.gpu.clone();
    let read = bench.kernel(
        "sample.comp",
        &format!(
            "{HEAD}{}",
            r#"
layout(local_size_x = 8) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Lods { float at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Colours { vec4 at[]; };
layout(push_constant, scalar) uniform Push { uvec2 lods; uvec2 to; uint image; uint sampler_id; uint count; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) Colours(to).at[i] = sample_lod(image, sampler_id, vec2(0.5), Lods(lods).at[i]);
}
"#
        ),
    )?;
    let extent = Extent::new(8, 4);
    let mips = levels.len() as u32;
    let usage = ImageUse { sampled: true, ..Default::default() };
    let image = Arc::new(magpie::gpu::Image::new(&gpu, "texture", format, extent, mips, usage)?);
    let (mut bytes, mut copies) = (Vec::new(), Vec::new());
    for (mip, colour) in (0..).zip(levels) {
        copies.push(MipCopy { offset: bytes.len() as u64, mip });
        let size = extent.mip(mip);
        (0..size.width * size.height).for_each(|_| bytes.extend(colour));
    }
    let staging = upload(&gpu, &bytes)?;
    let lod_table = upload(&gpu, bytemuck::cast_slice(lods))?;
    let sampler = gpu.sampler(sampler)?;
    let count = lods.len() as u32;
    let mut back = None;
    bench.run(extent, &[], |g, imports| {
        let desc = ImageDesc { mips, ..ImageDesc::fixed(format, extent) };
        let (staging_key, image_key, lods_key) = {
            let mut i = imports.borrow_mut();
            (i.buffer(&staging), i.image(&image), i.buffer(&lod_table))
        };
        let from = g.import_buffer("staging", BufferDesc::new(bytes.len() as u64), Access::CopyRead, staging_key);
        let to = g.import_image("texture", desc, ImageState::UNDEFINED, image_key);
        let texture = g.pass("test.upload", Queue::Transfer, |p| {
            let from = p.copy_from(from.read());
            let (to, into) = p.copy_to(to);
            (to.read(), move |c: &mut Record<'_>| c.copy_to_image(from, into, &copies))
        });
        let lods = g.import_buffer("lods", BufferDesc::new(lod_table.bytes()), Access::BufferRead, lods_key).read();
        let (target, buffer) = results(&gpu, g, imports, "colours", u64::from(count) * 16)?;
        let target = g.pass("test.sample", Queue::Graphics, |p| {
            let (texture, lods) = (p.sample(texture), p.read(lods));
            let (target, to) = p.write_buffer(target);
            (target, move |c: &mut Record<'_>| {
                let params = Params { lods: c.id(lods), to: c.id(to), image: c.id(texture), sampler, count };
                c.dispatch_groups(read, &params, [count.div_ceil(8), 1, 1]);
            })
        });
        g.leave(target.read(), Access::HostRead, Domain::Copy);
        back = Some(buffer);
        Ok(())
    })?;
    let Some(back) = back else { bail!("nothing was declared") };
    Ok(bytemuck::pod_collect_to_vec(back.contents()))
}

const LEVELS: [[u8; 4]; 4] = [[255, 0, 10, 255], [0, 255, 20, 204], [51, 102, 153, 0], [200, 100, 1, 128]];

#[test]
fn every_mip_is_found_where_it_was_put() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let lods = [0.0, 1.0, 2.0, 3.0, 9.0, 0.5, 1.75];
    let read = sampled(&mut bench, Format::Rgba8Unorm, &LEVELS, Sampler::default(), &lods)?;
    for (lod, colour) in lods.iter().zip(&read) {
        let lod = lod.min(3.0);
        let (low, part) = (lod.floor() as usize, lod.fract());
        for c in 0..4 {
            let mix = |i: usize| f32::from(LEVELS[i.min(3)][c]) / 255.0;
            let expected = mix(low) * (1.0 - part) + mix(low + 1) * part;
            // Devices blend mips with at least 8 fractional bits.
            ensure!((colour[c] - expected).abs() < 1.0 / 256.0, "lod {lod}, channel {c}: {} not {expected}", colour[c]);
        }
    }
    // Without mips the finest level is read at any lod.
    let sampler = Sampler { mips: false, ..Sampler::default() };
    let read = sampled(&mut bench, Format::Rgba8Unorm, &LEVELS, sampler, &[0.0, 3.0])?;
    ensure!(read[0] == read[1] && read[0][0] == 1.0, "{read:?}");
    Ok(())
}

#[test]
fn srgb_is_decoded_when_sampled_and_alpha_is_not() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let read = sampled(&mut bench, Format::Rgba8Srgb, &LEVELS, Sampler::default(), &[0.0, 1.0, 2.0, 3.0])?;
    for (level, colour) in LEVELS.iter().zip(&read) {
        for c in 0..3 {
            // Rounded back to the 8-bit code (IEC 61966-2-1): within half a step, as Vulkan requires.
            let x = f64::from(colour[c]);
            let code = 255.0 * if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            ensure!((code - f64::from(level[c])).abs() < 0.5, "{} was read as {x}, which is {code}", level[c]);
        }
        let alpha = f32::from(level[3]) / 255.0;
        ensure!((colour[3] - alpha).abs() < 1e-5, "alpha {} was read as {}", level[3], colour[3]);
    }
    Ok(())
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Spoil {
    image: StorageImage,
    size: [u32; 2],
    spoil: u32,
}

const SPOIL: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint image; uvec2 size; uint spoil; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    vec4 value = vec4(0.25, -1.0, 60000.0, 1.0);
    if (spoil == 1u && p == ivec2(5, 3)) value.g = uintBitsToFloat(0x7fc00000u);
    if (spoil == 1u && p == ivec2(17, 2)) value.b = uintBitsToFloat(0xff800000u);
    store(image, p, value);
}
"#;

#[test]
fn the_scan_finds_nan_and_infinity_and_nothing_later_hides_them() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel("spoil.comp", &format!("{HEAD}{SPOIL}"))?;
    let extent = Extent::new(37, 11); // no multiple of a workgroup
    for format in [Format::Rgba32Float, Format::Rgba16Float] {
        let ran = bench.run(extent, &["user.mend:image"], |g, _| {
            let mut make = |name: &str, spoil| {
                g.pass(name, Queue::Graphics, |p| {
                    let (image, target) = p.create("image", ImageDesc::full(format));
                    (image, move |c: &mut Record<'_>| {
                        let size = [extent.width, extent.height];
                        c.dispatch(kernel, &Spoil { image: c.id(target), size, spoil }, extent);
                    })
                })
            };
            let spoilt = make("user.spoil", 1);
            // This output is unused, so neither the pass nor its scan may run.
            let _ = make("user.idle", 1);
            g.pass("user.mend", Queue::Graphics, |p| {
                let (_, target) = p.write(spoilt);
                ((), move |c: &mut Record<'_>| {
                    let size = [extent.width, extent.height];
                    c.dispatch(kernel, &Spoil { image: c.id(target), size, spoil: 0 }, extent);
                })
            });
            Ok(())
        })?;
        let [found] = ran.findings.as_slice() else { bail!("{format:?}: {:?}", ran.findings) };
        assert_eq!((found.pass.as_str(), found.output.as_str()), ("user.spoil", "image"));
        assert_eq!((found.nan, found.infinite, found.place), (1, 1, Place::pixel(17, 2)), "the first in reading order");
        let text = found.to_string();
        for part in ["user.spoil:image", "1 pixel with NaN", "1 pixel with infinity", "(17, 2)"] {
            assert!(text.contains(part), "{text}");
        }
        let values = ran.values("user.mend:image")?;
        assert!(values.iter().all(|v| v[0] == 0.25 && v[1] == -1.0 && v[3] == 1.0), "it was mended");
        let names: Vec<&str> = ran.executed.sample.passes.iter().map(|p| p.name.as_str()).collect();
        assert!(!names.iter().any(|n| n.contains("user.idle")), "{names:?}");
        assert_eq!(ran.executed.sample.culled, 3, "the idle pass and its scans: {names:?}");
        assert_eq!(names.len(), 7, "two passes, two scans of two passes each, one copy: {names:?}");
    }
    Ok(())
}

/// The number of rays of `shadows.trace` against the pixels that must trace one, by the shader's rule in double precision.
fn shadow_rays(scene: &Scene) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let resident = ResidentScene::new(&gpu, scene, ResidentOptions::default())?.shared();
    let extent = Extent::new(203, 117);
    let shot = Shot { scene: &resident, camera: &scene.cameras[0], extent };
    let wanted =
        ["gbuffer.draw:depth", "gbuffer.draw:normal", "shadows.trace:visibility", "gbuffer.draw:geometric_normal"];
    let hard = config(&["shadows.edges=hard", "shadows.most_lights=1"])?;
    let ran = bench.frame(shot, &hard, &wanted)?.clean()?;
    let of = |k: usize| ran.values(wanted[k]);
    let [depth, normal, visibility, geometric] = [of(0)?, of(1)?, of(2)?, of(3)?];
    let eye = Eye::new(&scene.cameras[0], extent);
    let Some(light) = resident.borrow().shadow_lights().first().map(|c| &scene.lights[c.light as usize]) else {
        bail!("no light")
    };
    let (mut sure, mut unsure, mut seen) = (0_u64, 0_u64, 0_u64);
    for i in 0..depth.len() {
        if depth[i][0] == 0.0 {
            ensure!(visibility[i][0] == 0.0, "the background sees the light");
            continue;
        }
        let i_light = incident(light, eye.world_position(i, depth[i][0]));
        let n = [octahedral(normal[i][0], normal[i][1]), octahedral(geometric[i][0], geometric[i][1])];
        let least = n.map(|n| n.dot(i_light.direction)).into_iter().fold(f64::INFINITY, f64::min);
        let reached = i_light.irradiance.max_element();
        // In 32 bits values within a millionth of the limit may fall on either side.
        match (least > 1e-6 && reached > 1e-9, least < -1e-6 || reached == 0.0) {
            (true, _) => sure += 1,
            (false, true) => ensure!(visibility[i][0] == 0.0, "a pixel that faces away sees the light"),
            _ => unsure += 1,
        }
        seen += u64::from(visibility[i][0] > 0.0);
    }
    let [closest, any] = ran.rays("shadows.trace")?;
    println!("{}: {any} shadow rays, {sure} pixels must trace one, {unsure} may, {seen} see the light", scene.name);
    ensure!(closest == 0, "{closest} closest-hit rays");
    ensure!((sure..=sure + unsure).contains(&any), "{any} any-hit rays, {sure} to {} wanted", sure + unsure);
    ensure!(unsure * 100 < sure && seen > 0 && seen <= any, "{unsure} unsure, {seen} see the light");
    ensure!(ran.rays("direct.shade")? == [0, 0], "shading traces nothing");
    Ok(())
}

#[test]
fn shadow_rays_are_counted() -> Result<()> {
    shadow_rays(&builtin("courtyard")?)?;
    shadow_rays(&builtin("cornell")?)?;
    let mut lamp = scene("lamp", camera(glam::Vec3::new(0.0, 3.0, 5.0), glam::Vec3::ZERO));
    add(&mut lamp, plane(8.0), material([0.5; 3], 0.0, 0.5), glam::Affine3A::IDENTITY);
    add(&mut lamp, sphere(16), material([0.5; 3], 0.0, 0.5), glam::Affine3A::from_translation(glam::Vec3::Y));
    let (position, intensity) = (glam::DVec3::new(1.0, 3.0, 1.0), glam::Vec3::splat(30.0));
    lamp.lights.push(Light::Point { position, intensity, range: Some(4.5) });
    shadow_rays(&lamp)
}

#[test]
fn no_light_means_no_shadow_pass_and_no_ray() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let mut dark = builtin("cornell")?;
    dark.lights.clear();
    let resident = ResidentScene::new(&gpu, &dark, ResidentOptions::default())?.shared();
    let shot = Shot { scene: &resident, camera: &dark.cameras[0], extent: Extent::new(64, 64) };
    let ran = bench.frame(shot, &config(&[])?, &["direct.shade:radiance", "gbuffer.draw:emission"])?.clean()?;
    ensure!(ran.rays("shadows.trace").is_err(), "the shadow pass ran");
    let (radiance, emission) = (ran.values("direct.shade:radiance")?, ran.values("gbuffer.draw:emission")?);
    ensure!(radiance.iter().zip(&emission).all(|(r, e)| r[..3] == e[..3]), "light without a light");
    Ok(())
}

#[test]
fn an_unknown_device_is_an_error_that_lists_the_known_ones() -> Result<()> {
    if gpu()?.is_none() {
        return Ok(());
    }
    let options = GpuOptions { device: Some("no such card".to_owned()), validation: false, ..GpuOptions::default() };
    match Gpu::new(&options) {
        Err(error @ GpuError::UnknownDevice { .. }) => {
            let text = error.to_string();
            let GpuError::UnknownDevice { wanted, known } = error else { unreachable!() };
            assert_eq!(wanted, "no such card");
            assert!(!known.is_empty() && known.iter().all(|k| text.contains(k.as_str())), "{text}");
            println!("{text}");
        }
        other => bail!("{other:?}"),
    }
    Ok(())
}

#[test]
fn an_unknown_implementation_is_an_error_that_lists_the_known_ones() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let chosen = Slots::default().shadows.choose(
        &Build::new(&gpu, magpie::prelude::Rays::Software),
        "ray-trased",
        &Default::default(),
    );
    match chosen.map(|_| ()) {
        Err(error @ SlotError::UnknownImplementation { .. }) => {
            let text = error.to_string();
            for part in ["stages.shadows", "ray-trased", "ray-traced", "off"] {
                assert!(text.contains(part), "{text}");
            }
            println!("{text}");
        }
        other => bail!("{other:?}"),
    }
    Ok(())
}

#[test]
fn sizes_beyond_the_device_are_errors_with_numbers() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let usage = ImageUse { sampled: true, ..Default::default() };
    let wide = Extent::new(1 << 20, 1);
    match magpie::gpu::Image::new(&gpu, "wide", Format::R8Unorm, wide, 1, usage).map(|_| ()) {
        Err(GpuError::Limit { what, wanted, limit }) => {
            assert!(what.contains("wide") && wanted == 1 << 20 && limit < wanted)
        }
        other => bail!("{other:?}"),
    }
    let mut small = Buffer::new(&gpu, "small", 8, BufferMemory::Upload, BufferUse::Storage)?;
    assert!(small.write(1 << 40, &[0]).is_err() && small.write(4, &[0; 1 << 20]).is_err());
    match Buffer::new(&gpu, "vast", 1 << 50, BufferMemory::Device, BufferUse::Storage).map(|_| ()) {
        Err(GpuError::Limit { what, wanted, .. }) => assert!(what.contains("vast") && wanted == 1 << 50),
        other => bail!("{other:?}"),
    }
    gpu.check_validation()?;
    Ok(())
}

#[test]
fn the_validation_layers_report_a_wrong_pipeline() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    gpu.check_validation()?;
    // More threads per workgroup than any device supports. A dispatch of no workgroups makes the pipeline and runs nothing.
    let text = "layout(local_size_x = 1024, local_size_y = 8) in;
        layout(push_constant, scalar) uniform Push { uint image; };
        void main() { store(image, ivec2(0), vec4(0.0)); }";
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel("wrong.comp", &format!("{HEAD}{text}"))?;
    let messages = reported(&mut bench, |g, _| {
        let image = g.pass("wrong", Queue::Graphics, |p| {
            let (image, target) = p.create("image", ImageDesc::full(Format::Rgba32Float));
            (image.read(), move |c: &mut Record<'_>| {
                let target = c.id(target);
                c.dispatch_groups(kernel, &target, [0; 3]);
            })
        });
        g.output(image);
        Ok(())
    })?;
    println!("{}", messages[0]);
    ensure!(messages.iter().any(|m| m.to_lowercase().contains("workgroup")), "{}", messages[0]);
    gpu.check_validation()?; // returns messages once
    Ok(())
}

/// The validation messages of a frame.
fn reported(bench: &mut Bench, declare: impl FnOnce(&mut FrameGraph, &Shared) -> Result<()>) -> Result<Vec<String>> {
    match bench.run(Extent::new(16, 16), &[], declare) {
        Err(error) => match error.downcast::<GpuError>()? {
            GpuError::Validation { messages } => Ok(messages),
            other => bail!(other),
        },
        Ok(_) => bail!("nothing was reported"),
    }
}

#[test]
fn synchronization_validation_is_on() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let data = upload(&gpu, &[1; 1024])?;
    // Each pass is one copy: without a barrier between two, both write the same bytes.
    let messages = reported(&mut bench, |g, imports| {
        let key = imports.borrow_mut().buffer(&data);
        let from = g.import_buffer("data", BufferDesc::new(1024), Access::CopyRead, key);
        let (target, _) = results(&gpu, g, imports, "target", 1024)?;
        let from = from.read();
        let target = g.pass("user.copy_twice", Queue::Transfer, |p| {
            let from = p.copy_from(from);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| {
                c.copy_buffer(from, 0, to, 0, 512);
                c.copy_buffer(from, 512, to, 256, 512);
            })
        });
        g.leave(target.read(), Access::HostRead, Domain::Copy);
        Ok(())
    })?;
    println!("{}", messages[0]);
    ensure!(messages[0].contains("WRITE_AFTER_WRITE") || messages[0].contains("WRITE-AFTER-WRITE"), "{}", messages[0]);
    Ok(())
}

#[test]
fn a_lie_about_an_imported_image_is_reported() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let usage = ImageUse { sampled: true, storage: true, attachment: false };
    let (format, extent) = (Format::Rgba8Unorm, Extent::new(16, 16));
    let image = Arc::new(magpie::gpu::Image::new(&gpu, "fresh", format, extent, 1, usage)?);
    let kernel = bench.kernel("spoil.comp", &format!("{HEAD}{SPOIL}"))?;
    // It was never written, so its layout is undefined.
    let messages = reported(&mut bench, |g, imports| {
        let state = ImageState { access: Some((Access::Sample, Domain::Compute)) };
        let image = g.import_image("fresh", ImageDesc::full(format), state, imports.borrow_mut().image(&image));
        g.pass("user.write", Queue::Graphics, |p| {
            let (image, target) = p.write(image);
            (image.read(), move |c: &mut Record<'_>| {
                c.dispatch(kernel, &Spoil { image: c.id(target), size: [16, 16], spoil: 0 }, extent);
            })
        });
        Ok(())
    })?;
    println!("{}", messages[0]);
    ensure!(messages.iter().any(|m| m.to_lowercase().contains("layout")), "{}", messages[0]);
    Ok(())
}
