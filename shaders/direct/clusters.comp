#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/lamp_clusters.glsl"
#include "shared/scene.glsl"
// Lists the lamps that reach a cell, one workgroup for each. Where they are too many, all reach less far there.
layout(local_size_x = CLUSTER_GROUP) in;
layout(push_constant, scalar) uniform Push { ClusterParams params; };

// Steps in which reaches shrink.
const uint STEPS = 32u;

shared uint by_distance[STEPS + 1u];  // lamps by their distance over their reach; first those that count everywhere
shared uint counts[CLUSTER_GROUP];

// A cell's bounds along the axes of the camera.
struct Bounds {
    mat3 axes;
    vec3 low;
    vec3 high;
};

Bounds bounds_of(ViewBuffer view, LampGrid grid, uvec3 cell) {
    mat4 m = view.at[0].world_from_clip;
    vec3 right = normalize(m[0].xyz), down = normalize(m[1].xyz);
    Bounds b = Bounds(mat3(right, down, cross(right, down)), vec3(1.0 / 0.0), vec3(-1.0 / 0.0));
    for (uint k = 0u; k < 8u; k++) {
        vec3 corner = to_corner(view, grid, cell + (uvec3(k, k >> 1u, k >> 2u) & 1u)) * b.axes;
        b.low = min(b.low, corner);
        b.high = max(b.high, corner);
    }
    return b;
}

// A lamp's distance to the cell over its reach.
float relative_distance(ViewBuffer view, Bounds b, vec4 lamp) {
    vec3 place = (lamp.xyz - view.at[0].eye) * b.axes;
    return length(max(max(b.low - place, place - b.high), 0.0)) / lamp.w;
}

bool is_near(ViewBuffer view, Bounds b, vec4 lamp, float scale) {
    return isinf(lamp.w) || (lamp.w > 0.0 && relative_distance(view, b, lamp) < scale);
}

void main() {
    uint thread = gl_LocalInvocationIndex;
    ViewBuffer view = ViewBuffer(params.view);
    LampGrid grid = LampGridBuffer(params.grid).at[0];
    LampReaches reaches = LampReaches(grid.tables.reaches);
    uint count = SceneBuffer(params.scene).at[0].light_count;
    Bounds bounds = bounds_of(view, grid, gl_WorkGroupID);
    if (thread < STEPS + 1u) by_distance[thread] = 0u;
    barrier();
    for (uint i = thread; i < count; i += CLUSTER_GROUP) {
        vec4 lamp = reaches.at[i];
        if (!is_near(view, bounds, lamp, 1.0)) continue;
        uint step = isinf(lamp.w) ? 0u : 1u + uint(relative_distance(view, bounds, lamp) * float(STEPS));
        atomicAdd(by_distance[step], 1u);
    }
    barrier();
    uint listed = by_distance[0], steps = 0u;
    while (steps < STEPS && listed + by_distance[steps + 1u] <= CELL_LAMPS) {
        steps++;
        listed += by_distance[steps];
    }
    float scale = float(steps) / float(STEPS);

    // In an order that is the same in every run.
    uint own = 0u;
    for (uint i = thread; i < count; i += CLUSTER_GROUP) own += is_near(view, bounds, reaches.at[i], scale) ? 1u : 0u;
    counts[thread] = own;
    barrier();
    uint at = 0u;
    for (uint k = 0u; k < thread; k++) at += counts[k];
    LampCellBufferWrite cells = LampCellBufferWrite(grid.tables.lists);
    uint cell = cell_index(grid, gl_WorkGroupID);
    for (uint i = thread; i < count && at < CELL_LAMPS; i += CLUSTER_GROUP) {
        if (!is_near(view, bounds, reaches.at[i], scale)) continue;
        cells.at[cell].lamps[at] = i;
        at++;
    }
    if (thread == 0u) {
        cells.at[cell].count = min(listed, CELL_LAMPS);
        cells.at[cell].scale = scale;
    }
}
