#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/lamp_clusters.glsl"
#include "lib/lamp_walk.glsl"
#include "lib/light_tree.glsl"
#include "lib/shade_lights.glsl"
#include "shared/light_sampling.glsl"
// As shade.comp, with lamps by clusters: those that the pixel's cell lists, each as far as it is near, and what the corners of the cell have of the
// rest. Smooth surfaces show far lamps in their lobe.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ShadeParams params; };

// Where the window around the lobe ends: tangent of half vectors, over alpha, and at least.
const float LOBE_WIDTHS = 4.0;
const float LEAST_WIDTH = 0.2;

float window_end(float alpha) {
    return max(LOBE_WIDTHS * alpha, LEAST_WIDTH);
}

// Share of a GGX lobe within the window, as if it were one to three quarters of its end.
float share_within(float alpha) {
    float width = 0.75 * window_end(alpha) / alpha;
    return 1.0 - 1.0 / (1.0 + width * width);
}

// 1 in the middle of the lobe, 0 from the end of its window on. `size`: half angle of the light, radians. Half vectors see half of it in the plane of
// eye and normal, and across more at grazing angles.
float lobe_window(Receiver r, vec3 direction, float size, float alpha) {
    vec3 h = safe_normalize(r.s.to_eye + direction, r.s.normal);
    float cosine = max(dot(h, r.s.normal), 1e-6);
    float tangent = sqrt(max(1.0 - cosine * cosine, 0.0)) / cosine - 0.5 * size / max(dot(h, direction), 0.05);
    return 1.0 - smoothstep(0.5 * window_end(alpha), window_end(alpha), tangent);
}

// Lamps of the cell's list.
vec3 near_light(ViewBuffer view, LampGrid grid, Receiver r, vec3 place, float scale) {
    LightBuffer lights = LightBuffer(SceneBuffer(params.scene).at[0].lights);
    LampCellBuffer cells = LampCellBuffer(grid.tables.lists);
    LampReaches reaches = LampReaches(grid.tables.reaches);
    uint cell = cell_index(grid, min(uvec3(place), grid.tables.cells - 1u));
    uint count = cells.at[cell].count;
    vec3 sum = vec3(0.0);
    for (uint k = 0u; k < count; k++) {
        uint i = cells.at[cell].lamps[k];
        vec4 lamp = reaches.at[i];
        float share = near_share(distance(lamp.xyz, r.s.position), lamp.w, scale);
        if (share > 0.0) sum += share * seen_light(params, view, r, i, lights.at[i]);
    }
    return sum;
}

// Nodes that are left to look at, of each invocation: in registers they would take a fifth of these.
shared uint stack[LAMP_STACK][64];

// A walk over far lamps within a cone, by the bounds of the light tree.
struct ConeWalk {
    LitPoint apex;
    vec3 axis;               // unit
    float half_angle;        // radians
    float small;             // what looks smaller than this is taken together: its radius over its distance; more of what is off the axis
    float scale;             // of reaches
    uint size;               // of the stack
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
    stack[0][gl_LocalInvocationIndex] = 0u;
    walk.size = 1u;
    return walk;
}

// Whether no lamp below a node is near, or counts everywhere.
bool are_far(LampGrid grid, ConeWalk walk, LightNode node) {
    vec3 outside = max(max(node.min - walk.apex.position, walk.apex.position - node.max), 0.0);
    if (length(outside) < sqrt(node.intensity) * grid.reach * walk.scale) return false;
    for (uint k = 0u; k < MAX_SHADOW_LIGHTS; k++) {
        vec3 place = LampGridBuffer(params.clusters).at[0].everywhere[k];
        if (all(greaterThanEqual(place, node.min)) && all(lessThanEqual(place, node.max))) return false;
    }
    return true;
}

// Lamps off the axis may look larger than those on it: this part of their angle to it.
const float SMALL_OFF_AXIS = 0.25;

