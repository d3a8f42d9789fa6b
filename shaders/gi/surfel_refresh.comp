#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Brings what surfels have found to stand around them to where it is looked up. In the passes before it is that of the last frame, so that no path
// depends on which came first.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Placed { PlacedSurfel at[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i < params.capacity && pool.at[i].bound.instance != 0u) Placed(params.grid.placed).at[i].nearness = pool.at[i].nearness;
}
