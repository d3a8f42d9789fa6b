#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/pixel_list.glsl"
// Empties a list, and the numbers of pixels of each key.
layout(local_size_x = 1) in;
layout(push_constant, scalar) uniform Push { ListParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Histogram { uint at[]; };

void main() {
    PixelList list = PixelList(params.list);
    list.groups = uvec3(0u, 1u, 1u);
    list.threads = uvec3(0u, TILE_SIDE, 1u);
    list.count = 0u;
    list.last_key = GREATEST_KEY;
    if (params.is_limited == 0u) return;
    for (uint key = 0u; key <= GREATEST_KEY; key++) Histogram(params.histogram).at[key] = 0u;
}
