//! PoisonValue values do not persist: every output of every pass is overwritten with NaN and infinity in one frame, and 30 frames later no image
//! contains any, for any implementation of the slots. Values that histories reject are counted, and `--check` still names the origin.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DMat3, DVec3, Vec3};
use magpie::config::{Config, Value};
use magpie::gpu::Gpu;
use magpie::graph::check::{Place, Poison, PoisonValue};
use magpie::graph::{Format, Shape};
use magpie::measure::Recorder;
use magpie::scene::{AlphaMode, Light, Material, Scene, Sphere};
use magpie::slot::{Range, SlotInfo};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_shaders::scene as shared;
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene, sun};
use magpie_tests::harness::{config, gpu};
use std::collections::{BTreeMap, BTreeSet};
use std::env;
use std::mem::offset_of;
use std::time::Instant;

const SIZE: [u32; 2] = [64, 36];
/// The second frame that is poisoned, when histories have contents.
const SPOILT: u32 = 3;
/// Number of frames after which nothing may be left.
const HEALED: u32 = 30;
/// Parts of the names of passes that keep or average values, and must count those that they reject.
const COUNTS: [&str; 7] =
    [".accumulate", ".bilateral", "gi.light", "post.taa", ".map_look", "post.tone_map", ".filter_probe"];

/// A floor with a block, a ball and a pane of coloured glass, lit by a sun, a sphere light, sky and an emissive panel.
fn room() -> Scene {
    let mut s = scene("room", camera([0.0, 1.6, 3.4], [0.0, 0.3, 0.0]));
    let at = |x: f32, y: f32, z: f32| Affine3A::from_translation(Vec3::new(x, y, z));
    add(&mut s, plane(4.0), material([0.8; 3], 0.0, 0.8), at(0.0, 0.0, 0.0));
    add(&mut s, block(Vec3::new(0.3, 0.4, 0.3)), material([0.8, 0.4, 0.2], 0.0, 0.5), at(-0.6, 0.4, 0.0));
    let ball = Sphere { centre: Vec3::new(0.5, 0.3, 0.2), radius: 0.3 };
    let balls = magpie::scene::Mesh { name: "ball".to_owned(), spheres: vec![ball], ..Default::default() };
    add(&mut s, balls, material([0.9; 3], 1.0, 0.3), Affine3A::IDENTITY);
    let glass = Material { alpha: AlphaMode::Blend, double_sided: true, ..material([0.9, 0.2, 0.3], 0.0, 0.5) };
    let glass = Material { base_colour: glass.base_colour.truncate().extend(0.4), ..glass };
    add(&mut s, plane(0.4), glass, at(0.4, 0.9, 0.4));
    let panel = Material { emission: Vec3::new(6.0, 5.0, 3.0), double_sided: true, ..material([0.5; 3], 0.0, 1.0) };
    add(&mut s, plane(0.2), panel, at(-0.4, 1.2, -0.6));
    let Light::Directional { direction, illuminance, .. } = sun(Vec3::new(0.4, 1.0, 0.3)) else { return s };
    s.lights.push(Light::Directional { direction, illuminance, angular_radius: 0.03 });
    s.lights.push(Light::Sphere { centre: DVec3::new(0.9, 1.4, 0.9), radius: 0.15, radiance: Vec3::splat(9.0) });
    s.environment = Some(environment());
    s
}

/// A configuration, and whether the camera turns, so that histories are read between their pixels.
struct Case {
    changes: Vec<String>,
    turns: bool,
}

fn case(changes: &[&str], turns: bool) -> Case {
    Case { changes: changes.iter().map(|c| (*c).to_owned()).collect(), turns }
}

