#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/blur_taps.glsl"
#include "lib/bsdf.glsl"
#include "lib/colour.glsl"
#include "lib/found_ray.glsl"
#include "lib/guide.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
#include "lib/random.glsl"
#include "lib/ray_cells.glsl"
#include "lib/roughness_limit.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/reflections.glsl"
// Reconstruction and upsampling in one pass: each pixel takes the rays of its neighbours as samples of its own lobe, by the ratio estimator
// sum(L w) / sum(w), w = BRDF times cosine of this pixel over the pdf of the ray (Stachowiak 2015, "Stochastic Screen-Space Reflections").
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ReconstructParams params; };

// A neighbour on another surface counts this much at least: its light is better than none.
const float ANY_SURFACE = 1e-4;
// How much a smooth surface counts in the mean over frames where it has no ray of its own.
const float BORROWED = 0.02;
// Weights below this are those of other surfaces.
const float SAME_SURFACE = 0.01;

// What the pixel reflects.
struct Lobe {
    Surface surface;
    Guide guide;
    vec2 gradient;
    Bsdf bsdf;
    mat3 around;
    vec3 v;
    float albedo;      // luminance
    float smoothness;  // 1 where the lobe is narrower than the distance of rays, 0 where it is wide
};

// Distance of what the rays around hit: the harmonic mean, so that near things count.
float distance_around(ivec2 cell, ivec2 cells) {
    const ivec2 PLUS[5] = ivec2[](ivec2(0), ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1));
    vec2 sum = vec2(0.0);
    for (int k = 0; k < 5; k++) {
        ivec2 at = cell + PLUS[k];
        if (!inside(at, uvec2(cells))) continue;
        float distance = load(params.rays_found, at).z;
        if (distance > 0.0 && load(params.found, at).a > 0.0) sum += vec2(1.0, 1.0 / distance);
    }
    return sum.x > 0.0 ? sum.x / sum.y : SKY_DISTANCE;
}

// Weight of a cell's ray, and what it found.
float weight_of(ViewBuffer view, ivec2 pixel, ivec2 cell, ivec2 side, Lobe lobe, vec4 found, out FoundRay ray) {
    ivec2 from = ray_pixel(view, cell, side);
    Guide there = load_guide(params.guide, from);
    ray = unpack_ray(load(params.rays_found, cell));
    if (!is_surface(there)) return 0.0;
    vec2 offset = vec2(from - pixel);
    vec3 direction = ray.direction;
    if (ray.distance < SKY_DISTANCE) {
        vec3 moved = pixel_ray(view, from) * there.depth - pixel_ray(view, pixel) * lobe.guide.depth;
        direction = safe_normalize(moved + ray.direction * ray.distance, ray.direction);
    }
    vec3 l = direction * lobe.around;
    if (l.z <= 0.0) return 0.0;
    float ratio = luminance(bsdf_cosine(lobe.bsdf, lobe.v, l, LOBE_SPECULAR)) / (ray.pdf * lobe.albedo);
    float near = exp(-2.0 * dot(offset, offset) / float(side.x * side.x));
    return max(edge_weight(lobe.guide, lobe.gradient, there, offset), ANY_SURFACE) * mix(ratio, near, lobe.smoothness);
}

