#ifndef LIB_NOISE_WIDTH_GLSL
#define LIB_NOISE_WIDTH_GLSL
#include "lib/bindless.glsl"
#include "shared/denoise.glsl"
#include "shared/view.glsl"
// How wide the source of each pixel's noise is on the screen, such as the penumbra around it: no filter averages over more.

// Jitter moves each frame's samples within their pixels: to another part of a penumbra two pixels wide, or to where a surface turns away
// from the light. Anti-aliasing needs them unaveraged, as the mean of visibility times the mean of unshadowed light is not the mean of the
// product.
const float JITTERED = 2.0;

bool is_jittered(ViewBuffer view) {
    return view.at[0].jitter != view.at[0].previous_jitter;
}

// Width around a pixel, pixels, a channel each; 0 where there is no noise. Radiance has one width for all channels.
vec4 noise_width(uint image, ivec2 pixel, uint packing) {
    vec4 width = WIDEST_NOISE * load(image, pixel);
    return packing == SIGNAL_RADIANCE ? width.xxxx : width;
}

// Whether alpha is the weight of a sample.
bool is_weighted(NoisyImage noisy) {
    return (noisy.samples & SAMPLES_WEIGHTED) != 0u;
}

// Width over which neighbours and earlier frames may be averaged; 0 where each sample must be used as it is.
vec4 averaged_width(ViewBuffer view, vec4 width) {
    return is_jittered(view) ? max(width - JITTERED, vec4(0.0)) : width;
}

#endif
