//! Image pyramids against the CPU, in sizes that are no powers of two, and in as many passes as there are groups of four levels.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::Build;
use magpie_passes::parts::pyramid::{Content, Pyramid};
use magpie_shaders::{SampledImage, StorageImage};
use magpie_tests::bench::Bench;
use magpie_tests::harness::gpu;

const SIZES: [[u32; 2]; 4] = [[75, 43], [64, 32], [1, 1], [161, 3]];

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    source: SampledImage,
    target: StorageImage,
    size: [u32; 2],
    mip: i32,
}

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uvec2 size; int mip; };
"#;
/// Multiples of 1/64, so that sums of four are exact.
const FILL: &str = "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); \
    if (inside(p, size)) store(to, p, vec4(float((p.x * 73 + p.y * 179) % 257) / 64.0, float(p.x % 7), float(p.y), 1.0)); }";
const SHOW: &str = "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); \
    if (inside(p, size)) store(to, p, load_mip(from, p, mip)); }";

fn filled(x: u32, y: u32) -> [f32; 4] {
    [((x * 73 + y * 179) % 257) as f32 / 64.0, (x % 7) as f32, y as f32, 1.0]
}

/// One level on the CPU: each pixel from four below, those outside taken from the border.
fn reduced(below: &[[f32; 4]], size: [u32; 2], extent: [u32; 2], content: Content) -> Vec<[f32; 4]> {
    let at = |x: u32, y: u32| below[(y.min(size[1] - 1) * size[0] + x.min(size[0] - 1)) as usize];
    let one = |x: u32, y: u32| {
        let four = [at(2 * x, 2 * y), at(2 * x + 1, 2 * y), at(2 * x, 2 * y + 1), at(2 * x + 1, 2 * y + 1)];
        match content {
            Content::MinMax => {
                let least = four.iter().map(|v| v[0]).fold(f32::INFINITY, f32::min);
                [least, four.iter().map(|v| v[1]).fold(f32::NEG_INFINITY, f32::max), 0.0, 1.0]
            }
            Content::Mean => [0, 1, 2, 3].map(|c| four.iter().map(|v| v[c]).sum::<f32>() / 4.0),
        }
    };
    (0..extent[1]).flat_map(|y| (0..extent[0]).map(move |x| (x, y))).map(|(x, y)| one(x, y)).collect()
}

fn pass(
    g: &mut FrameGraph,
    name: &str,
    kernel: Kernel,
    from: Option<Handle<Image>>,
    extent: Extent,
    mip: i32,
) -> Handle<Image> {
    g.pass(name, Queue::Graphics, |p| {
        let source = from.map(|image| p.sample(image));
        let (image, target) = p.create("image", ImageDesc::fixed(Format::Rgba32Float, extent));
        (image.read(), move |c: &mut Record<'_>| {
            let source = source.map_or(SampledImage::default(), |token| c.id(token));
            let params = Params { source, target: c.id(target), size: [extent.width, extent.height], mip };
            c.dispatch(kernel, &params, extent);
        })
    })
}

#[test]
fn levels_are_what_the_cpu_makes_of_them() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let fill = bench.kernel("fill.comp", &format!("{HEAD}{FILL}"))?;
    let show = bench.kernel("show.comp", &format!("{HEAD}{SHOW}"))?;
    let build = Build::new(&gpu, Rays::Software);
    for [width, height] in SIZES {
        for (content, levels) in [(Content::MinMax, 6), (Content::Mean, 5), (Content::MinMax, 1)] {
            let pyramid = Pyramid::new(&build, "test", content)?;
            let full = Extent::new(width, height);
            let first = Pyramid::extent(full, levels);
            let names: Vec<String> = (0..levels).map(|mip| format!("test.show_{mip}:image")).collect();
            let wanted: Vec<&str> = names.iter().map(String::as_str).collect();
            let ran = bench.run(full, &wanted, |g, _| {
                let source = pass(g, "test.fill", fill, None, full, 0);
                let made = pyramid.add(g, source, levels);
                for mip in 0..levels {
                    let shown = pass(g, &format!("test.show_{mip}"), show, Some(made), first.mip(mip), mip as i32);
                    g.output(shown);
                }
                Ok(())
            })?;
            let ran = ran.clean()?;
            let mut below: Vec<[f32; 4]> = (0..height).flat_map(|y| (0..width).map(move |x| filled(x, y))).collect();
            if content == Content::MinMax {
                below.iter_mut().for_each(|v| v[1] = v[0]);
            }
            let mut size = [width, height];
            for (mip, name) in (0..levels).zip(&names) {
                let extent = [first.mip(mip).width, first.mip(mip).height];
                let wanted = reduced(&below, size, extent, content);
                let found = ran.values(name)?;
                ensure!(found.len() == wanted.len(), "{width}x{height}, level {mip}: {} pixels", found.len());
                for (at, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
                    // Means are kept in 16 bits.
                    let off =
                        (0..4).map(|c| (found[c] - wanted[c]).abs() / wanted[c].abs().max(1.0)).fold(0.0, f32::max);
                    let most = if content == Content::Mean { 2e-3 } else { 0.0 };
                    ensure!(
                        off <= most,
                        "{width}x{height}, {content:?} {mip}, pixel {at}: {found:?}, wanted {wanted:?}"
                    );
                }
                (below, size) = (wanted, extent);
            }
        }
    }
    Ok(())
}
