#ifndef LIB_GRADIENT_SQUARES_GLSL
#define LIB_GRADIENT_SQUARES_GLSL
#include "lib/gbuffer.glsl"
#include "lib/random.glsl"
#include "shared/denoise.glsl"
// Squares of GRADIENT_STRATUM pixels, in each of which one pixel tells what has changed since the previous frame.

// The pixel of a square that is stored in a frame: a different one in each frame.
ivec2 gradient_pixel(ViewBuffer view, ivec2 square, uint frame) {
    uint turn = hash4(uvec4(square, frame, view.at[0].seed)).x % (GRADIENT_STRATUM * GRADIENT_STRATUM);
    return square * int(GRADIENT_STRATUM) + ivec2(turn % GRADIENT_STRATUM, turn / GRADIENT_STRATUM);
}

// The square of the previous frame that corresponds to this one, by the motion vector of its middle.
ivec2 square_before(ViewBuffer view, ivec2 square, uint motion) {
    ivec2 size = ivec2(view.at[0].size);
    ivec2 middle = min(square * int(GRADIENT_STRATUM) + int(GRADIENT_STRATUM / 2u), size - 1);
    vec2 was = vec2(middle) - load(motion, middle).xy * vec2(size);
    return ivec2(floor(was / float(GRADIENT_STRATUM)));
}

#endif
