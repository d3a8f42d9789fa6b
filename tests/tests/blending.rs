//! Blended geometry over a depth image that is only tested against: closed forms of every way to blend, hidden fragments, the same depth
//! image sampled in the same pass, and the order of blended draws.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3};
use magpie::frame::ViewDesc;
use magpie::gpu::{Blend, Cull, GpuError, Kernel, Pipelines, RasterDesc, RasterKernel};
use magpie::graph::execute::{ExecuteOptions, Executor};
use magpie::graph::{
    BufferDesc, Draw, DrawClass, Extent, Format, FrameGraph, Handle, Image, ImageDesc, Queue, Record, Switches,
};
use magpie::scene::{AlphaMode, Material, Mesh, SceneFacts, SceneSketch, Sphere};
use magpie::slot::Needs;
use magpie_shaders::{SampledImage, Shader, Stage, StorageImage};
use magpie_tests::bench::Bench;
use magpie_tests::fixtures::{add, camera, material, plane, scene};
use magpie_tests::harness::gpu;
use std::sync::Arc;

const SWITCHES: [&str; 4] = ["", "serial", "no-alias", "queues=3"];
const EXTENT: Extent = Extent { width: 16, height: 6 };

/// Columns of pixels, with depth (reversed: greater is nearer) and straight colour. Every number is exact in 16 bits, and so is all that
/// becomes of it.
struct Columns {
    columns: [u32; 2],
    depth: f32,
    colour: [f32; 4],
}

const BACKGROUND: [f32; 4] = [0.5, 0.25, 0.125, 0.5];
const SOLID: Columns = Columns { columns: [4, 12], depth: 0.5, colour: [0.25, 0.5, 0.75, 1.0] };
/// Behind the solid.
const BEHIND: Columns = Columns { columns: [0, 8], depth: 0.25, colour: [1.0, 0.5, 0.25, 0.5] };
const BEFORE: Columns = Columns { columns: [2, 10], depth: 0.75, colour: [0.5, 1.0, 0.0, 0.25] };

const HEAD: &str = "#version 460
#extension GL_GOOGLE_include_directive : require
#include \"lib/bindless.glsl\"
layout(push_constant, scalar) uniform Push { vec4 colour; uvec2 columns; float width; float depth; uint seen; };
";
const VERTEX: &str = "
void main() {
    float x = float(gl_VertexIndex % 2 == 0 ? columns.x : columns.y) / width;
    gl_Position = vec4(2.0 * x - 1.0, 2.0 * float(gl_VertexIndex / 2) - 1.0, depth, 1.0);
}";
const SOLID_FRAGMENT: &str = "
layout(location = 0) out vec4 result;
void main() { result = colour; }";
/// Halves alpha in front of what the depth image holds.
const GLASS_FRAGMENT: &str = "
layout(location = 0) out vec4 result;
void main() {
    float behind = load(seen, ivec2(gl_FragCoord.xy)).r;
    result = vec4(colour.rgb, behind > 0.0 ? 0.5 * colour.a : colour.a);
}";
const COPY: &str = "#version 460
#extension GL_GOOGLE_include_directive : require
#include \"lib/bindless.glsl\"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint from; uint other; uint to; uvec2 size; };
void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(p), size))) return;
    store(to, p, vec4(load(from, p).r, load(other, p).a, 0.0, 0.0));
}";

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    colour: [f32; 4],
    columns: [u32; 2],
    width: f32,
    depth: f32,
    seen: SampledImage,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Copy2 {
    from: SampledImage,
    other: SampledImage,
    to: StorageImage,
    size: [u32; 2],
}

impl Columns {
    fn push(&self, seen: SampledImage) -> Push {
        Push { colour: self.colour, columns: self.columns, width: EXTENT.width as f32, depth: self.depth, seen }
    }

    fn has(&self, x: u32) -> bool {
        (self.columns[0]..self.columns[1]).contains(&x)
    }
}

fn shader(name: &'static str, glsl: &str, stage: Stage) -> Result<Shader> {
    let words = magpie_shaders::compile(name, &format!("{HEAD}{glsl}"), stage)?;
    Ok(Shader {
        name,
        stage,
        rays: None,
        spirv: words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>().leak(),
    })
}

fn kernel(pipelines: &Pipelines, fragment: &str, colour: Format, blend: Blend) -> Result<RasterKernel, GpuError> {
    let broken = |e: anyhow::Error| GpuError::Shader { name: "test".to_owned(), reason: e.to_string() };
    let vertex = shader("columns.vert", VERTEX, Stage::Vertex).map_err(broken)?;
    let fragment = shader("columns.frag", fragment, Stage::Fragment).map_err(broken)?;
    pipelines.raster_kernel(&RasterDesc {
        name: "columns",
        vertex: &vertex,
        fragment: &fragment,
        constants: &[],
        colours: &[colour],
        blend,
        depth: Some(Format::D32Float),
    })
}

