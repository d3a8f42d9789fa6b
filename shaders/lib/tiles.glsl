#ifndef LIB_TILES_GLSL
#define LIB_TILES_GLSL
#include "lib/bindless.glsl"
#include "shared/denoise.glsl"
// Lists of 8x8 pixel tiles with work in them, a workgroup each.

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer TileListWrite { uint at[]; };

// Variance of `channels` channels. With one it counts for all, as for radiance; otherwise missing channels are 0.
vec4 load_error(uint image, ivec2 pixel, uint channels) {
    vec4 error = load(image, pixel);
    return channels == 1u ? error.xxxx : mix(vec4(0.0), error, greaterThan(uvec4(channels), uvec4(0u, 1u, 2u, 3u)));
}

uint pack_tile(uvec2 tile) {
    return tile.x | (tile.y << 16u);
}

// The pixel of an invocation in a dispatch over a list of tiles.
ivec2 listed_pixel(uvec2 list, uint group, uvec2 place) {
    uint tile = WordBuffer(list).at[group];
    return ivec2(uvec2(tile & 0xffffu, tile >> 16u) * TILE + place);
}

#endif
