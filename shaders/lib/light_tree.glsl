#ifndef LIB_LIGHT_TREE_GLSL
#define LIB_LIGHT_TREE_GLSL
#include "lib/random.glsl"
#include "lib/vector.glsl"
#include "shared/light_sampling.glsl"
#include "shared/light_tree.glsl"
#include "shared/scene.glsl"
// Chooses a local light or an emissive primitive for a point with a probability near its share of the unshadowed light there, by a walk down the
// light tree (Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"). Lights go by their entry in
// `LightTables::near`.
//
// Of every function: `position` and `normal` of the point that is lit, in the world; `both_sides` where light counts from behind too. A normal
// of zero stands for a point without a surface. Whatever is behind the surface, turned away, or out of range for certain is not chosen while
// there is anything else.

// Pairs of nodes that this invocation has compared.
uint light_pairs_read = 0u;

// By how much cosines that decide whether a light is seen at all may be off.
const float COSINE_SLACK = 1e-4;
// Least share that an angle or a range leaves of a light that may be seen.
const float LEAST_SHARE = 1e-3;
// Least square of a distance.
const float LEAST_SQUARE = 1e-12;
// Probability of a node whose estimate is too small beside its sibling's for 32 bits.
const float LEAST_PROBABILITY = 1e-30;
// Greatest relative variance of a cluster: around the point itself it has none.
const float GREATEST_VARIANCE = 1e6;
// Word for no instance: of the tree over lamps and instances.
const uint NO_INSTANCE = 0xffffffffu;

// A point that is lit, in the world or in the object space of an instance.
struct LitPoint {
    vec3 position;
    vec3 normal;
    bool both_sides;
    float rounding;  // bound of what rounding may move the point by
};

LitPoint lit_point(vec3 position, vec3 normal, bool both_sides) {
    return LitPoint(position, normal, both_sides, 1e-6 * (abs(position.x) + abs(position.y) + abs(position.z)));
}

// The same point in the object space of an instance. Which side of a plane a point is on stays the same in any affine space.
LitPoint lit_in_object(SceneBuffer scene, uint index, LitPoint at) {
    InstanceBuffer instances = InstanceBuffer(scene.at[0].instances);
    vec4 rows[3] = instances.at[index].object_from_world;
    vec3 position = transform_point(rows, at.position);
    vec3 sizes = abs(position) + abs(vec3(rows[0].w, rows[1].w, rows[2].w));
    // A normal is a covector: it goes back by the transpose of the matrix that led here.
    vec3 normal = transform_normal(instances.at[index].world_from_object, at.normal);
    return LitPoint(position, safe_normalize(normal, vec3(0.0)), at.both_sides, 1e-6 * (sizes.x + sizes.y + sizes.z));
}

// Cosine of an angle less another, 0 at least, from the cosine of the one, and cosine and sine of the other.
float cosine_less(float from, vec2 less) {
    if (from > less.x) return 1.0;
    return min(from * less.x + sqrt(max(1.0 - from * from, 0.0)) * less.y, 1.0);
}

float sine_of(float cosine) {
    return sqrt(max(1.0 - cosine * cosine, 0.0));
}

// What the lights of a node send to a point, unshadowed: this over `square`, the square of a distance. 0 if certainly nothing.
float light_estimate(LightNode node, LitPoint at, out float square) {
    vec3 to = 0.5 * node.min + 0.5 * node.max - at.position;
    vec3 extent = 0.5 * node.max - 0.5 * node.min;
    float radius = length(extent) + at.rounding;
    float far = length(to);
    square = max(max(far * far, radius * radius), LEAST_SQUARE);
    if (!(node.intensity > 0.0)) return 0.0;
    float estimate = node.intensity;

    // Ranges: the window of lib/lights.glsl at the nearest point.
    float beyond = length(max(abs(to) - extent, 0.0)) / node.reach;
    if (beyond > 1.0 + COSINE_SLACK) return 0.0;
    float window = beyond * beyond * beyond * beyond;
    estimate *= max(1.0 - window, LEAST_SHARE);

    // The half angle that a ball around the bounds subtends.
    bool outside = far > radius;
    vec2 ball = outside ? vec2(sine_of(radius / far), radius / far) : vec2(0.0, 1.0);
    if (outside) {
        // The least angle between the direction to the point and a normal.
        float leaves = clamp(-dot(node.axis, to) / far, -1.0, 1.0);
        if ((node.child & LIGHT_NODE_TWO_SIDED) != 0u) leaves = abs(leaves);
        leaves = cosine_less(cosine_less(leaves, vec2(node.cos_normals, sine_of(node.cos_normals))), ball);
        if (leaves < node.cos_emission - COSINE_SLACK) return 0.0;
        estimate *= max(leaves, LEAST_SHARE);
    }
    if (at.normal != vec3(0.0)) {
        float height = dot(at.normal, to);
        if (!at.both_sides && height + dot(abs(at.normal), extent) + at.rounding < -COSINE_SLACK * far) return 0.0;
        if (at.both_sides) height = abs(height);
        if (outside) estimate *= max(cosine_less(clamp(height / far, -1.0, 1.0), ball), LEAST_SHARE);
    }
    return estimate;
}