/// What the frame is made with.
#[derive(Clone, Copy)]
struct Kernels {
    solid: RasterKernel,
    glass: RasterKernel,
    copy: Kernel,
}

/// A solid with depth, glass over it that is tested against its depth and samples it, and a look at the depth after that.
fn declare(g: &mut FrameGraph, kernels: Kernels) -> Handle<Image> {
    let Kernels { solid, glass, copy } = kernels;
    let words = g.pass("test.words", Queue::Graphics, |p| {
        let (words, to) = p.fill_buffer("words", BufferDesc::new(24));
        (words.read(), move |c: &mut Record<'_>| c.fill_buffer(to, 0, &[0_u32, 1, 2, 2, 1, 3]))
    });
    let all = [Draw { first_index: 0, index_count: 6, instance: 0, cull: Cull::None, class: DrawClass::Blended }];
    let (lit, depth) = g.pass("test.solid", Queue::Graphics, |p| {
        let indices = p.index(words);
        let (lit, _) = p.color("lit", ImageDesc::full(Format::Rgba16Float), BACKGROUND);
        let (depth, _) = p.depth("depth", ImageDesc::full(Format::D32Float), 0.0);
        ((lit, depth.read()), move |c: &mut Record<'_>| {
            c.draw(solid, &SOLID.push(SampledImage::default()), indices, &all);
        })
    });
    let lit = g.pass("test.glass", Queue::Graphics, |p| {
        p.depth_test(depth);
        let (indices, seen, (lit, _)) = (p.index(words), p.sample(depth), p.color_load(lit));
        (lit, move |c: &mut Record<'_>| {
            let seen = c.id(seen);
            for one in [BEHIND, BEFORE] {
                c.draw(glass, &one.push(seen), indices, &all);
            }
        })
    });
    g.output(lit.read());
    g.pass("test.look", Queue::AsyncCompute, |p| {
        let (from, other) = (p.sample(depth), p.sample(lit.read()));
        let (after, to) = p.create("after", ImageDesc::full(Format::Rgba32Float));
        (after.read(), move |c: &mut Record<'_>| {
            let size = [EXTENT.width, EXTENT.height];
            c.dispatch(copy, &Copy2 { from: c.id(from), other: c.id(other), to: c.id(to), size }, EXTENT);
        })
    })
}

/// The colour `s` over `d`, as its definition says.
fn over(blend: Blend, s: [f32; 4], d: [f32; 4]) -> [f32; 4] {
    let a = s[3];
    std::array::from_fn(|i| match blend {
        Blend::Opaque => s[i],
        Blend::Over if i == 3 => a + (1.0 - a) * d[3],
        Blend::Over => a * s[i] + (1.0 - a) * d[i],
        Blend::PremultipliedOver => s[i] + (1.0 - a) * d[i],
        Blend::Additive => s[i] + d[i],
        Blend::Multiply => s[i] * d[i],
    })
}

fn expected(blend: Blend, x: u32) -> [f32; 4] {
    let solid = SOLID.has(x);
    let mut colour = if solid { SOLID.colour } else { BACKGROUND };
    for one in [&BEHIND, &BEFORE] {
        if one.has(x) && (!solid || one.depth > SOLID.depth) {
            let [r, g, b, a] = one.colour;
            colour = over(blend, [r, g, b, if solid { 0.5 * a } else { a }], colour);
        }
    }
    colour
}

