#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfel_cells.glsl"
// Puts surfels into the lists of the cells that they touch, in any order.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= params.capacity || SurfelPool(params.pool).at[i].bound.instance == 0u) return;
    PlacedSurfel s = PlacedSurfelBuffer(params.grid.placed).at[i];
    SurfelCells cells = SurfelCells(params.grid.cells);
    TouchedCells touched = touched_cells(params.grid, ViewBuffer(params.view).at[0].eye, s);
    for (uint c = 0u; c < touched.count; c++) {
        uint cell = touched.at[c];
        uint place = atomicAdd(cells.at[cell].y, 1u);
        SurfelWords(params.grid.references).at[cells.at[cell].x + place] = i;
    }
}
