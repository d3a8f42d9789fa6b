#ifndef LIB_LAMP_WALK_GLSL
#define LIB_LAMP_WALK_GLSL
#include "shared/light_tree.glsl"
// The lamps that a ray may meet, found by the bounds of the light tree. Lamps are in no tree of the scene's geometry, as they do not occlude.

// A trail has 32 bits, so there are as many levels; each leaves one sibling behind, the last both.
const uint LAMP_STACK = 34u;

struct LampWalk {
    vec3 origin;
    vec3 inverse_direction;
    float end;               // metres, along a unit direction
    uint stack[LAMP_STACK];  // nodes by what is below them
    uint size;
};

LampWalk lamp_walk(LightTree tree, vec3 origin, vec3 direction, float end) {
    LampWalk walk;
    walk.origin = origin;
    // A quotient by 0 times a distance of 0 would be no number.
    vec3 least = mix(vec3(-1e-20), vec3(1e-20), greaterThanEqual(direction, vec3(0.0)));
    walk.inverse_direction = 1.0 / mix(direction, least, lessThan(abs(direction), vec3(1e-20)));
    walk.end = end;
    LightNode root = LightNodeBuffer(tree.nodes).at[0];
    walk.size = root.intensity > 0.0 ? 1u : 0u;
    walk.stack[0] = root.child;
    return walk;
}

bool passes(LampWalk walk, LightNode node) {
    vec3 a = (node.min - walk.origin) * walk.inverse_direction;
    vec3 b = (node.max - walk.origin) * walk.inverse_direction;
    vec3 enters = min(a, b);
    vec3 leaves = max(a, b);
    float first = max(max(enters.x, enters.y), max(enters.z, 0.0));
    float last = min(min(leaves.x, leaves.y), min(leaves.z, walk.end));
    // Rounding must not lose a lamp that is as flat as its bounds.
    return first <= last * (1.0 + 1e-5) + 1e-6;
}

// The next lamp, by its entry in `LightTables::near`. False after the last.
bool next_lamp(LightTree tree, inout LampWalk walk, out uint entry) {
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    entry = 0u;
    while (walk.size > 0u) {
        walk.size--;
        uint child = walk.stack[walk.size];
        uint kind = child & LIGHT_NODE_KIND;
        entry = child & LIGHT_NODE_INDEX;
        if (kind == LIGHT_NODE_LAMP) return true;
        // Emissive surfaces are met as geometry is.
        if (kind != 0u) continue;
        for (uint i = 0u; i < 2u; i++) {
            LightNode node = nodes.at[entry + i];
            if (!(node.intensity > 0.0) || !passes(walk, node)) continue;
            walk.stack[walk.size] = node.child;
            walk.size++;
        }
    }
    return false;
}

#endif
