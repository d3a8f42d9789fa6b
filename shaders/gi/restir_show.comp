#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/path_reservoirs.glsl"
// What reservoirs hold, as images.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { PathShowParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(cell, grid_size(view, params.modes))) return;
    PathReservoir r = PathReservoirBuffer(params.reservoirs).at[grid_index(view, params.modes, cell)];
    store(params.radiance, cell, vec4(sample_of(r, vec3(0.0)).radiance, 1.0));
    store(params.weight, cell, vec4(r.weight));
    store(params.confidence, cell, vec4(float(confidence_of(r))));
    store(params.age, cell, vec4(float(age_of(r))));
    store(params.traced, cell, vec4(float(frames_since_traced(r))));
    PathChanges changes = PathChanges(0u, 0u);
    if (params.changes != uvec2(0u)) changes = PathChangesBuffer(params.changes).at[tile_index(view, params.modes, cell)];
    store(params.changed, cell, vec4(changes.traced, changes.changed, 0.0, 0.0));
}
