#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Replaces numbers by the sum of those before, in one workgroup.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelSumParams params; };

shared uint sums[SURFEL_GROUP];

void main() {
    SurfelWords numbers = SurfelWords(params.numbers);
    uint thread = gl_LocalInvocationIndex;
    uint count = params.count_at == uvec2(0u) ? params.count : SurfelWords(params.count_at).at[0];
    // Each invocation adds up a row of numbers, and the first the sums of the rows.
    uint row = (count + SURFEL_GROUP - 1u) / SURFEL_GROUP;
    uint first = min(thread * row, count);
    uint end = min(first + row, count);
    uint sum = 0u;
    for (uint i = first; i < end; i++) sum += numbers.at[i];
    sums[thread] = sum;
    barrier();
    if (thread == 0u) {
        uint before = 0u;
        for (uint i = 0u; i < SURFEL_GROUP; i++) {
            uint own = sums[i];
            sums[i] = before;
            before += own;
        }
        numbers.at[count] = before;
    }
    barrier();
    uint before = sums[thread];
    for (uint i = first; i < end; i++) {
        uint own = numbers.at[i];
        numbers.at[i] = before;
        before += own;
    }
}
