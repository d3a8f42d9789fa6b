#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/surfels.glsl"
// Brings the light of surfels to where the picture looks it up. Those with few samples share them with others around them: what they keep for
// themselves is their own.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelPoolParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Placed { PlacedSurfel at[]; };

// Samples with which a surfel stands alone. With fewer it shares with others within a distance that is so great that they have as many, at most REACH radii.
const float ENOUGH = 64.0;

struct Shared {
    vec3 mean;
    mat3 tilt;
    float samples;
};

void add_cell(inout Shared sum, ivec3 cell, int level, vec3 position, vec3 normal, float reach) {
    SurfelPool pool = SurfelPool(params.pool);
    uvec2 list = SurfelCells(params.grid.cells).at[cell_index(params.grid, cell, level)];
    vec3 eye = ViewBuffer(params.view).at[0].eye;
    for (uint i = 0u; i < list.y; i++) {
        uint other = SurfelWords(params.grid.references).at[list.x + i];
        vec3 centre = PlacedSurfelBuffer(params.grid.placed).at[other].position;
        vec3 offset = position - centre;
        float square = dot(offset, offset) / (reach * reach);
        if (!(square < 1.0)) continue;
        // A surfel is in the lists of all cells that it touches. It counts in the one where its centre is.
        if (cell_of(params.grid, centre - eye, level) != cell) continue;
        vec3 own = PlacedSurfelBuffer(params.grid.placed).at[other].normal;
        float weight = disc_weight(square, reach, own, offset, normal).y;
        if (weight > 0.0) weight *= reached(params.grid, other, own, offset - dot(offset, own) * own) * min(pool.at[other].light.samples, ENOUGH);
        if (weight == 0.0) continue;
        sum.mean += weight * pool.at[other].light.mean;
        for (int channel = 0; channel < 3; channel++) sum.tilt[channel] += weight * pool.at[other].light.tilt[channel];
        sum.samples += weight;
    }
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity || pool.at[i].bound.instance == 0u) return;
    Placed placed = Placed(params.grid.placed);
    float samples = pool.at[i].light.samples;
    vec3 mean = pool.at[i].light.mean;
    vec3 tilt[3] = pool.at[i].light.tilt;
    if (samples < ENOUGH) {
        vec3 position = placed.at[i].position;
        vec3 normal = placed.at[i].normal;
        vec3 from_eye = position - ViewBuffer(params.view).at[0].eye;
        int level = cell_level(length(from_eye));
        float reach = placed.at[i].radius * clamp(sqrt(ENOUGH / max(samples, 1.0)), 1.0, REACH);
        ivec3 low = cell_of(params.grid, from_eye - reach, level);
        ivec3 high = cell_of(params.grid, from_eye + reach, level);
        Shared sum = Shared(vec3(0.0), mat3(0.0), 0.0);
        for (int z = low.z; z <= high.z; z++) {
            for (int y = low.y; y <= high.y; y++) {
                for (int x = low.x; x <= high.x; x++) add_cell(sum, ivec3(x, y, z), level, position, normal, reach);
            }
        }
        if (sum.samples > 0.0) {
            mean = sum.mean / sum.samples;
            for (int channel = 0; channel < 3; channel++) tilt[channel] = sum.tilt[channel] / sum.samples;
        }
    }
    placed.at[i].mean = mean;
    placed.at[i].samples = samples;
    placed.at[i].tilt = tilt;
}
