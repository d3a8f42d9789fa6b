#ifndef LIB_UPSAMPLE_GLSL
#define LIB_UPSAMPLE_GLSL
#include "lib/gbuffer.glsl"
// Edge-aware upsampling from half to full resolution: Kopf, Cohen, Lischinski, Uyttendaele 2007, "Joint Bilateral Upsampling", guided by
// depth and normals of the full image.

// Distance from a surface's plane, in pixel widths, at which a weight falls to 1/e, and how sharply weights fall with the angle between
// normals.
const float PLANE_PIXELS = 2.0;
const float NORMAL_POWER = 32.0;

// Weight of `there` for `here`, whose pixel is `width` metres wide: 1 on the same plane with the same normal.
float surface_weight(Surface here, Surface there, float width) {
    float off = abs(dot(here.geometric_normal, there.position - here.position));
    float alike = pow(max(dot(here.normal, there.normal), 0.0), NORMAL_POWER);
    return alike * exp(-off / (PLANE_PIXELS * width));
}

// The full-resolution pixel that a half-resolution pixel stands for: the upper left one.
ivec2 full_pixel(ivec2 coarse) {
    return 2 * coarse;
}

// Weights of the half-resolution texels around a full-resolution pixel with a surface, which sum to 1: the one above and to the left of it,
// right of that, below, and below right. Pixels that have a texel of their own use it; others blend the two or four around by distance, by
// distance from the pixel's plane, and by the angle between normals.
// `alike` is false where no texel lies on the pixel's surface.
vec4 upsampling_weights(ViewBuffer view, ivec2 pixel, Surface here, GBufferImages gbuffer, out bool alike) {
    ivec2 first = pixel / 2;
    vec4 weights = vec4(1.0, 0.0, 0.0, 0.0);
    alike = true;
    if (pixel == full_pixel(first)) return weights;

    ivec2 odd = pixel & 1;
    float width = pixel_spread(view) * distance(here.position, view.at[0].eye);
    weights = vec4(0.0);
    float sum = 0.0;
    // If no neighbour lies on the pixel's surface, the one nearest to its plane is used; if none has a surface, none is.
    vec4 nearest = vec4(0.0);
    float nearest_off = 3.4e38;
    for (int k = 0; k < 4; k++) {
        ivec2 at = ivec2(k & 1, k >> 1);
        if (any(greaterThan(at, odd)) || !inside(full_pixel(first + at), view.at[0].size)) continue;
        Surface there = load_geometry(view, full_pixel(first + at), gbuffer);
        if (!there.exists) continue;
        float off = abs(dot(here.geometric_normal, there.position - here.position));
        if (off < nearest_off) {
            nearest_off = off;
            nearest = vec4(0.0);
            nearest[k] = 1.0;
        }
        // Those left are equally far: two in a row or column, or four in a square.
        weights[k] = surface_weight(here, there, width);
        sum += weights[k];
    }
    alike = sum > 1e-4;
    return alike ? weights / sum : nearest;
}

// The mean of those texels of an image. Texels without weight are not read.
vec4 weighted_texels(uint coarse_image, ivec2 pixel, vec4 weights) {
    ivec2 first = pixel / 2;
    vec4 mean = vec4(0.0);
    float sum = 0.0;
    for (int k = 0; k < 4; k++) {
        if (!(weights[k] > 0.0)) continue;
        sum += weights[k];
        // A running mean: of equal values it is exactly that value.
        mean += (weights[k] / sum) * (load(coarse_image, first + ivec2(k & 1, k >> 1)) - mean);
    }
    return mean;
}

// The value of `coarse_image` at a full-resolution pixel with a surface.
vec4 joint_bilateral(ViewBuffer view, ivec2 pixel, Surface here, GBufferImages gbuffer, uint coarse_image) {
    bool alike;
    return weighted_texels(coarse_image, pixel, upsampling_weights(view, pixel, here, gbuffer, alike));
}

#endif
