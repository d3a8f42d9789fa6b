//! What effects ask of a frame: why they are idle in which scenes, that idle ones take nothing, and that a frame without an effect equals
//! one in which it is switched off.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::config::Config;
use magpie::frame::View;
use magpie::graph::execute::ExecuteError;
use magpie::graph::{Extent, FrameGraph, GraphError};
use magpie::measure::SlotReport;
use magpie::prelude::{Effect, Rays};
use magpie::scene::{Light, Material, Scene, SceneFacts};
use magpie::slot::Needs;
use magpie_passes::contracts::{IndirectIn, IndirectOut};
use magpie_passes::{FramePlan, FrameRequest, RenderError, RenderOptions, Renderer, Slots, plan_frame};
use magpie_tests::harness::{builtin, config, gpu, linear, render};
use magpie_tests::made;

const SIZE: [u32; 2] = [64, 36];

/// A ball on a plane of this material, under a sun, without a sky.
fn still_life(material: Material) -> Scene {
    let mut scene = made::scene("still life", made::camera(DVec3::new(0.0, 1.5, 4.0), DVec3::ZERO));
    made::add(&mut scene, made::plane(4.0), material.clone(), Affine3A::IDENTITY);
    made::add(&mut scene, made::sphere(12), material, Affine3A::from_translation(Vec3::Y));
    scene.lights.push(made::sun(Vec3::new(0.3, 1.0, 0.4).normalize()));
    scene
}

fn with_sky(mut scene: Scene) -> Scene {
    scene.environment = Some(made::environment());
    scene
}

fn plan(scene: &Scene, changes: &[&str]) -> Result<FramePlan> {
    let extent = Extent::new(SIZE[0], SIZE[1]);
    Ok(plan_frame(scene, &scene.cameras[0], (&Slots::default(), &config(changes)?), Rays::Software, extent)?)
}

fn slot<'a>(slots: &'a [SlotReport], name: &str) -> Result<&'a SlotReport> {
    slots.iter().find(|report| report.slot == name).with_context(|| format!("no slot {name}"))
}

/// `None` where it runs.
fn reason(plan: &FramePlan, name: &str) -> Result<Option<String>> {
    if let Some((slot_name, part_name)) = name.split_once('.') {
        let parts = &slot(&plan.slots, slot_name)?.parts;
        let part = parts.iter().find(|part| part.part == part_name).with_context(|| format!("no part {name}"))?;
        return Ok(part.reason.as_ref().map(|reason| reason.clone().into_owned()));
    }
    let report = slot(&plan.slots, name)?;
    ensure!(report.runs == report.reason.is_none(), "{report:?}");
    Ok(report.reason.as_ref().map(|reason| reason.clone().into_owned()))
}

const NO_SKY: Option<&str> = Some("the scene has no sky");
const NO_LIGHT: Option<&str> = Some("no light shines");
const NO_SURFACE: Option<&str> = Some("there is no surface");
const NO_EMITTER: Option<&str> = Some("no material emits");
const UNUSED: Option<&str> = Some("nothing reads what it makes");

