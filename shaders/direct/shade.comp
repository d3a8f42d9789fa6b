#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/shade_lights.glsl"
// Radiance towards the viewer: light of every light source times its visibility, reflected once, plus that of emissive surfaces, plus
// emission.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ShadeParams params; };

vec3 shade(ViewBuffer view, ivec2 pixel) {
    Receiver r = receiver_at(view, pixel, params.gbuffer);
    if (!r.s.exists) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(params.scene);
    LightBuffer lights = LightBuffer(scene.at[0].lights);
    vec3 radiance = emitted_and_sampled(params, r);
    uint lit = params.flags & LIGHTS_MASK;
    uint count = lit == LIGHTS_NONE ? 0u : scene.at[0].light_count;
    for (uint i = 0u; i < count; i++) {
        if (lit == LIGHTS_DIRECTIONAL && lights.at[i].kind != LIGHT_DIRECTIONAL) continue;
        radiance += seen_light(params, view, r, i, lights.at[i]);
    }
    return radiance;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (inside(pixel, view.at[0].size)) store_radiance(params, pixel, shade(view, pixel));
}
