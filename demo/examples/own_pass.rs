//! A pass of one's own, added from outside the engine: a vignette after the tone map.
//!
//! `cargo run --release -p magpie-demo --example own_pass -- vignette.png post.exposure=-1`
use bytemuck::{Pod, Zeroable};
use magpie::config::Config;
use magpie::gpu::{GpuOptions, Kernel};
use magpie::prelude::*;
use magpie::slot::{BoxedEffect, Build, SettingSpec, Settings, SlotError};
use magpie_passes::contracts::{PostIn, PostOut};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::{SampledImage, Stage, StorageImage};

/// Any GLSL will do; `lib/` and `shared/` of Magpie's own shaders can be included.
const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint source; uint result; uvec2 size; float strength; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(size)))) return;
    vec2 from_centre = (vec2(pixel) + 0.5) / vec2(size) - 0.5;
    float light = 1.0 - 2.0 * strength * dot(from_centre, from_centre);
    store(result, pixel, load(source, pixel) * vec4(vec3(light), 1.0));
}
"#;

/// The push constants, field by field as in the shader.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    source: SampledImage,
    result: StorageImage,
    size: [u32; 2],
    strength: f32,
}

/// The standard `post`, then a vignette.
struct Vignette {
    standard: BoxedEffect<PostIn, PostOut>,
    darken: Kernel,
    strength: f32,
}

impl Vignette {
    fn new(build: &Build<'_>, settings: &Settings, standard: BoxedEffect<PostIn, PostOut>) -> Result<Self, SlotError> {
        let words = magpie_shaders::compile("vignette.comp", GLSL, Stage::Compute).map_err(SlotError::other)?;
        let darken = build.kernel_from_words("vignette.comp", &words)?;
        Ok(Self { standard, darken, strength: settings.f32("vignette")? })
    }
}

impl Effect for Vignette {
    type In = PostIn;
    type Out = PostOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, input: PostIn) -> PostOut {
        let PostOut { radiance, display: bright } = self.standard.add(g, view, input);
        let (darken, strength) = (self.darken, self.strength);
        let display = g.pass("post.vignette", Queue::Graphics, |p| {
            let source = p.sample(bright);
            let (display, result) = p.create("display", p.desc(bright));
            let extent = p.extent(bright);
            (display.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = Params { source: c.id(source), result: c.id(result), size, strength };
                c.dispatch(darken, &params, extent);
            })
        });
        PostOut { radiance, display }
    }
}

/// Magpie's slots with the vignette among them, and a configuration that chooses it.
pub fn slots_with_vignette(strength: f32) -> anyhow::Result<(Slots, Config)> {
    let mut slots = Slots::default();
    let about = "Higher is darker: the corners lose this share of their light.";
    let settings = [SettingSpec::float("vignette", "", about, 0.5, 0.0..=1.0)];
    let line = "The standard post with darker corners.";
    slots.post.wrap("standard", "vignette", line, &settings, |build, settings, standard| {
        Ok(Box::new(Vignette::new(build, settings, standard)?))
    })?;
    let mut config = Config::default();
    config.set("stages.post=vignette")?;
    config.set(&format!("post.vignette={strength:?}"))?;
    slots.catalogue().check(&config, "own_pass")?;
    Ok((slots, config))
}

fn main() -> anyhow::Result<()> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "vignette.png".to_owned());
    let (slots, mut config) = slots_with_vignette(0.8)?;
    for setting in std::env::args().skip(2) {
        config.set(&setting)?; // such as post.exposure=-1, which is the standard post's
    }
    slots.catalogue().check(&config, "own_pass")?;
    let gpu = Gpu::new(&GpuOptions::default())?;
    let scene = magpie::scene::builtin("courtyard")?;
    let options = RenderOptions { width: 320, height: 180, seed: 0, check: false, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &slots, &config, options)?;
    let frame = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    let result = renderer.frame(frame)?.ok_or_else(|| anyhow::anyhow!("a size of zero shows nothing"))?;
    for pass in &result.sample.passes {
        println!("{:24} {:8.3} ms", pass.name, pass.gpu_ns.unwrap_or(0) as f64 / 1e6);
    }
    let display = result.images.and_then(|images| images.display).ok_or_else(|| anyhow::anyhow!("no picture"))?;
    image::save_buffer(&file, &display.bytes, display.extent.width, display.extent.height, image::ColorType::Rgba8)?;
    println!("{file}");
    Ok(())
}
