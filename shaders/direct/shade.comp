#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/brdf.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "lib/lights.glsl"
#include "shared/direct.glsl"
// Radiance towards the viewer: light of every lamp times what is seen of it, reflected once, and emission.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ShadeParams params; };

// The share of a light that is seen; all of those that cast no shadow.
vec3 visibility(ViewBuffer view, uint light, ivec2 pixel) {
    for (uint group = 0u; group < params.group_count; group++) {
        for (uint channel = 0u; channel < 4u; channel++) {
            uint caster = (params.casters[group] >> (8u * channel)) & 255u;
            if (caster == NO_CASTER || view.at[0].casters[caster] != light) continue;
            vec4 seen = load(params.visibility[group], pixel);
            return (params.coloured & (1u << group)) != 0u ? seen.rgb : vec3(seen[channel]);
        }
    }
    return vec3(1.0);
}

vec3 shade(ViewBuffer view, ivec2 pixel) {
    Surface s = load_surface(view, pixel, params.depth, params.normal, params.base_colour, params.material);
    if (!s.exists) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    LightBuffer lights = LightBuffer(scene.at[0].lights);

    vec3 radiance = load(params.emission, pixel).rgb;
    for (uint i = 0u; i < scene.at[0].light_count; i++) {
        LightSample light = sample_light(lights.at[i], s.position);
        // Lights that are out of reach stop here; most of them, in a scene with many.
        if (light.irradiance == vec3(0.0)) continue;
        light.irradiance *= visibility(view, i, pixel);
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
