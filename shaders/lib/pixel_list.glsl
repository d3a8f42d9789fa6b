#ifndef LIB_PIXEL_LISTS_GLSL
#define LIB_PIXEL_LISTS_GLSL
#ifndef RAYS_PIPELINE
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#endif
#include "lib/bindless.glsl"
#include "shared/pixel_lists.glsl"
// Lists of pixels that have work, for passes with workgroups of 8 by 8 that are dispatched, or trace, over a list. Pixels of a row of a tile
// lie side by side; other than that the order is undefined.

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer PixelList {
    uvec3 groups;    // workgroups of an indirect dispatch
    uvec3 threads;   // threads of an indirect trace
    uint count;      // pixels
    uint last_key;   // pixels with greater keys are left out
    uint at[];
};

// The pixel of an invocation. False for the last few, which have none. `invocation`: gl_GlobalInvocationID or RAY_INVOCATION.
bool listed_pixel(uvec2 list, uvec2 invocation, out ivec2 pixel) {
    uint place = (invocation.x / TILE_SIDE * TILE_SIDE + invocation.y) * TILE_SIDE + invocation.x % TILE_SIDE;
    if (place >= PixelList(list).count) return false;
    uint packed = PixelList(list).at[place];
    pixel = ivec2(packed & 0xffffu, packed >> 16u);
    return true;
}

#ifndef RAYS_PIPELINE
// Puts the pixels for which `wanted` is true into a list. All invocations of a subgroup call it.
void append_pixel(uvec2 list, ivec2 pixel, bool wanted) {
    uint mine = wanted ? 1u : 0u;
    uint before = subgroupExclusiveAdd(mine);
    uint count = subgroupAdd(mine);
    uint first = 0u;
    if (subgroupElect() && count != 0u) {
        first = atomicAdd(PixelList(list).count, count);
        uint groups = (first + count + TILE_SIDE * TILE_SIDE - 1u) / (TILE_SIDE * TILE_SIDE);
        atomicMax(PixelList(list).groups.x, groups);
        atomicMax(PixelList(list).threads.x, TILE_SIDE * groups);
    }
    first = subgroupMax(first);
    if (wanted) PixelList(list).at[first + before] = uint(pixel.x) | (uint(pixel.y) << 16u);
}
#endif

#endif
