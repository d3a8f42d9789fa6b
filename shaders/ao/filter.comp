#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/upsample.glsl"
#include "shared/ao.glsl"
// The mean over a square of four by four pixels, which holds every phase of the search's noise pattern once wherever it lies: five by five
// taps, those at the border with half the weight. Edge-aware.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { FilterParams params; };

vec4 mean(ViewBuffer view, ivec2 target, Surface here) {
    int step_size = int(params.step);
    float width = float(params.step) * pixel_spread(view) * distance(here.position, view.at[0].eye);
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            ivec2 at = target + ivec2(x, y);
            if (!inside(at * step_size, view.at[0].size)) continue;
            Surface there = load_geometry(view, at * step_size, params.gbuffer);
            if (!there.exists) continue;
            float weight = (abs(x) == 2 ? 0.5 : 1.0) * (abs(y) == 2 ? 0.5 : 1.0) * surface_weight(here, there, width);
            vec4 found = load(params.found, at);
            sum += weight * vec4(2.0 * found.xyz - 1.0, found.w);
            weights += weight;
        }
    }
    // The pixel itself weighs 1.
    return sum / weights;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 target = ivec2(gl_GlobalInvocationID.xy);
    ivec2 pixel = target * int(params.step);
    if (!inside(pixel, view.at[0].size)) return;
    Surface here = load_geometry(view, pixel, params.gbuffer);
    vec4 value = here.exists ? mean(view, target, here) : vec4(vec3(0.0), 1.0);
    if (params.bent_normal == NO_BENT_NORMAL) {
        store(params.filtered, target, vec4(safe_normalize(value.rgb, here.normal), value.a));
    } else {
        store(params.filtered, target, vec4(value.a));
        store(params.bent_normal, target, vec4(octahedral_encode(value.rgb), 0.0, 0.0));
    }
}
