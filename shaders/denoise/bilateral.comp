#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/guide.glsl"
#include "lib/noise_width.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
// A Gaussian blur along surfaces (Tomasi and Manduchi 1998, "Bilateral Filtering for Gray and Color Images", with depth and normal as
// edge-stopping functions in place of colour), no wider than the source of the noise. No history, no variance: one pass.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BilateralParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec4 noisy = load(params.noisy, pixel);
    if (!is_taken(params.not_finite, noisy)) noisy = finite_beside(params.noisy, pixel, view.at[0].size);
    Guide here = load_guide(params.guide, params.normals, pixel);
    if (!is_surface(here)) {
        store(params.filtered, pixel, vec4(representable(noisy.rgb, params.greatest), noisy.a));
        return;
    }
    vec2 gradient = depth_gradient(view, pixel, here);
    // The radius is two standard deviations.
    float falloff = 2.0 / float(params.radius * params.radius);
    vec4 farthest = vec4(float(params.radius));
    if (params.noise_width != NO_IMAGE) farthest = min(farthest, 0.5 * averaged_width(view, noise_width(params.noise_width, pixel, params.packing)));
    // Truncated: the nearest other pixel is one away.
    int radius = int(max(max(farthest.x, farthest.y), max(farthest.z, farthest.w)));
    // Starting with the pixel itself keeps the sum of weights at 1 or more.
    vec4 sum = noisy;
    vec4 weights = vec4(1.0);
    for (int y = -radius; y <= radius; y++) {
        for (int x = -radius; x <= radius; x++) {
            ivec2 at = pixel + ivec2(x, y);
            if (ivec2(x, y) == ivec2(0) || !inside(at, view.at[0].size)) continue;
            float edges = edge_weight(here, gradient, load_guide(params.guide, params.normals, at), vec2(x, y));
            vec4 there = load(params.noisy, at);
            if (!(edges > 0.0) || !is_finite(there)) continue;
            float square = float(x * x + y * y);
            vec4 weight = mix(vec4(0.0), vec4(edges * exp(-falloff * square)), lessThanEqual(vec4(square), farthest * farthest));
            weights += weight;
            // A running mean: of equal values it is exactly that value.
            sum += (weight / weights) * (there - sum);
        }
    }
    store(params.filtered, pixel, vec4(representable(sum.rgb, params.greatest), sum.a));
}
