//! Common mistakes of authors of external passes, and the errors they get: push constants whose size differs from the shader's, images that
//! violate a slot's contract, an index that was not set, a check that cannot find anything.
use anyhow::{Context, Result, bail, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::config::Config;
use magpie::gpu::{Blend, Cull, Gpu, GpuError, GpuOptions, Kernel, RasterDesc, RasterKernel, RayKernel};
use magpie::graph::execute::ExecuteError;
use magpie::graph::{BufferDesc, Draw, DrawClass, GraphError, IndirectDraws};
use magpie::prelude::*;
use magpie::scene::{ResidentOptions, ResidentScene};
use magpie::slot::BoxedEffect;
use magpie_passes::contracts::{AoIn, AoOut, PostIn, PostOut};
use magpie_passes::reference::{Reference, ReferenceError, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderError, RenderOptions, Renderer, Slots};
use magpie_shaders::{SampledImage, Shader, Stage, StorageImage};
use magpie_tests::bench::{Bench, Shot};
use magpie_tests::harness::{builtin, gpu};

const HEAD: &str = "#version 460\n#extension GL_GOOGLE_include_directive : require\n#include \"lib/bindless.glsl\"\n";
const COMPUTE: &str = "layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint image; uvec2 size; float a; float b; };
void main() {
    if (all(lessThan(gl_GlobalInvocationID.xy, size))) store(image, ivec2(gl_GlobalInvocationID.xy), vec4(a, b, a, b));
}";
const RAYS: &str = "#include \"lib/ray.glsl\"
layout(push_constant, scalar) uniform Push { uint image; uvec2 size; float a; float b; };
void main() {
    if (all(lessThan(RAY_INVOCATION.xy, size))) store(image, ivec2(RAY_INVOCATION.xy), vec4(a, b, a, b));
}";
/// The vertex shader's block is shorter than the fragment shader's.
const VERTEX: &str = "layout(push_constant, scalar) uniform Push { uint image; uvec2 size; };
void main() { gl_Position = vec4(float(size.x + image), 0.0, 0.5, 1.0); }";
const FRAGMENT: &str = "layout(push_constant, scalar) uniform Push { uint image; uvec2 size; float a; float b; };
layout(location = 0) out vec4 colour;
void main() { colour = vec4(a, b, a, b); }";

/// The block that the shaders read.
#[repr(C)]
#[derive(Clone, Copy, Default, Pod, Zeroable)]
struct Right {
    image: StorageImage,
    size: [u32; 2],
    numbers: [f32; 2],
}

/// The same without the last field.
#[repr(C)]
#[derive(Clone, Copy, Default, Pod, Zeroable)]
struct Short {
    image: StorageImage,
    size: [u32; 2],
    number: f32,
}

/// The same with an additional field.
#[repr(C)]
#[derive(Clone, Copy, Default, Pod, Zeroable)]
struct Long {
    image: StorageImage,
    size: [u32; 2],
    numbers: [f32; 3],
}

/// All commands that record push constants.
#[derive(Clone, Copy, Debug)]
enum Command {
    Dispatch,
    DispatchIndirect,
    Trace(RayKernel),
    TraceIndirect(RayKernel),
    Draw,
    DrawIndirect,
}

struct Pipelines {
    compute: Kernel,
    raster: RasterKernel,
}

/// Declares and runs a frame with a pass that records a command with these push constants.
fn record<P: Pod + Send + Default>(
    bench: &mut Bench,
    shot: Shot<'_>,
    pipelines: &Pipelines,
    command: Command,
) -> Result<()> {
    let gpu = bench.gpu.clone();
    let (compute, raster) = (pipelines.compute, pipelines.raster);
    let ran = bench.run(shot.extent, &[], |g, imports| {
        let (_, scene) = shot.declare(&gpu, g, imports)?;
        // Zeros, for indices and counts.
        let words = g.pass("mine.words", Queue::Graphics, |p| {
            let (words, to) = p.fill_buffer("words", BufferDesc::new(64));
            (words.read(), move |c: &mut Record<'_>| c.fill_buffer(to, 0, &[0_u32; 16]))
        });
        let image = g.pass("mine.step", Queue::Graphics, |p| {
            let draws = matches!(command, Command::Draw | Command::DrawIndirect);
            let (indices, tlas) = (draws.then(|| p.index(words)), (!draws).then(|| scene.trace(p).tlas));
            let (sizes, desc) = (p.indirect(words), ImageDesc::full(Format::Rgba32Float));
            let image = if draws { p.color("image", desc, [0.0; 4]).0 } else { p.create("image", desc).0 };
            (image.read(), move |c: &mut Record<'_>| {
                let (params, extent) = (P::default(), Extent::new(8, 8));
                let draw =
                    Draw { first_index: 0, index_count: 3, instance: 0, cull: Cull::None, class: DrawClass::Opaque };
                match (command, tlas, indices) {
                    (Command::Dispatch, ..) => c.dispatch(compute, &params, extent),
                    (Command::DispatchIndirect, ..) => c.dispatch_indirect(compute, &params, sizes, 0),
                    (Command::Trace(kernel), Some(tlas), _) => c.trace(kernel, tlas, &params, extent),
                    (Command::TraceIndirect(kernel), Some(tlas), _) => {
                        c.trace_indirect(kernel, tlas, &params, sizes, 0);
                    }
                    (Command::Draw, _, Some(indices)) => c.draw(raster, &params, indices, &[draw]),
                    (Command::DrawIndirect, _, Some(indices)) => {
                        let draws = IndirectDraws { words: sizes, offset: 0, count: 1, cull: Cull::None };
                        c.draw_indirect(raster, &params, indices, draws);
                    }
                    other => unreachable!("{other:?}"),
                }
            })
        });
        g.output(image);
        Ok(())
    })?;
    ran.clean().map(|_| ())
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

/// Wherever push constants are recorded, a struct that is shorter or longer than the block is rejected before anything runs. The right one
/// is accepted, and the frame after a rejection runs normally.
#[test]
fn push_constants_of_another_size_are_refused_with_both() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let scene = builtin("cornell")?;
    let (vertex, fragment) =
        (shader("mine.vert", VERTEX, Stage::Vertex)?, shader("mine.frag", FRAGMENT, Stage::Fragment)?);
    let colours = &[Format::Rgba32Float];
    let (name, blend, depth) = ("mine.raster", Blend::Opaque, None);
    let desc = RasterDesc { name, vertex: &vertex, fragment: &fragment, constants: &[], colours, blend, depth };
    let pipelines = Pipelines {
        compute: bench.kernel("mine.comp", &format!("{HEAD}{COMPUTE}"))?,
        raster: gpu.raster_kernel(&desc)?,
    };
    for rays in gpu.rays() {
        let resident = ResidentScene::new(&gpu, &scene, ResidentOptions { rays, ..Default::default() })?.shared();
        let shot = Shot { scene: &resident, camera: &scene.cameras[0], extent: Extent::new(8, 8) };
        let traced = bench.ray_kernel("mine.ray", &format!("{HEAD}{RAYS}"), rays)?;
        for (command, kernel) in [
            (Command::Dispatch, "mine.comp"),
            (Command::DispatchIndirect, "mine.comp"),
            (Command::Trace(traced), "mine.ray"),
            (Command::TraceIndirect(traced), "mine.ray"),
            (Command::Draw, "mine.raster"),
            (Command::DrawIndirect, "mine.raster"),
        ] {
            let refused = [
                (record::<Short>(&mut bench, shot, &pipelines, command), 16),
                (record::<Long>(&mut bench, shot, &pipelines, command), 24),
            ];
            for (result, bytes) in refused {
                let message =
                    result.err().with_context(|| format!("{command:?}: {bytes} bytes were taken"))?.to_string();
                let wanted = format!(
                    "pass mine.step: {kernel} reads 20 bytes of push constants, but the pass gives it {bytes}: the struct"
                );
                ensure!(message.starts_with(&wanted), "{command:?}: {message}");
            }
            record::<Right>(&mut bench, shot, &pipelines, command).with_context(|| format!("{command:?}"))?;
        }
    }
    Ok(())
}

#[test]
fn a_block_that_no_pass_can_fill_is_refused() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let bench = Bench::new(&gpu)?;
    let text = format!(
        "{HEAD}{}",
        COMPUTE.replace("float b;", "float b; vec4 much[8];").replace("b, a, b", "b, a, much[7].x")
    );
    match bench.kernel("much.comp", &text).map_err(|error| error.downcast::<GpuError>()) {
        Err(Ok(error)) => {
            let wanted = "bytes of push constants of much.comp: 148 is over the device's limit of 128";
            ensure!(error.to_string() == wanted, "{error}");
        }
        other => bail!("{other:?}"),
    }
    Ok(())
}

