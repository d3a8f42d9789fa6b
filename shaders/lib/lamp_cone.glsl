#ifndef LIB_LAMP_CONE_GLSL
#define LIB_LAMP_CONE_GLSL
#include "lib/bindless.glsl"
#include "lib/lamp_clusters.glsl"
#include "lib/lamp_walk.glsl"
#include "lib/light_tree.glsl"
// Far lamps within a cone, by the bounds of the light tree: one by one, or together where they look small (Walter et al. 2005, "Lightcuts: A
// Scalable Approach to Illumination").

struct ConeWalk {
    LitPoint apex;
    vec3 axis;               // unit
    float half_angle;        // radians
    float small;             // what looks smaller than this is taken together: its radius over its distance; more of what is off the axis
    float scale;             // of reaches
    uint stack[LAMP_STACK];  // nodes
    uint size;
};

// Lamps that were found.
struct FoundLamps {
    bool together;
    uint entry;        // of one: in `LightTables::near`
    vec3 place;        // of several
    float irradiance;  // of several, luminance at normal incidence
};

ConeWalk cone_walk(vec3 apex, vec3 axis, float half_angle, float small, float scale) {
    ConeWalk walk;
    walk.apex = lit_point(apex, vec3(0.0), true);
    walk.axis = axis;
    walk.half_angle = half_angle;
    walk.small = small;
    walk.scale = scale;
    walk.stack[0] = 0u;
    walk.size = 1u;
    return walk;
}

// Whether no lamp below a node is near, or counts everywhere.
bool are_far(LampGrid grid, ConeWalk walk, LightNode node) {
    vec3 outside = max(max(node.min - walk.apex.position, walk.apex.position - node.max), 0.0);
    if (length(outside) < sqrt(node.intensity) * grid.reach * walk.scale) return false;
    for (uint k = 0u; k < MAX_SHADOW_LIGHTS; k++) {
        vec3 place = grid.everywhere[k];
        if (all(greaterThanEqual(place, node.min)) && all(lessThanEqual(place, node.max))) return false;
    }
    return true;
}

// Lamps off the axis may look larger than those on it: this part of their angle to it.
const float SMALL_OFF_AXIS = 0.25;

// The next ones. False after the last.
bool next_in_cone(LampGrid grid, LightTree tree, inout ConeWalk walk, out FoundLamps found) {
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    found = FoundLamps(false, 0u, vec3(0.0), 0.0);
    while (walk.size > 0u) {
        walk.size--;
        LightNode node = nodes.at[walk.stack[walk.size]];
        if (!(node.intensity > 0.0)) continue;
        vec3 to = 0.5 * node.min + 0.5 * node.max - walk.apex.position;
        float radius = length(0.5 * node.max - 0.5 * node.min);
        float far = length(to);
        float half_angle = far > radius ? walk.half_angle + asin(radius / far) : PI;
        float cosine = far > 0.0 ? clamp(dot(to, walk.axis) / far, -1.0, 1.0) : 1.0;
        if (half_angle < PI && cosine < cos(half_angle) - 1e-5) continue;
        uint kind = node.child & LIGHT_NODE_KIND;
        uint index = node.child & LIGHT_NODE_INDEX;
        if (kind == LIGHT_NODE_LAMP) {
            found.entry = index;
            return true;
        }
        // Emissive surfaces are found by rays.
        if (kind != 0u) continue;
        bool lamps_alone = (node.child & LIGHT_NODE_HAS_SURFACES) == 0u;
        float small = max(walk.small, SMALL_OFF_AXIS * acos(cosine));
        if (lamps_alone && radius < small * far && are_far(grid, walk, node)) {
            float square;
            float estimate = light_estimate(node, walk.apex, square);
            found = FoundLamps(true, 0u, walk.apex.position + to, estimate / square);
            return true;
        }
        for (uint i = 0u; i < 2u; i++) {
            walk.stack[walk.size] = index + i;
            walk.size++;
        }
    }
    return false;
}

#endif
