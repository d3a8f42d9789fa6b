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

// The value of `coarse_image` at a full-resolution pixel with a surface. Pixels that have a half-resolution sample of their own use it;
// others blend the two or four around by distance, by distance from the pixel's plane, and by the angle between normals.
vec4 joint_bilateral(ViewBuffer view, ivec2 pixel, Surface here, GBufferImages gbuffer, uint coarse_image) {
    ivec2 first = pixel / 2;
    if (pixel == full_pixel(first)) return load(coarse_image, first);

    ivec2 odd = pixel & 1;
    float width = pixel_spread(view) * distance(here.position, view.at[0].eye);
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    // If no neighbour lies on the pixel's surface, the one nearest to its plane is used.
    vec4 nearest = vec4(0.0);
    float nearest_off = 3.4e38;
    for (int y = 0; y <= odd.y; y++) {
        for (int x = 0; x <= odd.x; x++) {
            ivec2 coarse = first + ivec2(x, y);
            if (!inside(full_pixel(coarse), view.at[0].size)) continue;
            Surface there = load_geometry(view, full_pixel(coarse), gbuffer);
            if (!there.exists) continue;
            vec4 value = load(coarse_image, coarse);
            float off = abs(dot(here.geometric_normal, there.position - here.position));
            if (off < nearest_off) {
                nearest_off = off;
                nearest = value;
            }
            // Those left are equally far: two in a row or column, or four in a square.
            float weight = surface_weight(here, there, width);
            sum += weight * value;
            weights += weight;
        }
    }
    return weights > 1e-4 ? sum / weights : nearest;
}

#endif
