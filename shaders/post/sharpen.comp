#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/gbuffer.glsl"
#include "shared/post.glsl"
// Subtracts part of the four neighbours from each pixel, as much as leaves every channel between 0 and 1 of the tone-weighted range, so
// that strong edges, which need it least, are sharpened least: after Lottes 2021, "Robust Contrast Adaptive Sharpening" (FidelityFX Super
// Resolution 1.0).
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SharpenParams params; };

// Limit of a neighbour's negative weight: at -1/4 the sum of all weights would be 0.
const float MOST = 0.25 - 1.0 / 16.0;

vec3 compressed(ivec2 pixel) {
    pixel = clamp(pixel, ivec2(0), ivec2(params.size) - 1);
    return rgb_of_ycocg(tone_compress(ycocg_of(load(params.colour, pixel).rgb), params.exposure));
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    vec3 own = compressed(pixel);
    vec3 left = compressed(pixel - ivec2(1, 0)), right = compressed(pixel + ivec2(1, 0));
    vec3 above = compressed(pixel - ivec2(0, 1)), below = compressed(pixel + ivec2(0, 1));
    vec3 sum = left + right + above + below;
    vec3 least = min(min(left, right), min(above, below));
    vec3 most = max(max(left, right), max(above, below));

    // (own - w sum) / (1 - 4 w) stays above 0 while w <= least / (4 most) for any `own` from least to most, and below 1 by the same
    // argument for the distances from 1. Next to black or white there is no room.
    vec3 room = min(least / (4.0 * max(most, vec3(1e-6))), (1.0 - most) / (4.0 * max(1.0 - least, vec3(1e-6))));
    float weight = params.amount * clamp(min(room.r, min(room.g, room.b)), 0.0, MOST);
    vec3 sharp = (own - weight * sum) / (1.0 - 4.0 * weight);
    // Limited to the range of the neighbourhood, against overshoot. By comparison, which keeps NaN for `--check` to find.
    least = min(least, own);
    most = max(most, own);
    sharp = mix(sharp, least, lessThan(sharp, least));
    sharp = mix(sharp, most, greaterThan(sharp, most));
    store(params.radiance, pixel, vec4(rgb_of_ycocg(tone_expand(ycocg_of(sharp), params.exposure)), 1.0));
}
