#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
#include "lib/sampling.glsl"
#include "lib/sequence.glsl"
#include "lib/sky.glsl"
#include "lib/slice.glsl"
#include "shared/gi.glsl"
// Diffuse indirect light from the depth image: Therrien, Levesque and Gilet 2023, "Screen Space Indirect Lighting with Visibility Bitmask".
// Each slice of the hemisphere is cut into sectors, one bit each. What the depth image shows in a slice takes the sectors that it covers, the
// nearest first, and sends its light through them; the sky shines through those that are left.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ScreenSearchParams params; };

const float SECTORS = 32.0;
const uint ALL_SECTORS = 0xffffffffu;
// What is lower above the plane of a surface than this lies in it: rounding of positions, relative to the distance from the eye, and of
// normals, as a sine.
const float PLACE_ROUNDING = 2e-5;
const float NORMAL_ROUNDING = 2e-4;
// Place on rays of what is no surface.
const float BACKGROUND = 1e30;
// A surface is taken to go on along its plane between two samples, up to this ratio of distances from the eye.
const float MOST_STRETCH = 4.0;

// The sectors of one slice and what was found in them.
struct Sectors {
    Slice slice;
    vec3 flat_way;  // direction of the surface's own plane in the slice, on the side of `slice.across`
    float low;      // signed arc at the lower end of the hemisphere of the shading normal
    float whole;    // arc of the whole hemisphere
    float offset;   // place in each sector at which its visibility is decided, 0 to 1
    uint taken;     // a bit for each sector that something covers
    vec3 light;     // mean over all sectors
    float share;    // of the sectors that things cover
    float known;    // share of the sectors that this light comes through
    vec3 covered;   // mean direction of covered sectors, as far as things cover them
};

// Sectors are not equal angles, as in the paper, but equal parts of the cosine-weighted integral, so that all count alike: this is that
// integral from the direction to the viewer to an angle, negative below 0.
float signed_arc(float angle, float n) {
    return angle < 0.0 ? -open_arc(angle, n) : open_arc(angle, n);
}

// Place of an angle among the sectors, 0 to 1.
float place_of(Sectors sectors, float angle) {
    float n = sectors.slice.shading;
    return (signed_arc(clamp(angle, n - 0.5 * PI, n + 0.5 * PI), n) - sectors.low) / sectors.whole;
}

// The sectors from one place to another. Their number is right in the mean over `offset`, and never rounded up for small things.
uint sectors_between(float from, float to, float offset) {
    int first = int(clamp(ceil(from * SECTORS - offset), 0.0, SECTORS));
    int end = int(clamp(ceil(to * SECTORS - offset), 0.0, SECTORS));
    int count = end - first;
    if (count <= 0) return 0u;
    return (count == int(SECTORS) ? ALL_SECTORS : (1u << count) - 1u) << first;
}

// Angle in the slice of a point on one side, `height` above the surface's plane. As in the search for ambient occlusion, it is counted from the surface's own plane, which
// must not cover itself.
float angle_of(Sectors sectors, float side, float height, vec3 apart) {
    float above = height / max(length(apart) * sectors.slice.geometric_length, 1e-20);
    float sine = clamp(above - NORMAL_ROUNDING, 0.0, 1.0);
    float cosine = sqrt(1.0 - sine * sine);
    if (sine > 0.0 && side * dot(apart, sectors.flat_way) < 0.0) cosine = -cosine;
    return sectors.slice.geometric + side * (0.5 * PI - acos(cosine));
}

// Length in pixels to the border of the picture.
float to_border(ViewBuffer view, ivec2 pixel, vec2 way) {
    vec2 here = vec2(pixel) + 0.5;
    vec2 room = mix(here, vec2(view.at[0].size) - here, greaterThan(way, vec2(0.0)));
    vec2 lengths = room / max(abs(way), vec2(1e-6));
    return min(lengths.x, lengths.y);
}

// What the depth image shows at a pixel. Points are relative to the eye.
struct Tap {
    ivec2 pixel;
    vec3 ray;
    float along;    // place on the ray, which is not normalised; huge on the background
    vec3 normal;    // geometric
    bool counts;    // a surface in range, and not the one that is lit
};

