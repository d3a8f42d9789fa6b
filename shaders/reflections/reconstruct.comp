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
#include "lib/ray_rate.glsl"
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
// Greatest distance of rays in cells, where the size of cells follows from the width of the lobe.
const float FARTHEST_CELL = 2.0;
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

// Width and height of the cells that have a ray each, around a pixel.
ivec2 side_at(ivec2 pixel) {
    if (params.rate == NO_IMAGE) return side_of(params.pixels_per_ray);
    uint rate = rate_at(params.rate, pixel);
    return ivec2(rate == RATE_FULL ? 1 : rate == RATE_QUARTER ? 2 : 4);
}

// Where the images have the ray of a cell.
ivec2 texel_of(ViewBuffer view, ivec2 cell, ivec2 side) {
    return params.rate == NO_IMAGE ? cell : ray_pixel(view, cell, side);
}

// Distance of what the rays around hit: the harmonic mean, so that near things count.
float distance_around(ViewBuffer view, ivec2 cell, ivec2 side, ivec2 cells) {
    const ivec2 PLUS[5] = ivec2[](ivec2(0), ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1));
    vec2 sum = vec2(0.0);
    for (int k = 0; k < 5; k++) {
        ivec2 at = cell + PLUS[k];
        if (!inside(at, uvec2(cells))) continue;
        ivec2 texel = texel_of(view, at, side);
        float distance = load(params.rays_found, texel).z;
        if (distance > 0.0 && load(params.found, texel).a > 0.0) sum += vec2(1.0, 1.0 / distance);
    }
    return sum.x > 0.0 ? sum.x / sum.y : SKY_DISTANCE;
}

// Weight of a cell's ray, and what it found. `expected`: what the weight would be in the mean if the ray were of the pixel's own lobe.
float weight_of(ViewBuffer view, ivec2 pixel, ivec2 cell, ivec2 side, Lobe lobe, vec4 found, out FoundRay ray, out float expected) {
    expected = 0.0;
    ivec2 from = ray_pixel(view, cell, side);
    Guide there = load_guide(params.guide, from);
    ray = unpack_ray(load(params.rays_found, texel_of(view, cell, side)));
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
    float edge = max(edge_weight(lobe.guide, lobe.gradient, there, offset), ANY_SURFACE);
    expected = edge * mix(1.0, near, lobe.smoothness);
    return edge * mix(ratio, near, lobe.smoothness);
}

// Light of the rays of a cell and those beside it, whatever they are rays of.
vec3 light_beside(ViewBuffer view, ivec2 cell, ivec2 side, ivec2 cells) {
    vec3 sum = vec3(0.0);
    float count = 0.0;
    for (int k = 0; k < 9; k++) {
        ivec2 at = cell + ivec2(k % 3, k / 3) - 1;
        if (!inside(at, uvec2(cells))) continue;
        vec4 found = load(params.found, texel_of(view, at, side));
        if (found.a == 0.0 || !is_finite(found)) continue;
        count += 1.0;
        sum += (found.rgb - sum) / count;
    }
    return sum;
}