#[test]
fn what_is_blended_over_a_tested_depth_has_its_closed_form() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let colour = Format::Rgba16Float;
    ensure!(gpu.blends(colour) && !gpu.blends(Format::Rg32Uint), "every device blends 16-bit floats, none integers");
    for words in SWITCHES {
        let mut switches = Switches::default();
        ensure!(words.is_empty() || switches.set(words), "{words}");
        let mut bench = Bench::new(&gpu)?;
        bench.executor = Executor::with(&gpu, ExecuteOptions { switches, ..Default::default() })?;
        let copy = bench.kernel("copy.comp", COPY)?;
        for blend in [Blend::Opaque, Blend::Over, Blend::PremultipliedOver, Blend::Additive, Blend::Multiply] {
            let solid = kernel(gpu.pipelines(), SOLID_FRAGMENT, colour, Blend::Opaque)?;
            let glass = kernel(gpu.pipelines(), GLASS_FRAGMENT, colour, blend)?;
            let ran = bench.run(EXTENT, &["test.glass:lit", "test.look:after"], |g, _| {
                let after = declare(g, Kernels { solid, glass, copy });
                g.output(after);
                Ok(())
            })?;
            let ran = ran.clean()?;
            let (lit, after) = (ran.values("test.glass:lit")?, ran.values("test.look:after")?);
            for (i, (lit, after)) in lit.iter().zip(&after).enumerate() {
                let (x, y) = (i as u32 % EXTENT.width, i as u32 / EXTENT.width);
                let wanted = expected(blend, x);
                let apart = lit.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                ensure!(apart <= 1e-3, "--graph {words:?}, {blend}, ({x}, {y}): {lit:?} is not {wanted:?}");
                let depth = if SOLID.has(x) { SOLID.depth } else { 0.0 };
                ensure!(after[0] == depth, "--graph {words:?}, {blend}, ({x}, {y}): depth became {}", after[0]);
            }
        }
    }
    Ok(())
}

#[test]
fn blending_into_integers_is_refused_by_name() -> Result<()> {
    let pipelines = Pipelines::default();
    kernel(&pipelines, SOLID_FRAGMENT, Format::Rg32Uint, Blend::Opaque)?;
    let error = kernel(&pipelines, SOLID_FRAGMENT, Format::Rg32Uint, Blend::Additive).expect_err("integers");
    ensure!(
        matches!(error, GpuError::Blend { blend: Blend::Additive, format: Format::Rg32Uint, .. }),
        "another error: {error}"
    );
    let message = error.to_string();
    ensure!(message == "pipeline columns blends (additive) into Rg32Uint, which holds integers", "{message}");
    Ok(())
}

#[test]
fn pipelines_that_blend_differently_are_different() -> Result<()> {
    let pipelines = Pipelines::default();
    let of = |blend| kernel(&pipelines, SOLID_FRAGMENT, Format::Rgba16Float, blend);
    ensure!(of(Blend::Over)? == of(Blend::Over)?, "the same description gives another pipeline");
    ensure!(of(Blend::Over)? != of(Blend::Additive)?, "blending is not part of the description");
    Ok(())
}

/// Draws of a scene by class, and its blended ones by distance, counted from an origin far away.
#[test]
fn blended_instances_come_farthest_first() -> Result<()> {
    let alpha = |alpha| Material { alpha, ..material([0.5; 3], 0.0, 0.5) };
    let far = 1000.0;
    let mut s = scene("panes", camera([far, 0.5, 5.0], [far, 0.5, 0.0]));
    let ball = || Mesh {
        name: "ball".to_owned(),
        spheres: vec![Sphere { centre: [0.0; 3].into(), radius: 0.5 }],
        ..Mesh::default()
    };
    // With their z; the camera is at 5. The first and the last are equally far.
    let panes = [
        (plane(0.5), AlphaMode::Blend, -1.0),
        (plane(0.5), AlphaMode::Opaque, 0.0),
        (plane(0.5), AlphaMode::Blend, 3.0),
        (ball(), AlphaMode::Blend, 0.0),
        (plane(0.5), AlphaMode::Blend, -4.0),
        (plane(0.5), AlphaMode::Mask(0.5), 0.0),
        (plane(2.5), AlphaMode::Blend, 0.0),
        (plane(0.5), AlphaMode::Blend, -1.0),
    ];
    for (mesh, mode, z) in panes {
        add(&mut s, mesh, alpha(mode), Affine3A::from_translation([far as f32, 0.0, z].into()));
    }
    let (facts, seen) = (Arc::new(SceneFacts::new(&s)), s.cameras.first().context("no camera")?);
    let sketch = SceneSketch::new(&s, facts, seen, &Needs::default());
    ensure!((sketch.origin - DVec3::X * far).length() < 100.0, "the origin is {} and does not matter", sketch.origin);
    let mut g = FrameGraph::new(EXTENT);
    let view = ViewDesc::new(seen, EXTENT).sketch(&sketch, &mut g);
    let of = |class| view.draws.of(class).iter().map(|d| d.instance).collect::<Vec<_>>();
    ensure!(of(DrawClass::Opaque) == [1] && of(DrawClass::AlphaTested) == [5], "{:?}", view.draws);
    ensure!(of(DrawClass::Procedural) == [3] && of(DrawClass::Blended) == [0, 2, 4, 6, 7], "{:?}", view.draws);
    let order: Vec<u32> = view.blended_back_to_front().iter().map(|d| d.instance).collect();
    ensure!(order == [4, 0, 7, 6, 2], "{order:?}");
    Ok(())
}
