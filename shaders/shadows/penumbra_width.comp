#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/denoise.glsl"
#include "shared/shadows.glsl"
// Widens penumbrae to the pixels that they may cover: the greatest penumbra width of all rays around that hit an occluder, as far away as
// that width. Pixels outside of all of them have no noise.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { PenumbraWidthParams params; };

// All pixels up to NEAR are read; further away eight in a ring, each ring twice as far out, as a wide penumbra has many hits.
const int NEAR = 2;
const int FURTHEST = 32;

ivec2 pixel;
vec4 widest = vec4(0.0);

void look(ivec2 offset) {
    ivec2 at = pixel + offset;
    if (!inside(at, params.size)) return;
    vec4 width = load(params.penumbra, at / int(params.step));
    // Less half a pixel for rounding, or more for what half resolution left out.
    float away = max(length(vec2(offset)) - 0.5 * float(params.step), 0.0) / WIDEST_NOISE;
    widest = max(widest, mix(vec4(0.0), width, greaterThanEqual(width, vec4(away))));
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
    store(params.width, pixel, widest);
}
