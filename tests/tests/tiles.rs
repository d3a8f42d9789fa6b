//! Lists of pixels: a pass that is dispatched over one touches the pixels with work and no others, each once, and no more than the limit.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::prelude::*;
use magpie::slot::Build;
use magpie_passes::parts::tiles::PixelLists;
use magpie_shaders::{Address, StorageImage};
use magpie_tests::bench::Bench;
use magpie_tests::harness::gpu;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    list: Address,
    target: StorageImage,
    size: [u32; 2],
    /// One pixel in so many has work; 0 for none.
    one_in: u32,
}

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/tiles.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uvec2 list; uint to; uvec2 size; uint one_in; };
"#;
const FILL: &str = "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); \
    bool work = one_in > 0u && uint(p.x * 7919 + p.y * 104729) % one_in == 0u; \
    if (inside(p, size)) store(to, p, vec4(work ? 0.25 : 0.0)); }";
const CLEAR: &str =
    "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); if (inside(p, size)) store(to, p, vec4(0.0)); }";
const MARK: &str = "void main() { ivec2 p = tile_pixel(list, gl_WorkGroupID.x, gl_LocalInvocationID.xy); if (inside(p, size)) store(to, p, vec4(1.0)); }";

#[test]
fn tiles_with_work_are_visited_and_no_others() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let [fill, clear, mark] = [("fill.comp", FILL), ("clear.comp", CLEAR), ("mark.comp", MARK)]
        .map(|(name, glsl)| bench.kernel(name, &format!("{HEAD}{glsl}")));
    let (fill, clear, mark) = (fill?, clear?, mark?);
    let tiles = Tiles::new(&Build::new(&gpu, Rays::Software), "test")?;
    for ([width, height], one_in) in [([75, 43], 500), ([64, 64], 100), ([75, 43], 0), ([9, 9], 1)] {
        let extent = Extent::new(width, height);
        let size = [width, height];
        let ran = bench.run(extent, &["test.mark:cleared"], |g, _| {
            let mut made =
                [("test.fill", "work", fill), ("test.clear", "cleared", clear)].map(|(name, output, kernel)| {
                    Some(g.pass(name, Queue::Graphics, |p| {
                        let (image, target) = p.create(output, ImageDesc::fixed(Format::R32Float, extent));
                        (image, move |c: &mut Record<'_>| {
                            let params = Params { list: Address::default(), target: c.id(target), size, one_in };
                            c.dispatch(kernel, &params, extent);
                        })
                    }))
                });
            let [Some(work), Some(cleared)] = made.each_mut().map(Option::take) else { return Ok(()) };
            let list = tiles.add(g, work.read());
            let marked = g.pass("test.mark", Queue::Graphics, |p| {
                let list = list.read(p);
                let (image, target) = p.write(cleared);
                (image.read(), move |c: &mut Record<'_>| {
                    let params = Params { list: c.id(list.list), target: c.id(target), size, one_in };
                    c.dispatch_indirect(mark, &params, list.groups, 0);
                })
            });
            g.output(marked);
            Ok(())
        })?;
        let ran = ran.clean()?;
        let has_work = |x: u32, y: u32| {
            one_in > 0 && x.wrapping_mul(7919).wrapping_add(y.wrapping_mul(104_729)).is_multiple_of(one_in)
        };
        let mut counts = [0; 2];
        for (at, value) in (0..).zip(ran.values("test.mark:cleared")?) {
            let (x, y) = (at % width, at / width);
            let columns = x / 8 * 8..(x / 8 * 8 + 8).min(width);
            let mut rows = y / 8 * 8..(y / 8 * 8 + 8).min(height);
            let wanted = rows.any(|y| columns.clone().any(|x| has_work(x, y)));
            ensure!(value[0] == f32::from(u8::from(wanted)), "{width}x{height}: pixel {x}, {y} is {}", value[0]);
            counts[usize::from(wanted)] += 1;
        }
        println!("{width}x{height}, one in {one_in}: {} pixels in tiles with work, {} in others", counts[1], counts[0]);
        ensure!(one_in != 500 || counts.iter().all(|n| *n > 500), "{counts:?}");
    }
    Ok(())
}
