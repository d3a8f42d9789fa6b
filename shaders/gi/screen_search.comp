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
// A surface is taken to go on along its plane between two samples, up to this ratio of distances from the eye.
const float MOST_STRETCH = 4.0;

// The sectors of one slice and what was found in them.
struct Sectors {
    Slice slice;
    float low;      // signed arc at the lower end of the hemisphere of the shading normal
    float whole;    // arc of the whole hemisphere
    float offset;   // place in each sector at which its visibility is decided, 0 to 1
    uint taken;     // a bit for each sector that something covers
    vec3 light;     // mean over all sectors
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

// Angle in the slice of a direction on one side. As in the search for ambient occlusion, it is counted from the surface's own plane, which
// must not cover itself.
float angle_of(Surface s, Slice slice, float side, vec3 apart) {
    vec3 flat_way = side * (cos(slice.geometric) * slice.across - sin(slice.geometric) * s.to_eye);
    float sine = clamp(dot(apart, s.geometric_normal) / max(length(apart) * slice.geometric_length, 1e-20), 0.0, 1.0);
    float cosine = sqrt(1.0 - sine * sine);
    if (sine > 0.0 && dot(apart, flat_way) < 0.0) cosine = -cosine;
    return slice.geometric + side * (0.5 * PI - acos(cosine));
}

// Length in pixels to the border of the picture.
float to_border(ViewBuffer view, ivec2 pixel, vec2 way) {
    vec2 here = vec2(pixel) + 0.5;
    vec2 room = mix(here, vec2(view.at[0].size) - here, greaterThan(way, vec2(0.0)));
    vec2 lengths = room / max(abs(way), vec2(1e-6));
    return min(lengths.x, lengths.y);
}

// Searches one side of a slice.
void search_side(ViewBuffer view, ivec2 pixel, Surface s, vec3 here, float side, float first, float radius, inout Sectors sectors) {
    vec2 way = side * sectors.slice.pixel_step;
    float reach = min(radius, to_border(view, pixel, way));
    float w = view.at[0].world_from_clip[2].w;
    ivec2 before = pixel;
    // Distances from the eye, over the length of the pixel's ray.
    float distance_before = 1.0 / (load(params.gbuffer.depth, pixel).r * w);
    for (uint i = 0u; i < params.steps; i++) {
        // Denser near the point, where things cover most.
        float share = (float(i) + first) / float(params.steps);
        ivec2 seen = ivec2(floor(vec2(pixel) + 0.5 + way * (1.0 + share * share * reach)));
        if (!inside(seen, view.at[0].size)) break;
        if (seen == before) continue;
        float depth = load(params.gbuffer.depth, seen).r;
        vec3 ray = pixel_ray(view, seen);
        vec3 ray_before = pixel_ray(view, before);
        float behind = distance_before;
        before = seen;
        distance_before = depth > 0.0 ? 1.0 / (depth * w) : 3.4e38;
        if (depth <= 0.0) continue;
        vec3 there = ray * distance_before;
        vec3 apart = there - here;
        float away = length(apart);
        if (away > params.range) continue;

        // The surface is taken to reach back to the sample before, or half as far if it would hide what is seen there.
        vec3 normal = octahedral_decode(load(params.gbuffer.geometric_normal, seen).xy);
        float facing = dot(normal, there);
        float back = facing / dot(normal, ray_before);
        if (back < 0.99 * behind) {
            ray_before = 0.5 * (ray_before + ray);
            back = facing / dot(normal, ray_before);
        }
        bool stretches = back > distance_before / MOST_STRETCH && back < MOST_STRETCH * distance_before;
        vec3 nearer = stretches ? ray_before * back - here : apart;
        vec3 beneath = apart + there * (params.thickness / length(there));

        float angle = angle_of(s, sectors.slice, side, apart);
        float angle_nearer = angle_of(s, sectors.slice, side, nearer);
        float angle_beneath = angle_of(s, sectors.slice, side, beneath);
        float least = min(angle, min(angle_nearer, angle_beneath));
        float most = max(angle, max(angle_nearer, angle_beneath));
        uint covered = sectors_between(place_of(sectors, least), place_of(sectors, most), sectors.offset) & ~sectors.taken;
        if (covered == 0u) continue;
        sectors.taken |= covered;
        float part = float(bitCount(covered)) / SECTORS;
        vec3 direction = safe_normalize(apart + nearer, s.normal);
        sectors.covered += part * direction;
        // The camera sees the front; what the back sends is not known.
        if (dot(normal, apart) >= 0.0) continue;
        sectors.light += part * diffuse_weight(s.fresnel, max(dot(s.normal, direction), 0.0)) * load(params.light, seen).rgb;
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
    float weights = 0.0;
    for (uint i = 0u; i < params.slices; i++) {
        uint index = params.frame * params.slices + i;
        vec2 u = sequence2(pixel, index, SEQUENCE_GI, seed);
        float angle = PI * u.x;
        Sectors sectors;
        sectors.slice = slice_of(view, s, ray, around * vec3(cos(angle), sin(angle), 0.0));
        float n = sectors.slice.shading;
        sectors.low = signed_arc(n - 0.5 * PI, n);
        sectors.whole = signed_arc(n + 0.5 * PI, n) - sectors.low;
        sectors.offset = sequence2(pixel, index, SEQUENCE_GI + 1u, seed).x;
        sectors.light = vec3(0.0);
        sectors.covered = vec3(0.0);
        // The surface itself covers what lies below its plane.
        float lowest = max(sectors.slice.geometric, n) - 0.5 * PI;
        float highest = min(sectors.slice.geometric, n) + 0.5 * PI;
        sectors.taken = ~sectors_between(place_of(sectors, lowest), place_of(sectors, highest), sectors.offset);
        search_side(view, pixel, s, here, -1.0, 1.0 - u.y, radius, sectors);
        search_side(view, pixel, s, here, 1.0, 1.0 - u.y, radius, sectors);

        // Divided by what the same slices give without anything in the way: a few sample the normals of a tilted surface unevenly.
        float length = sectors.slice.shading_length;
        float weight = length * sectors.whole;
        vec2 below = open_direction(n - 0.5 * PI, n) + open_direction(n + 0.5 * PI, n) - open_direction(lowest, n) - open_direction(highest, n);
        light += weight * sectors.light;
        hidden += weight * sectors.covered + length * (below.x * s.to_eye + below.y * sectors.slice.across);
        open += weight * float(bitCount(~sectors.taken)) / SECTORS;
        weights += weight;
    }
    light /= weights;
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
