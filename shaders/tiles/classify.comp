#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/tiles.glsl"
// Lists the tiles that have a pixel with work. Their order is undefined.
layout(local_size_x = TILE_SIDE, local_size_y = TILE_SIDE) in;
layout(push_constant, scalar) uniform Push { TileParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };

shared uint has_work;

void main() {
    if (gl_LocalInvocationIndex == 0u) has_work = 0u;
    barrier();
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (inside(pixel, params.size) && load(params.work, pixel).r != 0.0) atomicOr(has_work, 1u);
    barrier();
    if (gl_LocalInvocationIndex != 0u || has_work == 0u) return;
    uint place = atomicAdd(Words(params.groups).at[0], 1u);
    Words(params.list).at[place] = gl_WorkGroupID.x | (gl_WorkGroupID.y << 16u);
}
