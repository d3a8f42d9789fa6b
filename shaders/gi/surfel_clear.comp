#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfel_change.glsl"
// Empties the cells, of which one more holds the number of all references, and at the beginning of a frame what paths ask for in them. Counters of the frame begin at 0, but for the number of surfels.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i == 0u) {
        SurfelCounters counters = SurfelCounters(params.counts);
        SurfelWords groups = SurfelWords(params.groups);
        groups.at[0] = counters.counts.groups;
        groups.at[1] = 1u;
        groups.at[2] = 1u;
        // Placing surfels finds out how many groups the next frame needs.
        if (params.begins != 0u) {
            SurfelGridBufferWrite(params.cache).at[0] = params.grid;
            uint before = counters.counts.changed[1];
            uint changed = max(counters.counts.changed[0], before - (before + 31u) / 32u);
            counters.counts = SurfelCounts(0u, counters.counts.live, 0u, 0u, 0u, 0u, 0u, 0u, 0u, uvec2(0u, changed));
        }
    }
    if (params.begins != 0u && i <= params.grid.cell_mask) SurfelWords(params.wishes).at[i] = 0u;
    if (params.begins != 0u && i <= params.grid.cell_mask) {
        for (uint part = 0u; part < 2u * CHANGE_TESTS; part++) {
            SurfelChanges(params.changes).at[part * (params.grid.cell_mask + 1u) + i] = SurfelChange(0, 0u, 0u, 0u);
        }
    }
    if (i <= params.grid.cell_mask + 1u) SurfelCells(params.grid.cells).at[i] = uvec2(0u);
}
