//! The error of one image against another, on the device and by the library.
use anyhow::{Context, Result, bail, ensure};
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, Image, ImageUse};
use magpie::graph::{
    Access, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, ImageDesc, ImageState, MipCopy, Queue, Record,
};
use magpie::pixels::Pixels;
use magpie_accuracy::metrics::{self, Map, Picture};
use magpie_passes::metrics::{Errors, Metrics, MetricsIn};
use magpie_tests::bench::{Bench, Ran, Shared, results};
use magpie_tests::harness::{builtin, compare_with_golden, config, gpu, linear, render};
use std::sync::Arc;

/// Greatest relative difference; the library's sums are in double precision.
const CLOSE: f64 = 1e-5;

/// Uploads an image into a frame.
fn upload(
    gpu: &Gpu,
    g: &mut FrameGraph,
    imports: &Shared,
    name: &str,
    pixels: &Pixels,
) -> Result<Handle<magpie::graph::Image>> {
    let usage = ImageUse { sampled: true, ..Default::default() };
    let image = Arc::new(Image::new(gpu, name, pixels.format, pixels.extent, 1, usage)?);
    let bytes = pixels.bytes.len() as u64;
    let mut staging = Buffer::new(gpu, name, bytes, BufferMemory::Upload, BufferUse::Storage)?;
    staging.write(0, &pixels.bytes)?;
    let (from, to) = {
        let mut imports = imports.borrow_mut();
        (imports.buffer(&Arc::new(staging)), imports.image(&image))
    };
    let from = g.import_buffer(name, BufferDesc::new(bytes), Access::CopyRead, from).read();
    let to = g.import_image(name, ImageDesc::fixed(pixels.format, pixels.extent), ImageState::UNDEFINED, to);
    Ok(g.pass(&format!("test.upload_{name}"), Queue::Transfer, |p| {
        let from = p.copy_from(from);
        let (to, into) = p.copy_to(to);
        (to.read(), move |c: &mut Record<'_>| c.copy_to_image(from, into, &[MipCopy { offset: 0, mip: 0 }]))
    }))
}

/// Runs both passes on two uploaded images.
fn measure(bench: &mut Bench, test: &Pixels, reference: &Pixels) -> Result<(Ran, Errors)> {
    let gpu = bench.gpu.clone();
    let effect = Metrics::new(&gpu)?;
    let mut read = None;
    let ran = bench.run(reference.extent, &["metrics.error:error"], |g, imports| {
        let test = upload(&gpu, g, imports, "test", test)?;
        let reference = upload(&gpu, g, imports, "reference", reference)?;
        let out = effect.declare(g, MetricsIn { test, reference });
        let (target, buffer) = results(&gpu, g, imports, "errors", 12)?;
        let target = g.pass("test.copy", Queue::Transfer, |p| {
            let from = p.copy_from(out.errors);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, 12))
        });
        g.leave(target.read(), Access::HostRead, Domain::Copy);
        read = Some(buffer);
        Ok(())
    })?;
    let Some(read) = read else { bail!("nothing was declared") };
    let errors = Errors::read(read.contents()).context("too few bytes")?;
    Ok((ran, errors))
}