/// The standard `post`, but with an invalid display image.
struct Other {
    standard: BoxedEffect<PostIn, PostOut>,
    desc: fn(Extent) -> ImageDesc,
    fill: Kernel,
}

impl Effect for Other {
    type In = PostIn;
    type Out = PostOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, input: PostIn) -> PostOut {
        let (radiance, fill, desc) = (self.standard.add(g, view, input).radiance, self.fill, (self.desc)(view.output));
        let display = g.pass("post.other", Queue::Graphics, |p| {
            let (display, image) = p.create("display", desc);
            let extent = p.extent_of(desc);
            (display.read(), move |c: &mut Record<'_>| {
                let (size, numbers) = ([extent.width, extent.height], [0.25, 0.5]);
                c.dispatch(fill, &Right { image: c.id(image), size, numbers }, extent);
            })
        });
        PostOut { radiance, display }
    }
}

/// Openness at half size, which violates the slot's contract.
struct HalfOpen(Kernel);

impl Effect for HalfOpen {
    type In = AoIn;
    type Out = AoOut;

    fn add(&mut self, g: &mut FrameGraph, _: &View, _: AoIn) -> AoOut {
        let fill = self.0;
        let openness = g.pass("ao.half", Queue::Graphics, |p| {
            let (openness, image) = p.create("openness", ImageDesc::half(Format::R16Float));
            let extent = p.extent_of(ImageDesc::half(Format::R16Float));
            (openness.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                c.dispatch(fill, &Right { image: c.id(image), size, numbers: [1.0; 2] }, extent);
            })
        });
        AoOut { openness: Some(openness), bent_normal: None }
    }
}

