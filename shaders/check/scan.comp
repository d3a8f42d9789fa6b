#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/check.glsl"
// Looks for NaN and infinity in one image of a float format.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ScanParams params; };

// By their bits: a compiler may assume that floats are finite and fold isnan() away.
const uint EXPONENT = 0x7f800000u;
const uint MANTISSA = 0x007fffffu;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    uvec4 bits = floatBitsToUint(load(params.image, pixel));
    bool nan = false;
    bool infinite = false;
    for (int i = 0; i < 4; i++) {
        if ((bits[i] & EXPONENT) != EXPONENT) continue;
        if ((bits[i] & MANTISSA) != 0u) nan = true;
        else infinite = true;
    }
    if (!nan && !infinite) return;
    FindingBufferWrite finding = FindingBufferWrite(params.finding);
    if (nan) atomicAdd(finding.at[0].nan, 1u);
    else atomicAdd(finding.at[0].infinite, 1u);
    atomicMin(finding.at[0].first, uint(pixel.y) * params.size.x + uint(pixel.x));
}
