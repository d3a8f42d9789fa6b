//! Device-side conditions, indirect dispatches and draws, and images that are read and written by parts, compared with the CPU under all
//! switches of the graph.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::{Blend, Buffer, BufferMemory, BufferUse, Cull, Gpu, Kernel, RasterDesc, RasterKernel};
use magpie::graph::execute::{ExecuteOptions, Executor};
use magpie::graph::{
    self, Access, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, Image, ImageDesc, IndirectDraws, MipCopy,
    Part, Queue, Record, Switches, WriteHandle,
};
use magpie_shaders::{Address, SampledImage, Shader, Stage, StorageImage};
use magpie_tests::bench::{Shared, results};
use magpie_tests::harness::gpu;
use std::sync::Arc;

const SWITCHES: [&str; 6] = ["", "serial", "no-alias", "no-reorder,no-cull", "no-cache", "queues=3"];

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };
"#;

/// Push constants of kernels over words: two addresses and a number.
#[repr(C)]
#[derive(Clone, Copy, Default, Pod, Zeroable)]
struct Over {
    from: Address,
    to: Address,
    count: u32,
}

/// Push constants of kernels over texels: two images, by either kind of id, and a size.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Texels {
    from: SampledImage,
    to: StorageImage,
    size: [u32; 2],
    extra: u32,
}

/// Runs frames under one set of switches.
struct Runner {
    gpu: Gpu,
    executor: Executor,
}

impl Runner {
    fn frame<T>(
        &mut self,
        extent: Extent,
        declare: impl FnOnce(&mut FrameGraph, &Shared, &Gpu) -> Result<T>,
    ) -> Result<T> {
        let imports = Shared::default();
        let mut g = self.executor.begin(extent);
        let declared = declare(&mut g, &imports, &self.gpu)?;
        self.executor.run(g, &imports.borrow())?;
        self.gpu.check_validation()?;
        Ok(declared)
    }

    fn compile(name: &str, glsl: &str, stage: Stage) -> Result<Vec<u32>> {
        Ok(magpie_shaders::compile(name, &format!("{HEAD}{glsl}"), stage)?)
    }

    fn kernel(&self, name: &str, glsl: &str) -> Result<Kernel> {
        Ok(self.gpu.kernel_from_words(name, &Self::compile(name, glsl, Stage::Compute)?)?)
    }
}

/// Runs a test under all switches, on one device.
fn under_all(test: impl Fn(&mut Runner) -> Result<()>) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for words in SWITCHES {
        let mut switches = Switches::default();
        for word in words.split(',').filter(|w| !w.is_empty()) {
            ensure!(switches.set(word), "{word}");
        }
        let executor = Executor::with(&gpu, ExecuteOptions { switches, ..Default::default() })?;
        test(&mut Runner { gpu: gpu.clone(), executor }).map_err(|e| e.context(format!("--graph {words:?}")))?;
    }
    Ok(())
}

/// A buffer with these words.
fn upload(gpu: &Gpu, words: &[u32], usage: BufferUse) -> Result<Arc<Buffer>> {
    let mut buffer = Buffer::new(gpu, "upload", words.len() as u64 * 4, BufferMemory::Upload, usage)?;
    buffer.write(0, bytemuck::cast_slice(words))?;
    Ok(Arc::new(buffer))
}

fn import(g: &mut FrameGraph, imports: &Shared, name: &str, buffer: &Arc<Buffer>) -> Handle<graph::Buffer> {
    let key = imports.borrow_mut().buffer(buffer);
    g.import_buffer(name, BufferDesc::new(buffer.bytes()), Access::BufferRead, key).read()
}