Tap tap_at(ViewBuffer view, ivec2 pixel, vec3 here) {
    Tap tap;
    tap.pixel = pixel;
    tap.ray = pixel_ray(view, pixel);
    float depth = load(params.gbuffer.depth, pixel).r;
    tap.counts = depth > 0.0;
    tap.along = tap.counts ? 1.0 / (depth * view.at[0].world_from_clip[2].w) : BACKGROUND;
    tap.normal = octahedral_decode(load(params.gbuffer.geometric_normal, pixel).xy);
    tap.counts = tap.counts && distance(tap.ray * tap.along, here) < params.range;
    return tap;
}

// Place on a ray where it meets the plane of what a tap shows; that of the tap itself where they meet too far from it.
float along_plane(Tap tap, vec3 ray) {
    float along = tap.along * (dot(tap.normal, tap.ray) / dot(tap.normal, ray));
    return along > tap.along / MOST_STRETCH && along < MOST_STRETCH * tap.along ? along : tap.along;
}

// The ray between those of two taps at which one surface gives way to the other: where their planes meet, in a fold or at an edge. Where they
// do not meet, one of them ends somewhere in between.
vec3 boundary(Tap a, Tap b) {
    // The planes are equally far away where this is 0; it is linear between the rays.
    float plane_a = dot(a.normal, a.ray) * a.along;
    float plane_b = dot(b.normal, b.ray) * b.along;
    float at_a = plane_a * dot(b.normal, a.ray) - plane_b * dot(a.normal, a.ray);
    float at_b = plane_a * dot(b.normal, b.ray) - plane_b * dot(a.normal, b.ray);
    bool meet = (at_a < 0.0) != (at_b < 0.0) && max(a.along, b.along) < BACKGROUND;
    return mix(a.ray, b.ray, meet ? at_a / (at_a - at_b) : 0.5);
}

// Covers what lies between a tap and the place where `ray` meets its plane, and its thickness behind.
void cover(Surface s, vec3 here, float side, Tap tap, vec3 ray, inout Sectors sectors) {
    vec3 there = tap.ray * tap.along;
    vec3 apart = there - here;
    vec3 end = ray * along_plane(tap, ray) - here;
    vec3 beneath = apart + there * (params.thickness / length(there));
    vec3 height = s.geometric_normal * mat3(apart, end, beneath) - PLACE_ROUNDING * length(here);
    height.y -= NORMAL_ROUNDING * length(apart);
    if (max(height.x, max(height.y, height.z)) <= 0.0) return;
    float angle = angle_of(sectors, side, height.x, apart);
    float angle_end = angle_of(sectors, side, height.y, end);
    float angle_beneath = angle_of(sectors, side, height.z, beneath);
    float least = min(angle, min(angle_end, angle_beneath));
    float most = max(angle, max(angle_end, angle_beneath));
    uint covered = sectors_between(place_of(sectors, least), place_of(sectors, most), sectors.offset) & ~sectors.taken;
    if (covered == 0u) return;
    sectors.taken |= covered;
    float part = float(bitCount(covered)) / SECTORS;
    vec3 direction = safe_normalize(apart + end, s.normal);
    sectors.covered += part * direction;
    sectors.share += part;
    // The camera sees the front; what the back sends is not known.
    if (dot(tap.normal, apart) >= 0.0) return;
    sectors.known += part;
    sectors.light += part * diffuse_weight(s.fresnel, max(dot(s.normal, direction), 0.0)) * load(params.light, tap.pixel).rgb;
}

// Searches one side of a slice, outwards. Between two taps each surface goes on along its plane.
void search_side(ViewBuffer view, ivec2 pixel, Surface s, vec3 here, float side, float first, float radius, inout Sectors sectors) {
    vec2 way = side * sectors.slice.pixel_step;
    float reach = max(min(radius, to_border(view, pixel, way) - 0.01), 1.0) - 1.0;
    Tap before = tap_at(view, pixel, here);
    before.counts = false;
    for (uint i = 0u; i <= params.steps; i++) {
        // Denser near the point, where things cover most. The last surface is taken to reach to the end.
        float share = min((float(i) + first) / float(params.steps), 1.0);
        ivec2 seen = ivec2(floor(vec2(pixel) + 0.5 + way * (1.0 + share * share * reach)));
        if (!inside(seen, view.at[0].size)) break;
        if (seen == before.pixel) continue;
        if (sectors.taken == ALL_SECTORS) break;
        if (i == params.steps) {
            if (before.counts) cover(s, here, side, before, pixel_ray(view, seen), sectors);
            break;
        }
        Tap tap = tap_at(view, seen, here);
        vec3 end = boundary(before, tap);
        if (before.counts) cover(s, here, side, before, end, sectors);
        if (tap.counts) cover(s, here, side, tap, end, sectors);
        before = tap;
    }
}

