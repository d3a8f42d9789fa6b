#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/brdf.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "lib/lights.glsl"
#include "shared/direct.glsl"
// Radiance towards the viewer: light of every lamp, reflected once, and emission. Only the key light is shadowed.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ShadeParams params; };

vec3 shade(ViewBuffer view, ivec2 pixel) {
    Surface s = load_surface(view, pixel, params.depth, params.normal, params.base_colour, params.material);
    if (!s.exists) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    LightBuffer lights = LightBuffer(scene.at[0].lights);

    vec3 radiance = load(params.emission, pixel).rgb;
    for (uint i = 0u; i < scene.at[0].light_count; i++) {
        LightSample light = sample_light(lights.at[i], s.position);
        if (i == view.at[0].key_light && params.visibility != NO_VISIBILITY) {
            light.irradiance *= load(params.visibility, pixel).r;
        }
        // Unlit and unseen lights stop here; most of them, in a scene with many.
        if (light.irradiance == vec3(0.0)) continue;
        vec3 reflected = brdf_cosine(s.normal, s.to_eye, light.direction, s.base_colour, s.metalness, s.roughness);
        radiance += reflected * light.irradiance;
    }
    return radiance;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(at_most(shade(view, pixel), params.greatest), 1.0));
}
