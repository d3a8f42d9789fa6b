//! An effect in a slot of one's own: `style` draws over Magpie's picture, in the way that a configuration names.
//!
//! `cargo run --release -p magpie-demo --example custom_pass -- styled.png stages.style=haze style.half_metres=8`
use anyhow::Context;
use bytemuck::{Pod, Zeroable};
use magpie::config::Config;
use magpie::gpu::{GpuOptions, Kernel};
use magpie::pixels::Pixels;
use magpie::prelude::*;
use magpie::scene::Scene;
use magpie::slot::{BoxedEffect, Build, Implementation, SettingSpec, Slot, SlotError};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::{SampledImage, Stage, StorageImage};

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push {
    uint source; uint depth; uint result; uvec2 size; uvec2 depth_size; float near; float amount; float limit;
};

// One over the distance, in near planes; 0 in the sky. The frame may be smaller than the picture.
float depth_at(ivec2 pixel) {
    ivec2 at = ivec2((vec2(pixel) + 0.5) * vec2(depth_size) / vec2(size));
    return load(depth, clamp(at, ivec2(0), ivec2(depth_size) - 1)).x;
}
"#;

/// Over a plane this depth is linear, so that its second difference is 0 there.
const LINES: &str = r#"
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, size)) return;
    float centre = depth_at(pixel);
    float across = depth_at(pixel - ivec2(1, 0)) + depth_at(pixel + ivec2(1, 0)) - 2.0 * centre;
    float down = depth_at(pixel - ivec2(0, 1)) + depth_at(pixel + ivec2(0, 1)) - 2.0 * centre;
    bool is_line = abs(across) + abs(down) > limit * centre && centre > 0.0;
    store(result, pixel, load(source, pixel) * vec4(vec3(is_line ? 1.0 - amount : 1.0), 1.0));
}
"#;

const HAZE: &str = r#"
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, size)) return;
    float left = exp2(-near / (max(depth_at(pixel), 1e-9) * limit));
    vec4 seen = load(source, pixel);
    store(result, pixel, vec4(mix(vec3(amount), seen.rgb, left), seen.a));
}
"#;

/// The push constants, field by field as in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    source: SampledImage,
    depth: SampledImage,
    result: StorageImage,
    size: [u32; 2],
    depth_size: [u32; 2],
    near: f32,
    amount: f32,
    limit: f32,
}

/// What goes into the slot: display values, and depth in the size of the frame. Display values come out.
pub struct StyleIn {
    display: Handle<Image>,
    depth: Handle<Image>,
}

#[derive(Clone, Copy)]
struct Style {
    kernel: Kernel,
    amount: f32,
    limit: f32,
}

impl Style {
    fn boxed(
        build: &Build<'_>,
        main: &str,
        [amount, limit]: [f32; 2],
    ) -> Result<BoxedEffect<StyleIn, Handle<Image>>, SlotError> {
        let words = magpie_shaders::compile("style.comp", &format!("{HEAD}{main}"), Stage::Compute);
        let kernel = build.kernel_from_words("style.comp", &words.map_err(SlotError::other)?)?;
        Ok(Box::new(Self { kernel, amount, limit }))
    }
}

impl Effect for Style {
    type In = StyleIn;
    type Out = Handle<Image>;