// Probabilities of two siblings. Where nothing of either is seen they go by intensity, so that probabilities always sum to 1.
vec2 sibling_shares(LightNode a, LightNode b, LitPoint at) {
    light_pairs_read++;
    float square_a, square_b;
    vec2 shares = vec2(light_estimate(a, at, square_a), light_estimate(b, at, square_b));
    if (shares == vec2(0.0)) {
        shares = vec2(a.intensity, b.intensity);
        square_a = 1.0;
        square_b = 1.0;
    }
    bvec2 seen = greaterThan(shares, vec2(0.0));
    if (!seen.x || !seen.y) return vec2(seen);
    // Each over its own square, times the greater of both.
    shares *= vec2(square_b, square_a) / max(square_a, square_b);
    // A quotient may be some units in the last place over 1.
    return clamp(shares / (shares.x + shares.y), LEAST_PROBABILITY, 1.0);
}

// A random number that choices use up.
struct TreeDraw {
    float u;      // in [0, 1)
    float grain;  // distance between two neighbouring numbers that it can be
    float more;   // where further bits come from
    uint level;
};

TreeDraw tree_draw(vec2 u) {
    return TreeDraw(u.x, 1.0 / 16777216.0, u.y, 0u);
}

// Whether the second of two with these probabilities is chosen. What is left of the number is uniform again.
bool takes_second(inout TreeDraw draw, vec2 shares) {
    bool second_is_less = shares.y < shares.x;
    float less = second_is_less ? shares.y : shares.x;
    draw.level++;
    if (less > 0.0 && less < 1024.0 * draw.grain) {
        // Too coarse to tell: further bits.
        float bits = unit_floats(hash4(uvec4(floatBitsToUint(draw.more), draw.level, 0u, 0u))).x;
        draw.u += draw.grain * bits;
        draw.grain = max(draw.grain, draw.u) / 4194304.0;
    }
    bool takes_less = draw.u < less;
    float width = takes_less ? less : 1.0 - less;
    draw.u = clamp((takes_less ? draw.u : draw.u - less) / width, 0.0, 1.0 - 1.0 / 16777216.0);
    draw.grain /= width;
    return takes_less == second_is_less;
}

// Goes on from a node that shines to a light. `probability` is multiplied with that of the choice.
uint descend(SceneBuffer scene, LightTree tree, uint child, uint first_entry, LitPoint at, TreeDraw draw, inout float probability) {
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    for (;;) {
        uint kind = child & LIGHT_NODE_KIND;
        uint index = child & LIGHT_NODE_INDEX;
        if (kind == LIGHT_NODE_LAMP) return index;
        if (kind == LIGHT_NODE_PRIMITIVE) return first_entry + index;
        if (kind == LIGHT_NODE_INSTANCE) {
            LightTreeInstance instance = LightTreeInstanceBuffer(tree.instances).at[index];
            first_entry = instance.first_entry;
            at = lit_in_object(scene, index, at);
            child = nodes.at[instance.root].child;
            continue;
        }
        LightNode a = nodes.at[index];
        LightNode b = nodes.at[index + 1u];
        vec2 shares = sibling_shares(a, b, at);
        bool second = takes_second(draw, shares);
        probability *= second ? shares.y : shares.x;
        child = second ? b.child : a.child;
    }
}

