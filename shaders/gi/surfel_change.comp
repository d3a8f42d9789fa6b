#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfel_change.glsl"
// Adds up, over the surfels of each cell and block, how far their light of late is from their means.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity || pool.at[i].bound.instance == 0u || pool.at[i].light.samples < HAS_SAY) return;
    vec3 from_eye = PlacedSurfelBuffer(params.grid.placed).at[i].position - ViewBuffer(params.view).at[0].eye;
    Estimator e = pool.at[i].light;
    SurfelChanges changes = SurfelChanges(params.changes);
    for (uint test = 0u; test < CHANGE_TESTS; test++) {
        float change = change_of(e, test, ViewBuffer(params.view).at[0].frame);
        uvec2 places = change_places(params.grid, from_eye) + test * 2u * (params.grid.cell_mask + 1u);
        for (int place = 0; place < 2; place++) {
            atomicAdd(changes.at[places[place]].sum, int(round(256.0 * change)));
            atomicAdd(changes.at[places[place]].squares, uint(round(64.0 * change * change)));
            atomicAdd(changes.at[places[place]].count, 1u);
        }
    }
}
