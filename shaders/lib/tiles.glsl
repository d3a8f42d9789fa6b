#ifndef LIB_TILES_GLSL
#define LIB_TILES_GLSL
#include "lib/bindless.glsl"
#include "shared/tiles.glsl"
// For kernels that are dispatched over a list of tiles, with workgroups of 8 by 8.

// The pixel of an invocation: number of its workgroup, and its place in that. It can lie outside of an image whose sides are no multiples
// of 8.
ivec2 tile_pixel(uvec2 list, uint group, uvec2 local) {
    uint tile = WordBuffer(list).at[group];
    return ivec2(tile & 0xffffu, tile >> 16u) * int(TILE_SIDE) + ivec2(local);
}

#endif
