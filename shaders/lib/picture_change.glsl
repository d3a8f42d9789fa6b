#ifndef LIB_PICTURE_CHANGE_GLSL
#define LIB_PICTURE_CHANGE_GLSL
#include "lib/bindless.glsl"
#include "lib/surface_codes.glsl"
// Tells a change of light in a still picture from the noise of samples whose places change. Each pixel keeps moments over time of the mean colour of its 3x3, which
// varies less with jitter than single samples do. Colours are tone-compressed YCoCg: a vector, since colour can change while luma does not.

// STEP limits how far the 3x3 may be from its mean over time, DRIFT how far its fast mean may be: in standard deviations over time, plus a part of the luma itself and
// a constant.
const vec3 STEP = vec3(7.0, 0.02, 0.01);
const vec3 DRIFT = vec3(1.0, 0.01, 0.005);
// Parts of these limits from which on the history counts less, and from which on it has changed: an edge between them would show.
const vec2 CHANGE = vec2(0.8, 1.2);
// Temporal variance over the spatial one: before it is known, and at least, for edges that few samples hit. Of an edge that has 1 / n of a pixel the first comes
// after about n frames, and changes the mean by 1/3 where the deviation has been 0.47.
const float PRIOR = 0.06;
const float LEAST_VARIANCE = 0.02;
// Weight of a new sample in the fast mean: of steady light, and of light that changes.
const vec2 FAST = vec2(0.125, 0.3);
// Light changes in many pixels alike, noise in each on its own: the limits shrink to this part where pixels around have changed, the more of the eight the more. These
// are so far away, in pixels of the frame, that their 3x3 share no samples.
const float LIMITS_AMONG_CHANGED = 0.3;
const vec2 CHANGED_AROUND = vec2(0.1, 0.5);
const float AROUND_DISTANCE = 3.0;

// Over time, of the mean of the 3x3.
struct Moments {
    vec3 mean;
    float variance; // of all channels together, around the fast mean
    vec3 fast;      // a mean of about the last eight
    float samples;  // weight of the history
};

float square_of(vec3 v) {
    return dot(v, v);
}

// Weight of a new sample in the fast mean, of light that changes or does not.
float fast_share(bool changes) {
    return changes ? FAST.y : FAST.x;
}

// How far the 3x3 and its fast mean are from what they were, over their limits: beyond 1 the light has changed.
float change_of(Moments before, vec3 mean, vec3 deviation, float fast) {
    float noise = sqrt(before.variance + LEAST_VARIANCE * square_of(deviation));
    vec3 scale = vec3(noise, max(mean.x, before.mean.x), 1.0);
    float step_off = distance(mean, before.mean), drift = distance(mix(before.fast, mean, fast), before.mean);
    return max(step_off / dot(STEP, scale), drift / dot(DRIFT, scale));
}

// Share of the pixels around that had changed in the last frame, by their `surfaces`. `scale`: pixels of the frame per pixel of the picture.
float changed_around(uint surfaces, ivec2 pixel, vec2 scale, ivec2 size) {
    ivec2 apart = ivec2(AROUND_DISTANCE / scale + 0.5);
    float changed = 0.0;
    for (int k = 0; k < 9; k++) {
        ivec2 other = clamp(pixel + (ivec2(k % 3, k / 3) - 1) * apart, ivec2(0), size - 1);
        if (k != 4 && (load_uint(surfaces, other).y & HAS_CHANGED_BIT) != 0u) changed++;
    }
    return changed / 8.0;
}

// A change over its limits where these shrink, as this share of the pixels around has changed.
float change_among(float change, float around) {
    return change / mix(1.0, LIMITS_AMONG_CHANGED, smoothstep(CHANGED_AROUND.x, CHANGED_AROUND.y, around));
}

// Moments with one more 3x3. The share `kept` of them goes on, the other part restarts.
Moments moments_after(Moments before, vec3 mean, vec3 deviation, float fast, float kept) {
    float share = 1.0 / (1.0 + before.samples);
    // Around the fast mean, since a change raises that variance only as long as the fast mean does not know it.
    float variance = (1.0 - share) * (before.variance + share * square_of(mean - before.fast));
    Moments next;
    next.mean = mix(mean, mix(before.mean, mean, share), kept);
    next.variance = max(mix(PRIOR * square_of(deviation), variance, kept), LEAST_VARIANCE * square_of(deviation));
    next.fast = mix(mean, mix(before.fast, mean, max(share, fast)), kept);
    next.samples = before.samples;
    return next;
}

#endif
