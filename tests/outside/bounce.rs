//! A lighting effect from outside: one diffuse bounce. Rays see lit surfaces in the previous frame's picture, and emissive ones through the
//! light table; jitter spreads the rays within pixels, and a denoiser of its own filters what they find.
use bytemuck::{Pod, Zeroable};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SlotError};
use magpie_passes::Slots;
use magpie_passes::contracts::{Channel, LightingIn, LightingOut, RAY_START};
use magpie_passes::parts::denoise::{Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use magpie_shaders::gbuffer::GBufferImages;
use magpie_shaders::{Address, SampledImage, StorageImage, compile_rays};

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/light_sampling.glsl"
#include "lib/ray.glsl"
#include "lib/sampling.glsl"
#include "lib/sequence.glsl"
layout(push_constant, scalar) uniform Push {
    uvec2 view_address; uvec2 lights; GBufferImages gbuffer; uint previous; uint result;
};

// Radiance that a pixel's surface reflects, by one ray.
vec3 gather(ViewBuffer view, ivec2 pixel) {
    Surface s = load_surface(view, pixel, gbuffer);
    if (!s.exists) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    RayStart start = seen_start(scene, load_uint(gbuffer.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), s.position);
    uint frame = view.at[0].frame, seed = view.at[0].seed;
    vec3 direction = frame_of(s.normal) * sample_cosine(sequence2(pixel, frame, SEQUENCE_AO, seed));
    Ray ray = surface_ray(start, direction, INFINITELY_FAR);
    Hit hit;
    if (!trace_closest(scene, ray, hit)) return vec3(0.0);
    // On the screen, a frame ago: with all light that it reflected then, so that bounces add up from frame to frame.
    vec3 met = ray.origin + hit.t * ray.direction;
    vec4 clip = view.at[0].previous_clip_from_world * vec4(met, 1.0);
    ivec2 was = ivec2(floor((clip.xy / clip.w * 0.5 + 0.5) * vec2(view.at[0].size)));
    vec3 albedo = (1.0 - s.metalness) * s.base_colour;
    if (clip.w > 0.0 && inside(was, view.at[0].size)) return albedo * load(previous, was).rgb;
    // Elsewhere: what a grey surface reflects of one emitter, without shadow.
    LightTables tables = LightTablesBuffer(lights).at[0];
    vec2 which = sequence2(pixel, frame, SEQUENCE_AO + 1u, seed);
    LightChoice choice = LightChoiceBuffer(tables.near).at[uint(which.x * float(tables.near_count))];
    Incident from;
    if (!sample_emitter(scene, choice, met, sequence2(pixel, frame, SEQUENCE_AO + 2u, seed), from)) return vec3(0.0);
    return albedo * 0.5 / PI * from.radiance * max(-dot(direction, from.direction), 0.0) * float(tables.near_count);
}

void main() {
    ViewBuffer view = ViewBuffer(view_address);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (inside(pixel, view.at[0].size)) store(result, pixel, vec4(gather(view, pixel), 1.0));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    lights: Address,
    gbuffer: GBufferImages,
    previous: SampledImage,
    result: StorageImage,
}

struct Bounce {
    gather: RayKernel,
    denoiser: Denoiser,
}

impl Bounce {
    fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        let words = compile_rays("bounce.ray", GLSL, build.rays).map_err(SlotError::other)?;
        let options = Options { history: 64, levels: 5, ..Options::default() };
        let denoiser = Denoiser::new(build, "gi", options)?;
        Ok(Self { gather: build.ray_kernel_from_words("bounce.ray", &words)?, denoiser })
    }
}

impl Effect for Bounce {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if facts.diffuse == 0.0 {
            return Needs::idle("nothing reflects diffusely");
        }
        Needs { jitter: true, emitters: facts.emits(), previous_radiance: true, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let (Some(previous), Some(lights)) = (i.previous_radiance, i.scene.emitters) else {
            return LightingOut::default();
        };
        let (gather, block) = (self.gather, view.block);
        let image = g.pass("gi.gather", Queue::AsyncCompute, |p| {
            let (view, lights, tlas) = (p.read(block), p.read(lights), i.scene.trace(p));
            let channels = [RAY_START, &[Channel::BaseColour, Channel::Material]].concat();
            let (gbuffer, previous) = (i.gbuffer.read(p, &channels), p.sample(previous));
            let (noisy, result) = p.create("noisy", ImageDesc::full(Format::Rgba16Float));
            let extent = p.extent(i.gbuffer.depth);
            (noisy.read(), move |c: &mut Record<'_>| {
                let (view, lights, gbuffer) = (c.id(view), c.id(lights), gbuffer.images(c));
                let params = Params { view, lights, gbuffer, previous: c.id(previous), result: c.id(result) };
                c.trace(gather, tlas, &params, extent);
            })
        });
        let signal = Signal { image, content: Content::Radiance };
        let surfaces = Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected };
        let i = DenoiseIn { signal, surfaces, hints: Hints::default() };
        LightingOut::radiance(self.denoiser.add(g, view, i, ""))
    }
}

/// Puts it into the slot `gi`.
pub fn register(slots: &mut Slots) {
    slots.gi.register("bounce", "One diffuse bounce.", &[], |build, _| Ok(Box::new(Bounce::new(build)?)));
}
