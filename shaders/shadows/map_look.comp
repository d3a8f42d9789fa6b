#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lights.glsl"
#include "lib/shadow_map.glsl"
#include "shared/scene.glsl"
#include "shared/shadow_map.glsl"
// Looks up the shadow maps of up to four lights for each pixel, and classifies where they cannot be trusted.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { MapParams params; };

// Blockers are searched no nearer to a local light than this share of its distance.
const float NEAREST_BLOCKER = 0.25;

// A penumbra narrower than this, texels, is filtered by a box, as a disc of so few texels has no shape.
const float LEAST_DISC = 2.0;

// Occluders less than this many texels above the plane count as in contact: the map cannot tell them apart.
const float CONTACT = 2.0;

// Greatest error of the drawn plane, texels: vertices are snapped to a 256th of a texel.
const float SNAP = 1.0 / 64.0;

// Projects a point into a layer, offset along its normal for surfaces that are not planar.
MapPoint receive(MapLight light, MapLayer layer, float side, Surface surface, vec3 to_light) {
    MapPoint p = project(light.kind, light.size, layer, side, surface.position, surface.geometric_normal);
    float cosine = dot(surface.geometric_normal, to_light);
    float offset = NORMAL_OFFSET * p.texel * sqrt(max(1.0 - cosine * cosine, 0.0));
    vec3 moved = surface.position + offset * surface.geometric_normal;
    bool covered = p.covered;
    p = project(light.kind, light.size, layer, side, moved, surface.geometric_normal);
    p.covered = covered;
    return p;
}

// Reversed depth up to which blockers are searched.
float nearest_blocker(MapLight light, MapPoint p) {
    return light.kind == MAP_CASCADES ? 1.0 : min(p.depth / NEAREST_BLOCKER, 1.0);
}

// Percentage-closer soft shadows (Fernando 2005): the mean depth of the blockers gives the penumbra width, and so the filter radius. A
// texel counts as a blocker only if it can occlude part of the light from the point.
float soft(MapLight light, MapSheet sheet, MapPoint p, float turn, out bool mixed) {
    float radius = (nearest_blocker(light, p) - p.depth) * p.reach;
    float slack = 2.0 * NORMAL_OFFSET / sheet.side;
    float sum = 0.0;
    uint found = 0u;
    for (uint i = 0u; i < params.taps; i++) {
        ivec2 texel = texel_at(sheet, p.at + max(radius, slack) * search_sample(i, params.taps, turn));
        vec2 centre = texel_centre(sheet, texel);
        float above = above_plane(sheet, p, texel);
        float depth = above + p.rounding + plane_depth(p, centre);
        if (above > 0.0 && length(centre - p.at) <= (depth - p.depth) * p.reach + slack) {
            sum += depth;
            found++;
        }
    }
    // The search may have missed blockers close to the point.
    float near = box_filter(sheet, p, 1.0);
    mixed = (found > 0u && found < params.taps) || (near > 0.0 && near < 1.0);
    if (found == 0u) return near;
    float penumbra = max(sum / float(found) - p.depth, 0.0) * p.reach;
    float texels = 0.5 * penumbra * sheet.side;
    // A square of the same area as the disc.
    if (texels < LEAST_DISC) return box_filter(sheet, p, max(1.77245385 * texels, 1.0));
    float lit = 0.0;
    for (uint i = 0u; i < params.taps; i++) {
        vec2 at = p.at + penumbra * disc_sample(i, params.taps, turn);
        if (above_plane(sheet, p, texel_at(sheet, at)) <= 0.0) lit += 1.0;
    }
    return lit / float(params.taps);
}

// PCF by samples that are rotated for each pixel.
float turned_box(MapSheet sheet, MapPoint p, float turn) {
    float lit = 0.0;
    float radius = 1.12837917 * params.kernel / sheet.side;  // of a disc of the same area as the box
    for (uint i = 0u; i < params.taps; i++) {
        ivec2 texel = texel_at(sheet, p.at + radius * disc_sample(i, params.taps, turn));
        if (above_plane(sheet, p, texel) <= 0.0) lit += 1.0;
    }
    return lit / float(params.taps);
}

float filtered(MapLight light, MapSheet sheet, MapPoint p, float turn, out bool mixed) {
    mixed = false;
    if (params.filter_kind == MAP_FILTER_PCSS && light.size > 0.0) return soft(light, sheet, p, turn, mixed);
    if (params.filter_kind == MAP_FILTER_NONE) return above_plane(sheet, p, texel_at(sheet, p.at)) > 0.0 ? 0.0 : 1.0;
    return params.rotate != 0u ? turned_box(sheet, p, turn) : box_filter(sheet, p, params.kernel);
}

