#ifndef LIB_GUIDE_GLSL
#define LIB_GUIDE_GLSL
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/octahedral.glsl"
#include "shared/denoise.glsl"
// The guide of the denoisers, two words per pixel: view depth, and 12 bits each of an octahedral geometric normal over the lower 8 bits of
// the instance's index. It is free of noise.

struct Guide {
    float depth;    // along the view, metres; 0 on the background
    vec3 plane;     // geometric normal, unit: defines the plane along which depth is extrapolated
    vec3 normal;    // normal that edges are found by, unit: the geometric one, or the shading normal
    uint instance;  // lower 8 bits
};

uvec2 pack_guide(Guide g) {
    uvec2 n = uvec2(round((octahedral_encode(g.plane) * 0.5 + 0.5) * 4095.0));
    return uvec2(floatBitsToUint(g.depth), n.x | (n.y << 12u) | (g.instance << 24u));
}

Guide unpack_guide(uvec2 words) {
    Guide g;
    g.depth = uintBitsToFloat(words.x);
    vec2 n = vec2(words.y & 4095u, (words.y >> 12u) & 4095u) / 4095.0;
    g.plane = octahedral_decode(n * 2.0 - 1.0);
    g.normal = g.plane;
    g.instance = words.y >> 24u;
    return g;
}

Guide load_guide(uint image, ivec2 pixel) {
    return unpack_guide(load_uint(image, pixel).xy);
}

// `normals` is the G-buffer's image for signals that depend on the shading normal everywhere, or NO_IMAGE to compare geometric normals, as for
// visibility.
Guide load_guide(uint image, uint normals, ivec2 pixel) {
    Guide g = load_guide(image, pixel);
    if (normals != NO_IMAGE) g.normal = octahedral_decode(load(normals, pixel).xy);
    return g;
}

bool is_surface(Guide g) {
    return g.depth > 0.0;
}

// View depth at reversed depth `depth`, above 0, metres.
float view_depth(ViewBuffer view, float depth) {
    return 1.0 / (depth * view.at[0].world_from_clip[2].w);
}

// Change of view depth from one pixel to the next, right and down, on the plane of a pixel's surface: metres. On the plane through x with
// the normal n, the ray r of a pixel has the depth (n·x) / (n·r).
vec2 depth_gradient(ViewBuffer view, ivec2 pixel, Guide g) {
    mat4 m = view.at[0].world_from_clip;
    vec2 size = vec2(view.at[0].size);
    float facing = dot(g.plane, pixel_ray(view, pixel));
    vec2 change = vec2(dot(g.plane, m[0].xyz) * 2.0 / size.x, dot(g.plane, m[1].xyz) * 2.0 / size.y);
    // Edge on, the gradient is unbounded.
    float least = 1e-3 * length(pixel_ray(view, pixel));
    return -g.depth * change / (abs(facing) < least ? (facing < 0.0 ? -least : least) : facing);
}

// Edge-stopping functions of SVGF for a pixel `offset` pixels away: distance in depth from the plane (with the sign and the epsilon of the
// equation corrected), and difference of normals. Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering", equations 3 and 4.
const float SIGMA_DEPTH = 1.0;
// Least depth step between separate surfaces, relative to depth.
const float LEAST_STEP = 2e-3;

// The weight in two parts, y * exp(-x), for callers that add to the exponent.
vec2 edge_terms(Guide here, vec2 gradient, Guide there, vec2 offset) {
    if (!is_surface(there)) return vec2(0.0);
    float expected = abs(dot(gradient, offset));
    float depth = abs(there.depth - here.depth) / (SIGMA_DEPTH * expected + LEAST_STEP * here.depth);
    // The power of 128, by squaring.
    float turned = max(dot(here.normal, there.normal), 0.0);
    turned *= turned;
    turned *= turned;
    turned *= turned;
    turned *= turned;
    turned *= turned;
    turned *= turned;
    turned *= turned;
    return vec2(depth, turned);
}

float edge_weight(Guide here, vec2 gradient, Guide there, vec2 offset) {
    vec2 terms = edge_terms(here, gradient, there, offset);
    return terms.y * exp(-terms.x);
}

#endif