// Share of the rays around that were looked for on the screen and found there, over about four frames.
float share_on_screen(ViewBuffer view, ivec2 pixel, ivec2 cell, ivec2 side) {
    float before = load(params.rate, pixel).g;
    ivec2 texel = texel_of(view, cell, side);
    if (!is_marched(params.rate, texel)) return before;
    return mix(before, load(params.found, texel).a == FOUND_ON_SCREEN ? 1.0 : 0.0, 0.25);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Lobe lobe;
    lobe.surface = load_surface(view, pixel, params.gbuffer);
    bool is_traced = lobe.surface.exists && reflects(lobe.surface);
    if (is_traced && params.rate != NO_IMAGE) is_traced = rate_at(params.rate, pixel) >= RATE_SIXTEENTH;
    else if (is_traced) is_traced = share_of_rays(lobe.surface, params.roughness_limit, 0.0) > 0.0;
    ivec2 side = side_at(pixel);
    ivec2 cells = (ivec2(view.at[0].size) + side - 1) / side;
    ivec2 cell = pixel / side;
    if (!is_traced) {
        // A denoiser that knows no weights may take it for that of a neighbour.
        store(params.radiance, pixel, vec4(light_beside(view, cell, side, cells), 0.0));
        store(params.hit_distance, pixel, vec4(SKY_DISTANCE));
        store(params.width, pixel, vec4(0.0));
        if (params.steering != NO_IMAGE) store(params.steering, pixel, vec4(0.0));
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

    float width = lobe_width(view, s, strongest_alpha(lobe.bsdf, lobe.v), distance_around(view, cell, side, cells));
    lobe.smoothness = 1.0 - smoothstep(0.5, 2.0, width / float(side.x));
    // In cells. Where not every pixel has a ray, the nearest ones are needed at any width.
    vec2 reach = vec2(min(0.5 * width, params.radius)) / vec2(side);
    reach = max(reach, vec2(greaterThan(side, ivec2(1))));
    if (params.rate != NO_IMAGE) reach = min(reach, vec2(FARTHEST_CELL));

    vec4 lights[MOST_TAPS];
    ivec2 places[MOST_TAPS];
    uint count = 0u;
    float brightest = 0.0;
    uint brightest_at = 0u;
    vec2 light_sum = vec2(0.0);
    float nearness = 0.0;
    vec2 expected_sum = vec2(0.0);
    float turn = disc_turn(view, pixel, 0u);
    // Where nothing is blurred only the pixel's own ray counts.
    uint taps = lobe.smoothness == 1.0 && side == ivec2(1) ? 1u : params.taps;
    for (uint i = 0u; i < taps; i++) {
        vec2 offset = disc_tap(i, params.taps, turn) * reach;
        ivec2 at = ivec2(floor((vec2(pixel) + 0.5) / vec2(side) + offset));
        bool known = !inside(at, uvec2(cells));
        for (uint k = 0u; k < count; k++) known = known || places[k] == at;
        if (known) continue;
        vec4 found = load(params.found, texel_of(view, at, side));
        if (found.a == 0.0) continue;
        if (i == 0u ? !is_taken(params.not_finite, found) : !is_finite(found)) continue;
        FoundRay ray;
        float expected;
        float weight = weight_of(view, pixel, at, side, lobe, found, ray, expected);
        expected_sum += vec2(expected, expected * expected);
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
    // The ratio of two sums forgets of a single ray how likely that was. There the expected sum of the weights stands below instead, as for rays
    // that are not shared; with two or more its noise would be worse than the bias. Rays of much wider lobes may have any weight, so the light is
    // at most doubled.
    if (params.rate != NO_IMAGE && weights > SAME_SURFACE) {
        float rays = expected_sum.x * expected_sum.x / expected_sum.y;
        sum *= min(weights / mix(expected_sum.x, weights, min(rays - 1.0, 1.0)), 2.0);
    }
    // A lobe that none of these rays lies in: without a history, any light is nearer to the truth than none.
    if (count == 0u) sum = light_beside(view, cell, side, cells);
    bool own = count > 0u && places[0] == cell && ray_pixel(view, cell, side) == pixel;
    float counts = weights > SAME_SURFACE ? mix(1.0, own ? 1.0 : BORROWED, lobe.smoothness) : weights > 0.0 ? BORROWED : 0.0;
    if (params.steering != NO_IMAGE) {
        // Standard error of the mean over the mean. One ray tells nothing of it, nor do those of other surfaces.
        float mean = luminance(sum);
        vec2 spread = vec2(0.0);
        for (uint i = 0u; i < count; i++) {
            float apart = lights[i].a * (luminance(lights[i].rgb) - mean);
            spread += vec2(apart * apart, lights[i].a * lights[i].a);
        }
        float noise = count > 1u && weights > SAME_SURFACE && mean > 0.0 ? sqrt(spread.x) / (weights * mean) : 1.0;
        store(params.steering, pixel, vec4(min(noise, 1.0), clamp(width / WIDEST_NOISE, 1.0 / 255.0, 1.0), share_on_screen(view, pixel, cell, side), 0.0));
    }
    store(params.radiance, pixel, vec4(representable(sum, params.greatest), counts));
    store(params.hit_distance, pixel, vec4(weights > 0.0 ? min(weights / nearness, SKY_DISTANCE) : SKY_DISTANCE));
    store(params.width, pixel, vec4(min(width / WIDEST_NOISE, 1.0)));
}
