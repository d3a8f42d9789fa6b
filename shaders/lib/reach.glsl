#ifndef LIB_REACH_GLSL
#define LIB_REACH_GLSL
#include "lib/bindless.glsl"
#include "shared/denoise.glsl"
#include "shared/shadows.glsl"
#include "shared/view.glsl"
// How far noise reaches, as `shadows/reach.comp` found it: the width of the penumbrae around a pixel.

// Jitter takes each frame's samples somewhere else in their pixels, and whoever makes one picture of the frames wants to see what is there: a
// penumbra of two pixels shows another part of itself in each.
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
