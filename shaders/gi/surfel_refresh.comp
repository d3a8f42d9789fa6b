#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfel_change.glsl"
#include "lib/surfel_guide.glsl"
// Lets means begin anew where the light has changed, and brings what surfels have found to stand around them to where it is looked up. In the passes before it is that
// of the last frame, so that no path depends on which came first.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Placed { PlacedSurfel at[]; };

// Samples that are left where the light has changed, about as many as the windows hold.
const float LEFT[CHANGE_TESTS] = float[](2.0, 2.0, 12.0);
const float LEFT_LIKELY = 4.0;
// Samples below which what is left is so little that directions are learned anew.
const float FORGETS = 16.0;

// How much tells that the light at a surfel has changed, over what it takes: in its cell, or in its block if its cell does not say otherwise.
float evidence(vec3 from_eye, uint test) {
    uvec2 places = change_places(params.grid, from_eye) + test * 2u * (params.grid.cell_mask + 1u);
    float cell = change_at(SurfelChanges(params.changes).at[places.x]);
    float block = change_at(SurfelChanges(params.changes).at[places.y]);
    return (test == COLOUR ? OF_COLOUR : 1.0) * max(abs(cell), cell * block > 0.0 ? abs(block) : 0.0);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity || pool.at[i].bound.instance == 0u) return;
    Placed(params.grid.placed).at[i].nearness = pool.at[i].nearness;
    if (params.changes == uvec2(0u) || pool.at[i].light.samples < HAS_SAY) return;
    vec3 from_eye = Placed(params.grid.placed).at[i].position - ViewBuffer(params.view).at[0].eye;
    SurfelCounters counters = SurfelCounters(params.counts);
    // What changes in one place does so elsewhere as well, by light that is passed on.
    float likely = change_elsewhere(counters.counts);
    float samples = pool.at[i].light.samples;
    for (uint test = 0u; test < CHANGE_TESTS; test++) {
        float found = evidence(from_eye, test);
        if (found < 1.0) {
            // Not enough to throw away what is known, but the likelier a change is, the sooner that shall count no more.
            float evident = test == COLOUR ? 0.0 : likely * found;
            if (evident > 0.0) samples = min(samples, LEFT_LIKELY / (evident * evident));
            continue;
        }
        atomicAdd(counters.counts.changed[0], 1u);
        vec3 of_late = light_of_late(pool.at[i].light, test);
        // What is darker than before has less tilt as well.
        for (int channel = 0; channel < 3; channel++) {
            float before = pool.at[i].light.mean[channel];
            pool.at[i].light.tilt[channel] *= before > 0.0 ? min(of_late[channel] / before, 1.0) : 0.0;
        }
        pool.at[i].light_shared.mean = of_late;
        pool.at[i].light_shared.tilt = pool.at[i].light.tilt;
        pool.at[i].light.mean = of_late;
        pool.at[i].light_shared.excess = vec3(0.0);
        pool.at[i].excess = vec3(0.0);
        pool.at[i].excess_passed = vec3(0.0);
        pool.at[i].light.short_mean = of_late;
        pool.at[i].light.variance = of_late * of_late;
        samples = min(samples, LEFT[test]);
        break;
    }
    // What was learned of directions is of no use where the light is another. Paths begin a block.
    if (samples < min(pool.at[i].light.samples, FORGETS)) {
        for (uint pair = 0u; pair < GUIDE_SIDE * GUIDE_SIDE / 2u; pair++) pool.at[i].guide[pair] = 0u;
        pool.at[i].paths += GUIDE_BLOCK - pool.at[i].paths % GUIDE_BLOCK;
    }
    pool.at[i].light.samples = samples;
}