/// Reads back a buffer.
fn read_back(
    g: &mut FrameGraph,
    imports: &Shared,
    gpu: &Gpu,
    from: Handle<graph::Buffer>,
    bytes: u64,
) -> Result<Arc<Buffer>> {
    let (target, buffer) = results(gpu, g, imports, "test.bring", bytes)?;
    let target = g.pass("test.bring", Queue::Transfer, |p| {
        let from = p.copy_from(from);
        let (target, to) = p.copy_to(target);
        (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
    });
    g.leave(target.read(), Access::HostRead, Domain::Copy);
    Ok(buffer)
}

fn words_of(buffer: &Buffer) -> Vec<u32> {
    bytemuck::pod_collect_to_vec(buffer.contents())
}

/// Copies words into a device-local buffer, in place of a pass that computes them.
const DECIDE: &str = r#"
layout(local_size_x = 1) in;
layout(push_constant, scalar) uniform Push { uvec2 from; uvec2 to; uint count; };
void main() { for (uint i = 0u; i < count; ++i) Words(to).at[i] = Words(from).at[i]; }
"#;

const FILL: &str = r#"
layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { uvec2 from; uvec2 to; uint count; };
void main() { if (gl_GlobalInvocationID.x < count) Words(to).at[gl_GlobalInvocationID.x] = 7u; }
"#;

const NUMBER: &str = r#"
layout(local_size_x = 16) in;
layout(push_constant, scalar) uniform Push { uvec2 from; uvec2 to; uint count; };
void main() {
    uvec3 g = gl_NumWorkGroups;
    uint group = (gl_WorkGroupID.z * g.y + gl_WorkGroupID.y) * g.x + gl_WorkGroupID.x;
    uint i = group * 16u + gl_LocalInvocationID.x;
    if (i < count) Words(to).at[i] = 100u + i;
}
"#;

/// A pass that writes words which are known on the device only.
fn decide(g: &mut FrameGraph, kernel: Kernel, given: Handle<graph::Buffer>, count: u32) -> Handle<graph::Buffer> {
    g.pass("test.decide", Queue::AsyncCompute, |p| {
        let from = p.read(given);
        let (decided, to) = p.create_buffer("decided", BufferDesc::new(u64::from(count) * 4));
        (decided.read(), move |c: &mut Record<'_>| {
            c.dispatch_groups(kernel, &Over { from: c.id(from), to: c.id(to), count }, [1, 1, 1]);
        })
    })
}

#[test]
fn the_device_decides_how_much_is_dispatched() -> Result<()> {
    const COUNT: u32 = 200;
    under_all(|r| {
        let (decider, fill) = (r.kernel("decide.comp", DECIDE)?, r.kernel("fill.comp", FILL)?);
        let number = r.kernel("number.comp", NUMBER)?;
        for groups in [[0, 0, 0], [1, 1, 1], [5, 1, 1], [3, 2, 2], [5, 0, 1], [0, 4, 4], [4, 3, 0]] {
            // The middle one of three, with other words around it that must not matter.
            let all = [9, 9, 9, groups[0], groups[1], groups[2], 8, 8, 8];
            let given = upload(&r.gpu, &all, BufferUse::Storage)?;
            let seen = r.frame(Extent::new(1, 1), |g, imports, gpu| {
                let given = import(g, imports, "given", &given);
                let bytes = u64::from(COUNT) * 4;
                let filled = g.pass("test.fill", Queue::Graphics, |p| {
                    let (filled, to) = p.create_buffer("numbers", BufferDesc::new(bytes));
                    (filled, move |c: &mut Record<'_>| {
                        let params = Over { to: c.id(to), count: COUNT, ..Over::default() };
                        c.dispatch_groups(fill, &params, [COUNT.div_ceil(64), 1, 1]);
                    })
                });
                let decided = decide(g, decider, given, all.len() as u32);
                let numbers = g.pass("test.number", Queue::AsyncCompute, |p| {
                    let groups = p.indirect(decided);
                    let (numbers, to) = p.write_buffer(filled);
                    (numbers.read(), move |c: &mut Record<'_>| {
                        let params = Over { to: c.id(to), count: COUNT, ..Over::default() };
                        c.dispatch_indirect(number, &params, groups, 12);
                    })
                });
                read_back(g, imports, gpu, numbers, bytes)
            })?;
            let threads = (16 * groups.iter().product::<u32>()).min(COUNT);
            let expected = (0..COUNT).map(|i| if i < threads { 100 + i } else { 7 });
            ensure!(words_of(&seen) == expected.collect::<Vec<_>>(), "{groups:?}: {:?}", words_of(&seen));
        }
        Ok(())
    })
}

const COLUMN_VERT: &str = r#"
layout(push_constant, scalar) uniform Push { uvec2 from; uvec2 to; uint width; };
layout(location = 0) flat out uint column;
void main() {
    column = uint(gl_VertexIndex) / 4u + uint(gl_InstanceIndex);
    uint corner = uint(gl_VertexIndex) % 4u;
    float x = float(column + (corner & 1u)) / float(width);
    gl_Position = vec4(2.0 * x - 1.0, 2.0 * float(corner >> 1u) - 1.0, 0.5, 1.0);
}
"#;

const COLUMN_FRAG: &str = r#"
layout(location = 0) flat in uint column;
layout(location = 0) out vec4 colour;
void main() { colour = vec4(float(column) + 1.0, 0.0, 0.0, 1.0); }
"#;

