#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/pixel_lists.glsl"
// Counts the pixels of each key.
layout(local_size_x = TILE_SIDE, local_size_y = TILE_SIDE) in;
layout(push_constant, scalar) uniform Push { ListParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Histogram { uint at[]; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    uint key = uint(load(params.keys, pixel).r * float(GREATEST_KEY) + 0.5);
    if (key != 0u) atomicAdd(Histogram(params.histogram).at[key], 1u);
}
