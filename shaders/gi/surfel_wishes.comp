#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Counts the cells of each workgroup in which a path asks for a surfel, behind what the tiles of the picture ask for.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelSpawnParams params; };

shared uint asked;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (gl_LocalInvocationIndex == 0u) asked = 0u;
    barrier();
    if (i <= params.grid.cell_mask && SurfelWords(params.wishes).at[i] != 0u) atomicAdd(asked, 1u);
    barrier();
    if (gl_LocalInvocationIndex == 0u) SurfelWords(params.asked).at[params.tiles + gl_WorkGroupID.x] = asked;
}
