#ifndef LIB_REACH_GLSL
#define LIB_REACH_GLSL
#include "lib/bindless.glsl"
#include "shared/denoise.glsl"
#include "shared/shadows.glsl"
#include "shared/view.glsl"
// Extent of shadow noise, as `shadows/reach.comp` found it: the width of the penumbrae around a pixel.

// Jitter moves each frame's samples within their pixels: to another part of a penumbra two pixels wide, or to where a surface turns away
// from the light. Anti-aliasing needs them unaveraged, as the mean of visibility times the mean of unshadowed light is not the mean of the
// product.
const float JITTERED = 2.0;

bool is_jittered(ViewBuffer view) {
    return view.at[0].jitter != view.at[0].previous_jitter;
}

// Widths of the penumbrae around, pixels, a light in each channel; 0 outside of penumbrae.
vec4 penumbra_around(uint reach, ivec2 pixel) {
    return PENUMBRA_MOST * load(reach, pixel);
}

// Width over which neighbours and earlier frames may be averaged; 0 where each sample must be used as it is.
vec4 averaged_width(ViewBuffer view, vec4 width) {
    return is_jittered(view) ? max(width - JITTERED, vec4(0.0)) : width;
}

#endif
