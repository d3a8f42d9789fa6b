#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/rays.glsl"
// Turns the counts per key into the offset of each key (exclusive prefix sum). One workgroup: every thread sums some keys, then the sums
// are scanned in shared memory (Hillis and Steele 1986, "Data Parallel Algorithms").
layout(local_size_x = SORT_GROUP) in;
layout(push_constant, scalar) uniform Push { SortParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };

const uint OWN = SORT_KEYS / SORT_GROUP;
shared uint sums[SORT_GROUP];

void main() {
    uint thread = gl_LocalInvocationID.x;
    Words counts = Words(params.counts);
    uint sum = 0u;
    for (uint i = 0u; i < OWN; ++i) sum += counts.at[thread * OWN + i];
    sums[thread] = sum;
    barrier();
    for (uint step = 1u; step < SORT_GROUP; step *= 2u) {
        uint before = thread >= step ? sums[thread - step] : 0u;
        barrier();
        sums[thread] += before;
        barrier();
    }
    uint next = sums[thread] - sum;
    for (uint i = 0u; i < OWN; ++i) {
        uint count = counts.at[thread * OWN + i];
        counts.at[thread * OWN + i] = next;
        next += count;
    }
}
