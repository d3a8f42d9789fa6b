//! Shaders that are edited while frames go on, and pipelines that are made ahead.
use anyhow::{Context, Result, ensure};
use magpie::gpu::{Gpu, PipelineSet};
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::{Shader, Sources};
use magpie_tests::harness::{builtin, config, gpu};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A copy of the shaders, to be edited.
struct Folder {
    _folder: tempfile::TempDir,
    sources: Sources,
}

impl Folder {
    fn new() -> Result<Self> {
        let folder = tempfile::tempdir()?;
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shaders");
        for effect in fs::read_dir(&from)? {
            let effect = effect?;
            if !effect.file_type()?.is_dir() {
                continue;
            }
            let to = folder.path().join(effect.file_name());
            fs::create_dir(&to)?;
            for file in fs::read_dir(effect.path())? {
                let file = file?;
                if file.file_type()?.is_file() {
                    fs::copy(file.path(), to.join(file.file_name()))?;
                }
            }
        }
        let sources = Sources::open(folder.path()).context("no shaders")?;
        Ok(Self { _folder: folder, sources })
    }

    fn path(&self, file: &str) -> PathBuf {
        self.sources.folder().join(file)
    }

    /// Writes `to` where a file has `from` for the first time.
    fn edit(&self, file: &str, from: &str, to: &str) -> Result<()> {
        let text = fs::read_to_string(self.path(file))?;
        ensure!(text.contains(from), "{file} has no {from}");
        Ok(fs::write(self.path(file), text.replacen(from, to, 1))?)
    }

    /// The shaders that an edit of this file concerns, compiled.
    fn compile(&self, file: &str) -> Result<Vec<(&'static Shader, Vec<u32>)>> {
        let shaders = self.sources.affected(&BTreeSet::from([file.to_owned()]));
        shaders.into_iter().map(|shader| Ok((shader, self.sources.compile(shader)?))).collect()
    }

    /// Puts what was edited in place; returns the number of pipelines.
    fn reload(&self, gpu: &Gpu, file: &str) -> Result<usize> {
        let reload = gpu.reload(&self.compile(file)?)?;
        let count = reload.pipelines();
        reload.apply()?;
        Ok(count)
    }
}

/// The radiance of frame 0.
fn picture(renderer: &mut Renderer, scene: &Scene) -> Result<Vec<u8>> {
    renderer.restart();
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    let result = renderer.frame(request)?.context("a size of zero")?;
    ensure!(result.findings.is_empty(), "{}", result.findings[0]);
    Ok(result.images.context("no images")?.linear.bytes)
}

fn renderer(gpu: &Gpu, scene: &Scene, rays: Rays) -> Result<Renderer> {
    let options = RenderOptions { width: 48, height: 32, rays, check: true, ..RenderOptions::default() };
    Ok(Renderer::new(gpu, scene, &Slots::default(), &config(&[])?, options)?)
}

/// Every kind of shader is replaced and brought back, and a picture of before is a picture of after, to the last bit.
#[test]
fn edits_of_every_kind_of_shader_are_seen_and_taken_back() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let folder = Folder::new()?;
    for rays in gpu.rays() {
        let mut renderer = renderer(&gpu, &scene, rays)?;
        let before = picture(&mut renderer, &scene)?;
        for (file, from, to) in [
            ("compose/sum.comp", "representable(radiance, ", "representable(radiance * 0.5, "),
            ("gbuffer/draw.frag", "void main() {", "void main() {\n    if (gl_FragCoord.x < 20.0) discard;"),
            (
                "gbuffer/draw.vert",
                "void main() {",
                "void main() {\n    if (gl_VertexIndex % 3 == 0) { gl_Position = vec4(0); return; }",
            ),
            ("shadows/trace.ray", "target, seen)", "target, seen * 0.5)"),
            ("lib/precision.glsl", "float greatest) {", "float greatest) {\n    x *= 0.5;"),
        ] {
            if rays != Rays::Software && !file.ends_with(".ray") {
                continue;
            }
            folder.edit(file, from, to)?;
            let count = folder.reload(&gpu, file)?;
            ensure!(count > 0, "{rays}: no pipeline has {file}");
            ensure!(picture(&mut renderer, &scene)? != before, "{rays}: {file}: nothing is seen of it");
            folder.edit(file, to, from)?;
            ensure!(folder.reload(&gpu, file)? == count, "{rays}: {file}");
            ensure!(picture(&mut renderer, &scene)? == before, "{rays}: {file}: it was not taken back");
        }
    }
    Ok(())
}

