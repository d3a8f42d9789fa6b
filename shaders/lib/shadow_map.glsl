#ifndef LIB_SHADOW_MAP_GLSL
#define LIB_SHADOW_MAP_GLSL
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "shared/shadow_map.glsl"
// What shadow maps say of a point of a surface. Depth is reversed in all of them: 1 nearest to the light (parallel light) or at the
// near plane (a lamp), 0 furthest away. Places in a layer are -1 to 1 in x and y, as in clip space.
//
// A texel is compared with the plane of the surface where its own centre meets it (Isidoro 2006, "Shadow Mapping: GPU-based Tips and
// Techniques", receiver plane depth bias): depth is an affine function of the place in a layer for either kind of light. So no bias
// is needed on a plane but for rounding. What is not a plane is paid for by `NORMAL_OFFSET`.

// The point is moved along its normal by this many texels, times the sine of the angle to the light: half the diagonal of a texel, as
// far as a point may be from the centre of the texel that it falls in.
const float NORMAL_OFFSET = 0.70710678;

// Relative rounding error of a place in the world, eight unit roundoffs: of the matrices that draw it and of those that look it up.
const float MAP_ROUNDING = 4.76837158e-7;

// A map and a layer of it.
struct MapSheet {
    uint image;
    bool is_array;
    int layer;
    float side;     // texels
    MapLight light;
    uvec2 layers;   // MapLayerBuffer
};

// A point of a surface in a layer.
struct MapPoint {
    vec2 at;
    float depth;
    vec2 slope;     // change of the depth of the surface's plane over x and y
    float texel;    // width of a texel there, metres
    float unit;     // change of depth over one metre towards the light
    float rounding; // error of depth
    float reach;    // by how much, in x and y, a soft light sees around a blocker for one unit of depth between it and the point
    bool covered;   // inside of the layer
    vec3 normal;
    float height;   // of the plane over the origin of the layer, metres
};

// Where texels that are not finite are counted, which has the map drawn anew.
uvec2 map_not_finite;

float stored_depth(MapSheet sheet, ivec2 texel, int layer) {
    ivec2 p = clamp(texel, ivec2(0), ivec2(int(sheet.side) - 1));
    float depth = sheet.is_array ? load_layer(sheet.image, p, layer).r : load(sheet.image, p).r;
    // Such a texel shows nothing.
    return is_taken(map_not_finite, vec3(depth)) ? depth : 0.0;
}

float map_side(uint image, bool is_array) {
    return float(is_array ? textureSize(image_arrays[image], 0).x : textureSize(images[image], 0).x);
}

// The face of a lamp that a direction from it goes through; -1 where there is none.
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

// `position`, on a plane with the unit normal `normal`, in a layer. `size` is that of the light.
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
    // In the middle of the range of f32, depth itself is rounded once when it is drawn and once when it is stored.
    p.rounding += MAP_ROUNDING * p.depth;
    p.covered = p.depth > 0.0 && all(lessThanEqual(abs(p.at), vec2(1.0)));
    return p;
}

// The depth that a place is compared with: of the surface's plane where that comes nearer to the light, else of the point itself. On the
// side where the plane goes away from the light, another surface that meets it is no blocker, though it is above the plane's other half.
float plane_depth(MapPoint p, vec2 at) {
    return p.depth + max(dot(p.slope, at - p.at), 0.0);
}

vec2 texel_centre(MapSheet sheet, ivec2 texel) {
    return (vec2(texel) + 0.5) / sheet.side * 2.0 - 1.0;
}

// The texel that a place falls in.
ivec2 texel_at(MapSheet sheet, vec2 at) {
    return ivec2(floor((at * 0.5 + 0.5) * sheet.side));
}

vec3 face_ray(MapLayer layer, vec2 at) {
    return layer.forward + at.x * layer.right + at.y * layer.down;
}

// As `above_plane`, for a texel beyond the edge of a face: it lies on another one, whose depth is brought to that of this face.
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
    // Both as depths of this face.
    float depth = stored_depth(sheet, met, other) / max(dot(ray, here.forward), 1e-3);
    float plane = there.depth * dot(p.normal, ray) / (p.height * max(dot(ray, here.forward), 1e-3));
    return depth - max(plane, p.depth) - p.rounding;
}

// How much nearer to the light a texel is than the plane; above zero where it hides it.
float above_plane(MapSheet sheet, MapPoint p, ivec2 texel) {
    vec2 centre = texel_centre(sheet, texel);
    if (sheet.light.kind == MAP_FACES && sheet.light.layers > 1u) {
        MapLayer here = MapLayerBuffer(sheet.layers).at[sheet.light.first + uint(sheet.layer)];
        // Nothing behind a lamp that shines to one side hides it.
        if (dot(face_ray(here, centre), sheet.light.facing) < 0.0) return -1.0;
        bool outside = any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, ivec2(int(sheet.side))));
        if (outside) return above_plane_beyond(sheet, p, texel);
    }
    return stored_depth(sheet, texel, sheet.layer) - plane_depth(p, centre) - p.rounding;
}

// Share of a box of `width` texels around the point that is not hidden: every texel by its part of the box, so that it does not jump
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

// The same, dense around the centre: as many samples between a hundredth and a tenth of the radius as between a tenth and a half, so that
// what is near is found however far the search goes.
vec2 search_sample(uint i, uint count, float turn) {
    float angle = float(i) * 2.39996323 + turn;
    float share = (float(i) + 0.5) / float(count);
    return share * share * vec2(cos(angle), sin(angle));
}

// An angle for each pixel, as different as possible from those of its neighbours (Jimenez 2014, "Next Generation Post
// Processing in Call of Duty: Advanced Warfare": interleaved gradient noise).
float pixel_turn(ivec2 pixel) {
    return 6.28318531 * fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715))));
}

#endif
