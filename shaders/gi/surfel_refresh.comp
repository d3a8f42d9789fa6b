#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfel_change.glsl"
// Lets means begin anew where the light has changed, and brings what surfels have found to stand around them to where it is looked up. In the passes before it is that of the last frame, so that no path
// depends on which came first.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Placed { PlacedSurfel at[]; };

// Samples that are left where the light has changed, about as many as the windows hold.
const float LEFT[2] = float[](2.0, 12.0);

// Whether the light at a surfel has changed: in its cell, or in its block if its cell does not say otherwise.
bool has_changed(vec3 from_eye, uint window) {
    uvec2 places = change_places(params.grid, from_eye) + window * 2u * (params.grid.cell_mask + 1u);
    float cell = change_at(SurfelChanges(params.changes).at[places.x], WINDOWS[window]);
    float block = change_at(SurfelChanges(params.changes).at[places.y], WINDOWS[window]);
    return abs(cell) > 1.0 || (abs(block) > 1.0 && cell * block > 0.0);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity || pool.at[i].bound.instance == 0u) return;
    Placed(params.grid.placed).at[i].nearness = pool.at[i].nearness;
    if (params.changes == uvec2(0u) || pool.at[i].light.samples < HAS_SAY) return;
    vec3 from_eye = Placed(params.grid.placed).at[i].position - ViewBuffer(params.view).at[0].eye;
    for (uint window = 0u; window < 2u; window++) {
        if (!has_changed(from_eye, window)) continue;
        vec3 of_late = window == 0u ? vec3(pool.at[i].light.newest) : vec3(pool.at[i].light.short_mean);
        pool.at[i].light.mean = of_late;
        pool.at[i].light.short_mean = of_late;
        pool.at[i].light.variance = of_late * of_late;
        pool.at[i].light.samples = min(pool.at[i].light.samples, LEFT[window]);
        break;
    }
}
