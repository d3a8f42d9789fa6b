#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/denoise.glsl"
// Changes of noisy samples are summed over 5x5 texels, `step` apart, with their signs, so that noise in them cancels and a change that they share remains, and without,
// as light that moves brings as much as it takes away. The last sums become the share of the history to discard.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlurGradientParams params; };

// A sum is no change up to this many standard deviations of one that is noise.
const float NOISE = 1.5;
// Sum of the squared weights of all steps.
const float SQUARED_WEIGHTS = 0.0158;
// A change over the light, from which on the whole history is discarded: of the signed sum beyond its noise.
const float WHOLE_CHANGE = 0.06;
// Of the sum without signs, from none of the history to all of it. Paths that end in the previous frame's light differ by some hundredths, as that has noise.
const vec2 UNSIGNED_CHANGE = vec2(0.1, 0.2);

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    const float SPLINE[3] = float[](3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0);
    vec4 sum = vec4(0.0);
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            ivec2 at = pixel + ivec2(x, y) * int(params.step);
            if (inside(at, params.size)) sum += SPLINE[abs(x)] * SPLINE[abs(y)] * load(params.change, at);
        }
    }
    if (params.is_last != 0u) {
        float together = max(abs(sum.x) - NOISE * sqrt(SQUARED_WEIGHTS * sum.y), 0.0) / WHOLE_CHANGE;
        float each = max(sum.w - UNSIGNED_CHANGE.x * sum.z, 0.0) / (UNSIGNED_CHANGE.y - UNSIGNED_CHANGE.x);
        sum = vec4(sum.z > 0.0 ? min(max(together, each) / sum.z, 1.0) : 0.0);
    }
    store(params.blurred, pixel, sum);
}