/// A pipeline that draws columns one pixel wide.
fn columns(r: &Runner) -> Result<RasterKernel> {
    let shader = |name: &'static str, glsl: &str, stage| -> Result<Shader> {
        let spirv = Runner::compile(name, glsl, stage)?.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>();
        Ok(Shader { name, stage, rays: None, spirv: spirv.leak() })
    };
    let vertex = shader("column.vert", COLUMN_VERT, Stage::Vertex)?;
    let fragment = shader("column.frag", COLUMN_FRAG, Stage::Fragment)?;
    Ok(r.gpu.raster_kernel(&RasterDesc {
        name: "column",
        vertex: &vertex,
        fragment: &fragment,
        constants: &[],
        colours: &[Format::R32Float],
        blend: Blend::Opaque,
        depth: None,
    })?)
}

#[test]
fn the_device_decides_how_much_is_drawn() -> Result<()> {
    const WIDTH: u32 = 12;
    under_all(|r| {
        let (decider, column) = (r.kernel("decide.comp", DECIDE)?, columns(r)?);
        // The first three indices are skipped.
        let indices = upload(&r.gpu, &[50, 50, 50, 0, 1, 2, 2, 1, 3], BufferUse::Index)?;
        // Fields of an indexed draw: indices, instances, first index, vertex offset, first instance.
        let draw = |instances: u32, column: u32| [6, instances, 3, 4 * column, 0];
        let cases: [(&[[u32; 5]], &[u32]); 4] = [
            (&[draw(0, 1)], &[]),
            (&[draw(2, 1)], &[1, 2]),
            (&[draw(2, 0), draw(0, 4), draw(3, 7)], &[0, 1, 7, 8, 9]),
            (&[[0, 5, 3, 0, 0], draw(0, 0), draw(0, 3)], &[]),
        ];
        for (draws, drawn) in cases {
            // After one draw that is skipped.
            let all: Vec<u32> = draw(12, 0).into_iter().chain(draws.iter().flatten().copied()).collect();
            let given = upload(&r.gpu, &all, BufferUse::Storage)?;
            let extent = Extent::new(WIDTH, 3);
            let seen = r.frame(extent, |g, imports, gpu| {
                let (given, key) = (import(g, imports, "given", &given), imports.borrow_mut().buffer(&indices));
                let indices = g.import_buffer("indices", BufferDesc::new(36), Access::Index, key).read();
                let decided = decide(g, decider, given, all.len() as u32);
                let count = draws.len() as u32;
                let image = g.pass("test.draw", Queue::Graphics, |p| {
                    let (indices, draws) = (p.index(indices), p.indirect(decided));
                    let (image, _) = p.color("image", ImageDesc::full(Format::R32Float), [-1.0; 4]);
                    (image.read(), move |c: &mut Record<'_>| {
                        let params = Over { count: WIDTH, ..Over::default() };
                        let draws = IndirectDraws { words: draws, offset: 20, count, cull: Cull::None };
                        c.draw_indirect(column, &params, indices, draws);
                    })
                });
                read_back_mips(g, imports, gpu, image, 1)
            })?;
            for (i, value) in floats_of(&seen).into_iter().enumerate() {
                let column = i as u32 % WIDTH;
                let expected = if drawn.contains(&column) { column as f32 + 1.0 } else { -1.0 };
                ensure!(value == expected, "{draws:?}: {value} in column {column}");
            }
        }
        Ok(())
    })
}

/// Reads back mips of an image of single floats, one after another.
fn read_back_mips(
    g: &mut FrameGraph,
    imports: &Shared,
    gpu: &Gpu,
    image: Handle<Image>,
    mips: u32,
) -> Result<Arc<Buffer>> {
    let extent = g.extent(image);
    let bytes = |mip: u32| u64::from(extent.mip(mip).width * extent.mip(mip).height) * 4;
    let (mut target, buffer) = results(gpu, g, imports, "test.bring", (0..mips).map(bytes).sum())?;
    for mip in 0..mips {
        let offset = (0..mip).map(bytes).sum();
        target = g.pass(&format!("test.bring.{mip}"), Queue::Transfer, |p| {
            let from = p.copy_from(image);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| c.copy_from_image(from, to, MipCopy { offset, mip }))
        });
    }
    g.leave(target.read(), Access::HostRead, Domain::Copy);
    Ok(buffer)
}

fn floats_of(buffer: &Buffer) -> Vec<f32> {
    bytemuck::pod_collect_to_vec(buffer.contents())
}

const START: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uvec2 size; uint extra; };
void main() {
    uvec2 p = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(p, size))) return;
    store(to, ivec2(p), vec4(float((p.x * 7u + p.y * 13u + extra * 5u) % 31u)));
}
"#;

