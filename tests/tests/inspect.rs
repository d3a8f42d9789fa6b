//! Looking into images: `inspect.map` shows every format as the CPU says, marks what is not finite, and `inspect.measure` finds the values;
//! a renderer looks into an image while it is the newest version, and frames without it go on.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::{Gpu, ImageUse, Staging};
use magpie::graph::{Access, Domain, ImageState, MipCopy, Part};
use magpie::pixels::Pixels;
use magpie::prelude::*;
use magpie::slot::Build;
use magpie_passes::parts::inspect::{Channel, Colours, Inspected, Inspection, Inspector, Look, Pick};
use magpie_shaders::StorageImage;
use magpie_tests::bench::{Bench, results};
use magpie_tests::harness::gpu;
use std::sync::Arc;

#[path = "inspect/frames.rs"]
mod frames;

const FORMATS: [Format; 18] = [
    Format::R8Unorm,
    Format::Rg8Unorm,
    Format::Rgba8Unorm,
    Format::Rgba8Srgb,
    Format::R16Unorm,
    Format::Rg16Unorm,
    Format::Rgba16Unorm,
    Format::Rg16Snorm,
    Format::Rgba16Snorm,
    Format::R16Float,
    Format::Rg16Float,
    Format::Rgba16Float,
    Format::R32Float,
    Format::Rg32Float,
    Format::Rgba32Float,
    Format::R32Uint,
    Format::Rg32Uint,
    Format::D32Float,
];
const SIZE: Extent = Extent { width: 7, height: 5 };
/// Every pixel becomes three by three.
const PICTURE: Extent = Extent { width: 21, height: 15 };
const BESIDE: [u8; 4] = [24, 24, 24, 255];

/// Shows pixels of any format in a frame.
struct Shower {
    bench: Bench,
    inspector: Inspector,
}

impl Shower {
    fn new(gpu: &Gpu) -> Result<Self> {
        let inspector = Inspector::new(gpu, &Build::new(gpu, Rays::Software))?;
        Ok(Self { bench: Bench::new(gpu)?, inspector })
    }

