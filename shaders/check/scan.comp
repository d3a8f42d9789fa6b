#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "shared/check.glsl"
// Looks for NaN and infinity in one mip of one layer of an image of a float format.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ScanParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    uvec4 bits = floatBitsToUint(texelFetch(images[params.image], pixel, int(params.mip)));
    bool nan = false;
    bool infinite = false;
    for (int i = 0; i < 4; i++) {
        nan = nan || is_nan_bits(bits[i]);
        infinite = infinite || is_infinite_bits(bits[i]);
    }
    if (!nan && !infinite) return;
    CountedBufferWrite counted = CountedBufferWrite(params.counted);
    if (nan) atomicAdd(counted.at[0].nan, 1u);
    else atomicAdd(counted.at[0].infinite, 1u);
    atomicMax(counted.at[0].last, ~(uint(pixel.y) * params.size.x + uint(pixel.x)));
}