// Reasons why the map cannot be trusted at a point, from the texels around.
uint doubts(MapLight light, MapSheet sheet, MapPoint p, MapPoint unmoved, bool mixed, float pixel_width) {
    // Radius of the filter, texels, and one more.
    int reach = 1 + int(ceil(params.filter_kind == MAP_FILTER_PCF ? 0.5 * params.kernel : 0.5));
    float tilt = length(unmoved.slope) * 2.0 / sheet.side;  // change of the plane's depth over a texel
    float least = SNAP * tilt + unmoved.rounding;
    float most = CONTACT * (unmoved.texel * unmoved.unit + tilt);
    ivec2 middle = texel_at(sheet, p.at);
    int hidden = 0;
    bool touching = false;
    for (int y = -reach; y <= reach; y++) {
        for (int x = -reach; x <= reach; x++) {
            ivec2 texel = middle + ivec2(x, y);
            if (above_plane(sheet, p, texel) > 0.0) hidden++;
            float height = above_plane(sheet, unmoved, texel);
            touching = touching || (height > least && height < most);
        }
    }
    int all_texels = (2 * reach + 1) * (2 * reach + 1);
    bool edge = hidden > 0 && hidden < all_texels;
    uint why = mixed || edge ? UNSURE_PENUMBRA : 0u;
    if (touching) why |= UNSURE_CONTACT;
    if (edge && unmoved.texel > params.coarse * pixel_width) why |= UNSURE_RESOLUTION;
    return why;
}

// Half side of the part of a cascade in which the filter stays inside the cascade, as a share of its half side.
float usable(MapLight light, MapPoint p, float side) {
    float margin = 2.0 * (0.5 * params.kernel + 1.0) / side;
    if (params.filter_kind == MAP_FILTER_PCSS) margin = max(margin, (1.0 - p.depth) * p.reach);
    return 1.0 - min(margin, 0.25);
}

float look(MapLight light, uint image, Surface surface, vec3 to_light, float turn, float pixel_width, out uint why) {
    MapLayerBuffer layers = MapLayerBuffer(params.layers);
    bool is_array = light.layers > 1u;
    float side = map_side(image, is_array);
    why = UNSURE_OUTSIDE;
    bool mixed;
    if (light.kind == MAP_FACES) {
        int face = face_of(light, layers, -to_light);
        if (face < 0) return 1.0;
        MapLayer layer = layers.at[light.first + uint(face)];
        MapPoint p = receive(light, layer, side, surface, to_light);
        // With several faces, a point is always on one of them but for rounding. A single face may not cover it.
        if (light.layers == 1u && !p.covered) return 1.0;
        MapSheet sheet = MapSheet(image, is_array, face, side, light, params.layers);
        float lit = filtered(light, sheet, p, turn, mixed);
        MapPoint unmoved = project(light.kind, light.size, layer, side, surface.position, surface.geometric_normal);
        why = params.unsure != 0u ? doubts(light, sheet, p, unmoved, mixed, pixel_width) : 0u;
        return lit;
    }
    float lit = 1.0;
    float weight = 1.0;  // still to be filled by the next cascade
    for (uint i = 0u; i < light.layers && weight > 0.0; i++) {
        MapLayer layer = layers.at[light.first + i];
        MapPoint p = receive(light, layer, side, surface, to_light);
        bool last = i + 1u == light.layers;
        float border = max(abs(p.at.x), abs(p.at.y));
        float most = last ? 1.0 : usable(light, p, side);
        if (!p.covered || border > most) continue;
        MapSheet sheet = MapSheet(image, is_array, int(i), side, light, params.layers);
        float here = filtered(light, sheet, p, turn, mixed);
        if (weight == 1.0) {
            MapPoint unmoved = project(light.kind, light.size, layer, side, surface.position, surface.geometric_normal);
            why = params.unsure != 0u ? doubts(light, sheet, p, unmoved, mixed, pixel_width) : 0u;
            lit = here;
            weight = last ? 0.0 : clamp((border - (most - params.blend)) / max(params.blend, 1e-6), 0.0, 1.0);
        } else {
            lit = mix(lit, here, weight);
            weight = 0.0;
        }
    }
    return lit;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface surface = load_geometry(view, pixel, params.gbuffer);
    map_not_finite = params.not_finite;
    vec4 visibility = vec4(0.0);
    uint unsure = 0u;
    LightBuffer lights = LightBuffer(SceneBuffer(params.scene).at[0].lights);
    MapLightBuffer known = MapLightBuffer(params.lights);
    float pixel_width = surface.exists ? pixel_spread(view) * distance(surface.position, view.at[0].eye) : 0.0;
    for (uint i = 0u; surface.exists && i < params.light_count; i++) {
        MapLight light = known.at[i];
        LightSample towards = sample_light(lights.at[light.light], surface.position);
        // Surfaces that the light does not reach need no lookup.
        bool faces = dot(surface.normal, towards.direction) > 0.0 && dot(surface.geometric_normal, towards.direction) > 0.0;
        if (!faces || towards.irradiance == vec3(0.0)) continue;
        float turn = pixel_turn(pixel);
        uint why;
        visibility[i] = look(light, params.maps[i], surface, towards.direction, turn, pixel_width, why);
        unsure |= why << i;
    }
    store(params.visibility, pixel, visibility);
    if (params.unsure != 0u) store_uint(params.unsure, pixel, uvec4(unsure));
}