fn fill(gpu: &Gpu) -> Result<Kernel, magpie::slot::SlotError> {
    let words = magpie_shaders::compile("fill.comp", &format!("{HEAD}{COMPUTE}"), Stage::Compute);
    let words = words.map_err(magpie::slot::SlotError::other)?;
    gpu.kernel_from_words("fill.comp", &words).map_err(magpie::slot::SlotError::other)
}

/// The errors of a frame with these slots, in order.
fn mistakes(gpu: &Gpu, slots: &Slots, changes: &[&str]) -> Result<Vec<GraphError>> {
    let scene = builtin("cornell")?;
    let mut config = Config::default();
    for change in changes {
        config.set(change)?;
    }
    let options = RenderOptions { width: 32, height: 18, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, &scene, slots, &config, options)?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    match renderer.frame(request) {
        Ok(_) => Ok(Vec::new()),
        Err(RenderError::Execute(ExecuteError::Declaration(errors))) => Ok(errors.0),
        Err(error) => bail!(error),
    }
}

#[test]
fn an_image_that_is_not_as_the_contract_says_is_refused_with_both() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut slots = Slots::default();
    type Desc = fn(Extent) -> ImageDesc;
    let descs: [(&str, Desc, Option<&str>); 4] = [
        ("same", |extent| ImageDesc::fixed(Format::Rgba8Unorm, extent), None),
        ("float", |extent| ImageDesc::fixed(Format::Rgba16Float, extent), Some("as Rgba16Float of 32x18")),
        ("small", |extent| ImageDesc::fixed(Format::Rgba8Unorm, extent.half()), Some("as Rgba8Unorm of 16x9")),
        (
            "large",
            |extent| ImageDesc::fixed(Format::Rgba8Unorm, Extent::new(extent.width + 1, 18)),
            Some("as Rgba8Unorm of 33x18"),
        ),
    ];
    for (name, desc, _) in descs {
        slots.post.wrap("standard", name, "Another display.", &[], move |build, _, standard| {
            Ok(Box::new(Other { standard, desc, fill: fill(build.gpu()?)? }))
        })?;
    }
    slots.ao.register("half", "Half as large.", &[], |build, _| Ok(Box::new(HalfOpen(fill(build.gpu()?)?))));
    for (name, _, wrong) in descs {
        let found = mistakes(&gpu, &slots, &[&format!("stages.post={name}")])?;
        let said: Vec<String> = found.iter().map(ToString::to_string).collect();
        let wanted = wrong.map(|given| {
            format!("slot `post`: \"{name}\" gives `display` {given}, wanted Rgba8Unorm or Rgba16Unorm of 32x18")
        });
        ensure!(said == Vec::from_iter(wanted), "{name}: {said:?}");
    }
    // All errors are reported together.
    let found = mistakes(&gpu, &slots, &["stages.post=small", "stages.ao=half", "post.resolution_scale=0.5"])?;
    let said: Vec<String> = found.iter().map(ToString::to_string).collect();
    let wanted = [
        "slot `ao`: \"half\" gives `openness` as R16Float of 8x5, wanted R8Unorm or R16Unorm or R16Float or R32Float of 16x9",
        "slot `post`: \"small\" gives `display` as Rgba8Unorm of 16x9, wanted Rgba8Unorm or Rgba16Unorm of 32x18",
    ];
    ensure!(said == wanted, "{said:#?}");
    Ok(())
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Unset {
    from: SampledImage,
    to: StorageImage,
}

