#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Gives each cell room for its references: a prefix sum within each subgroup; subgroups come in any order. Leaves 0 as the number of references.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

void main() {
    SurfelCells cells = SurfelCells(params.grid.cells);
    uint i = gl_GlobalInvocationID.x;
    uint own = i <= params.grid.cell_mask ? cells.at[i].y : 0u;
    uint before = subgroupExclusiveAdd(own);
    uint all = subgroupAdd(own);
    uint first = 0u;
    if (subgroupElect() && all != 0u) first = atomicAdd(cells.at[params.grid.cell_mask + 1u].x, all);
    first = subgroupMax(first);
    if (own != 0u) cells.at[i] = uvec2(first + before, 0u);
}
