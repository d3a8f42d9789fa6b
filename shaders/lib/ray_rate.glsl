#ifndef LIB_RAY_RATE_GLSL
#define LIB_RAY_RATE_GLSL
#include "lib/bindless.glsl"
#include "shared/hybrid_reflections.glsl"
#include "shared/view.glsl"
// How far apart rays of reflections are at a pixel.

// `RATE_*` of a pixel.
uint rate_at(uint rates, ivec2 pixel) {
    return uint(load(rates, pixel).r * 255.0 + 0.5) & ~MARCHED;
}

// Whether a pixel's ray is looked for on the screen.
bool is_marched(uint rates, ivec2 pixel) {
    return (uint(load(rates, pixel).r * 255.0 + 0.5) & MARCHED) != 0u;
}

// How often a pixel has had a ray before, if its rate has always been this one, at least RATE_SIXTEENTH.
uint turns_at(ViewBuffer view, uint rate) {
    return view.at[0].frame >> (2u * (RATE_FULL - rate));
}

#endif