// Light of the rays of a cell and those beside it, whatever they are rays of.
vec3 light_beside(ivec2 cell, ivec2 cells) {
    vec3 sum = vec3(0.0);
    float count = 0.0;
    for (int k = 0; k < 9; k++) {
        ivec2 at = cell + ivec2(k % 3, k / 3) - 1;
        if (!inside(at, uvec2(cells))) continue;
        vec4 found = load(params.found, at);
        if (found.a == 0.0 || !is_finite(found)) continue;
        count += 1.0;
        sum += (found.rgb - sum) / count;
    }
    return sum;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Lobe lobe;
    lobe.surface = load_surface(view, pixel, params.gbuffer);
    if (!lobe.surface.exists || !reflects(lobe.surface)) {
        store(params.radiance, pixel, vec4(0.0));
        store(params.hit_distance, pixel, vec4(SKY_DISTANCE));
        store(params.width, pixel, vec4(0.0));
        return;
    }
    Surface s = lobe.surface;
    lobe.guide = load_guide(params.guide, pixel);
    lobe.gradient = depth_gradient(view, pixel, lobe.guide);
    lobe.bsdf = bsdf_of(s);
    lobe.around = frame_of(s.normal);
    lobe.v = s.to_eye * lobe.around;
    lobe.v.z = eye_cosine(s);
    lobe.albedo = luminance(specular_albedo(s));

    ivec2 side = ivec2(params.cell);
    ivec2 cells = ivec2((view.at[0].size + params.cell - 1u) / params.cell);
    ivec2 cell = pixel / side;
    float width = lobe_width(view, s, strongest_alpha(lobe.bsdf, lobe.v), distance_around(cell, cells));
    lobe.smoothness = 1.0 - smoothstep(0.5, 2.0, width / float(side.x));
    // In cells. Where not every pixel has a ray, the nearest ones are needed at any width.
    vec2 reach = vec2(min(0.5 * width, params.radius)) / vec2(side);
    reach = max(reach, vec2(greaterThan(side, ivec2(1))));

    vec4 lights[MOST_TAPS];
    ivec2 places[MOST_TAPS];
    uint count = 0u;
    float brightest = 0.0;
    uint brightest_at = 0u;
    vec2 light_sum = vec2(0.0);
    float nearness = 0.0;
    float turn = disc_turn(view, pixel, 0u);
    float share = share_of_rays(s, params.roughness_limit);
    uint taps = share > 0.0 ? params.taps : 0u;
    for (uint i = 0u; i < taps; i++) {
        vec2 offset = disc_tap(i, params.taps, turn) * reach;
        ivec2 at = ivec2(floor((vec2(pixel) + 0.5) / vec2(side) + offset));
        bool known = !inside(at, uvec2(cells));
        for (uint k = 0u; k < count; k++) known = known || places[k] == at;
        if (known) continue;
        vec4 found = load(params.found, at);
        if (found.a == 0.0) continue;
        if (i == 0u ? !is_taken(params.not_finite, found) : !is_finite(found)) continue;
        FoundRay ray;
        float weight = weight_of(view, pixel, at, side, lobe, found, ray);
        if (!(weight > 0.0)) continue;
        lights[count] = vec4(found.rgb, weight);
        places[count] = at;
        float light = luminance(found.rgb);
        light_sum += weight * vec2(1.0, light);
        nearness += weight / ray.distance;
        if (light > brightest) {
            brightest = light;
            brightest_at = count;
        }
        count++;
    }
    // A single bright ray among dark ones is limited: it stands for more than it found.
    if (count > 1u && lobe.smoothness < 1.0) {
        vec2 rest = light_sum - lights[brightest_at].a * vec2(1.0, brightest);
        float most = params.firefly_limit * rest.y / max(rest.x, 1e-6);
        if (brightest > most) lights[brightest_at].rgb *= mix(most / brightest, 1.0, lobe.smoothness);
    }
    vec3 sum = vec3(0.0);
    float weights = 0.0;
    for (uint i = 0u; i < count; i++) {
        weights += lights[i].a;
        // A running mean: of equal values it is exactly that value.
        sum += (lights[i].a / weights) * (lights[i].rgb - sum);
    }
    // A lobe that none of these rays lies in: without a history, any light is nearer to the truth than none.
    if (count == 0u) sum = light_beside(cell, cells);
    bool own = count > 0u && places[0] == cell && ray_pixel(view, cell, side) == pixel;
    float counts = weights > SAME_SURFACE ? mix(1.0, own ? 1.0 : BORROWED, lobe.smoothness) : weights > 0.0 ? BORROWED : 0.0;
    if (share < 1.0) {
        // Rougher surfaces have no rays, and beside them a surface may find none that it could take.
        if (weights == 0.0) share = 0.0;
        sum = mix(sky_over_albedo(view, s, params.openness, pixel), sum, share);
        if (share == 0.0) counts = 1.0;
    }
    store(params.radiance, pixel, vec4(representable(sum, params.greatest), counts));
    store(params.hit_distance, pixel, vec4(weights > 0.0 ? min(weights / nearness, SKY_DISTANCE) : SKY_DISTANCE));
    store(params.width, pixel, vec4(min(width / WIDEST_NOISE, 1.0)));
}
