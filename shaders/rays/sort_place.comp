#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/rays.glsl"
// Scatters the rays' indices by key. The order within a key is undefined, which is harmless: each ray keeps its own answer.
layout(local_size_x = SORT_GROUP) in;
layout(push_constant, scalar) uniform Push { SortParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= params.count) return;
    uint place = atomicAdd(Words(params.counts).at[Words(params.keys).at[index]], 1u);
    Words(params.order).at[place] = index;
}