/// Compares both passes with the library: every pixel, and the total.
fn agree(bench: &mut Bench, test: &Pixels, reference: &Pixels) -> Result<Ran> {
    let (ran, errors) = measure(bench, test, reference)?;
    let ran = ran.clean()?;
    let (a, b) = (Picture::from_pixels(test)?, Picture::from_pixels(reference)?);
    let near = |got: f32, wanted: f64| (f64::from(got) - wanted).abs() <= CLOSE * wanted;
    let [mse, relmse, smape] = [metrics::mse(&a, &b)?, metrics::relmse(&a, &b)?, metrics::smape(&a, &b)?];
    ensure!(mse > 0.0 && relmse > 0.0 && smape > 0.0, "nothing differs");
    println!("mse {} {mse}, relmse {} {relmse}, smape {} {smape}", errors.mse, errors.relmse, errors.smape);
    ensure!(near(errors.mse, mse), "mse {}, wanted {mse}", errors.mse);
    ensure!(near(errors.relmse, relmse), "relmse {}, wanted {relmse}", errors.relmse);
    ensure!(near(errors.smape, smape), "smape {}, wanted {smape}", errors.smape);
    ensure!(near(errors.rmse(), metrics::rmse(&a, &b)?), "rmse {}", errors.rmse());
    let psnr = metrics::psnr(&a, &b, 2.0)?;
    ensure!((f64::from(errors.psnr(2.0)) - psnr).abs() < 1e-4, "psnr {}, wanted {psnr}", errors.psnr(2.0));

    let image = ran.image("metrics.error:error")?;
    ensure!((image.extent, image.format) == (reference.extent, Format::Rgba32Float), "{:?}", image.extent);
    let maps = [metrics::squared_error_map(&a, &b)?, metrics::relmse_map(&a, &b)?, metrics::smape_map(&a, &b)?];
    for (at, pixel) in image.values().iter().enumerate() {
        for (Map { values, .. }, &got) in maps.iter().zip(pixel) {
            ensure!(near(got, f64::from(values[at])), "pixel {at}: {got}, wanted {}", values[at]);
        }
        ensure!(pixel[3] == 1.0, "pixel {at}: {}", pixel[3]);
    }
    Ok(ran)
}

fn floats(extent: Extent, format: Format, value: impl Fn(u32) -> f32) -> Pixels {
    let count = extent.width * extent.height * format.channels();
    Pixels { extent, format, bytes: (0..count).flat_map(|i| value(i).to_le_bytes()).collect() }
}

/// Pseudo-random from -1 to 1 by number.
fn noise(i: u32) -> f32 {
    (i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995).wrapping_mul(0x85eb_ca6b) as f32 / 2.0_f32.powi(31) - 1.0
}

#[test]
fn metrics_of_the_courtyard_are_those_of_the_library() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let radiance = |changes: &[&str]| {
        linear(render(&gpu, &scene, &config(changes)?, super::SIZE, 1, Some(("direct.shade", "radiance")))?)
    };
    let (test, reference) =
        (radiance(&["stages.shadows=off"])?, radiance(&["shadows.edges=hard", "shadows.most_lights=1"])?);
    let mut bench = Bench::new(&gpu)?;
    let ran = agree(&mut bench, &test, &reference)?;
    // Only shadowed pixels differ; a value of 0 has the greatest symmetric error.
    let error = ran.image("metrics.error:error")?;
    let values = error.values();
    let dark = values.iter().filter(|v| v[2] > 0.9).count() * 10 / values.len();
    let equal = values.iter().filter(|v| v[..3] == [0.0; 3]).count() * 10 / values.len();
    ensure!((1..9).contains(&dark) && (1..9).contains(&equal), "{dark} tenths differ, {equal} tenths are equal");
    compare_with_golden("metrics", error, super::LIMIT)
}

#[test]
fn metrics_of_every_kind_of_image_are_those_of_the_library() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let extent = Extent::new(37, 11); // no multiple of a tile
    let reference = floats(extent, Format::Rgba32Float, |i| 3.0 + 2.0 * noise(i));
    let test = floats(extent, Format::Rgba32Float, |i| 3.0 + 2.0 * noise(i) + 0.3 * noise(i + 9999));
    agree(&mut bench, &test, &reference)?;
    // Negative, far above one, and zero in the reference.
    let wide = |seed| move |i: u32| if i % 7 == seed { 0.0 } else { 1e3 * noise(i + seed) };
    let (a, b) = (floats(extent, Format::Rgba32Float, wide(1)), floats(extent, Format::Rgba32Float, wide(2)));
    agree(&mut bench, &a, &b)?;
    // A single channel is read as grey and compared with all three of a colour image.
    let grey = floats(extent, Format::R32Float, |i| noise(i).abs());
    agree(&mut bench, &grey, &floats(extent, Format::R32Float, |i| noise(i + 1).abs()))?;
    agree(&mut bench, &reference, &grey)?;
    // Display values are sRGB-decoded. 0 is avoided, as the precision of a power function is relative to its result.
    let display = |seed: u32| {
        let bytes = (0..37 * 11 * 4).map(|i| 128 + (noise(i + seed) * 127.0) as u8 / 2).collect();
        Pixels { extent, format: Format::Rgba8Unorm, bytes }
    };
    let (a, b) = (display(1), display(77));
    agree(&mut bench, &a, &b)?;
    // The display image is uploaded later: under validation every pass may see every texture, so the scan covers a float image too.
    agree(&mut bench, &reference, &b)?;
    Ok(())
}