/// Value of a texel that START writes.
fn start(x: u32, y: u32, extra: u32) -> f32 {
    ((x * 7 + y * 13 + extra * 5) % 31) as f32
}

const REDUCE: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uvec2 size; uint extra; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    ivec2 last = textureSize(images[from], 0) - 1;
    float sum = 0.0;
    for (int i = 0; i < 4; ++i) sum += load(from, min(2 * p + ivec2(i & 1, i >> 1), last)).r;
    store(to, p, vec4(sum));
}
"#;

/// Sums one texel of every mip of the whole image.
const CLIMB: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uvec2 size; uint extra; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    float sum = 0.0;
    for (int mip = 0; mip < int(extra); ++mip)
        sum += texelFetch(images[from], min(p >> mip, textureSize(images[from], mip) - 1), mip).r;
    store(to, p, vec4(sum));
}
"#;

/// A pass that reads one mip of an image and writes another.
fn reduce(g: &mut FrameGraph, kernel: Kernel, image: WriteHandle<Image>, mip: u32, size: Extent) -> WriteHandle<Image> {
    let queue = if mip.is_multiple_of(2) { Queue::Graphics } else { Queue::AsyncCompute };
    g.pass(&format!("test.reduce.{mip}"), queue, |p| {
        let from = p.sample_part(image.read(), Part::mip(mip - 1));
        let (image, to) = p.write_part(image, Part::mip(mip));
        (image, move |c: &mut Record<'_>| {
            let params = Texels { from: c.id(from), to: c.id(to), size: [size.width, size.height], extra: 0 };
            c.dispatch(kernel, &params, size);
        })
    })
}

#[test]
fn a_pyramid_is_made_mip_by_mip_in_one_image() -> Result<()> {
    under_all(|r| {
        let (begin, half) = (r.kernel("start.comp", START)?, r.kernel("reduce.comp", REDUCE)?);
        let climb = r.kernel("climb.comp", CLIMB)?;
        for extent in [Extent::new(37, 21), Extent::new(64, 64), Extent::new(1, 9)] {
            let mips = extent.full_mips();
            let desc = ImageDesc { mips, ..ImageDesc::full(Format::R32Float) };
            let (pyramid, sums) = r.frame(extent, |g, imports, gpu| {
                let mut image = g.pass("test.start", Queue::Graphics, |p| {
                    let (image, to) = p.create_part("pyramid", desc, Part::mip(0));
                    (image, move |c: &mut Record<'_>| {
                        let size = [extent.width, extent.height];
                        let params = Texels { from: SampledImage::default(), to: c.id(to), size, extra: 0 };
                        c.dispatch(begin, &params, extent);
                    })
                });
                for mip in 1..mips {
                    image = reduce(g, half, image, mip, extent.mip(mip));
                }
                let sums = g.pass("test.climb", Queue::Graphics, |p| {
                    let from = p.sample(image.read());
                    let (sums, to) = p.create("sums", ImageDesc::full(Format::R32Float));
                    (sums.read(), move |c: &mut Record<'_>| {
                        let size = [extent.width, extent.height];
                        c.dispatch(climb, &Texels { from: c.id(from), to: c.id(to), size, extra: mips }, extent);
                    })
                });
                let pyramid = read_back_mips(g, imports, gpu, image.read(), mips)?;
                let sums_back = read_back_named(g, imports, gpu, "sums", sums)?;
                Ok((pyramid, sums_back))
            })?;
            let expected = pyramid_of(extent);
            let seen = floats_of(&pyramid);
            ensure!(seen == expected.concat(), "{extent}: {seen:?}");
            for (i, sum) in floats_of(&sums).into_iter().enumerate() {
                let (x, y) = (i as u32 % extent.width, i as u32 / extent.width);
                let texel = |mip: u32| {
                    let size = extent.mip(mip);
                    let (x, y) = ((x >> mip).min(size.width - 1), (y >> mip).min(size.height - 1));
                    expected[mip as usize][(y * size.width + x) as usize]
                };
                ensure!(sum == (0..mips).map(texel).sum::<f32>(), "{extent}: {sum} at ({x}, {y})");
            }
        }
        Ok(())
    })
}

