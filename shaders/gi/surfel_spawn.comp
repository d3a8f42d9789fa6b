#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/surfels.glsl"
// Asks for surfels where the picture lacks them: in each tile at the pixel that is covered least, as long as that is covered too little.
layout(local_size_x = SPAWN_TILE, local_size_y = SPAWN_TILE) in;
layout(push_constant, scalar) uniform Push { SurfelSpawnParams params; };

// Of so many pixels one marks the surfels that cover it as used, another in each frame.
const uint MARKED = 16u;

shared uint least;
shared vec3 added_position;
shared vec3 added_normal;
shared float added_radius;
shared uint visible;
shared uint uncovered;

// Which pixel of each square of `stride` is looked at in a frame. All have their turn.
uvec2 turn_of(uint frame) {
    uint turn = bitfieldReverse(frame % (params.stride * params.stride)) >> (32u - 2u * findMSB(params.stride));
    return params.stride == 1u ? uvec2(0u) : uvec2((turn ^ (turn / params.stride)) % params.stride, turn / params.stride);
}

bool scatters_diffusely(ivec2 pixel) {
    return load(params.gbuffer.base_colour, pixel).rgb != vec3(0.0) && load(params.gbuffer.material, pixel).r < 1.0;
}

// Sum of the weights of all surfels at a point. Where the list of the cell has no room for more it counts as covered.
float coverage_at(ViewBuffer view, vec3 position, vec3 normal, bool marks) {
    uvec2 list = cell_list(params.grid, view.at[0].eye, position);
    float coverage = 0.0;
    for (uint i = 0u; i < list.y; i++) {
        uint surfel = SurfelWords(params.grid.references).at[list.x + i];
        float weight = surfel_weight(params.grid, surfel, position, normal, 1.0).y;
        coverage += weight;
        if (marks && weight > 0.0) SurfelPool(params.pool).at[surfel].last_used = view.at[0].frame;
    }
    return list.y == CELL_LIMIT ? max(coverage, params.coverage) : coverage;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy * params.stride + turn_of(view.at[0].frame));
    uint place = gl_LocalInvocationIndex;
    uint tiles = gl_NumWorkGroups.x * gl_NumWorkGroups.y;
    uint tile = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (place == 0u) {
        visible = 0u;
        uncovered = 0u;
    }
    barrier();
    Surface s = no_surface();
    float coverage = 1e30;
    uint word = hash4(uvec4(uvec2(pixel), view.at[0].frame, view.at[0].seed)).x;
    if (inside(pixel, view.at[0].size)) {
        s = load_geometry(view, pixel, params.gbuffer);
        if (s.exists && scatters_diffusely(pixel)) {
            coverage = coverage_at(view, s.position, s.geometric_normal, (word & (MARKED - 1u)) == 0u);
            atomicAdd(visible, 1u);
        }
    }
    uint asked = 0u;
    for (; asked < TILE_SPAWNS; asked++) {
        if (place == 0u) least = 0xffffffffu;
        barrier();
        // Least coverage first; of pixels with the same, any. The last byte tells which it is.
        if (coverage < params.coverage) {
            uint key = min(uint(coverage / params.coverage * 256.0), 255u);
            atomicMin(least, (key << 24u) | (word & 0xffff00u) | place);
        }
        barrier();
        uint chosen = least;
        if (chosen == 0xffffffffu) break;
        if ((chosen & 0xffu) == place) {
            SurfelWords(params.asked).at[tiles + cell_groups(params.grid) + 1u + tile * TILE_SPAWNS + asked] = uint(pixel.x) | (uint(pixel.y) << 16u);
            added_position = s.position;
            added_normal = s.geometric_normal;
            added_radius = surfel_radius(params.grid, length(s.position - view.at[0].eye));
            // So that it is not chosen again, not even where rounding leaves its radius 0.
            coverage = params.coverage;
        }
        barrier();
        vec3 offset = s.position - added_position;
        float square = dot(offset, offset) / (added_radius * added_radius);
        if (coverage < params.coverage && square < 1.0) {
            coverage += disc_weight(square, added_radius, added_normal, offset, s.geometric_normal).y;
        }
    }
    if (coverage < params.coverage) atomicAdd(uncovered, 1u);
    barrier();
    if (place != 0u) return;
    SurfelWords(params.asked).at[tile] = asked;
    if (visible != 0u) atomicAdd(SurfelCounters(params.counts).counts.visible, visible);
    if (uncovered != 0u) atomicAdd(SurfelCounters(params.counts).counts.uncovered, uncovered);
}