/// Shadows, ao, emitters, gi, reflections, sky: why each is idle.
type Reasons = [Option<&'static str>; 6];
const EFFECTS: [&str; 6] = ["shadows", "ao", "direct.emitters", "gi", "reflections", "sky"];

fn scenes() -> Result<Vec<(&'static str, Scene, Reasons)>> {
    let matte = || made::material([0.5; 3], 0.0, 0.6);
    let metal = || made::material([0.9; 3], 1.0, 0.3);
    let glass = Material { transmission: 1.0, roughness: 0.0, ..made::material([1.0; 3], 0.0, 0.0) };
    let lambert = Material { specular: 0.0, ..matte() };
    let glowing = Material { emission: Vec3::splat(4.0), ..matte() };
    let mut dark = still_life(glowing);
    dark.lights.clear();
    let mut unlit = still_life(matte());
    unlit.lights.clear();
    let mut black = still_life(matte());
    black.environment = Some(magpie::scene::Environment { scale: 0.0, ..made::environment() });
    let mut switched_off = still_life(matte());
    switched_off.lights = vec![Light::Point { position: DVec3::Y, intensity: Vec3::ZERO, range: None }];
    let empty = made::scene("empty", made::camera(DVec3::Z, DVec3::ZERO));
    Ok(vec![
        ("courtyard", builtin("courtyard")?, [None, None, NO_EMITTER, None, None, None]),
        ("carousel", builtin("carousel")?, [None, None, NO_EMITTER, None, None, None]),
        ("cornell", builtin("cornell")?, [None, UNUSED, NO_EMITTER, NO_SKY, NO_SKY, NO_SKY]),
        ("a sun", still_life(matte()), [None, UNUSED, NO_EMITTER, NO_SKY, NO_SKY, NO_SKY]),
        ("no lights", unlit, [NO_LIGHT, UNUSED, NO_EMITTER, NO_SKY, NO_SKY, NO_SKY]),
        ("emission alone", dark, [NO_LIGHT, UNUSED, None, NO_SKY, NO_SKY, NO_SKY]),
        ("a lamp of no strength", switched_off, [NO_LIGHT, UNUSED, NO_EMITTER, NO_SKY, NO_SKY, NO_SKY]),
        ("a black sky", black, [None, UNUSED, NO_EMITTER, NO_SKY, NO_SKY, NO_SKY]),
        ("metal", with_sky(still_life(metal())), [None, None, NO_EMITTER, Some("all surfaces are metal"), None, None]),
        (
            "Lambert",
            with_sky(still_life(lambert)),
            [None, None, NO_EMITTER, None, Some("no surface has a specular reflection"), None],
        ),
        ("glass", with_sky(still_life(glass)), [None, None, NO_EMITTER, None, None, None]),
        ("empty", with_sky(empty), [NO_LIGHT, NO_SURFACE, NO_EMITTER, NO_SURFACE, NO_SURFACE, None]),
    ])
}

#[test]
fn each_scene_has_what_it_calls_for_and_says_why_not_the_rest() -> Result<()> {
    for (name, scene, reasons) in scenes()? {
        let plan = plan(&scene, &[]).with_context(|| name.to_owned())?;
        for (effect, wanted) in EFFECTS.iter().zip(reasons) {
            let got = reason(&plan, effect)?;
            ensure!(got.as_deref() == wanted, "{name}: {effect} {got:?}, wanted {wanted:?}");
        }
    }
    Ok(())
}

#[test]
fn what_is_switched_off_says_so() -> Result<()> {
    let scene = builtin("courtyard")?;
    let all_off = EFFECTS.iter().filter(|e| !e.contains('.')).map(|e| format!("stages.{e}=off")).collect::<Vec<_>>();
    let plan = plan(&scene, &all_off.iter().map(String::as_str).collect::<Vec<_>>())?;
    for effect in EFFECTS.iter().filter(|e| !e.contains('.')) {
        ensure!(reason(&plan, effect)?.as_deref() == Some("switched off"), "{effect}");
    }
    ensure!(reason(&plan, "compose")?.as_deref() == Some("nothing to do in this frame"), "there is nothing to add");
    Ok(())
}

/// On a device: idle slots have no pass, no pipeline, no bytes, and the plan without a device is that of the frame that ran. One test, since
/// pipelines belong to the device, which tests of one process share.
#[test]
fn what_is_idle_takes_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // From few effects to many: a pipeline of an effect that was idle before must not have been made.
    let mut scenes = scenes()?;
    scenes.retain(|(name, ..)| *name != "carousel"); // it moves, which a plan without a device leaves out
    scenes.sort_by_key(|(_, _, reasons)| reasons.iter().filter(|reason| reason.is_none()).count());
    let mut ran = std::collections::BTreeSet::<String>::new();
    for (name, scene, _) in scenes {
        let frame = render(&gpu, &scene, &config(&[])?, SIZE, 3, None).with_context(|| name.to_owned())?;
        let (planned, reports) = (plan(&scene, &[])?, frame.what_runs());
        for (planned, report) in planned.slots.iter().zip(&reports) {
            let passes = |r: &SlotReport| r.passes.clone();
            ensure!(passes(planned) == passes(report), "{name}: planned {planned:?}, ran {report:?}");
            ensure!((planned.bytes, planned.transient_bytes) == (report.bytes, report.transient_bytes), "{name}");
            if report.runs {
                ran.insert(report.slot.clone());
                continue;
            }
            let SlotReport { bytes, transient_bytes, history_bytes, passes, .. } = report;
            ensure!(passes.is_empty() && [*bytes, *transient_bytes, *history_bytes] == [0; 3], "{name}: {report:?}");
        }
        for slot in ["shadows", "ao", "direct", "gi", "reflections", "compose", "sky"] {
            let made = gpu.pipelines().made().iter().any(|pipeline| pipeline.starts_with(&format!("{slot}/")));
            ensure!(made == ran.contains(slot), "{name}: pipelines of {slot}: {:?}", gpu.pipelines().made());
        }
    }
    ensure!(ran.len() >= 9, "{ran:?}");
    Ok(())
}

