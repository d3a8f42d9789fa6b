#ifndef LIB_LIGHT_TREE_FIT_GLSL
#define LIB_LIGHT_TREE_FIT_GLSL
#include "lib/lights.glsl"
#include "lib/vector.glsl"
#include "shared/light_tree.glsl"
#include "shared/scene.glsl"
// Bounds of lights in space, direction and strength, and how a tree of them is refitted. engine/src/scene/light_tree/bounds.rs has the same
// for the host.

// What rounding may take from a cosine.
const float COSINE_ROUNDING = 1e-6;

// Luminance of linear Rec.709, within what the tree can sum up and divide by.
float tree_intensity(float strength) {
    return strength > 0.0 ? clamp(strength, LEAST_INTENSITY, GREATEST_INTENSITY) : 0.0;
}

float tree_luminance(vec3 radiance) {
    return dot(radiance, vec3(0.2126, 0.7152, 0.0722));
}

// Cosine and sine of half the angle with this cosine.
vec2 half_angle(float cosine) {
    return sqrt(max(0.5 + 0.5 * vec2(cosine, -cosine), 0.0));
}

// Cosine and sine of a sum and of a difference of two angles.
vec2 angle_sum(vec2 a, vec2 b) {
    return vec2(a.x * b.x - a.y * b.y, a.y * b.x + a.x * b.y);
}
vec2 angle_difference(vec2 a, vec2 b) {
    return vec2(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y);
}

