//! The previous frame's radiance: there for effects that ask for it, with what the previous frame showed, and nothing where none asks.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::Needs;
use magpie_passes::contracts::{LightingIn, LightingOut};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};

const KEEP: &str = "previous_radiance.keep";

/// Gives the previous radiance as its light.
struct Echo;

impl Effect for Echo {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs { previous_radiance: true, ..Needs::default() }
    }

    fn add(&mut self, _: &mut FrameGraph, _: &View, i: LightingIn) -> LightingOut {
        i.previous_radiance.map_or_else(LightingOut::default, LightingOut::radiance)
    }
}

#[test]
fn it_is_the_frame_before_and_nothing_in_the_first() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut slots = Slots::default();
    slots.reflections.register("echo", "The previous frame.", &[], |_, _| Ok(Box::new(Echo)));
    let frames = |slots: &Slots, config: &Config| -> Result<Vec<Vec<[f32; 4]>>> {
        let options = RenderOptions { width: 48, height: 27, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, slots, config, options)?;
        let mut all = Vec::new();
        for _ in 0..3 {
            let camera = &scene.cameras[0];
            let result = renderer.frame(FrameRequest { camera, time: 0.0, view: None, read_back: true })?;
            let result = result.context("no frame")?;
            ensure!(result.findings.is_empty(), "{:?}", result.findings);
            let keeps = result.sample.passes.iter().any(|p| p.name == KEEP);
            ensure!(keeps == (config.stages.get("reflections").map(String::as_str) == Some("echo")), "{keeps}");
            all.push(result.images.context("no picture")?.linear.values());
        }
        Ok(all)
    };
    let hard = ["shadows.edges=hard", "direct.area=0", "stages.gi=off"];
    let plain = frames(&Slots::default(), &config(&hard)?)?;
    let mut echo = config(&hard)?;
    echo.set("stages.reflections=echo")?;
    let echoed = frames(&slots, &echo)?;
    // Each frame adds the one before: once, twice, three times the light of a frame, to the rounding of 16 bits.
    let mut lit = 0;
    for (frame, (plain, echoed)) in (1_u8..).zip(plain.iter().zip(&echoed)) {
        for (one, sum) in plain.iter().zip(echoed) {
            for channel in 0..3 {
                let wanted = f32::from(frame) * one[channel];
                ensure!((sum[channel] - wanted).abs() <= 2e-3 * wanted, "frame {frame}: {} not {wanted}", sum[channel]);
                lit += u32::from(wanted > 0.0);
            }
        }
    }
    ensure!(lit > 3000, "{lit} channels are lit");
    Ok(())
}
