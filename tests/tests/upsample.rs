//! Upsampling: pixels with a texel of their own keep it, what lies on one surface does not cross to another, and the background has its value.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::config::Config;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::{Scene, SceneFacts};
use magpie::slot::{Build, Needs, SlotError};
use magpie_passes::contracts::{Channel, LightingIn, LightingOut};
use magpie_passes::parts::upsample::{Upsample, UpsampleIn};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::gbuffer::GBufferImages;
use magpie_shaders::{Stage, StorageImage};
use magpie_tests::harness::{builtin, gpu};

/// Odd, so that the last column and row have no neighbour beyond them.
const SIZE: [u32; 2] = [121, 91];
const BACKGROUND: f32 = 31.0;

/// The number of the surface in the upper left one of four pixels.
const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/gbuffer.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { GBufferImages gbuffer; uint result; uvec2 size; };
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (inside(pixel, size)) store(result, pixel, vec4(float(load_uint(gbuffer.ids, 2 * pixel).x)));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    gbuffer: GBufferImages,
    result: StorageImage,
    size: [u32; 2],
}

struct Numbers {
    kernel: Kernel,
    upsample: Upsample,
}

impl Numbers {
    fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        let words = magpie_shaders::compile("numbers.comp", GLSL, Stage::Compute).map_err(SlotError::other)?;
        Ok(Self { kernel: build.kernel_from_words("numbers.comp", &words)?, upsample: Upsample::new(build, "gi")? })
    }
}

impl Effect for Numbers {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs::default()
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let kernel = self.kernel;
        let half_size = g.pass("gi.numbers", Queue::Graphics, |p| {
            let gbuffer = i.gbuffer.read(p, &[Channel::Ids]);
            let desc = ImageDesc::half(Format::Rgba32Float);
            let (image, target) = p.create("half", desc);
            let extent = p.extent_of(desc);
            (image.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                c.dispatch(kernel, &Params { gbuffer: gbuffer.images(c), result: c.id(target), size }, extent);
            })
        });
        let value = ("value", Format::Rgba32Float);
        let i = UpsampleIn { half_size, gbuffer: i.gbuffer, value, direction: None, background: BACKGROUND };
        LightingOut::radiance(self.upsample.add(g, view, i, "").value)
    }
}

fn image(scene: &Scene, view: (&str, &str)) -> Result<Option<Vec<[f32; 4]>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let mut slots = Slots::default();
    slots.gi.register("numbers", "Numbers of surfaces.", &[], |build, _| Ok(Box::new(Numbers::new(build)?)));
    let mut config = Config::default();
    config.set("stages.gi=numbers")?;
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, scene, &slots, &config, options)?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: Some(view), read_back: true };
    let result = renderer.frame(request)?.context("no frame")?;
    ensure!(result.findings.is_empty(), "{}", result.findings[0]);
    Ok(Some(result.images.context("no picture")?.linear.values()))
}

#[test]
fn values_stay_on_their_surface() -> Result<()> {
    let scene = builtin("cornell")?;
    let Some(found) = image(&scene, ("gi.upsample", "value"))? else { return Ok(()) };
    let numbers = image(&scene, ("gbuffer.draw", "ids"))?.context("no device")?;
    let [width, height] = SIZE;
    let at = |x: u32, y: u32| (y * width + x) as usize;
    let (mut at_edges, mut wrong) = (0, 0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let (own, found) = (numbers[at(x, y)][0], found[at(x, y)][0]);
        if own == 0.0 {
            ensure!(found == BACKGROUND, "pixel {x}, {y}: background is {found}");
        } else if x % 2 == 0 && y % 2 == 0 {
            ensure!(found == own, "pixel {x}, {y}: {found}, its own texel has {own}");
        } else {
            let (xs, ys) = (x & !1..=(x + (x & 1)).min(width - 1), y & !1..=(y + (y & 1)).min(height - 1));
            let around = ys.flat_map(|y| xs.clone().map(move |x| (x, y))).filter(|(x, y)| x % 2 == 0 && y % 2 == 0);
            let around: Vec<f32> = around.map(|(x, y)| numbers[at(x, y)][0]).collect();
            if around.contains(&own) {
                at_edges += usize::from(around.iter().any(|n| *n != own));
                wrong += usize::from((found - own).abs() > 0.05);
            }
        }
    }
    println!("{at_edges} pixels between texels of several surfaces, {wrong} took from another than their own");
    // Where surfaces touch, a texel of the other one lies on the pixel's plane too.
    ensure!(at_edges > 200 && wrong * 4 < at_edges, "{wrong} of {at_edges}");
    Ok(())
}
