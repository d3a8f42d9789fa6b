#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "shared/check.glsl"
// Looks for NaN and infinity in a buffer whose words are all floats.
layout(local_size_x = 256) in;
layout(push_constant, scalar) uniform Push { ScanWordsParams params; };

void main() {
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint index = group * gl_WorkGroupSize.x + gl_LocalInvocationIndex;
    if (index >= params.count) return;
    uint bits = WordBuffer(params.words).at[index];
    bool nan = is_nan_bits(bits);
    if (!nan && !is_infinite_bits(bits)) return;
    CountedBufferWrite counted = CountedBufferWrite(params.counted);
    if (nan) atomicAdd(counted.at[0].nan, 1u);
    else atomicAdd(counted.at[0].infinite, 1u);
    atomicMax(counted.at[0].last, ~index);
}
