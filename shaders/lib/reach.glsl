#ifndef LIB_REACH_GLSL
#define LIB_REACH_GLSL
#include "lib/bindless.glsl"
#include "shared/denoise.glsl"
#include "shared/shadows.glsl"
#include "shared/view.glsl"
// How far noise reaches, as `shadows/reach.comp` found it: the width of the penumbrae around a pixel.

// Jitter takes each frame's samples somewhere else in their pixels: to another part of a penumbra of two pixels, or to where a surface turns away
// from the light. Anti-aliasing wants to see each of them: the mean of visibility times the mean of what is lit is not the mean of both.
const float JITTERED = 2.0;

bool is_jittered(ViewBuffer view) {
    return view.at[0].jitter != view.at[0].previous_jitter;
}

// Widths in pixels, a light in each channel; 0 where there is no penumbra.
vec4 penumbra_around(uint reach, ivec2 pixel) {
    return PENUMBRA_MOST * load(reach, pixel);
}

// What of that neighbours and earlier frames may be averaged over: 0 where each sample stands for itself.
vec4 averaged_width(ViewBuffer view, vec4 width) {
    return is_jittered(view) ? max(width - JITTERED, vec4(0.0)) : width;
}

#endif