#[test]
fn a_frame_without_an_effect_equals_one_with_it_off() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let cases = [
        (builtin("cornell")?, &["stages.gi=off", "stages.reflections=off", "stages.sky=off", "stages.ao=off"][..]),
        (with_sky(still_life(made::material([0.9; 3], 1.0, 0.3))), &["stages.gi=off", "direct.emitter_rays=0"]),
    ];
    for (scene, off) in cases {
        let [whole, without] = [&[][..], off].map(|changes| render(&gpu, &scene, &config(changes)?, SIZE, 3, None));
        let (whole, without) = (whole?, without?);
        let names = |frame: &magpie_passes::FrameResult| -> Vec<String> {
            frame.sample.passes.iter().map(|pass| pass.name.clone()).collect()
        };
        ensure!(names(&whole) == names(&without), "{}: {:?}, {:?}", scene.name, names(&whole), names(&without));
        ensure!(whole.sample.memory == without.sample.memory, "{}", scene.name);
        ensure!(linear(whole)?.values() == linear(without)?.values(), "{}: the pictures differ", scene.name);
    }
    Ok(())
}

/// A lamp that is switched off while frames go on takes its shadows with it, and brings them back.
#[test]
fn facts_follow_the_scene() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = still_life(made::material([0.5; 3], 0.0, 0.6));
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options)?;
    for (factor, runs) in [(1.0, true), (0.0, false), (0.5, true)] {
        renderer.dim(0, factor);
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        let frame = renderer.frame(request)?.context("a frame")?;
        let reports = frame.what_runs();
        ensure!(slot(&reports, "shadows")?.runs == runs, "dimmed to {factor}: {:?}", slot(&reports, "shadows")?);
    }
    Ok(())
}

/// Says that it is idle, and adds a pass all the same.
struct Liar;

impl Effect for Liar {
    type In = IndirectIn;
    type Out = IndirectOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs::idle("I feel like it")
    }

    fn add(&mut self, g: &mut FrameGraph, _: &View, _: IndirectIn) -> IndirectOut {
        g.pass("gi.lie", magpie::graph::Queue::Graphics, |_| ((), |_: &mut magpie::graph::Record<'_>| {}));
        IndirectOut { radiance: None }
    }
}

#[test]
fn whoever_is_idle_and_adds_a_pass_is_refused() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut slots = Slots::default();
    slots.gi.register("liar", "Says one thing and does another.", &[], |_, _| Ok(Box::new(Liar)));
    let options = RenderOptions { width: 8, height: 8, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &slots, &config(&[])?, options)?;
    renderer.swap("gi", "liar")?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
    let Err(RenderError::Execute(ExecuteError::Declaration(errors))) = renderer.frame(request) else {
        anyhow::bail!("it was believed");
    };
    let said: Vec<String> = errors.0.iter().map(GraphError::to_string).collect();
    ensure!(
        said == ["slot `gi`: \"liar\" says that it is idle (I feel like it), yet adds the pass `gi.lie`"],
        "{said:?}"
    );
    Ok(())
}
