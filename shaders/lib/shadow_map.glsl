#ifndef LIB_SHADOW_MAP_GLSL
#define LIB_SHADOW_MAP_GLSL
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "shared/shadow_map.glsl"
// Shadow map lookups for a surface point. Depth is reversed in all maps: 1 nearest to the light (directional lights) or at the near plane
// (local lights), 0 furthest away. Positions in a layer are -1 to 1 in x and y, as in clip space.
//
// A texel is compared with the surface's plane at the texel's own centre (Isidoro 2006, "Shadow Mapping: GPU-based Tips and Techniques",
// receiver plane depth bias): depth is an affine function of the position in a layer for either kind of light. So a plane needs no bias
// beyond rounding. Surfaces that are not planar are handled by `NORMAL_OFFSET`.

// The point is moved along its normal by this many texels, times the sine of the angle to the light: half the diagonal of a texel, the
// greatest distance of a point from the centre of its texel.
const float NORMAL_OFFSET = 0.70710678;

// Relative rounding error of a world position, eight unit roundoffs: of the matrices that draw it and of those that look it up.
const float MAP_ROUNDING = 4.76837158e-7;

// One layer of a shadow map.
struct MapSheet {
    uint image;
    bool is_array;
    int layer;
    float side;     // texels
    MapLight light;
    uvec2 layers;   // MapLayerBuffer
};

// A surface point projected into a layer.
struct MapPoint {
    vec2 at;
    float depth;
    vec2 slope;     // gradient of the plane's depth over x and y
    float texel;    // width of a texel at that depth, metres
    float unit;     // change of depth per metre towards the light
    float rounding; // rounding error of depth
    float reach;    // penumbra radius in x and y per unit of depth between blocker and point
    bool covered;   // inside the layer
    vec3 normal;
    float height;   // of the plane above the origin of the layer, metres
};

// Counter of non-finite texels, which cause the map to be redrawn.
uvec2 map_not_finite;

float stored_depth(MapSheet sheet, ivec2 texel, int layer) {
    ivec2 p = clamp(texel, ivec2(0), ivec2(int(sheet.side) - 1));
    float depth = sheet.is_array ? load_layer(sheet.image, p, layer).r : load(sheet.image, p).r;
    // A non-finite texel counts as empty.
    return is_taken(map_not_finite, vec3(depth)) ? depth : 0.0;
}

float map_side(uint image, bool is_array) {
    return float(is_array ? textureSize(image_arrays[image], 0).x : textureSize(images[image], 0).x);
}

// The face of a local light's map for a direction from it; -1 if there is none.
int face_of(MapLight light, MapLayerBuffer layers, vec3 direction) {
    int best = -1;
    float most = 0.0;
    for (uint i = 0u; i < light.layers; i++) {
        float along = dot(direction, layers.at[light.first + i].forward);
        if (along > most) {
            most = along;
            best = int(i);
        }
    }
    return best;
}

// Projects `position`, on a plane with the unit normal `normal`, into a layer. `size` is that of the light.
MapPoint project(uint kind, float size, MapLayer layer, float side, vec3 position, vec3 normal) {
    MapPoint p;
    precise vec3 v = position - layer.origin;
    float half_square = dot(layer.right, layer.right);
    float half_side = sqrt(half_square);
    vec2 across = vec2(dot(v, layer.right), dot(v, layer.down)) / half_square;
    p.normal = normal;
    p.height = dot(normal, v);
    vec2 tilt = vec2(dot(normal, layer.right), dot(normal, layer.down));
    float scale = MAP_ROUNDING * (length(position) + length(v));
    if (kind == MAP_CASCADES) {
        float facing = -dot(normal, layer.forward);
        p.at = across;
        p.depth = -dot(v, layer.forward) / layer.depth;
        p.slope = -tilt / (facing * layer.depth);
        p.texel = 2.0 * half_side / side;
        p.unit = 1.0 / layer.depth;
        p.reach = layer.depth * size / half_side;
        p.rounding = scale / (facing * layer.depth);
    } else {
        float z = dot(v, layer.forward);
        // The light is above the plane where its height is below zero.
        p.at = across / z;
        p.depth = layer.depth / z;
        p.slope = layer.depth * tilt / p.height;
        p.texel = 2.0 * half_side * z / side;
        p.unit = p.depth / z;
        p.reach = size / (layer.depth * half_side);
        p.rounding = p.depth * scale / max(-p.height, scale);
    }
    // Depth itself is rounded once when it is drawn and once when it is stored.
    p.rounding += MAP_ROUNDING * p.depth;
    p.covered = p.depth > 0.0 && all(lessThanEqual(abs(p.at), vec2(1.0)));
    return p;
}

