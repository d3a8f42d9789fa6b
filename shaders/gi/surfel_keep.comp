#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Keeps what surfels share for the next frame, and hands out the counters of this one.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelKeepParams params; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i == 0u) {
        SurfelCounts counts = SurfelCounters(params.counts).counts;
        uint counted[7] = uint[](counts.live, counts.wanted, counts.spawned, counts.recycled, counts.dropped, counts.uncovered, counts.visible);
        for (uint at = 0u; at < 7u; at++) SurfelWords(params.counted).at[at] = counted[at];
    }
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity || pool.at[i].bound.instance == 0u) return;
    PlacedSurfelBuffer placed = PlacedSurfelBuffer(params.grid.placed);
    pool.at[i].light_shared = SharedLight(placed.at[i].mean, placed.at[i].tilt, placed.at[i].openness, 1u, pool.at[i].excess_passed);
}
