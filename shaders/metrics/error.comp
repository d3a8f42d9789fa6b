#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/metrics.glsl"
// The error of each pixel, and its sum over each tile by a reduction in shared memory, whose order is the same on every run.
layout(local_size_x = TILE_WIDTH, local_size_y = TILE_HEIGHT) in;
layout(push_constant, scalar) uniform Push { ErrorParams params; };

shared vec3 sums[METRICS_GROUP];

// IEC 61966-2-1, from the encoded values to the linear ones.
vec3 srgb_decode(vec3 c) {
    return mix(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, lessThanEqual(c, vec3(0.04045)));
}

vec3 colour(uint image, uint read, ivec2 pixel) {
    vec3 value = load(image, pixel).rgb;
    if (read == READ_GREY) return vec3(value.r);
    return read == READ_DISPLAY ? srgb_decode(value) : value;
}

// Squared, relative and symmetric error, each the mean over the channels. Written with sums and quotients, which keep NaN; min, max and
// clamp may not.
vec3 errors(vec3 test, vec3 reference) {
    vec3 squared = (test - reference) * (test - reference);
    vec3 relative = squared / (reference * reference + RELMSE_EPSILON);
    vec3 symmetric = abs(test - reference) / (abs(test) + abs(reference) + SMAPE_EPSILON);
    vec3 channels = vec3(1.0);
    return vec3(dot(squared, channels), dot(relative, channels), dot(symmetric, channels)) / 3.0;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    vec3 error = vec3(0.0);
    if (all(lessThan(uvec2(pixel), params.size))) {
        vec3 reference = colour(params.reference, params.read_reference, pixel);
        error = vec3(uintBitsToFloat(0x7fc00000u));
        if (params.test_size == params.size) error = errors(colour(params.test, params.read_test, pixel), reference);
        store(params.error, pixel, vec4(error, 1.0));
    }

    uint thread = gl_LocalInvocationIndex;
    sums[thread] = error;
    barrier();
    for (uint half_way = METRICS_GROUP / 2u; half_way > 0u; half_way /= 2u) {
        if (thread < half_way) sums[thread] += sums[thread + half_way];
        barrier();
    }
    if (thread == 0u) {
        uint tile = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
        ErrorSumsBufferWrite(params.tiles).at[tile] = ErrorSums(sums[0].x, sums[0].y, sums[0].z);
    }
}