// The depth to compare a texel with: of the surface's plane where it comes nearer to the light, else of the point itself. Where the plane
// recedes from the light, an adjoining surface is no blocker, even if it is above the plane's extension.
float plane_depth(MapPoint p, vec2 at) {
    return p.depth + max(dot(p.slope, at - p.at), 0.0);
}

vec2 texel_centre(MapSheet sheet, ivec2 texel) {
    return (vec2(texel) + 0.5) / sheet.side * 2.0 - 1.0;
}

// The texel that contains a position.
ivec2 texel_at(MapSheet sheet, vec2 at) {
    return ivec2(floor((at * 0.5 + 0.5) * sheet.side));
}

vec3 face_ray(MapLayer layer, vec2 at) {
    return layer.forward + at.x * layer.right + at.y * layer.down;
}

// As `above_plane`, for a texel beyond the edge of a face: it is read from the neighbouring face, and its depth converted to this one.
float above_plane_beyond(MapSheet sheet, MapPoint p, ivec2 texel) {
    MapLayerBuffer layers = MapLayerBuffer(sheet.layers);
    MapLayer here = layers.at[sheet.light.first + uint(sheet.layer)];
    vec3 ray = face_ray(here, texel_centre(sheet, texel));
    int other = face_of(sheet.light, layers, ray);
    if (other < 0) return -1.0;
    MapLayer there = layers.at[sheet.light.first + uint(other)];
    vec2 at = vec2(dot(ray, there.right), dot(ray, there.down)) / (dot(there.right, there.right) * dot(ray, there.forward));
    ivec2 met = texel_at(sheet, at);
    ray = face_ray(there, texel_centre(sheet, met));
    // Converted to depths of this face.
    float depth = stored_depth(sheet, met, other) / max(dot(ray, here.forward), 1e-3);
    float plane = there.depth * dot(p.normal, ray) / (p.height * max(dot(ray, here.forward), 1e-3));
    return depth - max(plane, p.depth) - p.rounding;
}

// How much nearer to the light a texel is than the plane; above zero if it occludes it.
float above_plane(MapSheet sheet, MapPoint p, ivec2 texel) {
    vec2 centre = texel_centre(sheet, texel);
    if (sheet.light.kind == MAP_FACES && sheet.light.layers > 1u) {
        MapLayer here = MapLayerBuffer(sheet.layers).at[sheet.light.first + uint(sheet.layer)];
        // Behind a one-sided light there are no occluders.
        if (dot(face_ray(here, centre), sheet.light.facing) < 0.0) return -1.0;
        bool outside = any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, ivec2(int(sheet.side))));
        if (outside) return above_plane_beyond(sheet, p, texel);
    }
    return stored_depth(sheet, texel, sheet.layer) - plane_depth(p, centre) - p.rounding;
}

// Unoccluded share of a box of `width` texels around the point, every texel weighted by its overlap, so that the result is continuous
// (Reeves, Salesin and Cook 1987, "Rendering Antialiased Shadows with Depth Maps").
float box_filter(MapSheet sheet, MapPoint p, float width) {
    vec2 centre = (p.at * 0.5 + 0.5) * sheet.side;
    vec2 lower = centre - 0.5 * width;
    vec2 upper = centre + 0.5 * width;
    ivec2 first = ivec2(floor(lower));
    ivec2 last = ivec2(floor(upper));
    float lit = 0.0;
    for (int y = first.y; y <= last.y; y++) {
        float high = min(upper.y, float(y + 1)) - max(lower.y, float(y));
        for (int x = first.x; x <= last.x; x++) {
            float wide = min(upper.x, float(x + 1)) - max(lower.x, float(x));
            if (above_plane(sheet, p, ivec2(x, y)) <= 0.0) lit += wide * high;
        }
    }
    return lit / (width * width);
}

// Sample `i` of `count` in the unit disc, evenly spread (Vogel 1979, "A better way to construct the sunflower head").
vec2 disc_sample(uint i, uint count, float turn) {
    float angle = float(i) * 2.39996323 + turn;
    return sqrt((float(i) + 0.5) / float(count)) * vec2(cos(angle), sin(angle));
}

// The same, denser around the centre: as many samples between a hundredth and a tenth of the radius as between a tenth and a half, so that
// near blockers are found in any search radius.
vec2 search_sample(uint i, uint count, float turn) {
    float angle = float(i) * 2.39996323 + turn;
    float share = (float(i) + 0.5) / float(count);
    return share * share * vec2(cos(angle), sin(angle));
}

// A rotation angle for each pixel that differs as much as possible from its neighbours' (Jimenez 2014, "Next Generation Post
// Processing in Call of Duty: Advanced Warfare": interleaved gradient noise).
float pixel_turn(ivec2 pixel) {
    return 6.28318531 * fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715))));
}

#endif
