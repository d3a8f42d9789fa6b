#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "lib/surfel_binding.glsl"
#include "lib/surfel_change.glsl"
// Places surfels where their triangles are in this frame, recycles those that nothing uses, chooses which of them trace, and counts free places.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

// Beyond this share of the pool surfels live shorter the fuller it is, down to the least.
const float CROWDED = 0.75;
const float LEAST_LIFE = 8.0;
// A surfel that nothing has used for so many frames traces rarely.
const uint IDLE = 32u;

shared uint free_places;

// Frames from path to path.
uint period_of(Surfel s, uint unused) {
    if (unused > IDLE) return 32u;
    return s.light.samples < 64.0 ? 1u : s.light.samples < 256.0 ? 2u : 4u;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    SceneBuffer scene = SceneBuffer(params.scene);
    SurfelPool pool = SurfelPool(params.pool);
    uint i = gl_GlobalInvocationID.x;
    if (gl_LocalInvocationIndex == 0u) free_places = 0u;
    barrier();

    uint key = 0u;
    bool lives = false;
    if (i < params.capacity && pool.at[i].bound.instance != 0u) {
        Surfel s = pool.at[i];
        uint unused = view.at[0].frame - s.last_used;
        float full = float(SurfelCounters(params.counts).counts.live) / float(params.capacity);
        float life = mix(float(params.life), LEAST_LIFE, clamp((full - CROWDED) / (1.0 - CROWDED), 0.0, 1.0));
        RayStart start = surfel_start(scene, s.bound);
        bool has_place = start.normal != vec3(0.0) && is_taken(params.not_finite, start.position) && is_taken(params.not_finite, start.normal);
        if (float(unused) > life || !has_place) {
            pool.at[i].bound.instance = 0u;
            atomicAdd(SurfelCounters(params.counts).counts.recycled, 1u);
        } else {
            lives = true;
            PlacedSurfel placed;
            placed.position = start.position;
            placed.radius = surfel_radius(params.grid, length(start.position - view.at[0].eye));
            placed.normal = start.normal;
            placed.samples = s.light.samples;
            placed.mean = s.light.newest;
            placed.tilt = s.light.tilt;
            placed.openness = s.light_shared.openness;
            placed.excess = vec3(0.0);
            placed.nearness = s.nearness;
            PlacedSurfelBufferWrite(params.grid.placed).at[i] = placed;
            uint block = change_places(params.grid, placed.position - view.at[0].eye).y;
            atomicMax(SurfelChanges(params.changes).at[block].brightest, floatBitsToUint(s.light.brightest));
            atomicMax(SurfelCounters(params.counts).counts.groups, gl_WorkGroupID.x + 1u);
            uint word = hash4(uvec4(i, s.born, 0u, view.at[0].seed)).x;
            uint period = period_of(s, unused);
            // Whose turn it is comes in an order that changes from frame to frame, for when the budget is too small for all.
            if ((word + view.at[0].frame) % period == 0u) key = 1u + ((word >> 8u) + 61u * view.at[0].frame) % 127u + (unused > IDLE ? 127u : 0u);
        }
    }
    if (i < params.capacity) {
        store(params.keys, key_pixel(i), vec4(float(key) / 255.0));
        if (!lives) atomicAdd(free_places, 1u);
    }
    barrier();
    bool holds_surfels = gl_WorkGroupID.x < SurfelWords(params.groups).at[0];
    if (holds_surfels && gl_LocalInvocationIndex == 0u) SurfelWords(params.free).at[gl_WorkGroupID.x] = free_places;
}
