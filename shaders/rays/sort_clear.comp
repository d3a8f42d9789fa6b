#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/rays.glsl"
// Clears the histogram of keys.
layout(local_size_x = SORT_GROUP) in;
layout(push_constant, scalar) uniform Push { SortParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };

void main() {
    if (gl_GlobalInvocationID.x < SORT_KEYS) Words(params.counts).at[gl_GlobalInvocationID.x] = 0u;
}