// Cone around the normals of two nodes: axis, and cosine of the half angle (Conty Estevez and Kulla 2018, algorithm 1, without angles). A cone of
// lights with two sides is as good with its axis turned round.
vec4 cone_around(LightNode a, LightNode b) {
    if (a.cos_normals > b.cos_normals) {
        LightNode wider = b;
        b = a;
        a = wider;
    }
    if (a.cos_normals <= COSINE_ROUNDING - 1.0) return vec4(a.axis, -1.0);
    if (dot(a.axis, b.axis) < 0.0) {
        if ((b.child & LIGHT_NODE_TWO_SIDED) != 0u) b.axis = -b.axis;
        else if ((a.child & LIGHT_NODE_TWO_SIDED) != 0u) a.axis = -a.axis;
    }
    vec2 half_a = half_angle(a.cos_normals);
    vec2 half_b = half_angle(b.cos_normals);
    vec2 half_between = 0.5 * vec2(length(a.axis + b.axis), length(a.axis - b.axis));
    vec2 farthest = angle_sum(half_between, half_b);
    // By how much the axis turns; not at all where the wider cone holds the other.
    vec2 turn = angle_difference(farthest, half_a);
    if (turn.y <= 0.0) return vec4(a.axis, a.cos_normals);
    vec2 opening = angle_sum(farthest, half_a);
    if (opening.y <= 0.0) return vec4(a.axis, -1.0);
    vec3 across = b.axis - dot(a.axis, b.axis) * a.axis;
    vec3 any = abs(a.axis.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
    across = dot(across, across) > 1e-12 ? normalize(across) : normalize(cross(a.axis, any));
    // Once more, since what rounding left of the axis grows where the two are nearly opposite.
    across = normalize(across - dot(a.axis, across) * a.axis);
    return vec4(normalize(turn.x * a.axis + turn.y * across), max(opening.x - COSINE_ROUNDING, -1.0));
}

// The node above two others. What does not shine counts for nothing.
LightNode node_above(LightNode a, LightNode b, uint first_child) {
    uint child = first_child | ((a.child | b.child) & (LIGHT_NODE_TWO_SIDED | LIGHT_NODE_HAS_SURFACES));
    if (!(b.intensity > 0.0) || !(a.intensity > 0.0)) {
        LightNode only = a.intensity > 0.0 ? a : b;
        only.child = child;
        return only;
    }
    LightNode above;
    above.min = min(a.min, b.min);
    above.max = max(a.max, b.max);
    above.intensity = a.intensity + b.intensity;
    above.reach = max(a.reach, b.reach);
    vec4 cone = cone_around(a, b);
    above.axis = cone.xyz;
    above.cos_normals = cone.w;
    above.cos_emission = min(a.cos_emission, b.cos_emission);
    above.count = a.count + b.count;
    // Mean of the squares over the square of the mean, less 1.
    float part_a = a.intensity / above.intensity;
    float part_b = b.intensity / above.intensity;
    float squares = part_a * part_a * (1.0 + a.spread) / float(a.count) + part_b * part_b * (1.0 + b.spread) / float(b.count);
    above.spread = max(float(above.count) * squares - 1.0, 0.0);
    above.child = child;
    return above;
}

// A leaf that does not shine.
LightNode dark_leaf(uint child) {
    return LightNode(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 1.0, 0.0, 0.0, 0u, child);
}

LightNode lamp_leaf(Light light, uint child) {
    LightNode leaf = dark_leaf(child);
    leaf.reach = light.range > 0.0 ? light.range : UNLIMITED_REACH;
    vec3 extent = vec3(0.0);
    bool faces = light.kind == LIGHT_RECTANGLE || light.kind == LIGHT_DISC;
    if (light.kind == LIGHT_RECTANGLE) {
        extent = abs(light.half_u) + abs(light.half_v);
    } else if (light.kind == LIGHT_DISC) {
        extent = light.radius * sqrt(max(1.0 - light.direction * light.direction, 0.0));
    } else if (light.kind == LIGHT_SPHERE) {
        extent = vec3(light.radius);
    }
    leaf.min = light.position - extent;
    leaf.max = light.position + extent;
    leaf.intensity = tree_intensity(lamp_area(light) * tree_luminance(light.intensity));
    leaf.count = leaf.intensity > 0.0 ? 1u : 0u;
    leaf.cos_normals = -1.0;
    if (faces || light.kind == LIGHT_SPOT) {
        leaf.axis = light.direction;
        leaf.cos_normals = 1.0;
    }
    if (light.kind == LIGHT_SPOT) leaf.cos_emission = -light.cone_offset / light.cone_scale;
    return leaf;
}

LightNode triangle_leaf(vec3 a, vec3 b, vec3 c, float emission, uint child) {
    LightNode leaf = dark_leaf(child);
    leaf.min = min(a, min(b, c));
    leaf.max = max(a, max(b, c));
    leaf.reach = UNLIMITED_REACH;
    vec3 across = cross(b - a, c - a);
    leaf.axis = safe_normalize(across, leaf.axis);
    leaf.intensity = tree_intensity(0.5 * length(across) * emission);
    leaf.count = leaf.intensity > 0.0 ? 1u : 0u;
    return leaf;
}

// Square of the greatest factor over the least by which a transform stretches normals; 0 where it is too great to tell. `rows`: those of the
// inverse.
float stretch_of_normals(vec4 rows[3]) {
    float size = dot(rows[0].xyz, rows[0].xyz) + dot(rows[1].xyz, rows[1].xyz) + dot(rows[2].xyz, rows[2].xyz);
    if (!(size > 0.0)) return 0.0;
    // Eigenvalues of a symmetric matrix of trace 1 (Smith 1961, "Eigenvalues of a Symmetric 3 x 3 Matrix").
    mat3 outer = mat3(0.0);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) outer[i][j] = dot(rows[i].xyz, rows[j].xyz) / size;
    }
    mat3 rest = outer - mat3(1.0 / 3.0);
    float deviation = sqrt((dot(rest[0], rest[0]) + dot(rest[1], rest[1]) + dot(rest[2], rest[2])) / 6.0);
    if (deviation < 1e-5) return 1.0;
    float angle = acos(clamp(determinant(rest / deviation) * 0.5, -1.0, 1.0)) / 3.0;
    float greatest = 1.0 / 3.0 + 2.0 * deviation * cos(angle);
    float least = 1.0 / 3.0 + 2.0 * deviation * cos(angle + 2.0 * PI / 3.0);
    // The least is known to the precision of the arc cosine.
    least -= 1e-3 * deviation;
    return least > 1e-4 ? greatest / least : 0.0;
}