/// A few configurations that include every pass of the frame.
fn few() -> Vec<Case> {
    let svgf = ["stages.ao=ray-traced", "post.anti_aliasing=taa", "shadows.precision=32", "ao.precision=32"];
    vec![
        case(&svgf, false),
        case(&["stages.reflections=screen-space"], true),
        case(&["stages.gi=surfels", "gi.surfels=4096"], true),
        case(&["stages.gi=ray-traced"], true),
        case(&["stages.gi=screen-space", "gi.resolution=half", "post.anti_aliasing=taa"], true),
        case(&["stages.reflections=screen-space", "reflections.lobe=cone", "reflections.resolution=half"], true),
        case(
            &["stages.reflections=ray-traced", "reflections.pixels_per_ray=4", "reflections.denoiser=pica-pica"],
            true,
        ),
        case(&["stages.reflections=hybrid", "reflections.budget=0.25"], true),
        case(&["stages.reflections=hybrid", "reflections.roughness_limit=0.5", "reflections.fallback=probe"], true),
        case(&["stages.ao=ray-traced", "shadows.tinted=false", "post.resolution_scale=0.67", svgf[1]], true),
        case(
            &[
                "ao.resolution=half",
                "shadows.resolution=half",
                "shadows.denoiser=bilateral",
                "direct.denoiser=bilateral",
                "post.resolution_scale=0.67",
                "post.sharpening=0.5",
            ],
            false,
        ),
        case(
            &[
                "stages.shadows=shadow-map",
                "shadows.filter=pcss",
                "shadows.map_size=512",
                "shadows.lamp_map_size=512",
                "gbuffer.precision=full",
                "post.anti_aliasing=taa",
            ],
            false,
        ),
        case(
            &[
                "stages.reflections=ray-traced",
                "reflections.denoiser=recurrent-blur",
                "reflections.pixels_per_ray=4",
                "stages.ao=ray-traced",
                "ao.denoiser=recurrent-blur",
                "shadows.denoiser=recurrent-blur",
            ],
            true,
        ),
        case(&["stages.reflections=probe", "reflections.resolution=16", "post.anti_aliasing=taa"], false),
        case(
            &["stages.shadows=hybrid", "shadows.map_size=512", "shadows.lamp_map_size=512", "post.anti_aliasing=none"],
            false,
        ),
    ]
}

/// Every implementation and preset of every slot in several display modes, and every named value of their settings.
fn all() -> Vec<Case> {
    let ways: [&[&str]; 3] = [
        &["post.anti_aliasing=taa"],
        &["post.anti_aliasing=taa", "post.resolution_scale=0.5", "post.sharpening=1"],
        &["post.anti_aliasing=none", "post.resolution_scale=0.67"],
    ];
    let mut cases = few();
    for SlotInfo { name: slot, implementations, presets, .. } in Slots::default().infos() {
        let mut choices: BTreeSet<Vec<String>> = BTreeSet::new();
        choices.extend(presets.iter().map(|p| vec![format!("stages.{slot}={}", p.name)]));
        for implementation in implementations {
            let chosen = format!("stages.{slot}={}", implementation.name);
            choices.insert(vec![chosen.clone()]);
            for setting in &implementation.settings {
                let names: Vec<String> = match (&setting.range, &setting.default) {
                    (Range::OneOf(names), _) => names.iter().map(|n| (*n).to_owned()).collect(),
                    (_, Value::Bool(_)) => vec!["true".to_owned(), "false".to_owned()],
                    _ => Vec::new(),
                };
                choices.extend(names.iter().map(|n| vec![chosen.clone(), format!("{slot}.{}={n}", setting.key)]));
            }
        }
        for (at, choice) in choices.into_iter().enumerate() {
            // Implementations and presets in all display modes, settings in one of them.
            let shown = |number: &usize| choice.len() == 1 || at % ways.len() == *number;
            for (number, way) in ways.iter().enumerate().filter(|(number, _)| shown(number)) {
                let own = way.iter().filter(|w| !choice.iter().any(|c| c.split('=').next() == w.split('=').next()));
                let changes = own.map(|w| (*w).to_owned()).chain(choice.clone()).collect();
                cases.push(Case { changes, turns: (at + number) % 2 == 1 });
            }
        }
    }
    cases
}

struct Run<'a> {
    renderer: Renderer,
    scene: &'a Scene,
    turns: bool,
    frame: u32,
}

impl Run<'_> {
    fn frame(&mut self) -> Result<FrameResult> {
        let mut camera = self.scene.cameras[0].clone();
        if self.turns {
            camera.world_from_camera.matrix3 *= DMat3::from_rotation_y(0.004 * f64::from(self.frame));
        }
        self.frame += 1;
        let request = FrameRequest { camera: &camera, time: 0.0, view: None, read_back: false };
        self.renderer.frame(request)?.context("a size of zero")
    }

    fn restart(&mut self) {
        self.renderer.restart();
        self.frame = 0;
    }
}

