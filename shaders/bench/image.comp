#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/bench.glsl"
// One pass over images of Magpie's bindless set.
layout(local_size_x = SIDE, local_size_y = SIDE) in;
layout(push_constant, scalar) uniform Push { ImageParams params; };

void main() {
    ivec2 pixel = ivec2(gl_LocalInvocationID.xy);
    uint lane = gl_LocalInvocationIndex;
    uint first = params.number > 0u ? imageLoad(storage_images_uint[params.first], pixel).x : 0u;
    uint second = params.number > 1u ? imageLoad(storage_images_uint[params.second], pixel).x : 0u;
    uint value = bench_value(first, second, params.number, lane);
    imageStore(storage_images_uint[params.result], pixel, uvec4(value));
}
