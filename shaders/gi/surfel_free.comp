#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Lists the free places among those that hold surfels, in their order.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

shared uint is_free[SURFEL_GROUP / 32u];

void main() {
    uint i = gl_GlobalInvocationID.x;
    uint place = gl_LocalInvocationIndex;
    if (place < SURFEL_GROUP / 32u) is_free[place] = 0u;
    barrier();
    bool mine = i < params.capacity && SurfelPool(params.pool).at[i].bound.instance == 0u;
    if (mine) atomicOr(is_free[place / 32u], 1u << (place % 32u));
    barrier();
    if (!mine) return;
    uint rank = bitCount(is_free[place / 32u] & ((1u << (place % 32u)) - 1u));
    for (uint word = 0u; word < place / 32u; word++) rank += bitCount(is_free[word]);
    SurfelWords list = SurfelWords(params.free);
    list.at[free_head(params.capacity) + list.at[gl_WorkGroupID.x] + rank] = i;
}
