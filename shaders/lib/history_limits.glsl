#ifndef LIB_HISTORY_LIMITS_GLSL
#define LIB_HISTORY_LIMITS_GLSL
#include "lib/noise_width.glsl"
// How many frames a mean may go over where the width of the noise is known: values of a penumbra that moves.

struct HistoryLimits {
    vec4 longest;   // frames, of each channel
    bvec4 moves;    // channels whose history may belong to another place or time
    bvec4 alone;    // channels that use the sample without its history
};

// Whether the reprojected position lies between pixels of the previous frame.
bool is_between(vec2 was) {
    return any(greaterThan(abs(was - round(was)), vec2(0.01)));
}

// Greatest history length where things move. Each interpolation widens an edge by f (1 - f) square pixels of variance in each direction, 1/6
// on average. A penumbra W pixels wide has a variance of W² / 12, which may at most triple. Outside of penumbrae there is no noise to average.
// Without interpolation nothing is widened, and a second frame halves the variance.
vec4 most_frames(vec4 width, bool between) {
    return max(floor(width * width), vec4(between ? 1.0 : 2.0));
}

// A history may belong to another place or time if it is interpolated (`between`), if what the channel shows moves by itself (its bit in
// `moved`), or if a change was found nearby (`forgotten` is above 0).
HistoryLimits history_limits(ViewBuffer view, vec4 width, vec2 was, bool between, uint moved, vec4 forgotten) {
    HistoryLimits limits;
    uvec4 moves = uvec4(between ? 15u : moved) & uvec4(1u, 2u, 4u, 8u);
    limits.moves = bvec4(moves | uvec4(greaterThan(forgotten, vec4(0.0))));
    limits.longest = mix(vec4(LONGEST), most_frames(width, between), limits.moves);
    limits.alone = bvec4(false);
    if (is_jittered(view)) {
        vec4 averaged = averaged_width(view, width);
        limits.alone = equal(averaged, vec4(0.0));
        // A pixel that does not move keeps its history even while it is not used: rays of later frames may find a penumbra there.
        bvec4 kept = bvec4(uvec4(limits.alone) & uvec4(is_between(was) ? 0u : 1u));
        limits.longest = mix(min(limits.longest, most_frames(averaged, true)), vec4(LONGEST), kept);
    }
    return limits;
}

// Whether a mean over frames blurs radiance: where it is interpolated, and of what is sharp under jitter, which anti-aliasing averages by itself.
bool is_blurred(ViewBuffer view, NoisyImage noisy, vec2 was) {
    return is_between(was) || ((noisy.samples & SAMPLES_SHARP) != 0u && is_jittered(view));
}

// Greatest number of frames where histories are interpolated, which widens each edge by 1/6 square pixel per frame and axis. That may not be
// more than the lobe does by itself; a mirror keeps as many frames as halve its noise, or none where it has no noise.
float most_between(NoisyImage noisy, ivec2 pixel, float longest) {
    if (noisy.width == NO_IMAGE) return longest;
    float least = (noisy.samples & SAMPLES_SHARP) != 0u ? 1.0 : min(4.0, longest);
    return clamp(most_frames(noise_width(noisy.width, pixel, noisy.packing), true).x, least, longest);
}

// Frames that a mean over radiance goes over with one more sample, which counts 0 to 1.
float frames_after(float past, float counts, NoisyImage noisy, ivec2 pixel, bool between, float longest) {
    if (!between) return min(past + counts, longest);
    float most = most_between(noisy, pixel, longest);
    // Edges are widened in frames without a sample as well.
    past *= 1.0 - (1.0 - counts) / most;
    return min(past + counts, most);
}

#endif
