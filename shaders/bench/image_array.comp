#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_nonuniform_qualifier : require
#include "lib/bench.glsl"
// The same pass over one plain array of images, for the hand-written Vulkan baseline and the other libraries.
layout(local_size_x = SIDE, local_size_y = SIDE) in;
layout(set = 0, binding = 0, r32ui) uniform uimage2D images[];
layout(push_constant, scalar) uniform Push { ImageParams params; };

void main() {
    ivec2 pixel = ivec2(gl_LocalInvocationID.xy);
    uint lane = gl_LocalInvocationIndex;
    uint first = params.number > 0u ? imageLoad(images[params.first], pixel).x : 0u;
    uint second = params.number > 1u ? imageLoad(images[params.second], pixel).x : 0u;
    imageStore(images[params.result], pixel, uvec4(bench_value(first, second, params.number, lane)));
}
