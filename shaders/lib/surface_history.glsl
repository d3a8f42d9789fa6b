#ifndef LIB_SURFACE_HISTORY_GLSL
#define LIB_SURFACE_HISTORY_GLSL
#include "lib/reprojection.glsl"
#include "lib/surface_codes.glsl"
// Compares what a pixel shows with what its history shows. `surfaces`: of the history, the range of depth codes and the set of instances.

// A thing counts as gone from its place if it moves by more than this, pixels per frame.
const float LEAST_DEPARTURE = 0.1;

// Whether the history shows a surface, by depth and instance.
bool showed(ViewBuffer view, SceneBuffer scene, uvec2 surfaces, ivec2 pixel, float depth, uint id) {
    uint expected = 0u;
    if (id != 0u) {
        Instance instance = InstanceBuffer(scene.at[0].instances).at[id - 1u];
        vec3 position = world_position(view, pixel, depth);
        expected = depth_code(depth_before(view, position_before(instance, position)));
    }
    uint least = surfaces.x & 0xffffu, most = surfaces.x >> 16;
    bool near = expected + DEPTH_TOLERANCE >= least && expected <= most + DEPTH_TOLERANCE;
    return near && (surfaces.y & instance_bit(id)) != 0u;
}

// Whether an instance moves with time.
bool can_move(SceneBuffer scene, uint id) {
    return id != 0u && (InstanceBuffer(scene.at[0].instances).at[id - 1u].flags & INSTANCE_MOVES) != 0u;
}

// Whether a thing that the history shows has moved on in this frame. By its transform, as a thin thing may also be missed by all samples. `surfaces` give its depth.
bool has_departed(ViewBuffer view, SceneBuffer scene, uvec2 surfaces, ivec2 pixel, uint id) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[id - 1u];
    uint nearest = surfaces.x >> 16;
    if (nearest == 0u || instance.world_from_object == instance.previous_world_from_object) return false;
    vec3 position = world_position(view, pixel, depth_of_code(nearest));
    vec4 now = view.at[0].steady_clip_from_world * vec4(position, 1.0);
    vec4 before = view.at[0].previous_clip_from_world * vec4(position_before(instance, position), 1.0);
    if (before.w <= 0.0) return true;
    return length((now.xy / now.w - before.xy / before.w) * 0.5 * vec2(view.at[0].size)) > LEAST_DEPARTURE;
}

#endif