    fn add(&mut self, g: &mut FrameGraph, view: &View, input: StyleIn) -> Handle<Image> {
        let (Self { kernel, amount, limit }, near) = (*self, view.camera.near);
        g.pass("style.draw", Queue::Graphics, |p| {
            let (source, depth) = (p.sample(input.display), p.sample(input.depth));
            let (drawn, result) = p.create("drawn", p.desc(input.display));
            let (extent, seen) = (p.extent(input.display), p.extent(input.depth));
            (drawn.read(), move |c: &mut Record<'_>| {
                let (size, depth_size) = ([extent.width, extent.height], [seen.width, seen.height]);
                let (source, depth, result) = (c.id(source), c.id(depth), c.id(result));
                let params = Params { source, depth, result, size, depth_size, near, amount, limit };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// The slot with its two implementations, and Magpie's slots beside it, so that one configuration names the implementations of all.
pub fn slots() -> (Slots, Slot<StyleIn, Handle<Image>>) {
    let darkness = SettingSpec::float("darkness", "", "Higher is darker; 1 is black.", 0.8, 0.0..=1.0);
    let bend =
        SettingSpec::float("bend", "", "Higher draws fewer lines: where depth bends by this share.", 0.1, 0.0..=10.0);
    let grey = SettingSpec::float("grey", "", "Display value of the haze: higher is brighter.", 0.7, 0.0..=1.0);
    let half =
        SettingSpec::float("half_metres", "metres", "Higher is clearer: half is left from so far.", 20.0, 0.1..=1e6);
    let slot = Slot::new("style")
        .about("Draws over the finished picture.")
        .with("lines", "Dark lines where depth bends.", &[darkness, bend], |build, settings| {
            Style::boxed(build, LINES, [settings.f32("darkness")?, settings.f32("bend")?])
        })
        .with("haze", "Fades to grey with distance.", &[grey, half], |build, settings| {
            Style::boxed(build, HAZE, [settings.f32("grey")?, settings.f32("half_metres")?])
        });
    (Slots { others: vec![slot.info().clone()], ..Slots::default() }, slot)
}

/// A renderer with what is in the slot.
pub struct Styled {
    gpu: Gpu,
    renderer: Renderer,
    slot: Slot<StyleIn, Handle<Image>>,
    style: Implementation<StyleIn, Handle<Image>>,
}

impl Styled {
    /// Checks the configuration, and makes what it names.
    pub fn new(gpu: &Gpu, scene: &Scene, config: &Config, options: RenderOptions) -> anyhow::Result<Self> {
        let (slots, slot) = slots();
        slots.catalogue().check(config, "custom_pass")?;
        let style = slot.from_config(&Build::new(gpu, options.rays), config)?;
        let renderer = Renderer::new(gpu, scene, &slots, config, options)?;
        Ok(Self { gpu: gpu.clone(), renderer, slot, style })
    }

    /// Takes another configuration from the next frame on. After an error the old one stays.
    pub fn configure(&mut self, config: &Config) -> anyhow::Result<()> {
        let build = Build::new(&self.gpu, Rays::default());
        let change = self.slot.change(&mut self.style, &build, config)?;
        self.renderer.configure(config)?;
        change.into_iter().for_each(|change| change());
        Ok(())
    }

    /// Renders a frame: Magpie's picture, and what the slot makes of it.
    pub fn frame(&mut self, scene: &Scene) -> anyhow::Result<[Pixels; 2]> {
        let (style, camera) = (&mut self.style, &scene.cameras[0]);
        let request = FrameRequest { camera, time: 0.0, view: None, read_back: false };
        let ticket = self.renderer.submit_with(request, &mut |g, imports, picture| {
            let input = StyleIn { display: picture.display, depth: picture.depth };
            let styled = style.add(g, &picture.view, input);
            picture.read_back(g, imports, "plain", picture.display);
            picture.read_back(g, imports, "styled", styled);
            Ok(())
        })?;
        let result = self.renderer.finish(ticket.context("a size of zero shows nothing")?)?;
        let images: Vec<Pixels> = result.copied.into_iter().map(|(_, image)| image).collect();
        images.try_into().ok().context("two images were asked for")
    }
}

/// What a file would hold.
const CONFIG: &str = "[stages]\nstyle = \"lines\"\nao = \"off\"\n\n[style]\ndarkness = 0.9\n";

fn main() -> anyhow::Result<()> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "styled.png".to_owned());
    let mut config = Config::from_toml(CONFIG, "custom_pass")?;
    for setting in std::env::args().skip(2) {
        config.set(&setting)?;
    }
    let gpu = Gpu::new(&GpuOptions::default())?;
    let scene = magpie::scene::builtin("courtyard").context("no such scene")?;
    let options = RenderOptions { width: 320, height: 180, ..RenderOptions::default() };
    let [_, styled] = Styled::new(&gpu, &scene, &config, options)?.frame(&scene)?;
    let Extent { width, height } = styled.extent;
    image::save_buffer(&file, &styled.bytes, width, height, image::ColorType::Rgba8)?;
    println!("{file}");
    Ok(())
}
