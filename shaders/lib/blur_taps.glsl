#ifndef LIB_BLUR_TAPS_GLSL
#define LIB_BLUR_TAPS_GLSL
#include "lib/noise_width.glsl"
#include "lib/random.glsl"
// Taps of blurs: where they lie, and how far they reach.

// A blur of one pixel reaches no farther than this, pixels.
const float WIDEST_BLUR = 32.0;

// Tap `i` of `count` on Vogel's spiral in the unit disc, turned by `turn` (Vogel 1979, "A Better Way to Construct the Sunflower Head"): even over
// the disc for any number of points.
vec2 disc_tap(uint i, uint count, float turn) {
    float angle = 2.39996323 * float(i) + turn;
    return sqrt(float(i) / float(count)) * vec2(cos(angle), sin(angle));
}

// A random turn for each pixel and frame, so that the taps of neighbours make no pattern. `salt` tells passes apart.
float disc_turn(ViewBuffer view, ivec2 pixel, uint salt) {
    Random random = random_of(uint(pixel.y) * view.at[0].size.x + uint(pixel.x), view.at[0].frame, view.at[0].seed ^ salt);
    return 6.2831853 * random4(random).x;
}

// How far a mean over `frames` is blurred, pixels, by all passes together. Area times frames is the same for every length of the history: so is
// the number of samples that a pixel is the mean of. `radius` is that of a full history, of `longest` frames. No farther than half of the noise's
// width.
vec4 blur_reach(ViewBuffer view, vec4 frames, float longest, float radius, vec4 width) {
    vec4 reach = min(radius * sqrt(longest / max(frames, vec4(1.0))), vec4(WIDEST_BLUR));
    return min(reach, 0.5 * averaged_width(view, width));
}

// Share of that reach that the passes before the blurs have, each: up to a quarter with a history of a single frame, none from `few` frames on.
vec4 fresh_share(vec4 frames, float few) {
    return 0.25 * clamp((few - frames) / max(few - 1.0, 1e-3), 0.0, 1.0);
}

// Width of the noise at a pixel, pixels; without an image it has no bound.
vec4 width_at(uint image, ivec2 pixel, uint packing) {
    return image == NO_IMAGE ? vec4(1e9) : noise_width(image, pixel, packing);
}

// Whether two pixels `away` from each other may be averaged, by the widths of both: what one takes of the other, the other takes of it.
vec4 both_reach(ViewBuffer view, uint image, ivec2 there, uint packing, float away, vec4 reach) {
    vec4 other = 0.5 * averaged_width(view, width_at(image, there, packing));
    return mix(vec4(0.0), vec4(1.0), lessThanEqual(vec4(away), min(reach, other)));
}

// History lengths of the channels that there are, in place of all others.
vec4 frames_used(vec4 frames, uint packing) {
    if (packing == SIGNAL_TWO) return frames.xyxy;
    return packing == SIGNAL_FOUR ? frames : frames.xxxx;
}

vec4 frames_at(uint image, ivec2 pixel, uint packing) {
    return frames_used(load(image, pixel), packing);
}

float greatest_of(vec4 v) {
    return max(max(v.x, v.y), max(v.z, v.w));
}

float least_of(vec4 v) {
    return min(min(v.x, v.y), min(v.z, v.w));
}

#endif