    fn show(&mut self, pixels: &Pixels, inspection: &Inspection, picture: Extent) -> Result<(Vec<[u8; 4]>, Inspected)> {
        let gpu = self.bench.gpu.clone();
        let usage = ImageUse { sampled: true, attachment: pixels.format.is_depth(), ..ImageUse::default() };
        let image = Arc::new(magpie::gpu::Image::new(&gpu, "image", pixels.format, pixels.extent, 1, usage)?);
        let mut staging = Staging::new(&gpu, "pixels");
        let source = staging.write(&pixels.bytes)?.clone();
        let inspector = &self.inspector;
        let mut shown = None;
        self.bench.run(picture, &[], |g, imports| {
            let (desc, bytes) = (ImageDesc::fixed(pixels.format, pixels.extent), pixels.bytes.len() as u64);
            let image = g.import_image("image", desc, ImageState::UNDEFINED, imports.borrow_mut().image(&image));
            let key = imports.borrow_mut().buffer(&source);
            let source = g.import_buffer("pixels", BufferDesc::new(bytes), Access::CopyRead, key);
            let image = g.pass("test.upload", Queue::Graphics, |p| {
                let from = p.copy_from(source.read());
                let (image, to) = p.copy_to(image);
                (image, move |c: &mut Record<'_>| c.copy_to_image(from, to, &[MipCopy { offset: 0, mip: 0 }]))
            });
            g.leave(image.read(), Access::Sample, Domain::Compute);
            let made = inspector.add(g, &mut imports.borrow_mut(), image.read(), inspection, picture)?;
            let bytes = 4 * u64::from(picture.width * picture.height);
            let (target, buffer) = results(&gpu, g, imports, "shown", bytes)?;
            let image = made.image;
            let target = g.pass("test.shown", Queue::Transfer, |p| {
                let from = p.copy_from(image);
                let (target, to) = p.copy_to(target);
                (target, move |c: &mut Record<'_>| c.copy_from_image(from, to, MipCopy { offset: 0, mip: 0 }))
            });
            g.leave(target.read(), Access::HostRead, Domain::Copy);
            shown = Some((made, buffer));
            Ok(())
        })?;
        let (inspecting, buffer) = shown.context("nothing was declared")?;
        Ok((buffer.contents().as_chunks().0.to_vec(), inspecting.finish()))
    }
}

/// Pixels of a format with numbers of every size that it has, all finite.
fn pixels(format: Format, extent: Extent) -> Pixels {
    let mut state = 1_u32;
    let mut word = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    };
    let count = (extent.width * extent.height * format.channels()) as usize;
    let bytes_each = (format.bytes_per_pixel() / format.channels()) as usize;
    let mut bytes = Vec::new();
    for at in 0..count {
        let number = (word() % 4001) as f32 / 1000.0 - 2.0;
        match (format.is_float(), bytes_each) {
            (true, 4) if format.is_depth() => bytes.extend_from_slice(&(number.abs() / 2.0).to_le_bytes()),
            (true, 4) => bytes.extend_from_slice(&number.to_le_bytes()),
            // 0.5 to 1, of either sign.
            (true, _) => bytes.extend_from_slice(&(((word() & 0x83ff) | 0x3800) as u16).to_le_bytes()),
            (false, 4) => bytes.extend_from_slice(&[0, 1, 7, u32::MAX, word()][at % 5].to_le_bytes()),
            (false, size) => bytes.extend_from_slice(&word().to_le_bytes()[..size]),
        }
    }
    Pixels { extent, format, bytes }
}

/// Bits of each channel as shaders see them.
fn bits(pixels: &Pixels) -> Vec<[u32; 4]> {
    if !pixels.format.is_uint() {
        return pixels.values().into_iter().map(|v| v.map(f32::to_bits)).collect();
    }
    let size = pixels.format.bytes_per_pixel() as usize;
    let words = |pixel: &[u8]| {
        let mut bits = [0, 0, 0, 1];
        for (word, bytes) in bits.iter_mut().zip(pixel.as_chunks().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        bits
    };
    pixels.bytes.chunks_exact(size).map(words).collect()
}

const VIRIDIS: [[f64; 3]; 9] = [
    [68.0, 1.0, 84.0],
    [71.0, 45.0, 123.0],
    [59.0, 82.0, 139.0],
    [44.0, 114.0, 142.0],
    [33.0, 145.0, 140.0],
    [40.0, 174.0, 128.0],
    [94.0, 201.0, 98.0],
    [173.0, 220.0, 48.0],
    [253.0, 231.0, 37.0],
];
const DIVERGING: [[f64; 3]; 3] = [[59.0, 76.0, 192.0], [221.0; 3], [180.0, 4.0, 38.0]];

/// A colour between those of a table, 0 to 255.
fn between(table: &[[f64; 3]], x: f64) -> [f64; 3] {
    let at = x * (table.len() - 1) as f64;
    let below = (at as usize).min(table.len() - 2);
    [0, 1, 2].map(|c| table[below][c] + (table[below + 1][c] - table[below][c]) * (at - below as f64))
}

/// `hash4` of `lib/random.glsl`.
fn hash4(v: [u32; 4]) -> [u32; 4] {
    let mut v = v.map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let round = |v: &mut [u32; 4]| {
        for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    round(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    round(&mut v);
    v
}

fn srgb(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The channels that are shown.
fn shown(channel: Channel, format: Format) -> Vec<usize> {
    let most = format.channels() as usize;
    let all = match channel {
        Channel::Rgb | Channel::Luminance | Channel::Length => 0..3,
        Channel::Red => 0..1,
        Channel::Green => 1..2,
        Channel::Blue => 2..3,
        Channel::Alpha => 3..4,
    };
    all.filter(|channel| *channel < most).collect()
}

/// What a finite pixel looks like, 0 to 255 for each colour.
fn looks(bits: [u32; 4], format: Format, look: &Look) -> [f64; 3] {
    let value =
        bits.map(|bits| if format.is_uint() { f64::from(bits as f32) } else { f64::from(f32::from_bits(bits)) });
    let gain = f64::from(look.exposure).exp2();
    let [low, high] = look.range.map(f64::from);
    let in_range = |x: f64| ((x * gain - low) / (high - low)).clamp(0.0, 1.0);
    let number = match look.channel {
        Channel::Length => value[..3].iter().map(|x| x * x).sum::<f64>().sqrt(),
        Channel::Rgb | Channel::Luminance if format.channels() < 3 => value[0],
        Channel::Rgb | Channel::Luminance => 0.2126 * value[0] + 0.7152 * value[1] + 0.0722 * value[2],
        Channel::Red => value[0],
        Channel::Green => value[1],
        Channel::Blue => value[2],
        Channel::Alpha => value[3],
    };
    match look.colours {
        Colours::False => between(&VIRIDIS, in_range(number)),
        Colours::Signed => between(&DIVERGING, in_range(number)),
        Colours::Distinct => {
            let mut key = [0; 4];
            shown(look.channel, format).into_iter().for_each(|channel| key[channel] = bits[channel]);
            let hash = hash4(key);
            if key == [0; 4] { [0.0; 3] } else { [0, 1, 2].map(|c| 51.0 + 0.8 * f64::from(hash[c] >> 24)) }
        }
        Colours::Plain => {
            let colour = match (look.channel, format.channels()) {
                (Channel::Rgb, 2) => [in_range(value[0]), in_range(value[1]), 0.0],
                (Channel::Rgb, 3..) => [value[0], value[1], value[2]].map(in_range),
                _ => [in_range(number); 3],
            };
            colour.map(|x| 255.0 * if look.encodes { srgb(x) } else { x })
        }
    }
}

/// Compares an image that is shown in three times its size. Results may be off by rounding: `look.range` must not be so narrow that floats of
/// 32 bits show more than that.
fn compare(found: &[[u8; 4]], pixels: &Pixels, look: &Look, what: &str) -> Result<()> {
    let bits = bits(pixels);
    for y in 0..PICTURE.height {
        for x in 0..PICTURE.width {
            let wanted = looks(bits[(y / 3 * SIZE.width + x / 3) as usize], pixels.format, look);
            let colour = found[(y * PICTURE.width + x) as usize];
            let off = (0..3).map(|c| (f64::from(colour[c]) - wanted[c]).abs()).fold(0.0, f64::max);
            ensure!(off < 0.6 && colour[3] == 255, "{what}, {x} {y}: {colour:?}, wanted {wanted:?}");
        }
    }
    Ok(())
}

fn inspection(look: Look) -> Inspection {
    Inspection { look, ..Inspection::of("test.upload", "image", None) }
}

#[test]
fn every_format_shows_its_values() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut shower = Shower::new(&gpu)?;
    for format in FORMATS {
        let pixels = pixels(format, SIZE);
        let bits = bits(&pixels);
        for (range, colours, encodes) in [
            ([0.0, 1.0], Colours::Plain, true),
            ([-2.0, 2.0], Colours::Plain, false),
            ([0.0, 1.0], Colours::Distinct, false),
        ] {
            let look = Look { range, colours, encodes, ..Look::default() };
            let at = [4, 3];
            let inspection = Inspection { pick: Some(Pick::Pixel(at)), ..inspection(look) };
            let (found, inspected) = shower.show(&pixels, &inspection, PICTURE)?;
            // The driver decides how normalised numbers are rounded, which is seen in their last bit.
            if colours != Colours::Distinct || format.is_uint() || format.is_float() {
                compare(&found, &pixels, &look, &format!("{format:?} {look:?}"))?;
            }
            let channels = format.channels() as usize;
            let number = |bits: u32| if format.is_uint() { f64::from(bits) } else { f32::from_bits(bits).into() };
            // Drivers may decode sRGB by tables, whose steps are seen where it is encoded.
            let near = |a: f64, b: f64| match format {
                Format::Rgba8Srgb => (srgb(a) - srgb(b)).abs() < 0.5 / 255.0,
                _ if format.is_uint() || format.is_float() => a == b,
                _ => (a - b).abs() < 1e-6,
            };
            let pixel = inspected.pixel.context("no pixel")?;
            let wanted = bits[(at[1] * SIZE.width + at[0]) as usize];
            for channel in 0..channels {
                let (found, wanted) = (number(pixel.bits[channel]), number(wanted[channel]));
                ensure!(near(found, wanted), "{format:?}, channel {channel}: {found}, wanted {wanted}");
                let values = || bits.iter().map(|bits| number(bits[channel]));
                let wanted = [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)];
                let range = inspected.ranges[channel].with_context(|| format!("{format:?}: no values"))?;
                ensure!(near(range[0], wanted[0]) && near(range[1], wanted[1]), "{format:?}: {range:?}, {wanted:?}");
            }
            ensure!(pixel.at == at && inspected.ranges.len() == channels, "{format:?}: {inspected:?}");
            ensure!([inspected.nan, inspected.above, inspected.below] == [0; 3], "{format:?}: {inspected:?}");
            ensure!((inspected.format, inspected.extent) == (format, SIZE), "{format:?}: {inspected:?}");
        }
    }
    Ok(())
}

#[test]
fn every_channel_gets_its_colours() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut shower = Shower::new(&gpu)?;
    for format in [Format::Rgba32Float, Format::Rg32Float, Format::Rgba16Float, Format::Rg32Uint] {
        let pixels = pixels(format, SIZE);
        let mut pictures = Vec::new();
        for channel in Channel::ALL.into_iter().filter(|channel| channel.is_of(format)) {
            for colours in Colours::ALL {
                let (exposure, range) = if format.is_uint() { (-8.0, [0.0, 65536.0]) } else { (1.0, [-1.5, 2.5]) };
                let look = Look { exposure, channel, range, colours, encodes: false };
                let (found, _) = shower.show(&pixels, &inspection(look), PICTURE)?;
                compare(&found, &pixels, &look, &format!("{format:?} {look:?}"))?;
                pictures.push(found);
            }
        }
        // Of two channels the number of `rgb` is that of `r`, so these look alike in three ways.
        let count = pictures.len();
        pictures.sort_unstable();
        pictures.dedup();
        let alike = if format.channels() == 2 { 2 } else { 3 };
        ensure!(count - pictures.len() <= alike + 1, "{format:?}: {} of {count} differ", pictures.len());
    }
    Ok(())
}

#[test]
fn what_is_not_finite_is_marked_and_counted() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut shower = Shower::new(&gpu)?;
    let (magenta, black) = ([255, 0, 255, 255], [0, 0, 0, 255]);
    let marks = [black, [255, 255, 0, 255], [0, 255, 255, 255]];
    for format in [Format::R16Float, Format::Rgba16Float, Format::R32Float, Format::Rgba32Float] {
        let extent = Extent::new(4, 2);
        let mut pixels = Pixels { bytes: vec![0; (8 * format.bytes_per_pixel()) as usize], extent, format };
        let (size, channels) = (format.bytes_per_pixel() as usize, format.channels() as usize);
        let each = size / channels;
        let mut set = |pixel: usize, channel: usize, value: f32| {
            let at = pixel * size + channel * each;
            // A half has the sign, five bits of the exponent and ten of the mantissa of a float.
            let half =
                (value.to_bits() >> 16 & 0x8000) | (value.to_bits() >> 13 & 0x7c00) | (value.to_bits() >> 13 & 0x3ff);
            let bytes = if each == 2 { half.to_le_bytes() } else { value.to_bits().to_le_bytes() };
            pixels.bytes[at..at + each].copy_from_slice(&bytes[..each]);
        };
        let last = channels - 1;
        set(0, 0, f32::NAN);
        set(1, 0, f32::INFINITY);
        set(2, 0, f32::NEG_INFINITY);
        set(3, 0, -f32::NAN);
        set(5, last, f32::NAN); // in alpha, where there is one
        let picture = Extent::new(32, 16);
        for colours in Colours::ALL {
            let look = Look { colours, range: [-1.0, 1.0], ..Look::default() };
            let inspection = Inspection { pick: Some(Pick::Pixel([2, 0])), ..inspection(look) };
            let (found, inspected) = shower.show(&pixels, &inspection, picture)?;
            let at = |x: u32, y: u32| found[(y * picture.width + x) as usize];
            // Every pixel is eight by eight, with squares of four.
            let marked = |pixel: u32| {
                let (x, y) = (pixel % 4 * 8, pixel / 4 * 8);
                (at(x, y) == magenta && at(x + 7, y + 7) == magenta && at(x + 4, y) == at(x + 3, y + 7))
                    .then(|| at(x + 4, y))
            };
            let wanted = [Some(marks[0]), Some(marks[1]), Some(marks[2]), Some(marks[0]), None];
            for (pixel, wanted) in (0..).zip(wanted) {
                ensure!(marked(pixel) == wanted, "{format:?} {colours:?}, {pixel}: {:?}", marked(pixel));
            }
            ensure!(marked(5) == (channels == 1).then_some(marks[0]), "{format:?} {colours:?}: {:?}", marked(5));
            ensure!([inspected.nan, inspected.above, inspected.below] == [3, 1, 1], "{format:?}: {inspected:?}");
            ensure!(inspected.ranges[0] == Some([0.0; 2]), "{format:?}: {inspected:?}");
            let seen = f32::from_bits(inspected.pixel.context("no pixel")?.bits[0]);
            ensure!(seen == f32::NEG_INFINITY, "{format:?}: {seen}");
            if channels == 4 {
                let alpha = Inspection { look: Look { channel: Channel::Alpha, ..look }, ..inspection };
                let (found, _) = shower.show(&pixels, &alpha, picture)?;
                let at = |x: u32, y: u32| found[(y * picture.width + x) as usize];
                ensure!(at(0, 0) != magenta && at(8, 8) == magenta && at(12, 8) == black, "{format:?} {colours:?}");
            }
        }
    }
    // Nothing finite at all.
    let bytes = [f32::NAN, f32::INFINITY].map(f32::to_le_bytes).concat();
    let pixels = Pixels { extent: Extent::new(2, 1), format: Format::R32Float, bytes };
    let (_, inspected) = shower.show(&pixels, &inspection(Look::default()), PICTURE)?;
    ensure!(inspected.ranges == [None] && inspected.pixel.is_none(), "{inspected:?}");
    ensure!(Look::default().fitted(&inspected) == Look::default());
    Ok(())
}

/// The image keeps its shape in the picture, and the pixel under a place of it is the one that is shown there.
#[test]
fn places_of_the_picture_are_pixels_of_the_image() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut shower = Shower::new(&gpu)?;
    let look = Look { colours: Colours::Distinct, ..Look::default() };
    for (image, picture, zoom, centre, wanted) in [
        ([7, 5], [21, 15], 1.0, [0.5; 2], [0.0, 0.0, 21.0, 15.0]),
        // Half of an odd size fills it.
        ([11, 8], [21, 15], 1.0, [0.5; 2], [0.0, 0.0, 21.0, 15.0]),
        // A square is in the middle.
        ([8, 8], [24, 16], 1.0, [0.5; 2], [4.0, 0.0, 16.0, 16.0]),
        ([4, 16], [16, 16], 1.0, [0.9; 2], [6.0, 0.0, 4.0, 16.0]),
        ([64, 32], [16, 16], 1.0, [0.5; 2], [0.0, 4.0, 16.0, 8.0]),
        ([8, 8], [16, 16], 4.0, [0.5; 2], [-24.0, -24.0, 64.0, 64.0]),
        ([8, 8], [16, 16], 2.0, [0.0, 1.0], [0.0, -16.0, 32.0, 32.0]),
        ([8, 8], [24, 16], 1.25, [0.5; 2], [2.0, -2.0, 20.0, 20.0]),
    ] {
        let (image, picture) = (Extent::new(image[0], image[1]), Extent::new(picture[0], picture[1]));
        let numbered = (1..=image.width * image.height).flat_map(u32::to_le_bytes).collect();
        let pixels = Pixels { extent: image, format: Format::R32Uint, bytes: numbered };
        for (x, y) in [(0, 0), (picture.width / 2, picture.height / 3), (picture.width - 1, picture.height - 1)] {
            let under = [x, y].map(|at| at as f32 + 0.5);
            let under = [under[0] / picture.width as f32, under[1] / picture.height as f32];
            let inspection = Inspection { zoom, centre, pick: Some(Pick::Under(under)), ..inspection(look) };
            let (found, inspected) = shower.show(&pixels, &inspection, picture)?;
            ensure!(inspected.place == wanted, "{image} in {picture}: {:?}, wanted {wanted:?}", inspected.place);
            let colour = found[(y * picture.width + x) as usize];
            let Some(pixel) = inspected.pixel else {
                ensure!(colour == BESIDE, "{image} in {picture}, {x} {y}: {colour:?} beside it");
                continue;
            };
            let number = 1 + pixel.at[1] * image.width + pixel.at[0];
            ensure!(pixel.bits[0] == number, "{image} in {picture}, {x} {y}: {} at {:?}", pixel.bits[0], pixel.at);
            let wanted = looks([number, 0, 0, 1], Format::R32Uint, &look);
            let off = (0..3).map(|c| (f64::from(colour[c]) - wanted[c]).abs()).fold(0.0, f64::max);
            ensure!(off < 0.6, "{image} in {picture}, {x} {y}: {colour:?}, wanted {wanted:?} of {number}");
        }
    }
    Ok(())
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FillParams {
    target: StorageImage,
    value: f32,
}

const FILL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint target; float value; };
void main() { store(target, ivec2(gl_GlobalInvocationID.xy), vec4(value)); }
"#;

