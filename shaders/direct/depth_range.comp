#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/clusters.glsl"
// The least and the greatest reversed depth of each block of the picture. Numbers above 0 are ordered as their bits are.
layout(local_size_x = 16, local_size_y = 16) in;
layout(push_constant, scalar) uniform Push { DepthRangeParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Blocks { uvec2 at[]; };

shared uint least, greatest;

void main() {
    if (gl_LocalInvocationIndex == 0u) {
        least = floatBitsToUint(1.0 / 0.0);
        greatest = 0u;
    }
    barrier();
    uint own_least = floatBitsToUint(1.0 / 0.0), own_greatest = 0u;
    ivec2 first = ivec2(gl_WorkGroupID.xy * DEPTH_BLOCK + gl_LocalInvocationID.xy);
    for (uint k = 0u; k < 4u; k++) {
        ivec2 pixel = first + 16 * ivec2(k & 1u, k >> 1u);
        float depth = inside(pixel, params.size) ? load(params.depth, pixel).r : 0.0;
        if (!(depth > 0.0)) continue;
        own_least = min(own_least, floatBitsToUint(depth));
        own_greatest = max(own_greatest, floatBitsToUint(depth));
    }
    atomicMin(least, own_least);
    atomicMax(greatest, own_greatest);
    barrier();
    if (gl_LocalInvocationIndex == 0u) Blocks(params.blocks).at[gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x] = uvec2(least, greatest);
}