// Chooses one light. `u`: two random numbers, of which the first decides. False if no light shines.
bool choose_by_tree(
    SceneBuffer scene, LightTree tree, vec3 position, vec3 normal, bool both_sides, vec2 u, out uint entry, out float probability
) {
    entry = 0u;
    probability = 0.0;
    LightNode root = LightNodeBuffer(tree.nodes).at[0];
    if (!(root.intensity > 0.0)) return false;
    probability = 1.0;
    entry = descend(scene, tree, root.child, 0u, lit_point(position, normal, both_sides), tree_draw(u), probability);
    return true;
}

// Greatest number of clusters that the kernel knows: each takes registers.
layout(constant_id = 1) const uint MOST_CLUSTERS = MOST_SPLIT_LIGHTS;

// Nodes that split lights into clusters, of each of which one is chosen.
struct LightCluster {
    uint child;        // the node, by what is below it
    uint instance;     // whose mesh it belongs to, or NO_INSTANCE
    float uncertainty; // estimate of the standard deviation of what its lights send; 0 for one that is not split further
};

struct LightCut {
    LightCluster clusters[MOST_CLUSTERS];
    uint count;
};

// Variance over squared mean of what one light of a node sends, times their number: from intensities, and from the distance for lights that are
// spread evenly between the nearest and the farthest point of a ball (Conty Estevez and Kulla 2018, section 5.4; relative, so that it has no
// unit).
float relative_variance(LightNode node, LitPoint at) {
    vec3 extent = 0.5 * node.max - 0.5 * node.min;
    float radius = length(extent);
    vec3 to = 0.5 * node.min + 0.5 * node.max - at.position;
    // E[1/x⁴] / E[1/x²]² - 1 for x from a to b: (b - a)² / 3ab.
    float product = dot(to, to) - radius * radius;
    float of_distance = 4.0 * radius * radius;
    of_distance = of_distance < 3.0 * GREATEST_VARIANCE * product ? of_distance / (3.0 * product) : GREATEST_VARIANCE;
    return min((1.0 + node.spread) * (1.0 + of_distance) - 1.0, GREATEST_VARIANCE);
}

LightCluster light_cluster(LightNode node, uint instance, LitPoint at, float threshold, out bool seen) {
    float square;
    float estimate = light_estimate(node, at, square);
    seen = estimate > 0.0;
    float variance = relative_variance(node, at);
    bool splits = node.count > 1u && variance > threshold;
    return LightCluster(node.child, instance, splits ? estimate / square * sqrt(variance) : 0.0);
}

// Splits the lights into at most `split.most` clusters, always the most uncertain one, and leaves out those that send nothing.
void light_cut(SceneBuffer scene, LightTree tree, LitPoint point, LightSplit split, out LightCut cut) {
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    bool seen;
    cut.clusters[0] = light_cluster(nodes.at[0], NO_INSTANCE, point, split.threshold, seen);
    cut.count = seen ? 1u : 0u;
    uint most = clamp(split.most, 1u, MOST_CLUSTERS);
    while (cut.count < most) {
        uint worst = 0u;
        for (uint i = 1u; i < cut.count; i++) {
            if (cut.clusters[i].uncertainty > cut.clusters[worst].uncertainty) worst = i;
        }
        if (cut.count == 0u || !(cut.clusters[worst].uncertainty > 0.0)) break;
        LightCluster old = cut.clusters[worst];
        cut.count--;
        cut.clusters[worst] = cut.clusters[cut.count];
        uint first = old.child & LIGHT_NODE_INDEX;
        LitPoint at = point;
        uint instance = old.instance;
        bool enters = (old.child & LIGHT_NODE_KIND) == LIGHT_NODE_INSTANCE;
        if (enters) {
            // The root of a mesh has the same lights, so its children are compared right away.
            instance = first;
            uint root = LightTreeInstanceBuffer(tree.instances).at[instance].root;
            first = nodes.at[root].child & LIGHT_NODE_INDEX;
        }
        if (instance != NO_INSTANCE) at = lit_in_object(scene, instance, point);
        light_pairs_read++;
        for (uint i = 0u; i < 2u; i++) {
            LightCluster part = light_cluster(nodes.at[first + i], instance, at, split.threshold, seen);
            if (!seen) continue;
            cut.clusters[cut.count] = part;
            cut.count++;
        }
    }
}

// From the random numbers of one cluster to those of the next (Cranley and Patterson 1976).
const vec2 CLUSTER_STEP = vec2(0.618034, 0.754878);

