#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/found_ray.glsl"
#include "lib/ray_cells.glsl"
#include "lib/roughness_limit.glsl"
#include "lib/reflector.glsl"
#include "lib/reprojection.glsl"
#include "lib/taps.glsl"
#include "shared/hybrid_reflections.glsl"
#include "shared/pixel_lists.glsl"
// Where rays start in this frame, and what has none. A reflection cannot change faster over the screen than the lobe is wide there, so rays
// are as far apart as a share of that width: one for each pixel, each 2x2 or each 4x4 pixels. Where the surface was not seen before, or the
// rays of the previous frame did not agree, they are denser by one step.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ChooseParams params; };

// What the previous frame knew of the surface.
struct Known {
    bool any;
    float noise;   // standard error of the reflection over its mean
    float width;   // of the lobe on the screen, pixels
    float found;   // share of the rays around that were found on the screen, of those that were looked for
};

// Rays are looked for on the screen where this share of them was found before. That costs less than to trace them.
const float WORTH_MARCHING = 0.4;
// Share of all others that are looked for all the same: things may have changed.
const float TRIED = 0.125;

Known known_of(ViewBuffer view, ivec2 pixel, float depth) {
    Known known = Known(false, 1.0, 0.0, 0.5);
    vec2 size = vec2(view.at[0].size);
    vec2 was = vec2(pixel) - motion_of(view, pixel, depth, load(params.gbuffer.motion, pixel).xy) * size;
    Taps taps = load_taps(params.taps, pixel, was);
    if (!taps.any) return known;
    vec4 sum = vec4(0.0);
    for (int k = 0; k < 4; k++) {
        if (taps.shares[k] == 0.0) continue;
        vec3 there = load(params.steering, taps.first + ivec2(k & 1, k >> 1)).rgb;
        // Nothing was reflected there.
        if (there.g == 0.0) continue;
        sum += taps.shares[k] * vec4(there, 1.0);
    }
    if (sum.w <= 0.0) return known;
    sum /= sum.w;
    return Known(true, sum.x, sum.y * WIDEST_NOISE, sum.z);
}

// Share that the specular lobe has in what the surface reflects of the same light from everywhere, 0 to 1. Errors of the reflection are seen
// against the rest.
float visible_share(Reflector r) {
    return min(luminance(specular_albedo(r.surface)) / luminance(reflectance(r.bsdf, r.v.z)), 1.0);
}

// Place of a pixel in the order of the rays of 4x4 pixels, 0 to 15: the first has the ray of them all, the first four those of 2x2.
float rank_of(ViewBuffer view, ivec2 pixel, float random) {
    ivec2 quarter = pixel >> 1;
    if (ray_pixel(view, quarter, ivec2(2)) != pixel) return 4.0 + 12.0 * random;
    return ray_quarter(view, pixel >> 2) == quarter ? random : 1.0 + 3.0 * random;
}

uint rate_of(ViewBuffer view, ivec2 pixel, Reflector r, Known known) {
    if (share_of_rays(r.surface, params.roughness_limit, params.faint) <= 0.0) return RATE_FALLBACK;
    float alpha = strongest_alpha(r.bsdf, r.v);
    float width = known.any ? known.width : lobe_width(view, r.surface, alpha, distance(r.surface.position, view.at[0].eye));
    float visible = visible_share(r);
    // The error of what lies between rays grows with the square of their distance. A pixel shows no more detail of a mirror than its own width.
    float apart = (width + 1.0) * params.spacing * inversesqrt(visible);
    uint rate = apart < 2.0 ? RATE_FULL : apart < 4.0 ? RATE_QUARTER : RATE_SIXTEENTH;
    rate = max(rate, params.least_rate);
    if (visible * known.noise > params.noise) rate = min(rate + 1u, RATE_FULL);
    return rate;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Reflector r = reflector_at(view, params.gbuffer, pixel);
    uint rate = RATE_NONE;
    Known known = Known(false, 1.0, 0.0, 0.5);
    if (r.exists) {
        known = known_of(view, pixel, load(params.gbuffer.depth, pixel).r);
        rate = rate_of(view, pixel, r, known);
    }
    uint key = 0u;
    uint marched = 0u;
    if (rate >= RATE_SIXTEENTH) {
        float among = rate == RATE_FULL ? 16.0 : rate == RATE_QUARTER ? 4.0 : 1.0;
        vec4 random = unit_floats(hash4(uvec4(uvec2(pixel), view.at[0].frame, view.at[0].seed)));
        float place = rank_of(view, pixel, random.x) / among;
        // Rays are left out in the order of their places, from each rate alike, if there are too many.
        if (place < 1.0) key = 1u + min(uint(place * float(GREATEST_KEY)), GREATEST_KEY - 1u);
        if (params.screen != 0u && (known.found > WORTH_MARCHING || random.w < TRIED)) marched = MARCHED;
    }
    store(params.rate, pixel, vec4(float(rate | marched) / 255.0, known.found, 0.0, 0.0));
    store(params.keys, pixel, vec4(float(key) / float(GREATEST_KEY)));
    store(params.found, pixel, vec4(0.0));
    store(params.rays_found, pixel, vec4(0.0));
}
