//! Light at the hits of rays, by the effect of `tests/outside`: without the previous frame's light it is one bounce, as the reference finds
//! it with the same lights and materials but other code for the first surface; with it, all bounces between surfaces on the screen.
#[path = "../outside/bounce.rs"]
mod bounce;

use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie::config::Config;
use magpie::prelude::*;
use magpie::scene::{Scene, SceneFacts};
use magpie::slot::Needs;
use magpie_passes::contracts::{LightingIn, LightingOut};
use magpie_passes::reference::{Only, Reference, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::against::light_and_block_error;
use magpie_tests::harness::{builtin, gpu};

const SIZE: [u32; 2] = [64, 48];
const FRAMES: u32 = 192;

/// An effect without light that asks for the previous frame's.
struct Asks;

impl Effect for Asks {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs { previous_radiance: true, ..Needs::default() }
    }

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: LightingIn) -> LightingOut {
        LightingOut::default()
    }
}

/// Mean over frames of what the effect gathered, before its denoiser.
fn gathered(scene: &Scene, reuse: bool) -> Result<Option<Vec<DVec3>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let mut slots = Slots::default();
    bounce::register(&mut slots);
    slots.reflections.register("asks", "Asks for the previous radiance.", &[], |_, _| Ok(Box::new(Asks)));
    let mut config = Config::default();
    config.set("stages.gi=bounce")?;
    // What one effect asks for, all get: without `reuse` hits must not use it.
    config.set("stages.reflections=asks")?;
    config.set(&format!("gi.reuse={reuse}"))?;
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, scene, &slots, &config, options)?;
    let mut sum = vec![DVec3::ZERO; (SIZE[0] * SIZE[1]) as usize];
    // Bounces add up over the first frames.
    let begin = if reuse { 16 } else { 0 };
    for frame in 0..begin + FRAMES {
        let view = Some(("gi.gather", "noisy"));
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: frame >= begin };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        // Culled where no pass reads it.
        let keeps = result.sample.passes.iter().any(|p| p.name == "previous_radiance.keep");
        ensure!(keeps == reuse, "the previous frame is kept: {keeps}");
        let Some(images) = result.images else { continue };
        for (sum, value) in sum.iter_mut().zip(images.linear.values()) {
            *sum += DVec3::new(f64::from(value[0]), f64::from(value[1]), f64::from(value[2])) / f64::from(FRAMES);
        }
    }
    Ok(Some(sum))
}

/// Indirect diffuse light of the reference, with at most `depth` scatterings.
fn truth(scene: &Scene, depth: u32) -> Result<Vec<DVec3>> {
    let gpu = gpu()?.context("no device")?;
    let options = ReferenceOptions { width: SIZE[0], height: SIZE[1], depth, only: Only::Gi, ..Default::default() };
    let mut reference = Reference::new(&gpu, scene, &scene.cameras[0], options)?;
    reference.add(FRAMES)?;
    Ok(reference.estimate().mean.clone())
}

#[test]
fn one_bounce_is_that_of_the_reference() -> Result<()> {
    // An area light; a sun, lamps and a sky over foliage.
    for name in ["cornell", "courtyard"] {
        let scene = builtin(name)?;
        let Some(found) = gathered(&scene, false)? else { return Ok(()) };
        let [ratio, rmse] = light_and_block_error(&found, &truth(&scene, 2)?, SIZE[0]);
        println!("{name}: mean {ratio:.4} of the truth, rmse of blocks {rmse:.4}");
        ensure!((ratio - 1.0).abs() < 0.02 && rmse < 0.08, "{name}: mean {ratio} of the truth, blocks {rmse}");
    }
    Ok(())
}

#[test]
fn the_previous_frame_brings_all_bounces() -> Result<()> {
    let scene = builtin("cornell")?;
    let (Some(one), Some(all)) = (gathered(&scene, false)?, gathered(&scene, true)?) else { return Ok(()) };
    let truth = truth(&scene, 0)?;
    let ([one_ratio, one_rmse], [ratio, rmse]) =
        (light_and_block_error(&one, &truth, SIZE[0]), light_and_block_error(&all, &truth, SIZE[0]));
    println!("one bounce: mean {one_ratio:.4}, rmse {one_rmse:.4}; with the previous frame: {ratio:.4}, {rmse:.4}");
    // A fifth of the hits is not on the screen, as the backs of the blocks and the floor behind them, and has one bounce.
    let is_closer = rmse < 0.6 * one_rmse && ratio > one_ratio + 0.2 && ratio < 1.02;
    ensure!(is_closer, "{ratio} of the truth, {rmse}; one bounce {one_ratio}, {one_rmse}");
    Ok(())
}