/// What Rust relies on cannot change: the size of workgroups, and what push constants hold. Nothing comes of such an edit, nor of a reload that
/// is not applied.
#[test]
fn what_rust_relies_on_is_refused() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let folder = Folder::new()?;
    let mut renderer = renderer(&gpu, &scene, Rays::Software)?;
    let before = picture(&mut renderer, &scene)?;
    let file = "compose/sum.comp";
    let block = "uniform Push { SumParams params; };";
    for (from, to, wanted) in [
        ("local_size_x = 8,", "local_size_x = 16,", "8 x 8 x 1 and is 16 x 8 x 1"),
        (block, "uniform Push { SumParams params; uint more; };", "push constants"),
        (block, "uniform Push { SumParams parameters; };\n#define params parameters", "push constants"),
    ] {
        folder.edit(file, from, to)?;
        let error = gpu.reload(&folder.compile(file)?).err().context("it was taken")?.to_string();
        ensure!(error.contains(file) && error.contains(wanted) && error.contains("built again"), "{error}");
        folder.edit(file, to, from)?;
    }
    folder.edit(file, "vec3 radiance =", "vec3 radiance = nothing +")?;
    let error = folder.compile(file).err().context("it compiled")?.to_string();
    ensure!(error.contains("compose/sum.comp:14") && error.contains("nothing"), "{error}");
    folder.edit(file, "nothing +", "")?;
    folder.edit(file, "representable(radiance, ", "representable(radiance * 0.5, ")?;
    let reload = gpu.reload(&folder.compile(file)?)?;
    ensure!(reload.pipelines() == 1);
    ensure!(picture(&mut renderer, &scene)? == before, "it was seen before it was applied");
    drop(reload);
    ensure!(picture(&mut renderer, &scene)? == before, "it was seen though it was not applied");
    Ok(())
}

/// A shader that was not in use when it was edited runs as edited once it is, also in frames in flight; tables of ray pipelines do not pile up.
#[test]
fn what_comes_into_use_later_is_as_edited() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let folder = Folder::new()?;
    let rays = *gpu.rays().last().context("no way to trace")?;
    let mut renderer = renderer(&gpu, &scene, rays)?;
    let (file, from, to) = ("ao/trace.ray", "vec4(openness(view, pixel))", "vec4(0.5 * openness(view, pixel))");
    folder.edit(file, from, to)?;
    ensure!(folder.reload(&gpu, file)? == 0, "ambient occlusion is traced already");
    renderer.configure(&config(&["stages.ao=ray-traced"])?)?;
    let edited = picture(&mut renderer, &scene)?;
    folder.edit(file, to, from)?;
    ensure!(folder.reload(&gpu, file)? > 0);
    ensure!(picture(&mut renderer, &scene)? != edited, "it ran as it was built");

    // Between frames in flight. What they still use is freed as later frames begin.
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
    let mut bytes = Vec::new();
    for turn in 0..12 {
        let ticket = renderer.submit(request)?.context("a size of zero")?;
        let [old, new] = if turn % 2 == 0 { [from, to] } else { [to, from] };
        folder.edit(file, old, new)?;
        folder.reload(&gpu, file)?;
        drop(ticket);
        if turn % 4 == 3 {
            (0..3).try_for_each(|_| picture(&mut renderer, &scene).map(drop))?;
            bytes.push(gpu.in_use().0);
        }
    }
    ensure!(bytes[1] == bytes[0] && bytes[2] == bytes[0], "bytes after 4, 8 and 12 reloads: {bytes:?}");
    Ok(())
}

/// Pipelines that were made ahead, on another thread while frames go on, are all that a new configuration needs.
#[test]
fn pipelines_are_made_ahead() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut renderer = renderer(&gpu, &scene, Rays::Software)?;
    picture(&mut renderer, &scene)?;
    let wanted = config(&["stages.reflections=high", "post.anti_aliasing=taa"])?;
    let none: PipelineSet = renderer.pipelines_of(&config(&[])?)?;
    ensure!(none.missing(&gpu) == 0, "{} pipelines of the configuration in use", none.missing(&gpu));
    let set = renderer.pipelines_of(&wanted)?;
    ensure!(set.missing(&gpu) > 3, "{} are missing", set.missing(&gpu));
    std::thread::scope(|scope| {
        let made = scope.spawn(|| set.make(&gpu));
        let drawn = (0..3).try_for_each(|_| picture(&mut renderer, &scene).map(drop));
        made.join().map_err(|_| anyhow::anyhow!("it panicked"))??;
        drawn
    })?;
    ensure!(set.missing(&gpu) == 0);
    let before = gpu.pipelines().made();
    renderer.configure(&wanted)?;
    for _ in 0..3 {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        renderer.frame(request)?.context("a size of zero")?;
    }
    let late: Vec<String> = gpu.pipelines().made().into_iter().filter(|name| !before.contains(name)).collect();
    ensure!(late.is_empty(), "made by a frame: {late:?}");
    Ok(())
}