// An instance of a mesh whose tree has this root.
LightNode instance_leaf(LightNode root, Instance instance, uint child) {
    float inverse = 0.0;
    for (int i = 0; i < 3; i++) inverse += dot(instance.object_from_world[i].xyz, instance.object_from_world[i].xyz);
    // A singular transform leaves nothing that shines.
    if (!(inverse > 0.0) || !(root.intensity > 0.0)) return dark_leaf(child);
    LightNode leaf = root;
    leaf.child = child;
    vec3 centre = 0.5 * root.min + 0.5 * root.max;
    vec3 extent = 0.5 * root.max - 0.5 * root.min;
    for (int i = 0; i < 3; i++) {
        vec4 row = instance.world_from_object[i];
        float middle = dot(row.xyz, centre) + row.w;
        float size = dot(abs(row.xyz), abs(centre) + extent) + abs(row.w);
        float reach = dot(abs(row.xyz), extent) + 1e-6 * size;
        leaf.min[i] = middle - reach;
        leaf.max[i] = middle + reach;
    }
    vec3 normal = transform_normal(instance.object_from_world, root.axis);
    leaf.axis = safe_normalize(normal, root.axis);
    // The angle between two vectors grows by no more than tan(after / 2) = stretch tan(before / 2) (Wielandt's inequality).
    float stretch_square = stretch_of_normals(instance.object_from_world);
    if (root.cos_normals < 1.0 && stretch_square != 1.0) {
        float wide = 1.0 + root.cos_normals;
        float tangent_square = stretch_square * (1.0 - root.cos_normals) / max(wide, 1e-6);
        bool known = stretch_square > 0.0 && wide > 1e-6;
        leaf.cos_normals = known ? max((1.0 - tangent_square) / (1.0 + tangent_square) - COSINE_ROUNDING, -1.0) : -1.0;
    }
    // Areas across the axis grow by the cofactor matrix, those of other normals by its mean.
    vec4 rows[3] = instance.world_from_object;
    float volume = abs(dot(cross(rows[0].xyz, rows[1].xyz), rows[2].xyz));
    float along = pow(max(root.cos_normals, 0.0), 2.0);
    float growth = volume * sqrt(mix(inverse / 3.0, dot(normal, normal), along));
    leaf.intensity = tree_intensity(root.intensity * growth);
    leaf.count = leaf.intensity > 0.0 ? root.count : 0u;
    return leaf;
}

// Nodes that other workgroups read in the same pass.
layout(buffer_reference, scalar, buffer_reference_align = 4) coherent buffer SharedLightNodes { LightNode at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) coherent buffer LightPairCounters { uint at[]; };

// Stores a leaf and every node above it whose other leaves are done: whoever comes second to a pair of siblings goes on (Karras 2012,
// "Maximizing Parallelism in the Construction of BVHs, Octrees, and k-d Trees", section 4).
void refit_above(LightTree tree, LightTreePart part, uint node, LightNode value) {
    SharedLightNodes nodes = SharedLightNodes(tree.nodes);
    LightPairCounters counters = LightPairCounters(part.counters);
    WordBuffer parents = WordBuffer(part.parents);
    for (;;) {
        nodes.at[part.first_node + node] = value;
        if (node == 0u) return;
        uint pair = (node - 1u) / 2u;
        memoryBarrierBuffer();
        if (atomicAdd(counters.at[pair], 1u) == 0u) return;
        counters.at[pair] = 0u;
        memoryBarrierBuffer();
        uint first = part.first_node + 1u + 2u * pair;
        LightNode a = nodes.at[first];
        LightNode b = nodes.at[first + 1u];
        node = parents.at[pair];
        value = node_above(a, b, first);
    }
}

#endif