// The next ones: one, or several that look small (Walter et al. 2005, "Lightcuts: A Scalable Approach to Illumination"). False after the last.
bool next_in_cone(LampGrid grid, LightTree tree, inout ConeWalk walk, out FoundLamps found) {
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    found = FoundLamps(false, 0u, vec3(0.0), 0.0);
    while (walk.size > 0u) {
        walk.size--;
        LightNode node = nodes.at[stack[walk.size][gl_LocalInvocationIndex]];
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
            stack[walk.size][gl_LocalInvocationIndex] = index + i;
            walk.size++;
        }
    }
    return false;
}

// What one far lamp sends to the lobe, as far as it is not near.
vec3 lamp_in_lobe(ViewBuffer view, LampGrid grid, Receiver r, float scale, float alpha, uint i) {
    vec4 lamp = LampReaches(grid.tables.reaches).at[i];
    if (isinf(lamp.w)) return vec3(0.0);
    Light light = LightBuffer(SceneBuffer(params.scene).at[0].lights).at[i];
    LightSample centre = sample_light(light, r.s.position);
    float share = 1.0 - near_share(centre.distance, lamp.w, scale);
    if (share <= 0.0 || centre.irradiance == vec3(0.0)) return vec3(0.0);
    float size = has_size(light) ? half_angle(light, centre.distance) : 0.0;
    return share * lobe_window(r, centre.direction, size, alpha) * reflected_by_lobe(params, view, r, i, light, centre);
}

// Far lamps in the specular lobe of a smooth surface. Several that are taken together have the colour of what comes from there.
vec3 far_light_in_lobe(ViewBuffer view, LampGrid grid, Receiver r, FarLight far) {
    LightTables tables = LightTablesBuffer(grid.tables.lights).at[0];
    LightTree tree = LightTreeBuffer(grid.tables.tree).at[0];
    float alpha = strongest_alpha(r.b, r.v);
    vec3 axis = reflect(-r.s.to_eye, r.s.normal);
    ConeWalk walk = cone_walk(r.s.position, axis, 2.0 * atan(window_end(alpha)), alpha, far.scale);
    vec3 sum = vec3(0.0);
    FoundLamps found;
    while (next_in_cone(grid, tree, walk, found)) {
        if (!found.together) {
            sum += lamp_in_lobe(view, grid, r, far.scale, alpha, LightChoiceBuffer(tables.near).at[found.entry].light);
            continue;
        }
        vec3 direction = normalize(found.place - r.s.position);
        vec3 l = direction * r.around;
        if (l.z <= 0.0) continue;
        vec3 colour = max(far.fluence + 2.0 * direction * far.flow, 0.05 * far.fluence);
        colour *= found.irradiance / max(luminance(colour), 1e-30);
        sum += lobe_window(r, direction, 0.0, alpha) * bsdf_cosine(r.b, r.v, l, LOBE_SPECULAR) * colour;
    }
    return sum;
}

vec3 shade(ViewBuffer view, ivec2 pixel) {
    Receiver r = receiver_at(view, pixel, params.gbuffer);
    if (!r.s.exists) return vec3(0.0);
    LampGrid grid = LampGridBuffer(params.clusters).at[0];
    float along = 1.0 / (load(params.gbuffer.depth, pixel).r * view.at[0].world_from_clip[2].w);
    vec3 place = cell_position(grid, view.at[0].size, pixel, along);
    FarLight far = light_between_corners(grid, place, r.s.normal);
    float smooth_share = grid.tables.lobe > 0.0 ? share_apart(r.s, grid.tables.lobe) : 0.0;
    vec3 radiance = emitted_and_sampled(params, r) + near_light(view, grid, r, place, far.scale);
    float within = share_within(strongest_alpha(r.b, r.v));
    if (smooth_share > 0.0) radiance += smooth_share * far_light_in_lobe(view, grid, r, far);
    return radiance + reflected_of_far(far, r.b, r.around, r.v, 1.0 - smooth_share * within);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (inside(pixel, view.at[0].size)) store_radiance(params, pixel, shade(view, pixel));
}
