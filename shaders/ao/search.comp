#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "lib/sampling.glsl"
#include "lib/slice.glsl"
#include "shared/ao.glsl"
// Openness and bent normals from the depth image: Jimenez, Wu, Pesce and Jarabo 2016, "Practical Real-Time Strategies for Accurate
// Indirect Occlusion". The hemisphere is cut into slices, planes through the view direction. In each slice the horizon is searched on both
// sides, and what lies above the two horizons is integrated in closed form. Angles in a slice are counted from the direction to the viewer.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SearchParams params; };

// Height of the horizon on one side of a slice, as an angle from the surface's own plane on that side, 0 to pi. It is not counted from the
// viewer because taps are at pixel centres, not exactly on the slice, and a plane must not occlude itself.
float horizon(ViewBuffer view, ivec2 pixel, Surface s, vec3 here, Slice slice, float side, float first, float radius) {
    vec3 flat_way = side * (cos(slice.geometric) * slice.across - sin(slice.geometric) * s.to_eye);
    // Cosine of the horizon: 1 lies in the plane, and anything lower occludes no more than the plane.
    float highest = 1.0;
    float away_before = 0.0;
    float cosine_before = 1.0;
    for (uint i = 0u; i < params.steps; i++) {
        // Denser near the point, where occluders matter most.
        float share = (float(i) + first) / float(params.steps);
        vec2 at = vec2(pixel) + 0.5 + side * slice.pixel_step * (1.0 + share * share * radius);
        ivec2 seen = ivec2(floor(at));
        if (!inside(seen, view.at[0].size)) break;
        float depth = load(params.gbuffer.depth, seen).r;
        if (depth <= 0.0) {
            away_before = 2.0 * params.range;
            continue;
        }
        vec3 apart = from_eye(view, seen, depth) - here;
        float away = length(apart);
        float sine = clamp(dot(apart, s.geometric_normal) / max(away * slice.geometric_length, 1e-20), 0.0, 1.0);
        float cosine = sqrt(1.0 - sine * sine);
        if (sine > 0.0 && dot(apart, flat_way) < 0.0) cosine = -cosine;
        float found = 1.0;
        if (away < params.range) {
            found = cosine;
        } else if (away_before < params.range && away < 2.0 * params.range) {
            // A surface that continues beyond the range occludes up to the end of the range, not just up to the last tap.
            found = mix(cosine_before, cosine, (params.range - away_before) / (away - away_before));
        }
        away_before = away;
        cosine_before = cosine;
        // A tap below the horizon may lie behind a thin object, so it lowers the horizon (thickness heuristic).
        highest = found < highest ? found : mix(highest, found, params.decay);
    }
    return acos(highest);
}

// Bent normal and openness.
vec4 search(ViewBuffer view, ivec2 pixel, Surface s, float depth) {
    vec3 ray = pixel_ray(view, pixel);
    vec3 here = from_eye(view, pixel, depth);
    // Range in pixels.
    float radius = params.range * depth * view.at[0].world_from_clip[2].w / pixel_spread(view);
    mat3 around = frame_of(s.to_eye);

    // Sixteen rotations in every square of four by four pixels, and four offsets of the taps (as in the paper).
    ivec2 target = pixel / int(params.step);
    float turn = float((((target.x + target.y) & 3) << 2) + (target.x & 3)) / 16.0;
    // Greater than 0, at most 1, so that some taps reach the end of the range.
    float first = 1.0 - fract(float((target.y - target.x) & 3) / 4.0 + params.noise.y);

    float open = 0.0;
    float clear = 0.0;
    vec3 bent = vec3(0.0);
    for (uint i = 0u; i < params.slices; i++) {
        float angle = PI * (float(i) + fract(turn + params.noise.x)) / float(params.slices);
        Slice slice = slice_of(view, s, ray, around * vec3(cos(angle), sin(angle), 0.0));
        float left = horizon(view, pixel, s, here, slice, -1.0, first, radius);
        float right = horizon(view, pixel, s, here, slice, 1.0, first, radius);
        // Horizons are limited to the hemispheres of the geometric and the shading normal.
        float n = slice.shading;
        float h0 = min(max(slice.geometric - 0.5 * PI + left, n - 0.5 * PI), 0.0);
        float h1 = max(min(slice.geometric + 0.5 * PI - right, n + 0.5 * PI), 0.0);
        open += slice.shading_length * (open_arc(h0, n) + open_arc(h1, n));
        // Normalised by what the same slices give without occluders: a few slices sample the normals of a tilted surface unevenly.
        clear += slice.shading_length * (cos(n) + n * sin(n));
        vec2 direction = open_direction(h0, n) + open_direction(h1, n);
        bent += slice.shading_length * (direction.x * s.to_eye + direction.y * slice.across);
    }
    return vec4(safe_normalize(bent, s.normal), open / clear);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 target = ivec2(gl_GlobalInvocationID.xy);
    ivec2 pixel = target * int(params.step);
    if (!inside(pixel, view.at[0].size)) return;
    Surface surface = load_geometry(view, pixel, params.gbuffer);
    vec4 found = vec4(vec3(0.0), 1.0);
    if (surface.exists) found = search(view, pixel, surface, load(params.gbuffer.depth, pixel).r);
    // The image cannot hold what is not finite: counted, and taken for open.
    if (!is_taken(params.not_finite, found)) found = vec4(surface.normal, 1.0);
    store(params.found, target, vec4(0.5 + 0.5 * found.xyz, found.w));
}
