#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/pixel_list.glsl"
// Lists the pixels that have work.
layout(local_size_x = TILE_SIDE, local_size_y = TILE_SIDE) in;
layout(push_constant, scalar) uniform Push { ListParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    uint key = 0u;
    if (inside(pixel, params.size)) key = uint(load(params.keys, pixel).r * float(GREATEST_KEY) + 0.5);
    append_pixel(params.list, pixel, key != 0u && key <= PixelList(params.list).last_key);
}
