#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/shadows.glsl"
// How wide the penumbrae are that a pixel may lie in: the widest of all that rays around have met the shadow of, as far away as it is wide.
// Pixels that lie in none have no noise.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ReachParams params; };

// Each pixel this near is looked at; further away, eight in a ring, each ring twice as far out: of a wide penumbra there is much to meet.
const int NEAR = 2;
const int FURTHEST = 32;

ivec2 pixel;
vec4 reach = vec4(0.0);

void look(ivec2 offset) {
    ivec2 at = pixel + offset;
    if (!inside(at, params.size)) return;
    vec4 width = load(params.penumbra, at / int(params.step));
    // Half a pixel of rounding, and what half resolution has left out.
    float away = max(length(vec2(offset)) - 0.5 * float(params.step), 0.0) / PENUMBRA_MOST;
    reach = max(reach, mix(vec4(0.0), width, greaterThanEqual(width, vec4(away))));
}

void main() {
    pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    for (int y = -NEAR; y <= NEAR; y++) {
        for (int x = -NEAR; x <= NEAR; x++) look(ivec2(x, y));
    }
    for (int ring = 2 * NEAR; ring <= FURTHEST; ring *= 2) {
        for (int k = 0; k < 9; k++) {
            if (k != 4) look(ivec2(k % 3 - 1, k / 3 - 1) * ring);
        }
    }
    store(params.reach, pixel, reach);
}
