#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/lamp_clusters.glsl"
#include "lib/lights.glsl"
#include "shared/scene.glsl"
// Light at a corner of cells, of lamps as far as they are not near: one workgroup for each.
layout(local_size_x = CLUSTER_GROUP) in;
layout(push_constant, scalar) uniform Push { ClusterParams params; };

shared CornerLight sums[CLUSTER_GROUP];

// The least factor of the cells around, so that lists hold all that is near.
float scale_here(LampGrid grid, uvec3 corner) {
    float scale = 1.0;
    for (uint k = 0u; k < 8u; k++) {
        ivec3 cell = ivec3(corner) - (ivec3(k, k >> 1u, k >> 2u) & 1);
        if (any(lessThan(cell, ivec3(0))) || any(greaterThanEqual(cell, ivec3(grid.tables.cells)))) continue;
        scale = min(scale, LampCellBuffer(grid.tables.lists).at[cell_index(grid, uvec3(cell))].scale);
    }
    return scale;
}

// A third of the diagonal of a cell, or so. Lamps nearer than that to a corner, but not near in the sense of their reach, shine from that far: what is between
// corners can't show their peaks.
float least_distance(ViewBuffer view, LampGrid grid, uvec3 corner) {
    uvec3 other = mix(corner + 1u, corner - 1u, equal(corner, grid.tables.cells));
    return 0.3 * distance(to_corner(view, grid, corner), to_corner(view, grid, other));
}

void main() {
    uint thread = gl_LocalInvocationIndex;
    ViewBuffer view = ViewBuffer(params.view);
    LampGrid grid = LampGridBuffer(params.grid).at[0];
    SceneBuffer scene = SceneBuffer(params.scene);
    LampReaches reaches = LampReaches(grid.tables.reaches);
    uvec3 corner = gl_WorkGroupID;
    vec3 position = view.at[0].eye + to_corner(view, grid, corner);
    float least = least_distance(view, grid, corner);
    float scale = scale_here(grid, corner);
    vec3 sum[9];
    for (int k = 0; k < 9; k++) sum[k] = vec3(0.0);
    for (uint i = thread; i < scene.at[0].light_count; i += CLUSTER_GROUP) {
        vec4 lamp = reaches.at[i];
        if (!(lamp.w > 0.0) || isinf(lamp.w)) continue;
        float share = 1.0 - near_share(distance(lamp.xyz, position), lamp.w, scale);
        if (share <= 0.0) continue;
        LightSample from = sample_light(LightBuffer(scene.at[0].lights).at[i], position);
        float limit = from.distance < least ? from.distance / least : 1.0;
        float basis[9] = harmonics(from.direction);
        for (int k = 0; k < 9; k++) sum[k] += from.irradiance * (share * limit * limit * basis[k]);
    }
    sums[thread].harmonics = sum;
    barrier();
    // The sum of all invocations, in an order that is the same in every run.
    for (uint apart = CLUSTER_GROUP / 2u; apart > 0u; apart /= 2u) {
        if (thread < apart) {
            for (int k = 0; k < 9; k++) sums[thread].harmonics[k] += sums[thread + apart].harmonics[k];
        }
        barrier();
    }
    if (thread == 0u) CornerLightBufferWrite(grid.tables.corners).at[corner_index(grid, corner)] = CornerLight(scale, sums[0].harmonics);
}
