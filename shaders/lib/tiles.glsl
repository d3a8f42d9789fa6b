#ifndef LIB_TILES_GLSL
#define LIB_TILES_GLSL
#include "lib/bindless.glsl"
#include "shared/tiles.glsl"
// For kernels that are dispatched over a list of tiles, with workgroups of 8 by 8.

// The pixel of this invocation. It can lie outside of an image whose sides are no multiples of 8.
ivec2 tile_pixel(uvec2 list) {
    uint tile = WordBuffer(list).at[gl_WorkGroupID.x];
    return ivec2(tile & 0xffffu, tile >> 16u) * int(TILE_SIDE) + ivec2(gl_LocalInvocationID.xy);
}

#endif