// Chooses one light of a cluster.
uint choose_in_cluster(SceneBuffer scene, LightTree tree, LitPoint at, LightCluster cluster, vec2 u, out float probability) {
    uint first_entry = 0u;
    if (cluster.instance != NO_INSTANCE) {
        first_entry = LightTreeInstanceBuffer(tree.instances).at[cluster.instance].first_entry;
        at = lit_in_object(scene, cluster.instance, at);
    }
    probability = 1.0;
    return descend(scene, tree, cluster.child, first_entry, at, tree_draw(u), probability);
}

// Chooses one light of each of up to `split.most` clusters, into which the lights are split where they differ most. Each light's contribution
// over its probability, summed up, is an estimate of the light of all. Returns how many, at most MOST_SPLIT_LIGHTS.
uint choose_by_tree_split(
    SceneBuffer scene, LightTree tree, vec3 position, vec3 normal, bool both_sides, LightSplit split, vec2 u,
    out uint entries[MOST_SPLIT_LIGHTS], out float probabilities[MOST_SPLIT_LIGHTS]
) {
    LitPoint point = lit_point(position, normal, both_sides);
    LightCut cut;
    light_cut(scene, tree, point, split, cut);
    for (uint i = 0u; i < cut.count; i++) {
        entries[i] = choose_in_cluster(scene, tree, point, cut.clusters[i], fract(u + float(i) * CLUSTER_STEP), probabilities[i]);
    }
    return cut.count;
}

// Probability of a light by a walk along its trail. With `count` clusters above 0 that of its choice within its cluster, 0 if it is in none.
float trail_probability(SceneBuffer scene, LightTree tree, LightTables lights, uint entry, LitPoint at, LightCut cut) {
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    LightNode root = nodes.at[0];
    if (entry >= lights.near_count || !(root.intensity > 0.0)) return 0.0;
    LightChoice choice = LightChoiceBuffer(lights.near).at[entry];
    LightTreeInstance instance;
    uint trail;
    if (choice.light == CHOICE_EMITTER) {
        instance = LightTreeInstanceBuffer(tree.instances).at[choice.instance];
        trail = instance.trail;
    } else {
        trail = WordBuffer(tree.lamp_trails).at[entry];
    }
    float probability = cut.count == 0u ? 1.0 : 0.0;
    uint child = root.child;
    uint owner = NO_INSTANCE;
    for (;;) {
        for (uint i = 0u; i < cut.count; i++) {
            if (cut.clusters[i].child == child && cut.clusters[i].instance == owner) probability = 1.0;
        }
        uint kind = child & LIGHT_NODE_KIND;
        uint index = child & LIGHT_NODE_INDEX;
        if (kind == LIGHT_NODE_LAMP || kind == LIGHT_NODE_PRIMITIVE) return probability;
        if (kind == LIGHT_NODE_INSTANCE) {
            owner = index;
            at = lit_in_object(scene, index, at);
            trail = WordBuffer(instance.trails).at[choice.primitive];
            child = nodes.at[instance.root].child;
            continue;
        }
        LightNode a = nodes.at[index];
        LightNode b = nodes.at[index + 1u];
        bool second = (trail & 1u) != 0u;
        trail >>= 1u;
        if (probability > 0.0) {
            vec2 shares = sibling_shares(a, b, at);
            probability *= second ? shares.y : shares.x;
            if (probability == 0.0) return 0.0;
        }
        child = second ? b.child : a.child;
    }
}

// Probability with which `choose_by_tree` chooses a light.
float tree_probability(SceneBuffer scene, LightTree tree, LightTables lights, uint entry, vec3 position, vec3 normal, bool both_sides) {
    LightCut none;
    none.count = 0u;
    return trail_probability(scene, tree, lights, entry, lit_point(position, normal, both_sides), none);
}

// Probability that a light is among those of `choose_by_tree_split`.
float tree_split_probability(
    SceneBuffer scene, LightTree tree, LightTables lights, LightSplit split, uint entry, vec3 position, vec3 normal, bool both_sides
) {
    LitPoint at = lit_point(position, normal, both_sides);
    LightCut cut;
    light_cut(scene, tree, at, split, cut);
    return cut.count == 0u ? 0.0 : trail_probability(scene, tree, lights, entry, at, cut);
}

#endif