#[test]
fn metrics_of_many_tiles_lose_nothing_and_are_the_same_twice() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    // More tiles than threads of the second pass, and one pixel with nearly all of the error.
    let extent = Extent::new(611, 405);
    let test = floats(extent, Format::Rgba32Float, |i| if i == 90_001 { 300.0 } else { 1.0 + 0.1 * noise(i) });
    let reference = floats(extent, Format::Rgba32Float, |_| 1.0);
    agree(&mut bench, &test, &reference)?;
    let (_, first) = measure(&mut bench, &test, &reference)?;
    let (_, second) = measure(&mut bench, &test, &reference)?;
    ensure!(first == second, "{first:?} and {second:?}");
    let (ran, equal) = measure(&mut bench, &test, &test)?;
    ran.clean()?;
    ensure!(equal == Errors { mse: 0.0, relmse: 0.0, smape: 0.0 }, "{equal:?}");
    Ok(())
}

#[test]
fn metrics_let_a_nan_through() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let extent = Extent::new(70, 30);
    let good = floats(extent, Format::Rgba32Float, |_| 0.5);
    let at = |x: u32, y: u32, channel: u32| (y * 70 + x) * 4 + channel;
    let broken = floats(extent, Format::Rgba32Float, |i| if i == at(41, 17, 1) { f32::NAN } else { 0.25 });
    for (test, reference) in [(&broken, &good), (&good, &broken)] {
        let (ran, errors) = measure(&mut bench, test, reference)?;
        ensure!(errors.mse.is_nan() && errors.relmse.is_nan() && errors.smape.is_nan(), "{errors:?}");
        for (i, pixel) in ran.values("metrics.error:error")?.iter().enumerate() {
            let wanted = i == 17 * 70 + 41;
            ensure!(pixel[..3].iter().all(|x| x.is_nan() == wanted), "pixel {i}: {pixel:?}");
        }
        let found: Vec<String> = ran.findings.iter().map(ToString::to_string).collect();
        for output in ["metrics.error:error", "metrics.error:tiles", "metrics.sum:errors"] {
            ensure!(found.iter().any(|finding| finding.contains(output)), "{output} is not in {found:?}");
        }
    }
    Ok(())
}

#[test]
fn metrics_of_two_sizes_are_no_number() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let image = |width, height| floats(Extent::new(width, height), Format::Rgba32Float, |_| 0.5);
    for (test, reference) in [(image(20, 20), image(24, 20)), (image(24, 20), image(24, 19))] {
        let (_, errors) = measure(&mut bench, &test, &reference)?;
        ensure!(errors.mse.is_nan() && errors.relmse.is_nan() && errors.smape.is_nan(), "{errors:?}");
    }
    Ok(())
}

#[test]
fn metrics_add_the_same_constants_as_the_library() {
    use magpie_shaders::metrics::{METRICS_GROUP, RELMSE_EPSILON, SMAPE_EPSILON, TILE_HEIGHT, TILE_WIDTH};
    let same = |shader: f32, library: f64| (f64::from(shader) / library - 1.0).abs() < 1e-7;
    assert!(same(RELMSE_EPSILON, metrics::RELMSE_EPSILON) && same(SMAPE_EPSILON, metrics::SMAPE_EPSILON));
    assert_eq!(TILE_WIDTH * TILE_HEIGHT, METRICS_GROUP);
}
