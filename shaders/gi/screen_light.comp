#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
#include "lib/screen_light.glsl"
#include "lib/taps.glsl"
#include "shared/gi.glsl"
// What each visible surface gives to others: the light that it scatters in this frame, and the indirect light that it had one frame ago.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ScreenLightParams params; };

// Emission that counts as direct light of the surfaces that it reaches: of unlit things nobody else takes account.
vec3 counted_emission(ivec2 pixel) {
    if (params.has_emission == 0u) return vec3(0.0);
    vec3 emission = load(params.gbuffer.emission, pixel).rgb;
    uint id = load_uint(params.gbuffer.ids, pixel).x;
    if (emission == vec3(0.0) || id == 0u) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(params.scene);
    uint material = InstanceBuffer(scene.at[0].instances).at[id - 1u].material;
    uint flags = MaterialBuffer(scene.at[0].materials).at[material].flags;
    return (flags & (MATERIAL_UNLIT | MATERIAL_SHOWS_LIGHT)) == MATERIAL_UNLIT ? vec3(0.0) : emission;
}

// Indirect light of the previous frame where it showed this surface.
vec3 light_before(ViewBuffer view, ivec2 pixel) {
    if (params.previous == NO_IMAGE) return vec3(0.0);
    vec2 was = vec2(pixel) - load(params.gbuffer.motion, pixel).xy * vec2(view.at[0].size);
    Taps taps = load_taps(params.taps, pixel, was);
    if (!taps.any) return vec3(0.0);
    vec4 sum = vec4(0.0);
    for (int k = 0; k < 4; k++) {
        if (taps.shares[k] > 0.0) sum += taps.shares[k] * load(params.previous, taps.first + ivec2(k & 1, k >> 1));
    }
    return is_taken(params.not_finite, sum) ? sum.rgb : vec3(0.0);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec3 light = vec3(0.0);
    if (load(params.gbuffer.depth, pixel).r > 0.0) {
        vec4 direct = load(params.direct, pixel);
        if (is_taken(params.not_finite, direct)) light = without_emission(direct.rgb, counted_emission(pixel));
        light += light_before(view, pixel);
    }
    store(params.light, pixel, vec4(representable(light, params.greatest), 1.0));
}
