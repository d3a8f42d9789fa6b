//! What effects ask of a frame: why they are idle in which scenes, and that a frame without an effect equals one in which it is switched off.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie::frame::View;
use magpie::graph::execute::ExecuteError;
use magpie::graph::{FrameGraph, GraphError};
use magpie::prelude::Effect;
use magpie::scene::SceneFacts;
use magpie::slot::Needs;
use magpie_passes::contracts::{LightingIn, LightingOut};
use magpie_passes::{FrameRequest, RenderError, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures;
use magpie_tests::harness::{builtin, config, gpu, linear, render};

#[path = "needs/scenes.rs"]
mod scenes;
use scenes::{EFFECTS, SIZE, plan, reason, scenes, slot, still_life, with_sky};

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

#[test]
fn a_frame_without_an_effect_equals_one_with_it_off() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let cases = [
        (builtin("cornell")?, &["stages.reflections=off", "stages.sky=off", "direct.emitter_rays=0"][..]),
        (with_sky(still_life(fixtures::material([0.9; 3], 1.0, 0.3))), &["stages.gi=off", "direct.emitter_rays=0"]),
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
    let scene = still_life(fixtures::material([0.5; 3], 0.0, 0.6));
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options)?;
    for (factor, runs) in [(1.0, true), (0.0, false), (0.5, true)] {
        renderer.scale_light(0, factor);
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        let frame = renderer.frame(request)?.context("a frame")?;
        let reports = frame.what_runs();
        ensure!(slot(&reports, "shadows")?.runs == runs, "dimmed to {factor}: {:?}", slot(&reports, "shadows")?);
    }
    Ok(())
}

/// Says that it is idle, and adds a pass all the same.
struct FalselyIdle;

impl Effect for FalselyIdle {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs::idle("I feel like it")
    }

    fn add(&mut self, g: &mut FrameGraph, _: &View, _: LightingIn) -> LightingOut {
        g.pass("gi.lie", magpie::graph::Queue::Graphics, |_| ((), |_: &mut magpie::graph::Record<'_>| {}));
        LightingOut::default()
    }
}

#[test]
fn whoever_is_idle_and_adds_a_pass_is_refused() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut slots = Slots::default();
    slots.gi.register("falsely-idle", "Says one thing and does another.", &[], |_, _| Ok(Box::new(FalselyIdle)));
    let options = RenderOptions { width: 8, height: 8, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &slots, &config(&[])?, options)?;
    renderer.swap("gi", "falsely-idle")?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
    let Err(RenderError::Execute(ExecuteError::Declaration(errors))) = renderer.frame(request) else {
        anyhow::bail!("it was believed");
    };
    let said: Vec<String> = errors.0.iter().map(GraphError::to_string).collect();
    ensure!(
        said == ["slot `gi`: \"falsely-idle\" says that it is idle (I feel like it), yet adds the pass `gi.lie`"],
        "{said:?}"
    );
    Ok(())
}