/// NaN and infinity for every output of a frame that can hold them, each at its own place; shadow maps at many places, as the picture reads
/// little of them.
fn poisons(result: &FrameResult) -> Vec<[Poison; 2]> {
    let FrameResult { declaration, plan, .. } = result;
    let passes = plan.order.iter().copied().filter(|&p| !declaration.passes[p as usize].weak);
    let mut found = Vec::new();
    for pass in passes {
        for output in declaration.outputs_of(pass) {
            let Shape::Image { format, extent, .. } = declaration.resources[output.resource as usize].shape else {
                continue;
            };
            if !format.is_float() {
                continue;
            }
            let writes = |u: &&magpie::graph::Use| u.resource == output.resource && u.writes == Some(output.version);
            // Of a pass that writes several mips, the last.
            let (mip, layer) = declaration
                .uses_of(pass)
                .iter()
                .find(writes)
                .map_or((0, 0), |u| (u.part.mip.into(), u.part.layer.into()));
            let poison = |x: u32, y: u32, value| {
                let place = Place::Pixel { x, y, mip, layer };
                Poison { pass: declaration.pass_name(pass).to_owned(), output: output.name.clone(), place, value }
            };
            let is_map = format == Format::D32Float && declaration.pass_name(pass).contains(".map_");
            // The lower two thirds of the picture show surfaces.
            let number = found.len() as u32;
            let (width, height) = (extent.mip(mip).width, extent.mip(mip).height);
            let places: Vec<[u32; 2]> = if is_map {
                (0..64).map(|k| [k % 8, k / 8].map(|n| (2 * n + 1) * width / 16)).collect()
            } else {
                let x = |k: u32| (7 + 23 * number + k * width / 2) % width;
                let y = |k: u32| height - 1 - (3 + 5 * number + 11 * k) % (2 * height / 3).max(1);
                vec![[x(0), y(0)]]
            };
            for [x, y] in places {
                let across = (x + width / 2) % width;
                found.push([poison(x, y, PoisonValue::Nan), poison(across, y, PoisonValue::Infinity)]);
            }
        }
    }
    found
}

/// Result of one run.
#[derive(Default)]
struct Left {
    /// Frames from the last poisoned one until the scan found nothing.
    healed_after: u32,
    /// Number of rejected values by pass.
    counted: BTreeMap<String, u64>,
}

/// Runs from the first frame, poisons two frames, and scans all images of every frame until they have to be clean. Without `whole` it stops
/// early after several clean frames.
fn run(run: &mut Run<'_>, spoilt: [&[[Poison; 2]]; 2], whole: bool) -> Result<Left> {
    run.restart();
    let mut recorder = Recorder::new(0);
    let mut left = Left::default();
    let last = if spoilt[1].is_empty() { 0 } else { SPOILT };
    for frame in 0..=last + HEALED {
        let now = match frame {
            0 => spoilt[0],
            SPOILT => spoilt[1],
            _ => &[],
        };
        now.iter().flatten().for_each(|p| run.renderer.poison(p.clone()));
        let result = run.frame()?;
        recorder.push(result.sample);
        if !result.findings.is_empty() {
            left.healed_after = (frame + 1).saturating_sub(last);
            ensure!(frame < last + HEALED, "left after {HEALED} frames: {}", result.findings[0]);
        } else if frame > last + 2 && !whole && frame >= last + left.healed_after + 4 {
            break; // after several clean frames nothing can reappear
        }
        ensure!(now.is_empty() || !result.findings.is_empty(), "frame {frame} was spoilt and nothing was found");
    }
    left.counted = recorder.not_finite().iter().map(|n| (n.pass.clone(), n.values)).collect();
    Ok(left)
}

/// Poisons every output of every pass in one frame; with `full` for all frames after it, with `singly` also each output alone. Returns the
/// names of the poisoned passes.
fn heals(gpu: &Gpu, scene: &Scene, case: &Case, full: bool, singly: bool) -> Result<BTreeSet<String>> {
    let start = Instant::now();
    let changes: Vec<&str> = case.changes.iter().map(String::as_str).collect();
    let config: Config = config(&changes)?;
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], seed: 0, check: true, ..RenderOptions::default() };
    let renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
    let mut all = Run { renderer, scene, turns: case.turns, frame: 0 };
    // Shadow maps are drawn in the first frame only, and histories exist in later ones.
    let first = poisons(&all.frame()?);
    for _ in 1..SPOILT {
        all.frame()?;
    }
    let later = all.frame()?;
    ensure!(later.findings.is_empty(), "{}", later.findings[0]);
    let counts: Vec<String> = later.sample.passes.iter().map(|p| p.name.clone()).collect();
    let later = poisons(&later);

    let Left { healed_after, counted } = run(&mut all, [&first, &later], full)?;
    println!(
        "{:.1} s, {changes:?}: {} places, clean after {healed_after} frames, left out {counted:?}",
        start.elapsed().as_secs_f64(),
        first.len() + later.len()
    );
    for pass in counts.iter().filter(|p| !p.starts_with("check.") && COUNTS.iter().any(|c| p.contains(c))) {
        // An input limited to 0 to 1 cannot hold a bad value, nor can a history of 16 bits.
        let exact = |slot: &str| case.changes.iter().any(|c| *c == format!("{slot}.precision=32"));
        let bounded = (pass.contains(".bilateral") && !pass.starts_with("direct."))
            || (pass.starts_with("shadows.accumulate") && !exact("shadows"))
            || (pass == "reflections.accumulate_confidence" && !exact("reflections"));
        // One texel per pixel may miss all that are bad; the preset `low` reads no more.
        let one_texel = |c: &String| c == "shadows.filter=none" || c == "stages.shadows=low";
        let unread = pass.contains(".map_look") && case.changes.iter().any(one_texel);
        ensure!(bounded || unread || counted.contains_key(pass), "{pass} left out nothing: {counted:?}");
    }
    let has_history = |pass: &str| pass.contains(".accumulate") || pass == "post.taa";
    if singly {
        for poison in &later {
            let Left { counted, .. } = run(&mut all, [&[], std::slice::from_ref(poison)], false)
                .with_context(|| format!("{}:{} alone", poison[0].pass, poison[0].output))?;
            if has_history(&poison[0].pass) && poison[0].output.ends_with(".next") {
                ensure!(counted.contains_key(&poison[0].pass), "{}: {counted:?}", poison[0].pass);
            }
        }
    }
    Ok(first.iter().chain(&later).map(|p| p[0].pass.clone()).collect())
}

