#ifndef LIB_SAME_SURFACE_GLSL
#define LIB_SAME_SURFACE_GLSL
#include "lib/guide.glsl"
// Which pixels of the previous frame showed the same surface.

// Least cosine between the geometric normals of both frames.
const float ALIKE = 0.9;
// Relative difference from the expected depth that is tolerated, beside the depth gradient over one pixel.
const float DEPTH_TOLERANCE = 0.01;

// A surface in the previous frame.
struct Before {
    float depth;     // view depth of the point
    vec2 gradient;   // see depth_gradient
    vec2 sampled;    // where the previous frame sampled the point, pixels, its jitter included
};

// Bilinear weights of the four pixels around `at`, 0 for those that showed another surface.
vec4 shares_of(ViewBuffer view, uint previous_guide, Before before, Guide here, vec2 at) {
    vec2 first = floor(at);
    vec2 f = at - first;
    vec4 bilinear = vec4((1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y);
    float tolerance = abs(before.gradient.x) + abs(before.gradient.y) + DEPTH_TOLERANCE * before.depth;
    vec4 shares = vec4(0.0);
    for (int k = 0; k < 4; k++) {
        // Below a thousandth, a weight is rounding of a position on the pixel itself.
        if (bilinear[k] < 1e-3) continue;
        ivec2 tap = ivec2(first) + ivec2(k & 1, k >> 1);
        if (!inside(tap, view.at[0].size)) continue;
        Guide there = load_guide(previous_guide, tap);
        if (!is_surface(there) || there.instance != here.instance) continue;
        float expected = before.depth + dot(before.gradient, vec2(tap) - before.sampled);
        if (abs(there.depth - expected) > tolerance || dot(there.plane, here.plane) < ALIKE) continue;
        shares[k] = bilinear[k];
    }
    return shares;
}

#endif
