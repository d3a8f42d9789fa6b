#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Sorts the list of each cell, so that sums over it do not depend on the order in which surfels came. Of a list that is too long the first
// CELL_LIMIT stay. A surfel that touches two cells which share a list is in it once.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i > params.grid.cell_mask) return;
    SurfelCells cells = SurfelCells(params.grid.cells);
    SurfelWords references = SurfelWords(params.grid.references);
    uvec2 list = cells.at[i];
    uint kept = 0u;
    uint dropped = 0u;
    for (uint next = 0u; next < list.y; next++) {
        uint surfel = references.at[list.x + next];
        uint place = kept;
        while (place > 0u && references.at[list.x + place - 1u] > surfel) place--;
        if (place > 0u && references.at[list.x + place - 1u] == surfel) continue;
        if (kept == CELL_LIMIT) dropped++;
        else kept++;
        for (uint behind = kept - 1u; behind > place; behind--) references.at[list.x + behind] = references.at[list.x + behind - 1u];
        if (place < kept) references.at[list.x + place] = surfel;
    }
    cells.at[i].y = kept;
    if (dropped != 0u) atomicAdd(SurfelCounters(params.counts).counts.dropped, dropped);
}
