//! A lighting effect from outside: one diffuse bounce. Hits of rays are shaded by the lights that they see, or by what the previous frame
//! saw of them; jitter spreads the rays within pixels, and a denoiser of its own filters what they find.
use bytemuck::{Pod, Zeroable};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_passes::Slots;
use magpie_passes::contracts::{Channel, LightingIn, LightingOut, RAY_START};
use magpie_passes::parts::denoise::{Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use magpie_passes::parts::hit_shading::{self, HitShading};
use magpie_shaders::gbuffer::GBufferImages;
use magpie_shaders::hit_shading::HitShadingParams;
use magpie_shaders::{Address, StorageImage, compile_rays};

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/sequence.glsl"
layout(push_constant, scalar) uniform Push {
    uvec2 view_address; uvec2 scene_address; uvec2 rays; GBufferImages gbuffer; HitShadingParams hits; uint result;
};

uvec2 traced = uvec2(0u);

// Radiance that a pixel's surface reflects, by one ray.
vec3 gather(ViewBuffer view, ivec2 pixel) {
    Surface s = load_surface(view, pixel, gbuffer);
    if (!s.exists) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(scene_address);
    RayStart start = seen_start(scene, load_uint(gbuffer.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), s.position);
    uint frame = view.at[0].frame, seed = view.at[0].seed;
    mat3 around = frame_of(s.normal);
    vec3 l = sample_cosine(sequence2(pixel, frame, SEQUENCE_AO, seed)), direction = around * l;
    Bsdf bsdf = opaque_bsdf(s.base_colour, s.metalness, s.roughness, s.fresnel);
    vec3 reflected = bsdf_cosine(bsdf, s.to_eye * around, l, LOBE_DIFFUSE) * PI / l.z;
    if (reflected == vec3(0.0) || dot(direction, start.normal) <= 0.0) return vec3(0.0);
    Ray ray = surface_ray(start, direction, UNBOUNDED);
    Hit hit;
    traced.x++;
    if (!trace_closest(scene, ray, hit)) return view.at[0].has_sky != 0u ? reflected * sky_radiance(view.at[0].sky, direction) : vec3(0.0);
    SurfacePoint met = surface_at(scene, ray, hit, NO_FOOTPRINT);
    Random random = random_of(uint(pixel.y) * view.at[0].size.x + uint(pixel.x), frame, seed);
    // Without what the hit emits: `direct` samples emissive surfaces.
    return reflected * shade_hit(view, scene, hits, hit, met, direction, random, traced).scattered;
}

void main() {
    ViewBuffer view = ViewBuffer(view_address);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (inside(pixel, view.at[0].size)) store(result, pixel, vec4(gather(view, pixel), 1.0));
    count_rays(rays, traced.x, traced.y);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    scene: Address,
    rays: Address,
    gbuffer: GBufferImages,
    hits: HitShadingParams,
    result: StorageImage,
}

struct Bounce {
    gather: RayKernel,
    denoiser: Denoiser,
    reuse: bool,
}

impl Bounce {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let words = compile_rays("bounce.ray", GLSL, build.rays).map_err(SlotError::other)?;
        let options = Options { history: 64, levels: 5, ..Options::default() };
        let denoiser = Denoiser::new(build, "gi", options)?;
        let gather = build.ray_kernel_from_words("bounce.ray", &words)?;
        Ok(Self { gather, denoiser, reuse: settings.switch("reuse")? })
    }
}

impl Effect for Bounce {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if facts.diffuse == 0.0 {
            return Needs::idle("nothing reflects diffusely");
        }
        Needs { jitter: true, previous_radiance: self.reuse, ..hit_shading::needs(facts) }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let Some(hits) = HitShading::new(&i, self.reuse) else { return LightingOut::default() };
        let (gather, block) = (self.gather, view.block);
        let image = g.pass("gi.gather", Queue::AsyncCompute, |p| {
            let (view, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, &[Channel::BaseColour, Channel::Material]].concat());
            let (noisy, result) = p.create("noisy", ImageDesc::full(Format::Rgba16Float));
            let extent = p.extent(i.gbuffer.depth);
            (noisy.read(), move |c: &mut Record<'_>| {
                let (view, root, rays, gbuffer) = (c.id(view), c.id(scene.root), c.rays(), gbuffer.images(c));
                let params = Params { view, scene: root, rays, gbuffer, hits: hits.params(c), result: c.id(result) };
                c.trace(gather, scene.tlas, &params, extent);
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
    let reuse = SettingSpec::switch("reuse", "Hits show what the previous frame saw of them: bounces add up.", true);
    slots.gi.register("bounce", "One diffuse bounce.", &[reuse], |b, s| Ok(Box::new(Bounce::new(b, s)?)));
}
