//! Lists of pixels: a pass that is dispatched over one touches the pixels with work and no others, each once, and no more than the limit.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::prelude::*;
use magpie::slot::Build;
use magpie_passes::parts::pixel_lists::PixelLists;
use magpie_shaders::{Address, StorageImage};
use magpie_tests::bench::Bench;
use magpie_tests::harness::gpu;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    list: Address,
    target: StorageImage,
    size: [u32; 2],
    /// One pixel in so many has work, 0 for none.
    one_in: u32,
}

/// As [`Params`], with a second list.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PickParams {
    list: Address,
    unused: u32,
    picked: Address,
    one_in: u32,
}

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/pixel_list.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uvec2 list; uint to; uvec2 size; uint one_in; };
"#;
// Keys of eight bits: 0 where there is no work.
const KEYS: &str = "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); uint hash = uint(p.x * 7919 + p.y * 104729); \
    bool work = one_in > 0u && hash % one_in == 0u; \
    if (inside(p, size)) store(to, p, vec4(work ? float(1u + hash / 7u % 255u) / 255.0 : 0.0)); }";
const CLEAR: &str =
    "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); if (inside(p, size)) store(to, p, vec4(0.0)); }";
// The number of pixels in the list, at each of them.
const MARK: &str = "void main() { ivec2 p; if (listed_pixel(list, gl_GlobalInvocationID.xy, p)) \
    store(to, p, vec4(float(PixelList(list).count))); }";
// Of a list those in even columns.
const PICK: &str = "void main() { ivec2 p = ivec2(0); bool one = listed_pixel(list, gl_GlobalInvocationID.xy, p); \
    append_pixel(uvec2(size), p, one && p.x % 2 == 0); }";

/// Key of a pixel.
fn key([x, y]: [u32; 2], one_in: u32) -> u32 {
    let hash = x.wrapping_mul(7919).wrapping_add(y.wrapping_mul(104_729));
    if one_in > 0 && hash.is_multiple_of(one_in) { 1 + hash / 7 % 255 } else { 0 }
}

/// The greatest key up to which all pixels fit.
fn last_key(keys: &[u32], most: Option<u32>) -> u32 {
    let Some(most) = most else { return 255 };
    (1..=255)
        .take_while(|last| keys.iter().filter(|k| (1..=*last).contains(*k)).count() <= most as usize)
        .last()
        .unwrap_or(0)
}

#[test]
fn pixels_with_work_are_visited_once_and_no_others() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let [keys, clear, mark, pick] =
        [("keys.comp", KEYS), ("clear.comp", CLEAR), ("mark.comp", MARK), ("pick.comp", PICK)]
            .map(|(name, glsl)| bench.kernel(name, &format!("{HEAD}{glsl}")));
    let (keys, clear, mark, pick) = (keys?, clear?, mark?, pick?);
    let lists = PixelLists::new(&Build::new(&gpu, Rays::Software), "test")?;
    for (size, one_in, most) in [
        ([75, 43], 3, None),
        ([75, 43], 3, Some(500)),
        ([75, 43], 3, Some(0)),
        ([64, 64], 100, Some(10_000)),
        ([75, 43], 0, None),
        ([9, 9], 1, None),
        ([9, 9], 1, Some(40)),
    ] {
        let extent = Extent::new(size[0], size[1]);
        let ran = bench.run(extent, &["test.mark_all:marked", "test.mark_picked:marked"], |g, _| {
            let made = g.pass("test.keys", Queue::Graphics, |p| {
                let (image, target) = p.create("keys", ImageDesc::fixed(Format::R8Unorm, extent));
                (image.read(), move |c: &mut Record<'_>| {
                    let params = Params { list: Address::default(), target: c.id(target), size, one_in };
                    c.dispatch(keys, &params, extent);
                })
            });
            let all = lists.add(g, "all", made, most);
            let picked = lists.empty(g, "picked", extent);
            let picked = g.pass("test.pick", Queue::Graphics, |p| {
                let list = all.read(p);
                let (picked, target) = picked.fill(p);
                (picked, move |c: &mut Record<'_>| {
                    // The address of the second list takes the place of the size.
                    let params = PickParams { list: c.id(list.list), unused: 0, picked: c.id(target), one_in };
                    c.dispatch_indirect(pick, &params, list.threads, 0);
                })
            });
            for (name, list) in [("all", all), ("picked", picked)] {
                let cleared = g.pass(&format!("test.blank_{name}"), Queue::Graphics, |p| {
                    let (image, target) = p.create("marked", ImageDesc::fixed(Format::R32Float, extent));
                    (image, move |c: &mut Record<'_>| {
                        let params = Params { list: Address::default(), target: c.id(target), size, one_in };
                        c.dispatch(clear, &params, extent);
                    })
                });
                let marked = g.pass(&format!("test.mark_{name}"), Queue::Graphics, |p| {
                    let list = list.read(p);
                    let (image, target) = p.write(cleared);
                    (image.read(), move |c: &mut Record<'_>| {
                        let params = Params { list: c.id(list.list), target: c.id(target), size, one_in };
                        c.dispatch_indirect(mark, &params, list.threads, 0);
                    })
                });
                g.output(marked);
            }
            Ok(())
        })?;
        let ran = ran.clean()?;
        let places: Vec<[u32; 2]> = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| [x, y])).collect();
        let keys: Vec<u32> = places.iter().map(|p| key(*p, one_in)).collect();
        let last = last_key(&keys, most);
        for (name, columns) in [("all", 1), ("picked", 2)] {
            let is_wanted = |at: usize| keys[at] != 0 && keys[at] <= last && places[at][0].is_multiple_of(columns);
            let count = (0..keys.len()).filter(|at| is_wanted(*at)).count();
            // All are visited and the list has no more entries, so none is visited twice.
            for (at, value) in ran.values(&format!("test.mark_{name}:marked"))?.iter().enumerate() {
                let wanted = if is_wanted(at) { count as f32 } else { 0.0 };
                ensure!(
                    value[0] == wanted,
                    "{name}, {size:?}, {most:?}: pixel {:?} has {}, not {wanted}",
                    places[at],
                    value[0]
                );
            }
            println!("{name}: {size:?}, one in {one_in}, at most {most:?}: {count} pixels, keys up to {last}");
            ensure!(columns > 1 || most.is_none_or(|most| count <= most as usize), "{count}, not {most:?}");
        }
    }
    Ok(())
}
