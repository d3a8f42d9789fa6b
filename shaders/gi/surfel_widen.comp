#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Where all surfels around one have few samples, takes the mean of what those share that are up to twice as far away, in two turns: the second takes
// what the first has found. Of two surfels so near to each other one at least knows what stands on the surface between them, so no light leaks.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelWidenParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Placed { PlacedSurfel at[]; };

// Radii within which others are asked.
const float ASKED = 2.0 * REACH;
// Surfels of a cell that are asked, about. Those of one cell share nearly the same.
const uint ASKED_OF_CELL = 2u;
// Samples for which all count that are near, whichever way they face, for a surfel in its first frame with fewer samples around than SPARSE: the few paths from a
// narrow surface may all have met shade.
const float NEAR_BY = 16.0;
const float SPARSE = 64.0;

// What a surfel shares before this turn.
SharedLight shared_before(uint surfel) {
    if (params.turn == 1u) return SurfelPool(params.pool).at[surfel].light_shared;
    Placed placed = Placed(params.grid.placed);
    return SharedLight(placed.at[surfel].mean, placed.at[surfel].tilt, placed.at[surfel].openness, 1u, placed.at[surfel].excess);
}

// `near`: the mean of all that are near, times its weight.
void add_cell(inout SharedLight sum, inout float weights, inout float seen, inout vec4 near, uint cell, uint surfel, PlacedSurfel s) {
    SurfelPool pool = SurfelPool(params.pool);
    bool is_sparse = s.samples <= 1.0 && pool.at[surfel].samples_around < SPARSE;
    uvec2 list = SurfelCells(params.grid.cells).at[cell];
    uint step = max(list.y / ASKED_OF_CELL, 1u);
    for (uint i = surfel % step; i < list.y; i += step) {
        uint other = SurfelWords(params.grid.references).at[list.x + i];
        vec3 offset = s.position - PlacedSurfelBuffer(params.grid.placed).at[other].position;
        float square = dot(offset, offset) / (ASKED * ASKED * s.radius * s.radius);
        if (!(square < 1.0)) continue;
        vec3 normal = PlacedSurfelBuffer(params.grid.placed).at[other].normal;
        vec2 likeness = disc_weight(square, REACH * s.radius, normal, offset, s.normal) * pool.at[other].samples_around;
        if ((is_sparse ? likeness.x : likeness.y) == 0.0) continue;
        likeness *= reached(params.grid, surfel, s.normal, dot(offset, s.normal) * s.normal - offset);
        if (likeness.y > 0.0) likeness.y *= reached(params.grid, other, normal, offset - dot(offset, normal) * normal);
        if (is_sparse) near += likeness.x * vec4(shared_before(other).mean, 1.0);
        if (likeness.y > 0.0) add_shared(sum, shared_before(other), likeness.y, weights, seen);
    }
}

// The mean over a wide surrounding; what the surfel shares itself, where there is nothing else.
SharedLight shared_widely(vec3 eye, uint surfel, PlacedSurfel s, SharedLight own) {
    SharedLight sum = no_shared_light();
    float weights = 0.0;
    float seen = 0.0;
    vec4 near = vec4(0.0);
    SurfelCellsAround around = cells_around(params.grid, s.position - eye, s.normal, ASKED * s.radius, s.radius);
    for (int z = around.low.z; z <= around.high.z; z++) {
        for (int y = around.low.y; y <= around.high.y; y++) {
            for (int x = around.low.x; x <= around.high.x; x++) {
                ivec3 cell = ivec3(x, y, z);
                if (holds(around, cell)) add_cell(sum, weights, seen, near, cell_index(params.grid, cell, around.level), surfel, s);
            }
        }
    }
    if (weights == 0.0) return own;
    SharedLight wide = mean_shared(sum, weights, seen);
    if (near.w > 0.0) {
        float alike = weights / (weights + NEAR_BY);
        wide.mean = mix(near.rgb / near.w, wide.mean, alike);
        for (int channel = 0; channel < 3; channel++) wide.tilt[channel] *= alike;
    }
    if (seen == 0.0) wide.openness = own.openness;
    return wide;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity) return;
    Placed placed = Placed(params.grid.placed);
    if (pool.at[i].bound.instance == 0u) {
        // Those that went in this frame are still in lists, with the light that paths take, which is that of a single one. Not before: others ask for this radius
        // while light is shared.
        if (params.turn == 1u) placed.at[i].radius = 0.0;
        return;
    }
    PlacedSurfel s = placed.at[i];
    float known = pool.at[i].samples_around / WELL_KNOWN;
    SharedLight near = SharedLight(s.mean, s.tilt, s.openness, 1u, s.excess);
    SharedLight light = near;
    if (known < 1.0) light = shared_widely(ViewBuffer(params.view).at[0].eye, i, s, near);
    if (params.turn == 0u) {
        pool.at[i].light_shared = light;
        return;
    }
    placed.at[i].mean = mix(light.mean, near.mean, known);
    placed.at[i].excess = mix(light.excess, near.excess, known);
    for (int channel = 0; channel < 3; channel++) placed.at[i].tilt[channel] = mix(light.tilt[channel], near.tilt[channel], known);
    placed.at[i].openness = mix(light.openness, near.openness, known);
}