// Irradiance over pi.
vec3 search(ViewBuffer view, ivec2 pixel, Surface s) {
    float depth = load(params.gbuffer.depth, pixel).r;
    vec3 ray = pixel_ray(view, pixel);
    vec3 here = from_eye(view, pixel, depth);
    // Range in pixels.
    float radius = params.range * depth * view.at[0].world_from_clip[2].w / pixel_spread(view);
    mat3 around = frame_of(s.to_eye);
    uint seed = view.at[0].seed;

    vec3 light = vec3(0.0);
    vec3 hidden = vec3(0.0);
    float open = 0.0;
    float covered = 0.0;
    float known = 0.0;
    float weights = 0.0;
    for (uint i = 0u; i < params.slices; i++) {
        uint index = params.frame * params.slices + i;
        vec2 u = sequence2(pixel, index, SEQUENCE_GI, seed);
        float angle = PI * u.x;
        Sectors sectors;
        sectors.slice = slice_of(view, s, ray, around * vec3(cos(angle), sin(angle), 0.0));
        float g = sectors.slice.geometric;
        sectors.flat_way = cos(g) * sectors.slice.across - sin(g) * s.to_eye;
        float n = sectors.slice.shading;
        sectors.low = signed_arc(n - 0.5 * PI, n);
        sectors.whole = signed_arc(n + 0.5 * PI, n) - sectors.low;
        sectors.offset = sequence2(pixel, index, SEQUENCE_GI + 1u, seed).x;
        sectors.light = vec3(0.0);
        sectors.share = 0.0;
        sectors.known = 0.0;
        sectors.covered = vec3(0.0);
        // The surface itself covers what lies below its plane.
        float lowest = max(g, n) - 0.5 * PI;
        float highest = min(g, n) + 0.5 * PI;
        sectors.taken = ~sectors_between(place_of(sectors, lowest), place_of(sectors, highest), sectors.offset);
        search_side(view, pixel, s, here, -1.0, 1.0 - u.y, radius, sectors);
        search_side(view, pixel, s, here, 1.0, 1.0 - u.y, radius, sectors);

        // Divided by what the same slices give without anything in the way: a few sample the normals of a tilted surface unevenly.
        float projected = sectors.slice.shading_length;
        float weight = projected * sectors.whole;
        vec2 below = open_direction(n - 0.5 * PI, n) + open_direction(n + 0.5 * PI, n) - open_direction(lowest, n) - open_direction(highest, n);
        light += weight * sectors.light;
        hidden += weight * sectors.covered + projected * (below.x * s.to_eye + below.y * sectors.slice.across);
        open += weight * float(bitCount(~sectors.taken)) / SECTORS;
        covered += weight * sectors.share;
        known += weight * sectors.known;
        weights += weight;
    }
    light /= weights;
    // Backs of things are taken to shine like the mean of what is seen, which keeps light within its bounds.
    if (known > 0.0) light *= covered / known;
    open /= weights;
    if (view.at[0].has_sky == 0u || open <= 0.0) return light;
    // Of all directions the mean, weighted with the cosine, is 2/3 of the normal.
    vec3 bent = safe_normalize(2.0 / 3.0 * s.normal - hidden / weights, s.normal);
    // The occlusion map shows folds finer than the mesh; where the search has found them too, the lesser counts.
    return light + sky_irradiance(view.at[0].sky, bent) * (min(open, s.occlusion) / PI);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 target = ivec2(gl_GlobalInvocationID.xy);
    ivec2 pixel = target * int(params.step);
    if (!inside(pixel, view.at[0].size)) return;
    Surface s = load_surface(view, pixel, params.gbuffer);
    vec3 found = vec3(0.0);
    if (s.exists) found = search(view, pixel, s);
    if (!is_taken(params.not_finite, found)) found = vec3(0.0);
    store(params.found, target, vec4(representable(found, params.greatest), 1.0));
}