#[test]
fn mips_and_layers_are_told_apart() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut shower = Shower::new(&gpu)?;
    let fill = shower.bench.kernel("fill.comp", FILL)?;
    let desc = ImageDesc { mips: 3, layers: 2, ..ImageDesc::fixed(Format::R32Float, Extent::new(8, 8)) };
    for (mip, layer, wanted) in [(0, 0, 0.0), (2, 0, 2.0), (1, 1, 11.0), (9, 9, 12.0)] {
        let inspection = Inspection { mip, layer, pick: Some(Pick::Pixel([1, 1])), ..inspection(Look::default()) };
        let inspector = &shower.inspector;
        let mut inspecting = None;
        shower.bench.run(PICTURE, &[], |g, imports| {
            let mut image: Option<WriteHandle<Image>> = None;
            for (mip, layer) in [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)] {
                let part = Part { mips: 1, layers: 1, mip, layer };
                let extent = Extent::new(8, 8).mip(mip.into());
                image = Some(g.pass(&format!("test.fill_{mip}_{layer}"), Queue::Graphics, |p| {
                    let (image, target) = match image.take() {
                        None => p.create_part("image", desc, part),
                        Some(image) => p.write_part(image, part),
                    };
                    let value = f32::from(mip) + 10.0 * f32::from(layer);
                    (image, move |c: &mut Record<'_>| {
                        c.dispatch(fill, &FillParams { target: c.id(target), value }, extent);
                    })
                }));
            }
            let image = image.context("no image")?.read();
            inspecting = Some(inspector.add(g, &mut imports.borrow_mut(), image, &inspection, PICTURE)?);
            Ok(())
        })?;
        let found = inspecting.context("nothing was declared")?.finish();
        ensure!(found.ranges == [Some([wanted; 2])], "{mip} {layer}: {found:?}");
        ensure!((found.mip, found.layer) == (mip.min(2), layer.min(1)), "{found:?}");
        let side = 8 >> found.mip;
        ensure!((found.extent, found.mips, found.layers) == (Extent::new(side, side), 3, 2), "{found:?}");
        let value = found.pixel.map(|pixel| f64::from(f32::from_bits(pixel.bits[0])));
        ensure!(value == Some(wanted), "{mip} {layer}: {value:?}");
    }
    Ok(())
}