/// The mips on the CPU: integers below 2^24, so that no sum is rounded.
fn pyramid_of(extent: Extent) -> Vec<Vec<f32>> {
    let texels = |size: Extent| (0..size.height).flat_map(move |y| (0..size.width).map(move |x| (x, y)));
    let mut mips = vec![texels(extent).map(|(x, y)| start(x, y, 0)).collect::<Vec<f32>>()];
    for mip in 1..extent.full_mips() {
        let (size, above, last) = (extent.mip(mip), extent.mip(mip - 1), mips[mip as usize - 1].clone());
        let at = |x: u32, y: u32| last[(y.min(above.height - 1) * above.width + x.min(above.width - 1)) as usize];
        let sum = |(x, y): (u32, u32)| (0..4).map(|i| at(2 * x + (i & 1), 2 * y + (i >> 1))).sum();
        mips.push(texels(size).map(sum).collect());
    }
    mips
}

fn read_back_named(
    g: &mut FrameGraph,
    imports: &Shared,
    gpu: &Gpu,
    name: &str,
    image: Handle<Image>,
) -> Result<Arc<Buffer>> {
    let extent = g.extent(image);
    let (target, buffer) = results(gpu, g, imports, name, u64::from(extent.width * extent.height) * 4)?;
    let target = g.pass(&format!("test.bring.{name}"), Queue::Transfer, |p| {
        let from = p.copy_from(image);
        let (target, to) = p.copy_to(target);
        (target, move |c: &mut Record<'_>| c.copy_from_image(from, to, MipCopy { offset: 0, mip: 0 }))
    });
    g.leave(target.read(), Access::HostRead, Domain::Copy);
    Ok(buffer)
}

/// Copies every layer to another in reverse order, plus one.
const TURN: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uvec2 size; uint extra; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    int layers = int(extra);
    for (int layer = 0; layer < layers; ++layer)
        store_layer(to, p, layer, load_layer(from, p, layers - 1 - layer) + 1.0);
}
"#;

const PLAIN: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint to; uvec2 size; uint extra; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(uvec2(p), size))) store(to, p, load(from, p));
}
"#;

#[test]
fn layers_are_written_one_by_one_and_read_as_a_whole() -> Result<()> {
    const LAYERS: u32 = 3;
    under_all(|r| {
        let (begin, turn) = (r.kernel("start.comp", START)?, r.kernel("turn.comp", TURN)?);
        let plain = r.kernel("plain.comp", PLAIN)?;
        let extent = Extent::new(19, 10);
        let size = [extent.width, extent.height];
        let desc = ImageDesc { layers: LAYERS, ..ImageDesc::full(Format::R32Float) };
        let seen = r.frame(extent, |g, imports, gpu| {
            let mut image: Option<WriteHandle<Image>> = None;
            for layer in 0..LAYERS {
                let queue = if layer == 1 { Queue::AsyncCompute } else { Queue::Graphics };
                image = Some(g.pass(&format!("test.start.{layer}"), queue, |p| {
                    let (image, to) = match image {
                        None => p.create_part("layers", desc, Part::layer(layer)),
                        Some(image) => p.write_part(image, Part::layer(layer)),
                    };
                    (image, move |c: &mut Record<'_>| {
                        let params = Texels { from: SampledImage::default(), to: c.id(to), size, extra: layer };
                        c.dispatch(begin, &params, extent);
                    })
                }));
            }
            let Some(image) = image else { return Ok(Vec::new()) };
            let turned = g.pass("test.turn", Queue::Graphics, |p| {
                let from = p.sample(image.read());
                let (turned, to) = p.create("turned", desc);
                (turned.read(), move |c: &mut Record<'_>| {
                    c.dispatch(turn, &Texels { from: c.id(from), to: c.id(to), size, extra: LAYERS }, extent);
                })
            });
            let mut seen = Vec::new();
            for layer in 0..LAYERS {
                let one = g.pass(&format!("test.plain.{layer}"), Queue::AsyncCompute, |p| {
                    let from = p.sample_part(turned, Part::layer(layer));
                    let (one, to) = p.create("one", ImageDesc::full(Format::R32Float));
                    (one.read(), move |c: &mut Record<'_>| {
                        c.dispatch(plain, &Texels { from: c.id(from), to: c.id(to), size, extra: 0 }, extent);
                    })
                });
                seen.push(read_back_named(&mut *g, imports, gpu, &format!("layer {layer}"), one)?);
            }
            Ok(seen)
        })?;
        ensure!(seen.len() == LAYERS as usize, "{} layers", seen.len());
        for (layer, buffer) in (0..).zip(&seen) {
            for (i, value) in floats_of(buffer).into_iter().enumerate() {
                let (x, y) = (i as u32 % extent.width, i as u32 / extent.width);
                let expected = start(x, y, LAYERS - 1 - layer) + 1.0;
                ensure!(value == expected, "layer {layer}, ({x}, {y}): {value} instead of {expected}");
            }
        }
        Ok(())
    })
}