/// An index that was left out refers to the device's own black pixel, not to the first image.
#[test]
fn an_index_that_nobody_set_reads_black_and_writes_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    unset(&gpu, "")?;
    // With the validation layers on, a pass sees only its own storage images.
    let options = GpuOptions { device: std::env::var("MAGPIE_DEVICE").ok(), ..GpuOptions::default() };
    unset(&Gpu::new(&options)?, "store(0u, ivec2(gl_GlobalInvocationID.xy), vec4(7.0));")
}

/// Reads an index that was not set, and runs another statement.
fn unset(gpu: &Gpu, beside: &str) -> Result<()> {
    let mut bench = Bench::new(gpu)?;
    let text = format!(
        "{HEAD}layout(local_size_x = 8, local_size_y = 8) in;
        layout(push_constant, scalar) uniform Push {{ uint from; uint to; }};
        void main() {{
            {beside}
            store(to, ivec2(gl_GlobalInvocationID.xy), vec4(0.5) + load(from, ivec2(0)));
        }}"
    );
    let kernel = bench.kernel("unset.comp", &text)?;
    for frame in 0..2 {
        let ran = bench.run(Extent::new(8, 8), &["mine.step:image"], |g, _| {
            let image = g.pass("mine.step", Queue::Graphics, |p| {
                let (image, to) = p.create("image", ImageDesc::full(Format::Rgba32Float));
                (image.read(), move |c: &mut Record<'_>| {
                    let params = Unset { from: SampledImage::default(), to: c.id(to) };
                    c.dispatch(kernel, &params, Extent::new(8, 8));
                })
            });
            g.output(image);
            Ok(())
        })?;
        let values = ran.clean()?.values("mine.step:image")?;
        ensure!(values.iter().all(|v| *v == [0.5; 4]), "frame {frame}: it read {:?}", values[0]);
    }
    Ok(())
}

#[test]
fn a_check_that_could_find_nothing_is_refused() -> Result<()> {
    if gpu()?.is_none() {
        return Ok(());
    }
    let options = GpuOptions { device: std::env::var("MAGPIE_DEVICE").ok(), ..GpuOptions::default() };
    let (gpu, scene) = (Gpu::new(&options)?, builtin("cornell")?);
    let checked = RenderOptions { width: 8, height: 8, check: true, ..RenderOptions::default() };
    let refused = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), checked).map(|_| ());
    let Err(RenderError::Gpu(error @ GpuError::NotValidated { .. })) = refused else { bail!("{refused:?}") };
    let message = error.to_string();
    ensure!(message.contains("without the validation layers") && message.contains("validation: true"), "{message}");
    let options = ReferenceOptions { width: 8, height: 8, check: true, ..ReferenceOptions::default() };
    let refused = Reference::new(&gpu, &scene, &scene.cameras[0], options).map(|_| ());
    ensure!(matches!(refused, Err(ReferenceError::Gpu(GpuError::NotValidated { .. }))), "{refused:?}");
    let unchecked = RenderOptions { check: false, ..checked };
    Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), unchecked)?;
    Ok(())
}
