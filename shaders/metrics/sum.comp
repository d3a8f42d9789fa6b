#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/metrics.glsl"
// Reduces the tiles' errors to those of the picture. One workgroup: each thread sums every METRICS_GROUP-th tile, then a reduction in
// shared memory sums the threads. The order is the same on every run.
layout(local_size_x = METRICS_GROUP) in;
layout(push_constant, scalar) uniform Push { SumParams params; };

shared vec3 sums[METRICS_GROUP];

void main() {
    uint thread = gl_LocalInvocationID.x;
    // Compensated summation (Kahan 1965, "Further Remarks on Reducing Truncation Errors"). An infinity becomes NaN here.
    precise vec3 sum = vec3(0.0);
    precise vec3 lost = vec3(0.0);
    for (uint i = thread; i < params.count; i += METRICS_GROUP) {
        ErrorSums tile = ErrorSumsBuffer(params.tiles).at[i];
        precise vec3 add = vec3(tile.squared, tile.relative, tile.symmetric) - lost;
        precise vec3 next = sum + add;
        lost = (next - sum) - add;
        sum = next;
    }
    sums[thread] = sum;
    barrier();
    for (uint half_way = METRICS_GROUP / 2u; half_way > 0u; half_way /= 2u) {
        if (thread < half_way) sums[thread] += sums[thread + half_way];
        barrier();
    }
    if (thread == 0u) {
        vec3 mean = sums[0] / float(params.pixels);
        ErrorSumsBufferWrite(params.errors).at[0] = ErrorSums(mean.x, mean.y, mean.z);
    }
}
