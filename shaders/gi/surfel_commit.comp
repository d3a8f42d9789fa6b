#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/pixel_list.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "lib/surfel_binding.glsl"
// Spawns the surfels that tiles and paths ask for, as far as there is room. They begin with the light that surfels around them give.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelCommitParams params; };

// Samples that inherited light stands for.
const float INHERITED = 4.0;

shared uint asks[SURFEL_GROUP / 32u];

// Where a pixel of a tile lies.
SurfelBinding seen_at(ViewBuffer view, ivec2 pixel) {
    vec3 position = world_position(view, pixel, load(params.depth, pixel).r);
    return seen_binding(SceneBuffer(params.scene), load_uint(params.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), position);
}

// Light at a point by what surfels around it share. Paths take light that is newer but has more noise.
SharedLight shared_around(vec3 eye, vec3 position, vec3 normal) {
    SurfelPool pool = SurfelPool(params.pool);
    uvec2 list = cell_list(params.grid, eye, position);
    SharedLight sum = no_shared_light();
    float weights = 0.0;
    float seen = 0.0;
    for (uint i = 0u; i < list.y; i++) {
        uint other = SurfelWords(params.grid.references).at[list.x + i];
        float weight = surfel_weight(params.grid, other, position, normal, REACH).y * min(pool.at[other].light.samples, CONFIDENT);
        if (weight > 0.0) add_shared(sum, pool.at[other].light_shared, weight, weights, seen);
    }
    return mean_shared(sum, weights, seen);
}

// False where there is no place for it: a triangle without area, or a pixel without a position.
bool spawn(ViewBuffer view, uint surfel, SurfelBinding at) {
    Surfel s;
    s.bound = at;
    RayStart start = surfel_start(SceneBuffer(params.scene), at);
    if (start.normal == vec3(0.0) || !is_finite(start.position) || !is_finite(start.normal)) return false;
    s.last_used = view.at[0].frame;
    s.born = view.at[0].frame;
    s.paths = 0u;
    SurfelLight around = surfel_lookup(params.grid, view.at[0].eye, start.position, start.normal, start.normal);
    s.light_shared = no_shared_light();
    if (around.known) s.light_shared = shared_around(view.at[0].eye, start.position, start.normal);
    else s.light_shared.mean = around.light;
    s.excess = vec3(0.0);
    s.excess_passed = vec3(0.0);
    s.openness = -1.0;
    s.samples_around = 0.0;
    s.light.mean = s.light_shared.mean;
    s.light.samples = min(around.samples, INHERITED);
    s.light.short_mean = s.light.mean;
    s.light.newest = around.light;
    s.light.variance = s.light.mean * s.light.mean;
    s.light.variance_blend = 1.0;
    s.light.inconsistency = 1.0;
    s.light.brightest = 0.0;
    s.light.tilt = s.light_shared.tilt;
    for (uint sector = 0u; sector < SECTORS; sector++) s.nearness[sector] = 0u;
    for (uint pair = 0u; pair < GUIDE_SIDE * GUIDE_SIDE / 2u; pair++) s.guide[pair] = 0u;
    s.chances = uvec4(0u);
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
    SurfelPool(params.pool).at[surfel] = s;
    PlacedSurfelBufferWrite(params.grid.placed).at[surfel] = placed;
    return true;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    SurfelWords asked = SurfelWords(params.asked);
    SurfelWords free = SurfelWords(params.free);
    uint i = gl_GlobalInvocationID.x;
    uint numbers = params.tiles + cell_groups(params.grid);
    uint wanted = asked.at[numbers];
    // Free places among those that hold surfels, then all behind.
    uint groups = SurfelWords(params.groups).at[0];
    uint listed = free.at[groups];
    uint held = min(groups * SURFEL_GROUP, params.capacity);
    SurfelCounters counters = SurfelCounters(params.counts);
    uint most = (params.budget - min(counters.counts.rays, params.budget)) / params.rays_of_new;
    uint spawned = min(min(wanted, listed + params.capacity - held), most);
    if (i == 0u) {
        counters.counts.live = held - listed + spawned;
        counters.counts.wanted = wanted;
        counters.counts.spawned = spawned;
    }

    // The first workgroups have tiles, the others cells.
    uint of_tiles = (params.tiles * TILE_SPAWNS + SURFEL_GROUP - 1u) / SURFEL_GROUP;
    uint place = gl_LocalInvocationIndex;
    uint number = 0u;
    bool asks_for = false;
    SurfelBinding at = SurfelBinding(0u, 0u, vec2(0.0), 0u);
    if (place < SURFEL_GROUP / 32u) asks[place] = 0u;
    barrier();
    if (gl_WorkGroupID.x < of_tiles) {
        uint tile = i / TILE_SPAWNS;
        if (tile < params.tiles) {
            number = asked.at[tile] + i % TILE_SPAWNS;
            asks_for = number < asked.at[tile + 1u];
        }
        if (asks_for) {
            uint packed = asked.at[numbers + 1u + i];
            at = seen_at(view, ivec2(packed & 0xffffu, packed >> 16u));
        }
    } else {
        uint group = gl_WorkGroupID.x - of_tiles;
        uint cell = group * SURFEL_GROUP + place;
        uint wish = cell <= params.grid.cell_mask ? SurfelWords(params.wishes).at[cell] : 0u;
        asks_for = wish != 0u;
        if (asks_for) {
            at = wished_bindings(params.grid, params.wishes).at[wish - 1u];
            atomicOr(asks[place / 32u], 1u << (place % 32u));
        }
        barrier();
        number = asked.at[params.tiles + group] + bitCount(asks[place / 32u] & ((1u << (place % 32u)) - 1u));
        for (uint word = 0u; word < place / 32u; word++) number += bitCount(asks[word]);
    }
    uint surfel = 0u;
    if (asks_for) {
        // Where not all that are wanted can be spawned, others come first in each frame.
        uint turn = (number + view.at[0].frame * most) % wanted;
        asks_for = turn < spawned;
        if (asks_for) {
            surfel = turn < listed ? free.at[free_head(params.capacity) + turn] : held + turn - listed;
            atomicMax(counters.counts.groups, surfel / SURFEL_GROUP + 1u);
            asks_for = spawn(view, surfel, at);
        }
    }
    append_pixel(params.list, key_pixel(surfel), asks_for);
}