#[test]
fn ranges_are_fitted_to_what_is_shown() {
    let mut found = Inspected {
        pass: String::new(),
        output: String::new(),
        format: Format::Rgba32Float,
        extent: SIZE,
        mip: 0,
        layer: 0,
        mips: 1,
        layers: 1,
        place: [0.0; 4],
        picture: PICTURE,
        pixel: None,
        ranges: vec![Some([-3.0, 1.0]), Some([0.0, 4.0]), None, Some([0.5, 0.75])],
        nan: 0,
        above: 0,
        below: 0,
    };
    let fitted = |channel, colours, found: &Inspected| {
        let look = Look { channel, colours, exposure: 3.0, ..Look::default() }.fitted(found);
        assert_eq!((look.exposure, look.channel, look.colours), (0.0, channel, colours));
        look.range
    };
    assert_eq!(fitted(Channel::Rgb, Colours::Plain, &found), [-3.0, 4.0]);
    assert_eq!(fitted(Channel::Red, Colours::False, &found), [-3.0, 1.0]);
    assert_eq!(fitted(Channel::Red, Colours::Signed, &found), [-3.0, 3.0]);
    assert_eq!(fitted(Channel::Alpha, Colours::Plain, &found), [0.5, 0.75]);
    assert_eq!(fitted(Channel::Length, Colours::Plain, &found), [0.0, 5.0]);
    found.ranges = vec![None; 4];
    let look = Look { exposure: 3.0, ..Look::default() };
    assert_eq!(look.fitted(&found), look);
}

/// Formats are seen at once as they are best seen.
#[test]
fn looks_suit_their_formats() {
    for format in FORMATS {
        let look = Look::of(format);
        assert_eq!(look.colours == Colours::Distinct, format.is_uint(), "{format:?}");
        assert_eq!(look.range[0] < 0.0, matches!(format, Format::Rg16Snorm | Format::Rgba16Snorm), "{format:?}");
        assert!(!Look::wants_fit(format) || format.is_float(), "{format:?}");
        assert!(look.channel.is_of(format), "{format:?}");
    }
    assert!(Look::of(Format::Rgba16Float).encodes && !Look::of(Format::Rgba8Unorm).encodes);
}