/// The cases with their numbers; of those only the I-th of N parts where `MAGPIE_PART` is I/N, for several machines or processes. `None` for
/// anything else in it.
fn part(cases: &[Case]) -> Option<impl Iterator<Item = (usize, &Case)>> {
    let (index, count) = match env::var("MAGPIE_PART") {
        Err(_) => (1, 1),
        Ok(text) => {
            text.split_once('/').and_then(|(i, n)| Some((i.parse::<usize>().ok()?, n.parse::<usize>().ok()?)))?
        }
    };
    let first = |part: usize| part * cases.len() / count.max(1);
    let range = (1..=count).contains(&index).then(|| first(index - 1)..first(index))?;
    Some(cases.iter().enumerate().skip(range.start).take(range.len()))
}

#[test]
fn no_bad_value_outlives_its_frame_for_long() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, full) = (room(), env::var_os("MAGPIE_FULL").is_some());
    let (mut passes, mut failed) = (BTreeSet::new(), Vec::new());
    let cases = if full { all() } else { few() };
    for (number, case) in part(&cases).context("MAGPIE_PART: wanted I/N, such as 2/3")? {
        let singly = full && number < 2;
        match heals(&gpu, &scene, case, full, singly) {
            Ok(spoilt) => passes.extend(spoilt),
            Err(error) => failed.push(format!("{:?}: {error:#}", case.changes)),
        }
    }
    ensure!(failed.is_empty(), "{} cases:\n{}", failed.len(), failed.join("\n"));
    println!("spoilt: {passes:?}");
    if env::var_os("MAGPIE_PART").is_some() {
        return Ok(());
    }
    for pass in
        ["gbuffer.draw", "shadows.accumulate", "ao.accumulate", "direct.accumulate", "direct.bilateral", "post.taa"]
    {
        ensure!(passes.contains(pass), "{pass} was not spoilt: {passes:?}");
    }
    Ok(())
}

/// The tables of instances and lights are only written when something changes, here when a light is dimmed: a bad word in them affects
/// every frame from then on.
#[test]
fn what_is_made_once_is_made_anew() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = room();
    let after = |at: usize, bytes: usize| at.next_multiple_of(16) + bytes;
    let instances = size_of::<shared::Scene>().next_multiple_of(16);
    let lights = after(instances, scene.instances.len() * size_of::<shared::Instance>()).next_multiple_of(16);
    let sun = (lights + offset_of!(shared::Light, intensity)) as u64 / 4;
    for anti_aliasing in ["taa", "none"] {
        let changes = ["stages.ao=off", "direct.emitter_rays=0", &format!("post.anti_aliasing={anti_aliasing}")];
        let options =
            RenderOptions { width: SIZE[0], height: SIZE[1], seed: 0, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&changes)?, options)?;
        let (mut written, mut bad) = (Vec::new(), Vec::new());
        for frame in 0..6 {
            if frame == 1 {
                renderer.scale_light(0, 0.9);
                let (pass, output) = ("scene.update".to_owned(), "scene.state".to_owned());
                renderer.poison(Poison { pass, output, place: Place::Element(sun), value: PoisonValue::Nan });
            }
            let camera = &scene.cameras[0];
            let result = renderer.frame(FrameRequest { camera, time: 0.0, view: None, read_back: false })?;
            let result = result.context("a size of zero")?;
            if result.sample.passes.iter().any(|p| p.name == "scene.update") {
                written.push(frame);
            }
            if !result.findings.is_empty() {
                bad.push(frame);
            }
        }
        println!("{anti_aliasing}: tables written in frames {written:?}, bad values in {bad:?}");
        ensure!(written == [1, 2] && bad == [1], "{anti_aliasing}: written in {written:?}, bad in {bad:?}");
    }
    Ok(())
}
